"""The pages in a real browser: no errors, a 3-D view that draws, filters and a slider that work."""

from __future__ import annotations

import io
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from fake_catalog import FakeCatalog
from PIL import Image

from upplied.outputs import pages
from upplied.outputs.publish import publish_file, publish_pages
from upplied.outputs.site import write_findings_page

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed; it drives the browser"
)
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
GRAPHICS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
QUIET = ["--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"]
FLAGS = ["--no-sandbox", "--disable-sync", *GRAPHICS, *QUIET]
MAP_COLOURS = {"path": (0, 114, 178), "structure": (184, 193, 204), "view": (220, 175, 70)}
COLUMNS = ["pair", "status", "demonstration", "source", "target", "kind", "coverage", "attainable", "paper"]
COLUMNS += ["baseline", "clearance", "frechet", "length", "duration", "change", "planned", "reason", "page"]

pytestmark = [
    pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine; apt-get install chromium"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=BROWSER, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def reports(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("reports")
    catalog = FakeCatalog(targets=2)
    catalog.fly("t0000")
    publish_pages(catalog, root, pictures=9)
    publish_file(catalog, root / "mail.html", target_id="cuboid-0")
    return root


@pytest.fixture
def visit(browser) -> Iterator[Any]:
    """Opens an address; at the end the page must have had no errors and asked nobody else for anything."""
    opened, errors, requests = [], [], []

    def go(address: str, width: int = 900, height: int = 640) -> Any:
        page = browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(240_000)
        page.on("console", lambda message: message.type == "error" and errors.append(message.text))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(address)
        opened.append(page)
        return page

    yield go
    for page in opened:
        page.close()
    assert errors == []
    assert all(url.startswith(("file://", "blob:", "data:")) for url in requests)


def comes_true(page: Any, condition: Callable[[], bool]) -> bool:
    """Whether a condition holds at last: a picture is drawn when the machine gets to it."""
    for _ in range(200):
        if condition():
            return True
        page.wait_for_timeout(100)
    return False


def drawn(page: Any) -> None:
    """Open the tab with the 3-D views, and wait for them."""
    page.click("#tab-quality")
    page.wait_for_selector("#app[data-drawn=true]", timeout=240_000)


def until(page: Any, condition: str) -> None:
    """Wait for a condition; the page's policy allows no strings as code, so it is asked again and again."""
    for _ in range(400):
        if page.evaluate(f"() => {condition}"):
            return
        page.wait_for_timeout(50)
    raise AssertionError(condition)


def colours(page: Any, selector: str) -> np.ndarray:
    """How many clearly different colours a part of the page shows, as its distinct pixels."""
    shot = Image.open(io.BytesIO(page.locator(selector).first.screenshot())).convert("RGB")
    return np.asarray(shot)


@pytest.mark.ci
def test_the_fleet_filters_searches_and_sorts(visit, reports):
    page = visit((reports / "index.html").as_uri())
    rows = page.locator(".spacer .row")
    assert rows.count() == 3 and "refused" in rows.nth(0).inner_text()
    page.fill("#search", "cuboid-1")
    assert rows.count() == 1 and "1 of 3" in page.locator(".count").inner_text()
    page.fill("#search", "gamma")
    assert "odd" in rows.nth(0).inner_text()
    page.fill("#search", "")
    page.select_option("#filter-status", "ok")
    assert rows.count() == 2
    page.click("button[data-key=coverage]")
    assert "cuboid-1" in rows.nth(0).inner_text()
    page.click("button[data-key=coverage]")
    assert "cuboid-0" in rows.nth(0).inner_text()
    assert page.title() == "Inspection fleet" and page.locator("#app img:not(.thumbnail)").count() == 0


@pytest.mark.ci
def test_thousands_of_rows_are_drawn_a_screen_at_a_time(visit, tmp_path):
    rows = [
        [
            f"d--t{at}",
            "ok",
            "d",
            "s",
            f"t{at}",
            "cube",
            at % 100,
            None,
            1.0,
            1.0,
            2.0,
            1.0,
            9.0,
            9.0,
            "",
            "",
            "",
            True,
        ]
        for at in range(20_000)
    ]
    (tmp_path / "assets").mkdir()
    for name, text in pages.assets().items():
        (tmp_path / "assets" / name).write_text(text)
    data = {"fleet": {"title": "Large", "columns": COLUMNS, "rows": rows}}
    (tmp_path / "index.html").write_text(pages.page("fleet", "Large", data, ""))
    page = visit((tmp_path / "index.html").as_uri())
    assert page.locator(".spacer .row").count() < 80
    page.evaluate("document.querySelector('.view').scrollTop = 1e9")
    until(page, "[...document.querySelectorAll('.target a')].some(a => a.textContent === 't19999')")
    spent = page.evaluate(
        "() => { const box = document.getElementById('search'); const start = performance.now();"
        " box.value = 't1999'; box.dispatchEvent(new Event('input')); return performance.now() - start; }"
    )
    assert spent < 1000 and page.locator(".count").inner_text().startswith("11 of 20000")


@pytest.mark.ci
def test_a_transfer_draws_in_colours_and_follows_the_slider(visit, reports):
    page = visit((reports / "transfers" / "orbit-1--cuboid-1.html").as_uri())
    drawn(page)
    assert page.title() == "orbit-1 → cuboid-1"
    before = colours(page, ".canvas >> nth=1")
    assert len(np.unique(before.reshape(-1, 3), axis=0)) > 100
    seen, missed = (
        np.abs(before.astype(int) - at).sum(axis=2).min() for at in ([110, 160, 205], [190, 85, 0])
    )
    assert seen < 90 and missed < 90
    start = page.locator(".readout").nth(1).inner_text()
    page.evaluate("() => { const time = document.getElementById('time'); time.value = 400;"
                  " time.dispatchEvent(new Event('input')); }")  # fmt: skip
    until(page, "!document.querySelectorAll('.readout')[1].textContent.startsWith('0.0 s')")
    assert start.startswith("0.0 s") and page.locator(".clock").inner_text() == "40 %"
    page.wait_for_timeout(300)
    after = colours(page, ".canvas >> nth=1")
    assert (before != after).any(axis=2).mean() > 1e-3
    assert page.locator("#charts .scatterlayer .trace").count() == 3 * 4
    assert page.locator("#panel-research .figures thead th").count() == 4


def test_the_map_shows_structure_path_and_views_and_the_heights_a_line(visit, reports):
    page = visit((reports / "transfers" / "orbit-1--cuboid-1.html").as_uri())
    page.wait_for_selector("#app[data-ready=true]")
    until(page, "document.getElementById('map').naturalWidth > 300")
    shot = colours(page, "#map").reshape(-1, 3).astype(int)
    near = {name: (np.abs(shot - at).sum(axis=1) < 40).sum() for name, at in MAP_COLOURS.items()}
    assert min(near.values()) > 50, near
    heights = colours(page, "#heights").reshape(-1, 3).astype(int)
    assert (np.abs(heights - MAP_COLOURS["path"]).sum(axis=1) < 40).sum() > 50
    assert page.evaluate("typeof Plotly") == "undefined", "the first tab needs no drawing library"
    assert "place on the Earth is unknown" in page.locator("#no-mission").inner_text()


def test_a_figure_that_rounds_to_zero_has_no_sign(visit, reports):
    page = visit((reports / "index.html").as_uri())
    shown = page.evaluate(
        "[[-0.3, 0], [-0.04, 1], [-0.06, 1], [-12, 0]].map((each) => upplied.format(...each))"
    )
    assert shown == ["0", "0.0", "-0.1", "-12"]


@pytest.mark.slow
def test_the_camera_preview_has_the_frame_of_the_picture_and_no_frusta(visit, reports):
    page = visit((reports / "transfers" / "orbit-1--cuboid-1.html").as_uri())
    drawn(page)
    page.check("#aboard")
    until(page, "document.querySelectorAll('.frame').length === 2")
    box = page.locator(".frame").nth(1).bounding_box()
    assert abs(box["width"] / box["height"] - 1) < 0.03, "the camera's field of view is 75 by 75 degrees"
    visible = page.evaluate(
        "document.querySelectorAll('.canvas')[1].data.slice(1).map((each) => each.visible)"
    )
    assert visible and not any(visible)
    page.uncheck("#aboard")
    until(page, "document.querySelectorAll('.frame').length === 0")


def test_a_structures_page_lists_its_plans_and_leads_to_them(visit, reports):
    page = visit((reports / "structures" / "cuboid-1.html").as_uri())
    assert "No flight was imported yet." in page.locator("main").inner_text()
    page.click("table a")
    page.wait_for_selector("#app[data-ready=true]")
    assert page.title() == "orbit-1 → cuboid-1"
    page.click("h1 a")
    page.wait_for_selector("dl")
    assert page.title() == "cuboid-1"


@pytest.mark.parametrize("width", [1440, 1280])
def test_no_column_of_the_fleet_is_clipped(visit, reports, width):
    page = visit((reports / "index.html").as_uri(), width, 800)
    view = page.evaluate(
        "(() => { const v = document.querySelector('.view'); return [v.scrollWidth, v.clientWidth]; })()"
    )
    assert view[0] <= view[1]
    cut = "[...document.querySelectorAll('.head .cell')].filter((e) => e.scrollWidth > e.clientWidth).length"
    assert page.evaluate(cut) == 0


@pytest.mark.slow
def test_a_transfer_flies_seen_through_the_camera(visit, reports):
    page = visit((reports / "transfers" / "orbit-1--cuboid-1.html").as_uri())
    drawn(page)
    before = colours(page, ".canvas >> nth=1")
    page.check("#aboard")
    page.wait_for_timeout(500)
    aboard = colours(page, ".canvas >> nth=1")
    assert (aboard != before).any(axis=2).mean() > 0.1
    page.check("#show-baseline")
    page.uncheck("#frusta")
    page.click("#play")
    until(page, "document.getElementById('time').value > 10")
    page.click("#play")


@pytest.mark.slow
def test_planned_and_flown_are_drawn_together(visit, reports):
    page = visit((reports / "transfers" / "orbit-1--cuboid-0.html").as_uri())
    drawn(page)
    together = colours(page, ".canvas >> nth=1")
    page.uncheck("#show-recommended-flown")
    page.wait_for_timeout(500)
    alone = colours(page, ".canvas >> nth=1")
    assert (np.abs(together.astype(int) - alone).sum(axis=2) > 100).sum() > 50  # the flown path went
    assert page.locator("#charts .scatterlayer .trace").count() == 3 * 5
    figures = page.locator("#panel-research .figures").first.text_content()
    assert "recommended, flown" in figures and "3.25 m" in figures
    assert "In a wind of 6 m/s" in page.locator(".flown").inner_text()


def test_a_refusal_is_explained_and_stays_text(visit, reports):
    page = visit((reports / "transfers" / "orbit-1--odd.html").as_uri())
    verdict = page.locator(".verdict").first.inner_text()
    assert "Planning was refused" in verdict and "<img src=x" in verdict
    assert page.locator("main img").count() == 0 and page.title() == "orbit-1 → odd"


@pytest.mark.slow
def test_the_mailed_file_shows_fleet_and_transfer(visit, reports):
    page = visit((reports / "mail.html").as_uri())
    page.click(".target a")
    drawn(page)
    assert page.locator("h1").inner_text().startswith("orbit-1")
    page.click(".back")
    page.wait_for_selector(".fleet")
    assert page.title() == "Inspection fleet"


@pytest.mark.parametrize("name", ["index.html", "transfers/orbit-1--cuboid-1.html"])
def test_a_phone_needs_no_sideways_scrolling(visit, reports, name):
    page = visit((reports / name).as_uri(), 375, 760)
    page.wait_for_timeout(300)
    wide = page.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
    assert wide[0] <= wide[1]


@pytest.mark.slow
def test_the_verdict_stands_in_the_first_screen_and_warnings_on_the_fleet_page(visit, reports):
    page = visit((reports / "transfers" / "orbit-1--cuboid-1.html").as_uri())
    drawn(page)
    box = page.locator(".verdict").first.bounding_box()
    assert box["y"] + box["height"] < 640 and page.locator("#tab-research").is_visible()
    verdict = page.locator(".verdict").first.inner_text()
    assert "flyable" in verdict and "stays 4.0 m clear" in verdict and "Mind the mast." in verdict
    fleet = visit((reports / "index.html").as_uri())
    fleet.check("#filter-warned")
    assert fleet.locator(".spacer .row").count() == 1
    assert "Mind the mast." in fleet.locator(".warned").get_attribute("aria-label")


@pytest.mark.slow
def test_keys_turn_the_view_and_home_brings_it_back(visit, reports):
    page = visit((reports / "transfers" / "orbit-1--cuboid-1.html").as_uri())
    drawn(page)
    pane = page.locator(".canvas").first
    page.wait_for_timeout(500)
    before = colours(page, ".canvas")
    pane.focus()
    for _ in range(4):
        page.keyboard.press("ArrowLeft")
    assert comes_true(page, lambda: (colours(page, ".canvas") != before).any(axis=2).mean() > 0.02)
    page.keyboard.press("Home")
    assert comes_true(page, lambda: (colours(page, ".canvas") != before).any(axis=2).mean() < 0.01)
    assert "arrow keys" in pane.get_attribute("aria-label").lower()


@pytest.mark.slow
def test_print_shows_what_the_views_show(visit, reports):
    page = visit((reports / "transfers" / "orbit-1--cuboid-1.html").as_uri())
    drawn(page)
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    page.wait_for_timeout(300)
    assert page.locator(".shot").count() == 2
    shot = colours(page, ".shot >> nth=1")
    assert len(np.unique(shot.reshape(-1, 3), axis=0)) > 100
    assert not page.locator(".flight").is_visible()


@pytest.mark.ci
def test_without_webgl_the_picture_and_the_figures_remain(visit, reports, browser):
    context = browser.new_context()
    context.add_init_script(
        "const get = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {"
        " return kind.startsWith('webgl') ? null : get.call(this, kind, ...rest); };"
    )
    page = context.new_page()
    page.goto((reports / "transfers" / "orbit-1--cuboid-0.html").as_uri())
    drawn(page)
    assert "no 3-D views" in page.locator("#no-3d").inner_text()
    assert not page.locator(".views").is_visible() and page.locator(".explained").is_visible()
    assert page.locator("#charts .scatterlayer .trace").count() > 0
    context.close()


@pytest.mark.ci
def test_dark_mode_is_dark_and_legible(visit, reports):
    page = visit((reports / "transfers" / "orbit-1--cuboid-1.html").as_uri())
    page.emulate_media(color_scheme="dark")
    ink, paper = (
        page.evaluate(f"getComputedStyle(document.body).{name}") for name in ("color", "backgroundColor")
    )
    bright = [sum(map(int, re.findall(r"\d+", value)[:3])) for value in (ink, paper)]
    assert bright[0] > 600 and bright[1] < 120
    assert page.locator(".verdict").first.is_visible()


def test_the_path_can_be_taken_along(visit, reports, tmp_path):
    page = visit((reports / "transfers" / "orbit-1--cuboid-1.html").as_uri())
    with page.expect_download() as waiting:
        page.click("#save-path")
    waiting.value.save_as(tmp_path / "path.csv")
    rows = np.loadtxt(tmp_path / "path.csv", delimiter=",", skiprows=1)
    expected = FakeCatalog(targets=2).waypoints("t0003")[["x_m", "y_m", "z_m"]].to_numpy()
    assert np.allclose(rows[:, 1:4], expected, atol=1e-3)
    assert "upplied export t0003" in page.locator(".downloads").text_content()


@pytest.mark.slow
def test_findings_are_bright_where_they_are_on_the_structure(visit, tmp_path):
    catalog = FakeCatalog(targets=1)
    low, high = (getattr(catalog.structure("cuboid-0").vertices, end)(axis=0) for end in ("min", "max"))
    places = np.array([[high[0], 0.3 * high[1], 3.0], [high[0], 0.3 * high[1], 3.2], [low[0], low[1], 1.0]])
    rows = pd.DataFrame(places, columns=[f"reference_{axis}_m" for axis in "xyz"]).assign(
        finding_id=["a1", "b2", "c3"], target_id="cuboid-9", state="open", severity="", photo="", by="Ada",
        added_at=pd.Timestamp("2026-03-01", tz="UTC"), place_error_m=0.1, length_mm=12.0,
        reference_error_m=0.2, reference_doubtful=[False, True, False],
        **{"class": ["crack", "crack", "</script>"]},
    )  # fmt: skip
    page = visit(write_findings_page(catalog, "cuboid-0", rows, tmp_path).as_uri())
    page.wait_for_selector("#app[data-drawn=true]", timeout=240_000)
    text = page.inner_text("#app")
    assert "shown on cuboid-0" in text and "doubtful, from cuboid-9" in text
    assert "Required zones" not in text
    traces = "document.querySelector('.canvas').data"
    colours = f"({traces}[0].intensity || {traces}[0].marker.color)"
    heat = f"[Math.max(...{colours}), {traces}.at(-1).x.length]"
    most, shown = page.evaluate(heat)
    assert 1.5 < most <= 2.0 and shown == 3
    page.select_option("#finding-class", "</script>")
    until(page, f"{heat}[1] === 1")
    assert page.evaluate(heat)[0] <= 1.0
    pixels = np.asarray(Image.open(io.BytesIO(page.locator(".canvas").screenshot())).convert("RGB"))
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 50
