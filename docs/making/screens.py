"""Draw the documentation's pictures of pages: each page on a desk, on a phone and in the dark.

``python docs/making/screens.py CATALOG`` serves a catalog with at least one plan of preset `recommended` and
writes ``docs/pictures/screens/``. It needs Chromium and playwright.
"""

from __future__ import annotations

import io
import shutil
import sys
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

from upplied.catalog import open_catalog
from upplied.checks import pair_name
from upplied.web.serving import Server

PLACE = Path(__file__).parents[1] / "pictures" / "screens"
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
]
SCREENS = {"desktop": (1440, 900, "light"), "phone": (390, 844, "light"), "dark": (1440, 900, "dark")}
COLOURS = 256  # of a palette: a third of the bytes


def main(location: str, names: str = "") -> None:
    """Serve a catalog and picture its pages."""
    catalog = open_catalog(location)
    plans = catalog.transfers(status="ok", preset="recommended")
    row = plans.sort_values(["state", "duration_s"], ascending=[False, True]).iloc[0]
    pair = pair_name(row["demonstration_id"], row["target_id"])
    pages = {
        "sign-in": ("none", None),
        "fleet": ("", None),
        "structure": (f"structures/{row['target_id']}.html", None),
        "fly": (f"transfers/{pair}.html", None),
        "quality": (f"transfers/{pair}.html", quality),
        "preview": (f"transfers/{pair}.html", preview),
        "research": (f"transfers/{pair}.html", lambda page: page.click("#tab-research")),
        "flight": (f"demonstrations/{row['demonstration_id']}.html", None),
        "studio": (f"studio/{row['transfer_id']}", opened),
    }
    PLACE.mkdir(parents=True, exist_ok=True)
    with Server(catalog).running() as server, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=FLAGS)
        for screen, (wide, high, scheme) in SCREENS.items():
            context = browser.new_context(viewport={"width": wide, "height": high}, color_scheme=scheme)
            for name, (path, act) in pages.items():
                if names and name not in names.split(","):
                    continue
                page = context.new_page()
                page.set_default_timeout(400_000)
                page.goto(f"http://127.0.0.1:{server.port}/" if name == "sign-in" else server.address(path))
                page.wait_for_selector("#password" if name == "sign-in" else "h1")
                page.wait_for_load_state("networkidle")
                if act is not None:
                    act(page)
                    page.wait_for_timeout(800)
                save(page, PLACE / f"{name}-{screen}.png", high)
                page.close()
            context.close()
        browser.close()


def quality(page: Any) -> None:
    """The tab with the 3-D views."""
    page.click("#tab-quality")
    page.wait_for_selector("#app[data-drawn=true]")


def preview(page: Any) -> None:
    """The camera's picture, a third of the flight on."""
    quality(page)
    page.check("#aboard")
    page.evaluate(
        "() => { const time = document.getElementById('time'); time.value = 330;"
        " time.dispatchEvent(new Event('input')); }"
    )
    page.wait_for_timeout(2500)


def opened(page: Any) -> None:
    """The studio once its plan is drawn."""
    page.wait_for_selector("#app[data-ready=true]")


def save(page: Any, path: Path, high: int) -> None:
    """A picture of at most two screens, with few colours."""
    tall = min(page.evaluate("document.documentElement.scrollHeight"), 2 * high)
    picture = Image.open(io.BytesIO(page.screenshot(full_page=True)))
    picture = picture.crop((0, 0, picture.width, tall)).convert("RGB")
    few = picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=1)  # small marks stay in colour
    few.save(path, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
