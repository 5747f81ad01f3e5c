"""The studio: a plan changed in a browser by keyboard alone, checked at once, stored and released."""

from __future__ import annotations

import io
import json
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from PIL import Image
from web_catalog import KEY, catalog_with_plan

from upplied.catalog.database import Catalog
from upplied.web.serving import Server
from upplied.web.session import Session

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
GRAPHICS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
FLAGS = ["--no-sandbox", "--disable-sync", *GRAPHICS, "--disable-quic", "--no-first-run"]


@pytest.fixture
def catalog(tmp_path) -> Catalog:
    return catalog_with_plan(tmp_path)


@pytest.fixture
def session(catalog) -> Session:
    # The plan of these tests shows a part of the demonstration: whether it shows enough is not their subject.
    session = Session(catalog, KEY[:20])
    settings = session.editing.recipe.settings
    verdict = replace(settings.verdict, least_inspected_pct=0.0)
    session.editing.recipe = replace(session.editing.recipe, settings=replace(settings, verdict=verdict))
    return session


@pytest.fixture
def server(catalog, monkeypatch) -> Iterator[Server]:
    opened = Session.__init__

    def lenient(self: Session, *arguments: Any) -> None:
        opened(self, *arguments)
        settings = self.editing.recipe.settings
        verdict = replace(settings.verdict, least_inspected_pct=0.0)
        self.editing.recipe = replace(self.editing.recipe, settings=replace(settings, verdict=verdict))

    monkeypatch.setattr(Session, "__init__", lenient)
    with Server(catalog).running() as service:
        yield service


def question(plan: dict[str, Any], **other: Any) -> dict[str, Any]:
    return {"base": 0, "viewpoints": plan["viewpoints"], "keep_out": [], "clearance_m": 2.0, **other}


# --- what is answered ----------------------------------------------------------------------------


@pytest.mark.ci
def test_a_change_is_judged_as_every_plan_is_and_nothing_is_planned_for_it(session, monkeypatch):
    plan = session.answer("plan", {})
    monkeypatch.setattr("upplied.fleet.editing.plan_transfer", None)
    assert len(plan["viewpoints"]) == 12 and plan["differences"] == [
        "Compared with the plan as opened: no difference."
    ]
    views = [dict(each) for each in plan["viewpoints"]]
    for _ in range(5):
        views[4]["z_m"] += 0.2
        answer = session.answer("judge", question(plan, viewpoints=views[:9] + views[10:]))
        assert "viewpoint 9 left out" in answer["words"] and answer["path"]["xyz"] != plan["path"]["xyz"]
    again = session.editing.judged(*session._read(question(plan, viewpoints=views[:9] + views[10:])))
    assert answer["measures"]["min_clearance_m"] == again.plan.measures.min_clearance_m
    inside = json.loads(json.dumps(views))
    inside[4] |= {"x_m": 0.0, "y_m": 0.0, "z_m": 1.0}
    refused = session.answer("judge", question(plan, viewpoints=inside))["refused"]
    assert "viewpoint 4" in refused and "2 m are required" in refused


@pytest.mark.ci
def test_the_headline_tells_the_clearance_that_the_change_asks_for(session):
    plan = session.answer("plan", {})
    for asked_m, words in ((3.0, "(limit 3 m)"), (2.5, "(limit 2.5 m)"), (1.0, "(limit 2 m)")):
        answer = session.answer("judge", question(plan, clearance_m=asked_m))
        assert words in answer["verdict"]["headline"]  # never less than the plan's own
        assert "mm/px" in answer["verdict"]["headline"] and "demonstrated" in answer["verdict"]["headline"]
        scaled = session.editing.recipe.row["standoff_mode"] == "scaled"
        assert ("relative to the structure's size" in answer["verdict"]["headline"]) == scaled


@pytest.mark.slow
def test_the_rest_is_planned_anew_round_what_is_fixed(session, catalog):
    plan = session.answer("plan", {})
    views = [dict(each) for each in plan["viewpoints"]]
    views[4]["z_m"] += 0.5
    middle = np.array([[views[8][name] for name in ("x_m", "y_m", "z_m")]])
    box = np.concatenate([middle - 0.6, middle + 0.6]).tolist()
    request = question(plan, viewpoints=views, keep_out=[box], fixed=[2])
    refused = session.answer("judge", request)
    assert "in a keep-out box" in refused["refused"]
    answer = session.answer("replan", request)
    assert answer["base"] == 1 and len(answer["fixed"]) == 2
    rows = {(row["x_m"], row["y_m"], row["z_m"]) for row in answer["viewpoints"]}
    for number in (2, 4):
        assert tuple(views[number][name] for name in ("x_m", "y_m", "z_m")) in rows
    new = np.array([[row[name] for name in ("x_m", "y_m", "z_m")] for row in answer["viewpoints"]])
    inside = ((new > box[0]) & (new < box[1])).all(axis=1)
    assert not inside.any() and answer["verdict"]["flyable"]
    again = question(plan, base=1, viewpoints=answer["viewpoints"], keep_out=[box], by="Ada")
    draft = session.answer("keep", again)
    steps = catalog.waypoints(draft["id"])[["x_m", "y_m", "z_m"]].to_numpy()
    assert not ((steps > np.array(box[0])) & (steps < np.array(box[1]))).all(axis=1).any()
    assert "planned again" in catalog.edits().iloc[-1]["words"]


