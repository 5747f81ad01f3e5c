"""The studio: a plan changed in a browser by keyboard alone, judged at once, kept and released; answered to
nobody but whoever holds its token."""

from __future__ import annotations

import hashlib
import http.client
import json
import shutil
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from upplied.catalog import open_catalog
from upplied.catalog.database import Catalog
from upplied.poses import interpolate
from upplied.records import Plan
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
from upplied.studio.server import Studio
from upplied.studio.session import Session

CUBE = member("cube-v1").structure
FLOWN = fly(CUBE, "sides", seed=1)
PATH = interpolate(FLOWN.trajectory, np.arange(0.0, 60.0, 0.5))
PLAN = Plan(FLOWN.demonstration_id, "cube-v1", "cube-v1", CUBE.kind, "recommended", "ok", trajectory=PATH,
            is_viewpoint=np.arange(len(PATH)) % 10 == 0, flyable=True)  # fmt: skip
KEY = hashlib.sha256(b"plan").hexdigest()
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
GRAPHICS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
FLAGS = ["--no-sandbox", "--disable-sync", *GRAPHICS, "--disable-quic", "--no-first-run"]


@pytest.fixture
def catalog(tmp_path) -> Catalog:
    made = open_catalog(tmp_path / "catalog")
    made.add_structures([CUBE])
    made.add_demonstrations([FLOWN])
    made.add_plans([(KEY, PLAN, {})])
    return made


@pytest.fixture
def session(catalog) -> Session:
    # The plan of these tests shows a part of the demonstration: whether it shows enough is not their subject.
    made = Session(catalog, KEY[:20])
    settings = made.editing.recipe.settings
    verdict = replace(settings.verdict, least_inspected_pct=0.0)
    made.editing.recipe = replace(made.editing.recipe, settings=replace(settings, verdict=verdict))
    return made


@pytest.fixture
def server(session) -> Iterator[Studio]:
    with Studio(session.answer) as made:
        threading.Thread(target=made.serve_forever, daemon=True).start()
        yield made
        made.shutdown()


def asked(server: Studio, what: str = "plan", body: Any = b"{}", method: str = "POST", **headers: str) -> Any:
    """The answer to a request: its status, headers and text."""
    line = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=60)
    sent = {
        "Host": f"127.0.0.1:{server.server_port}",
        "Authorization": f"Bearer {server.token}",
        "Content-Type": "application/json",
        **{name.replace("_", "-"): value for name, value in headers.items()},
    }
    line.request(method, what if what.startswith("/") else f"/api/{what}", body, sent)
    answer = line.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read().decode()
    line.close()
    return found


def wanted(plan: dict[str, Any], **other: Any) -> dict[str, Any]:
    return {"base": 0, "viewpoints": plan["viewpoints"], "keep_out": [], "clearance_m": 2.0, **other}


# --- who is answered -----------------------------------------------------------------------------


