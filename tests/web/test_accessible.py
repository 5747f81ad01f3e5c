"""No page has a serious fault that axe-core finds, on a desk, on a phone, or in the dark."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from web_catalog import KEY, catalog_with_plan

from upplied.web.serving import Server

AXE = Path(__file__).parents[1] / "node_modules" / "axe-core" / "axe.min.js"
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PAIR = "transfers/cube-sides-v1--cube-v1.html"
PAGES = {
    "login": ("", "#password", ()),
    "fleet": ("", ".fleet", ()),
    "structure": ("structures/cube-v1.html", "table", ()),
    "fly": (PAIR, "#map", ()),
    "quality": (PAIR, "#map", ("#tab-quality",)),
    "research": (PAIR, "#map", ("#tab-research",)),
    "flight": ("demonstrations/cube-sides-v1.html", "h1", ()),
    "studio": (f"studio/{KEY[:20]}", "#app[data-ready=true]", ()),
}
SCREENS = {"desk": (1440, 900, "light"), "phone": (390, 844, "light"), "dark": (1440, 900, "dark")}

pytestmark = [
    pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine; apt-get install chromium"),
    pytest.mark.skipif(not AXE.is_file(), reason="axe-core is not here: npm ci --prefix tests"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.slow,
]


@pytest.fixture(scope="module")
def server(tmp_path_factory) -> Iterator[Server]:
    with Server(catalog_with_plan(tmp_path_factory.mktemp("web"))).running() as service:
        yield service


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with sync_api.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=BROWSER, args=FLAGS)
        yield opened
        opened.close()


@pytest.mark.parametrize("screen", SCREENS)
def test_no_page_has_a_serious_fault(server, browser, screen):
    wide, high, scheme = SCREENS[screen]
    context = browser.new_context(viewport={"width": wide, "height": high}, color_scheme=scheme)
    faults: list[str] = []
    for name, (path, ready, clicks) in PAGES.items():
        page = context.new_page()
        page.set_default_timeout(400_000)
        page.goto(f"http://127.0.0.1:{server.port}/" if name == "login" else server.address(path))
        page.wait_for_selector(ready)
        for control in clicks:
            page.click(control)
            if control == "#tab-quality":
                page.wait_for_selector("#app[data-drawn=true]")
        page.evaluate(AXE.read_text(encoding="utf-8"))
        violations = page.evaluate("axe.run(document, {resultTypes: ['violations']})")["violations"]
        for fault in violations:
            if fault["impact"] in ("serious", "critical"):
                places = [node["html"][:120] for node in fault["nodes"][:3]]
                faults.append(f"{name}, {screen}: {fault['id']}: {fault['help']}: {places}")
        page.close()
    context.close()
    assert not faults, "\n".join(faults)