def test_two_who_decide_at_once_are_told_of_each_other(session, catalog):
    plan = session.answer("plan", {})
    other = Session(catalog, KEY[:20])
    released = {"decision": "released", "id": plan["id"], "by": "Ada"}
    assert "is released by Ada" in session.answer("decide", released)["message"]
    refused = other.answer("decide", {**released, "by": "Ben"})["refused"]
    assert "somebody decided about this pair meanwhile" in refused and "Ada released" in refused
    assert list(catalog.in_force()["state_by"]) == ["Ada"]
    assert "message" in other.answer("decide", {**released, "by": "Ben"})  # now knowing of it
    for bad in ({"by": " "}, {"decision": "flown"}, {"id": "another"}):
        assert "refused" in session.answer("decide", {**released, **bad})


@pytest.mark.ci
def test_a_zone_is_painted_asked_for_and_judged(session, catalog):
    plan = session.answer("plan", {})
    aim = session.answer("aim", question(plan, viewpoint=3))
    assert aim["place"] is not None
    where = "ball " + " ".join(map(str, aim["place"])) + " 0.8"
    assert 0 < session.answer("zone", {"where": where})["share_pct"] < 20
    request = {"set": "monthly", "zone": {"zone": "seam", "where": where, "looks": 2}, "by": "Ada"}
    assert "now requires 1 zone." in session.answer("require", request)["message"]
    (zone,) = session.answer("judge", question(plan))["zones"]
    assert (zone["zone"], zone["status"]) == ("seam", "met")
    away = [row for row in plan["viewpoints"] if row["viewpoint"] in (0, 11)]
    session.answer("require", {**request, "zone": {**request["zone"], "looks": 50}})
    (zone,) = session.answer("judge", question(plan, viewpoints=away))["zones"]
    assert zone["status"] == "missed" and zone["why"]
    assert list(catalog.requirements()["version"]) == [2]
    assert "names no surface" in session.answer("zone", {"where": "ball 900 0 0 1"})["refused"]


# --- in a browser --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine; apt-get install chromium")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_drag_and_the_keyboard_alone_change_store_and_release_a_plan(server, catalog, capsys):
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with sync_api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=FLAGS)
        page, errors, urls = browser.new_page(viewport={"width": 1300, "height": 900}), [], []
        page.set_default_timeout(240_000)
        page.on(
            "console",
            lambda line: line.type == "error" and "401" not in line.text and errors.append(line.text),
        )
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: urls.append(request.url))
        answers: list[dict[str, Any]] = []
        page.on("response", lambda got: got.url.endswith("/judge") and answers.append(got.json()))
        page.goto(server.address(f"studio/{KEY[:20]}"))
        page.wait_for_selector("#app[data-ready=true]", timeout=240_000)
        assert "#" not in page.url and "flyable" in page.locator("#verdict").inner_text()
        # every control has a name
        unnamed = (
            "els => els.filter(e => !(e.labels && e.labels.length) && !e.getAttribute('aria-label')"
            " && !e.textContent.trim()).length"
        )
        assert page.eval_on_selector_all("button, input, select, textarea, [tabindex]", unnamed) == 0
        page.wait_for_timeout(500)
        x, y = handle(page)
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 3, y - 4, steps=3)
        page.mouse.up()
        judged(page, "Changes: viewpoint 0 changed.")
        assert page.locator("#picture .frame").count() == 1
        page.keyboard.press("Control+z")
        page.wait_for_selector("#verdict:not([aria-busy]):has-text('As opened')", timeout=240_000)
        reach(page, "viewpoints")
        for key in ("ArrowDown", "ArrowDown", "ArrowDown", "r", "r", "s"):
            page.keyboard.press(key)
        judged(page, "viewpoint 3 changed")
        page.keyboard.press("ArrowDown")
        page.keyboard.press("Delete")
        text = judged(page, "viewpoint 4 left out, viewpoint 3 changed")
        assert "Checked in" in text
        with capsys.disabled():
            sys.stdout.write(f"\nin Chromium: {text.splitlines()[-1]}, {answers[-1]['cpu_s']:.2f} s of CPU\n")
        page.keyboard.press("Control+z")
        judged(page, "Changes: viewpoint 3 changed.")
        reach(page, "release")
        page.keyboard.press("Enter")  # neither kept nor signed
        assert "Store the change as a draft first" in page.locator("#message").inner_text()
        reach(page, "by")
        page.keyboard.type("Ada")
        reach(page, "keep")
        page.keyboard.press("Enter")
        shows(page, "Stored as draft")
        reach(page, "release")
        page.keyboard.press("Enter")
        shows(page, "is released")
        browser.close()
    assert errors == [] and all(
        url.startswith((f"http://127.0.0.1:{server.port}/", "blob:", "data:")) for url in urls
    )
    (row,) = catalog.in_force().to_dict("records")
    (edit,) = catalog.edits().to_dict("records")
    assert row["transfer_id"] == edit["transfer_id"] and row["state_by"] == "Ada" == edit["by"]


def handle(page: Any) -> tuple[float, float]:
    """Where the red dot of the selected viewpoint is drawn."""
    view = page.locator("#view")
    shot = np.asarray(Image.open(io.BytesIO(view.screenshot())).convert("RGB")).astype(int)
    down, right = np.nonzero(np.abs(shot - (179, 38, 30)).sum(axis=2) < 60)
    box = view.bounding_box()
    return box["x"] + right.mean(), box["y"] + down.mean()


def reach(page: Any, element: str) -> None:
    """Go to a control by the Tab key alone."""
    for _ in range(150):
        if page.evaluate("document.activeElement.id") == element:
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"{element} is not reached by Tab")


def judged(page: Any, words: str) -> str:
    """The verdict once it tells of a change."""
    page.wait_for_selector(f"#verdict:not([aria-busy]):has-text('{words}')", timeout=240_000)
    return str(page.locator("#verdict").inner_text())


def shows(page: Any, words: str) -> None:
    page.wait_for_selector(f"#message:has-text('{words}')", timeout=240_000)
