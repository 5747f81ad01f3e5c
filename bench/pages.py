"""How long a plan's page takes until a person can use it, and how long the plan takes to open in the studio.

    python bench/pages.py [--waypoints N]

A plan of N waypoints round a cube is published. Chromium opens its page and waits until it answers to a
click on a tab. Other programs lengthen the time; the CPU of all processes of the browser is printed too, and
that of the main thread of the page.
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

from upplied.catalog import open_catalog
from upplied.geometry.poses import interpolate
from upplied.outputs.publish import publish
from upplied.records import Plan
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
from upplied.web.session import Session

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def main() -> None:
    """Publish the plan, open its page and its studio, and print the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--waypoints", type=int, default=500)
    options = parser.parse_args()
    cube = member("cube-v1").structure
    flown = fly(cube, "sides", seed=1)
    path = interpolate(flown.trajectory, np.linspace(0, flown.trajectory.t_s[-1], options.waypoints))
    plan = Plan(flown.demonstration_id, "cube-v1", "cube-v1", cube.kind, "recommended", "ok", trajectory=path,
                is_viewpoint=np.arange(len(path)) % 2 == 0, flyable=True)  # fmt: skip
    key = hashlib.sha256(b"plan").hexdigest()
    with tempfile.TemporaryDirectory() as place:
        catalog = open_catalog(Path(place, "catalog"))
        catalog.add_structures([cube])
        catalog.add_demonstrations([flown])
        catalog.add_plans([(key, plan, {})])
        began, busy = time.perf_counter(), time.process_time()
        Session(catalog, key[:20]).answer("plan", {})
        waited, busy = time.perf_counter() - began, time.process_time() - busy
        print(f"studio: plan ready in {waited:.2f} s, {busy:.2f} s of CPU")
        publish(catalog, Path(place, "reports"))
        if BROWSER is None:
            print("page: not measured, no Chromium here")
            return
        opened(next(Path(place, "reports", "transfers").glob("*.html")))


def opened(page_file: Path) -> None:
    """Print how long the page took, and what of it the browser was busy with."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=FLAGS)
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.set_default_timeout(300_000)
        page.goto("about:blank")
        meter = page.context.new_cdp_session(page)
        meter.send("Performance.enable", {"timeDomain": "threadTicks"})
        began, busy = time.perf_counter(), browser_cpu_s()
        page.goto(page_file.as_uri())
        page.wait_for_selector("#app[data-ready=true]")
        page.click("#tab-research")
        page.wait_for_selector("#panel-research:not([hidden])")
        waited, busy = time.perf_counter() - began, browser_cpu_s() - busy
        spent = {one["name"]: one["value"] for one in meter.send("Performance.getMetrics")["metrics"]}
        main_s = spent["TaskDuration"]
        print(f"page: interactive in {waited:.2f} s, {busy:.2f} s of CPU, {main_s:.2f} s of the main thread")
        browser.close()


def browser_cpu_s() -> float:
    """CPU time of every process below this one, s."""
    spent = [child.cpu_times() for child in psutil.Process().children(recursive=True)]
    return sum(each.user + each.system for each in spent)


if __name__ == "__main__":
    sys.exit(main())