@pytest.mark.ci
def test_only_whoever_holds_the_token_is_answered_and_no_other_site(server):
    port = server.server_port
    assert server.server_address[0] == "127.0.0.1" and len(server.token) > 40
    for bad in (
        {"Authorization": ""},
        {"Authorization": "Bearer "},
        {"Authorization": f"Bearer {server.token[:-1]}"},
        {"Authorization": f"Bearer {server.token}x"},
        {"Authorization": "Bearer \xff"},
    ):
        assert asked(server, **bad)[0] == 401
    for bad in (
        {"Host": "evil.example"},
        {"Host": f"evil.example:{port}"},
        {"Host": "127.0.0.1:1"},
        {"Host": ""},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": f"https://127.0.0.1:{port}"},
        {"Origin": "http://127.0.0.1:1"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ):
        assert asked(server, **bad)[0] == 403, bad
        assert asked(server, "/", None, "GET", **bad)[0] == 403, bad
    own = {"Origin": f"http://localhost:{port}", "Host": f"localhost:{port}", "Sec_Fetch_Site": "same-origin"}
    assert asked(server, "nothing", **own)[0] == 200


def test_requests_that_are_none_are_told_and_stop_nobody(server):
    assert asked(server, Content_Type="text/plain")[0] == 415
    assert asked(server, Content_Length="99999999999")[0] == 413
    for body in (b"", b"[]", b"{", b"\xff", b"[" * 100_000):
        assert asked(server, body=body)[0] in (400, 413), body[:9]
    for what in ("nothing", "../plan", "plan/x", "judge"):
        status, _, text = asked(server, what)
        assert status == 200 and json.loads(text)["refused"]
    for body in ({"viewpoints": 3}, {"viewpoints": [], "base": "0"}, {"base": 9}, {"viewpoints": [{}]}):
        for what in ("judge", "replan", "keep", "aim", "zone", "require", "decide"):
            status, _, text = asked(server, what, json.dumps(body).encode())
            assert status == 200 and json.loads(text)["refused"], (what, body)


def test_the_page_is_strict_and_lies_nowhere_else(server):
    status, headers, text = asked(server, "/", None, "GET", Authorization="")
    policy = headers["Content-Security-Policy"]
    assert status == 200 and "default-src 'none'" in policy and "script-src 'self';" in policy
    assert "connect-src 'self'" in policy and "frame-ancestors 'none'" in policy
    assert headers["X-Content-Type-Options"] == "nosniff" and headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cache-Control"] == "no-store" and "Access-Control-Allow-Origin" not in headers
    assert server.token not in text and "<script>" not in text
    for path in ("/../session.py", "/%2e%2e/x", "/core.js/..", "/index.htm", "/api/plan"):
        assert asked(server, path, None, "GET")[0] == 404
    assert asked(server, "/", None, "PUT")[0] == 501


# --- what is answered ----------------------------------------------------------------------------


def test_a_change_is_judged_as_every_plan_is_and_nothing_is_planned_for_it(session, monkeypatch):
    plan = session.answer("plan", {})
    monkeypatch.setattr("upplied.fleet.editing.plan_transfer", None)
    assert len(plan["viewpoints"]) == 12 and plan["differences"] == ["against the plan as opened: as good"]
    views = [dict(each) for each in plan["viewpoints"]]
    for _ in range(5):
        views[4]["z_m"] += 0.2
        found = session.answer("judge", wanted(plan, viewpoints=views[:9] + views[10:]))
        assert "viewpoint 9 left out" in found["words"] and found["path"]["xyz"] != plan["path"]["xyz"]
    again = session.editing.judged(*session._read(wanted(plan, viewpoints=views[:9] + views[10:])))
    assert found["measures"]["min_clearance_m"] == again.plan.measures.min_clearance_m
    inside = json.loads(json.dumps(views))
    inside[4] |= {"x_m": 0.0, "y_m": 0.0, "z_m": 1.0}
    refused = session.answer("judge", wanted(plan, viewpoints=inside))["refused"]
    assert "viewpoint 4" in refused and "2 m are to be kept" in refused


def test_the_headline_tells_the_clearance_that_the_change_asks_for(session):
    plan = session.answer("plan", {})
    for asked_m, told in ((3.0, "3 m asked for"), (2.5, "2.5 m asked for"), (1.0, "2 m asked for")):
        found = session.answer("judge", wanted(plan, clearance_m=asked_m))
        assert told in found["verdict"]["headline"]  # never less than the plan's own


@pytest.mark.slow
def test_the_rest_is_planned_anew_round_what_is_fixed(session, catalog):
    plan = session.answer("plan", {})
    views = [dict(each) for each in plan["viewpoints"]]
    views[4]["z_m"] += 0.5
    middle = np.array([[views[8][name] for name in ("x_m", "y_m", "z_m")]])
    box = np.concatenate([middle - 0.6, middle + 0.6]).tolist()
    said = wanted(plan, viewpoints=views, keep_out=[box], fixed=[2])
    refused = session.answer("judge", said)
    assert "in a keep-out box" in refused["refused"]
    found = session.answer("replan", said)
    assert found["base"] == 1 and len(found["fixed"]) == 2
    rows = {(row["x_m"], row["y_m"], row["z_m"]) for row in found["viewpoints"]}
    for number in (2, 4):
        assert tuple(views[number][name] for name in ("x_m", "y_m", "z_m")) in rows
    new = np.array([[row[name] for name in ("x_m", "y_m", "z_m")] for row in found["viewpoints"]])
    inside = ((new > box[0]) & (new < box[1])).all(axis=1)
    assert not inside.any() and found["verdict"]["flyable"]
    again = wanted(plan, base=1, viewpoints=found["viewpoints"], keep_out=[box], by="Ada")
    kept = session.answer("keep", again)
    steps = catalog.waypoints(kept["id"])[["x_m", "y_m", "z_m"]].to_numpy()
    assert not ((steps > np.array(box[0])) & (steps < np.array(box[1]))).all(axis=1).any()
    assert "planned anew" in catalog.edits().iloc[-1]["words"]


def test_two_who_decide_at_once_are_told_of_each_other(session, catalog):
    plan = session.answer("plan", {})
    other = Session(catalog, KEY[:20])
    released = {"decision": "released", "id": plan["id"], "by": "Ada"}
    assert "in force, released by Ada" in session.answer("decide", released)["told"]
    refused = other.answer("decide", {**released, "by": "Ben"})["refused"]
    assert "somebody decided about this pair meanwhile" in refused and "Ada released" in refused
    assert list(catalog.in_force()["state_by"]) == ["Ada"]
    assert "told" in other.answer("decide", {**released, "by": "Ben"})  # now knowing of it
    for bad in ({"by": " "}, {"decision": "flown"}, {"id": "another"}):
        assert "refused" in session.answer("decide", {**released, **bad})


def test_a_zone_is_painted_asked_for_and_judged(session, catalog):
    plan = session.answer("plan", {})
    aim = session.answer("aim", plan["viewpoints"][3])
    assert aim["place"] is not None
    where = "ball " + " ".join(map(str, aim["place"])) + " 0.8"
    assert 0 < session.answer("zone", {"where": where})["share_pct"] < 20
    asked = {"set": "monthly", "zone": {"zone": "seam", "where": where, "looks": 2}, "by": "Ada"}
    assert "asks for 1 zone(s)" in session.answer("require", asked)["told"]
    (zone,) = session.answer("judge", wanted(plan))["zones"]
    assert (zone["zone"], zone["status"]) == ("seam", "met")
    away = [row for row in plan["viewpoints"] if row["viewpoint"] in (0, 11)]
    session.answer("require", {**asked, "zone": {**asked["zone"], "looks": 50}})
    (zone,) = session.answer("judge", wanted(plan, viewpoints=away))["zones"]
    assert zone["status"] == "missed" and zone["why"]
    assert list(catalog.requirements()["version"]) == [2]
    assert "names no surface" in session.answer("zone", {"where": "ball 900 0 0 1"})["refused"]


# --- in a browser --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.ci
@pytest.mark.skipif(BROWSER is None, reason="no chromium on this machine; apt-get install chromium")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_the_keyboard_alone_changes_keeps_and_releases_a_plan(server, catalog, capsys):
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with sync_api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=FLAGS)
        page, errors, urls = browser.new_page(viewport={"width": 1300, "height": 900}), [], []
        page.on("console", lambda message: message.type == "error" and errors.append(message.text))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: urls.append(request.url))
        answers: list[dict[str, Any]] = []
        page.on("response", lambda got: got.url.endswith("/judge") and answers.append(got.json()))
        page.goto(server.address)
        page.wait_for_selector("#app[data-ready=true]", timeout=120_000)
        assert server.token not in page.url and "flyable" in page.locator("#verdict").inner_text()
        # every control has a name
        unnamed = (
            "els => els.filter(e => !(e.labels && e.labels.length) && !e.getAttribute('aria-label')"
            " && !e.textContent.trim()).length"
        )
        assert page.eval_on_selector_all("button, input, select, textarea, [tabindex]", unnamed) == 0
        reach(page, "viewpoints")
        for key in ("ArrowDown", "ArrowDown", "ArrowDown", "r", "r", "s"):
            page.keyboard.press(key)
        judged(page, "viewpoint 3 changed")
        page.keyboard.press("ArrowDown")
        page.keyboard.press("Delete")
        text = judged(page, "viewpoint 4 left out, viewpoint 3 changed")
        assert "judged in" in text
        with capsys.disabled():
            sys.stdout.write(f"\nin Chromium: {text.splitlines()[-1]}, {answers[-1]['cpu_s']:.2f} s of CPU\n")
        page.keyboard.press("Control+z")
        judged(page, "Changed: viewpoint 3 changed.")
        reach(page, "release")
        page.keyboard.press("Enter")  # neither kept nor signed
        assert "Keep the change as a draft first" in page.locator("#told").inner_text()
        reach(page, "by")
        page.keyboard.type("Ada")
        reach(page, "keep")
        page.keyboard.press("Enter")
        told(page, "kept as draft")
        reach(page, "release")
        page.keyboard.press("Enter")
        told(page, "in force")
        browser.close()
    assert errors == [] and all(
        url.startswith((server.address.split("#")[0], "blob:", "data:")) for url in urls
    )
    (row,) = catalog.in_force().to_dict("records")
    (edit,) = catalog.edits().to_dict("records")
    assert row["transfer_id"] == edit["transfer_id"] and row["state_by"] == "Ada" == edit["by"]


def reach(page: Any, wanted: str) -> None:
    """Go to a control by the Tab key alone."""
    for _ in range(150):
        if page.evaluate("document.activeElement.id") == wanted:
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"{wanted} is not reached by Tab")


def judged(page: Any, words: str) -> str:
    """The verdict once it tells of a change."""
    page.wait_for_selector(f"#verdict:not([aria-busy]):has-text('{words}')", timeout=60_000)
    return str(page.locator("#verdict").inner_text())


def told(page: Any, words: str) -> None:
    page.wait_for_selector(f"#told:has-text('{words}')", timeout=60_000)
