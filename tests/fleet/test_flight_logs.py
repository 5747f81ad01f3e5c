"""A log comes back: judged on its plan, kept, told in the report, and its gap becomes a plan."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from made_logs import Flight, Topic, poses
from made_logs import write_log as made_log
from made_plans import plan_as_demonstrated

from upplied.catalog import open_catalog, verify
from upplied.catalog.database import Catalog
from upplied.cli import main
from upplied.config import CloudSettings
from upplied.errors import InputError, RefusedError, SettingsError
from upplied.fleet import flights
from upplied.fleet.flight_logs import Judged, judge_log, keep
from upplied.fleet.flights import promote_flight, simulated_row
from upplied.fleet.gaps import plan_gap
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import scene_of
from upplied.inputs.columns import photo_times
from upplied.inputs.sidecar import LogOptions
from upplied.outputs import logs
from upplied.outputs.logs import write_log
from upplied.outputs.missions.mcap import mcap_bytes
from upplied.outputs.publish import publish_pages
from upplied.outputs.verdicts import seen_as_flown
from upplied.planning.airspace.rules import path_clearance
from upplied.planning.surface.samples import surface_samples
from upplied.proof.looks import looks_of
from upplied.records import SURFACE_STATES, Cloud, Demonstration, Plan, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
from upplied.simulate import Wind, fly_trajectory

CUBE = member("cube-v1").structure
FLOWN = fly(CUBE, "sides", seed=1)
KEY = hashlib.sha256(b"plan").hexdigest()
ID = KEY[:20]
SIMULATED = {"wind_mps": 4.0, "towards_deg": 0.0, "gusts": True, "seed": 2, "min_clearance_m": 3.0}
START_NS = 1_770_000_000_000_000_000  # 2 February 2026


@pytest.fixture(scope="module")
def plan() -> Plan:
    surface = surface_samples(CUBE, scene_of(CUBE), CloudSettings(surface_samples=500))
    return plan_as_demonstrated(CUBE, FLOWN, surface)


@pytest.fixture
def catalog(tmp_path, plan) -> Catalog:
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([CUBE])
    catalog.add_demonstrations([FLOWN])
    catalog.add_plans([(KEY, plan, {})])
    return catalog


@pytest.fixture(scope="module")
def log(tmp_path_factory, plan):
    """What came back: broken off at 60 %, 25 s after the recorder started."""
    flown = fly_trajectory(plan.trajectory, wind=Wind(4.0), seed=2)
    part = flown.t_s <= 0.6 * flown.t_s[-1]
    t_ns = START_NS + np.round(flown.t_s[part] * 1e9).astype(np.int64)
    record = replace(
        FLOWN, demonstration_id="flight-7", t_ns=t_ns, positions=flown.positions[part],
        quat_xyzw=flown.quat_xyzw[part], operator="Ada",
    )  # fmt: skip
    return write_log(tmp_path_factory.mktemp("log") / "flight-7.mcap", record, CUBE, heavy_topic=False)


def judged(catalog: Catalog, log, plan: str = ID, photos=None) -> Judged:
    return judge_log(catalog.location, str(log), plan, photos, None)


@pytest.mark.slow
def test_a_log_is_judged_kept_told_and_its_gap_is_planned(catalog, log, tmp_path, capsys):
    row = keep(catalog, judged(catalog, log))
    assert (row["kind"], row["operator"], f"{row['flown_at']:%Y-%m-%d}") == ("flown", "Ada", "2026-02-02")
    assert 50 < row["flown_pct"] < 70 and "aborted" in row["findings"]
    assert 30 < row["inspected_pct"] < row["required_pct"] < 95
    keep(catalog, judged(catalog, log))
    (stored,) = catalog.flights(kind="flown").to_dict("records")
    assert stored["flight_id"] == row["flight_id"] and verify(catalog) == []
    # the history of a patch that was seen, and of one that was not
    looks = catalog.looks.get(stored["looks_sha256"])
    points = catalog.surfaces.points(looks.samples_sha256)
    (seen,) = catalog.looks_at("cube-v1", points[looks.patch[0]]).to_dict("records")
    assert (
        seen["seen"] and seen["distance_m"] == pytest.approx(looks.distance_m[0]) and seen["patch_off_m"] == 0
    )
    unseen = np.setdiff1d(np.arange(len(points)), looks.patch)[0]
    assert not catalog.looks_at("cube-v1", points[unseen])["seen"].any()
    # the page shows both paths, the one that was flown with what it saw
    publish_pages(catalog, tmp_path / "reports", pictures=0)
    (page,) = (tmp_path / "reports" / "transfers").glob("*.html")
    assert "Flown 2026-02-02" in page.read_text() and "aborted" in page.read_text()
    assert "wind not logged" in page.read_text() and stored["wind_mps"] != stored["wind_mps"]
    headline = f"{row['inspected_pct']:.1f} % of the planned surface was inspected as planned"
    assert f"{headline}, {row['required_pct']:.1f} % was certainly in view" in page.read_text()
    # the gap becomes a plan like any other, a draft beside the one that was flown
    gap = plan_gap(catalog, row["flight_id"][:10])
    plan, gap_row = catalog.plan(gap), catalog.transfer(gap)
    assert gap_row["purpose"] == f"gap {row['flight_id'][:20]}" and plan.flyable
    nearest = path_clearance(scene_of(CUBE), catalog.plan(ID).trajectory.positions).distance_m
    assert gap_row["min_clearance_m"] >= nearest - 0.1 > 4  # as its plan does, where 2 m are allowed
    assert f"keeps {nearest:.1f} m from the structure, as its plan does" in plan.warnings
    assert "as near and as frontally as planned" in plan.warnings[0] and 0 < gap_row["duration_s"] < 120
    assert list(catalog.transfers()["transfer_id"]) == [ID]  # nothing takes the place of the plan
    scene = scene_of(CUBE)
    surface, shown = catalog.surface(ID), catalog.surface(gap)
    missing = (surface.state == 1) & ~np.isin(np.arange(len(points)), looks.as_asked)
    assert len(looks.as_asked) < len(looks.patch)
    assert ((shown.state == 1) | (shown.state == 3))[missing].mean() > 0.995
    assert plan_gap(catalog, row["flight_id"]) == gap and verify(catalog) == []
    catalog.release(ID, "Grace")
    catalog.release(gap, "Grace")
    assert set(catalog.in_force()["transfer_id"]) == {ID, gap}
    assert scene is scene_of(CUBE)
    # by the command
    where = ["--catalog", catalog.location]
    assert main(["flights", "show", row["flight_id"][:8], *where]) == 0
    shown_row = capsys.readouterr().out
    assert "aborted" in shown_row and "inspected as planned (%)" in shown_row
    assert main(["flights", "list", "--json", *where]) == 0
    assert json.loads(capsys.readouterr().out)[0]["kind"] == "flown"
    assert main(["flights", "history", "cube-v1", *map(str, points[looks.patch[0]]), *where]) == 0
    assert "last seen 2026-02-02 from" in capsys.readouterr().out
    assert main(["transfer", "--reproduce", gap, *where]) == 1


def test_the_plan_that_was_flown_is_found(catalog, log):
    assert judged(catalog, log, plan="").row["transfer_id"] == ID


@pytest.mark.ci
def test_a_log_that_names_no_structure_is_found_by_the_plan_that_it_lies_on(
    catalog, plan, tmp_path, monkeypatch
):
    tall = replace(CUBE, structure_id="tall-v1", vertices=CUBE.vertices * [1, 1, 3.0], sha256="tall")
    moved = replace(plan.trajectory, positions=plan.trajectory.positions + 9.0)
    other = hashlib.sha256(b"other").hexdigest()
    facts = logs._facts
    monkeypatch.setattr(logs, "_facts", lambda *args: {**facts(*args), "structure_id": ""})
    silent = write_log(tmp_path / "silent.mcap", FLOWN, CUBE, heavy_topic=False)
    with pytest.raises(InputError, match="does not name the structure that was flown"):
        judged(open_catalog(tmp_path / "empty").create(), silent, plan="")
    catalog.add_structures([tall])
    catalog.add_plans([(other, replace(plan, target_id="tall-v1", trajectory=moved, surface=None), {})])
    row = judged(catalog, silent, plan="").row
    assert (row["transfer_id"], row["target_id"]) == (ID, "cube-v1")


def test_a_flight_is_of_the_plan_that_was_in_force_when_it_was_flown(catalog, plan, log):
    from upplied.fleet import plan_of_flight

    later = hashlib.sha256(b"later").hexdigest()
    catalog.add_plans([(later, replace(plan, trajectory=plan.trajectory), {})])
    assert list(catalog.transfers()["transfer_id"]) == [later[:20]]
    catalog.release(ID, "Ada")
    catalog.release(later[:20], "Ada")
    flown = plan_of_flight._read(catalog, str(log), plan_of_flight.LogOptions())
    before = catalog.decisions().iloc[0]["added_at"]
    at = int(before.value) + 1000
    for t_ns, plans in ((at, {ID, later[:20]}), (at + 10**15, {later[:20]})):
        moved = replace(flown, t_ns=flown.t_ns - flown.t_ns[0] + t_ns)
        assert {row["transfer_id"] for row in plan_of_flight._plans(catalog, moved)} == plans
    assert plan_of_flight._plans(
        catalog, replace(flown, t_ns=flown.t_ns - flown.t_ns[0])
    )  # a clock from 1970


@pytest.mark.ci
def test_a_good_flight_becomes_a_demonstration_and_one_that_is_not_does_not(
    catalog, plan, log, tmp_path, capsys
):
    where = ["--catalog", catalog.location]
    broken_off = keep(catalog, judged(catalog, log))["flight_id"]
    assert main(["flights", "promote", broken_off[:12], "--by", "Grace", *where]) == 1
    message = capsys.readouterr().err
    assert "% of its plan was flown" in message and "was inspected as planned" in message
    flown = fly_trajectory(plan.trajectory, wind=Wind(1.0), seed=4)
    record = replace(
        FLOWN, demonstration_id="flight-8", t_ns=START_NS + np.round(flown.t_s * 1e9).astype(np.int64),
        positions=flown.positions, quat_xyzw=flown.quat_xyzw, operator="Ada",
    )  # fmt: skip
    path = write_log(tmp_path / "flight-8.mcap", record, CUBE, heavy_topic=False)
    row = keep(catalog, judged(catalog, path))
    assert row["inspected_pct"] > 95 and row["required_pct"] > 98
    for column, share, words in (
        ("inspected_pct", 94.0, "94.0 % of its surface was inspected as planned"),  # though it was in view
        ("inspected_pct", None, "the share inspected as planned is unknown"),
        ("required_pct", 97.0, "97.0 % of what it shows was in view"),
    ):
        lacking = {**row, column: share}
        assert flights._broken(lacking, 9.0, catalog.transfer(ID)) == [("whole", words)]
    assert main(["flights", "promote", row["flight_id"][:12], "--by", "Grace", "--name", "good", *where]) == 0
    record = catalog.demonstration("good")
    assert (record.structure_id, record.operator, int(record.t_ns[0])) == (
        "cube-v1",
        "Ada",
        START_NS,
    )
    assert np.abs(record.positions - flown.positions[: len(record)]).max() < 0.2 and "Grace" in record.notes
    assert vars(record.camera) == vars(FLOWN.camera) and verify(catalog) == []
    with pytest.raises(RefusedError, match="a name of its own"):
        promote_flight(catalog, row["flight_id"], "Grace", "good")
    with pytest.raises(SettingsError, match="is unknown"):
        promote_flight(catalog, row["flight_id"], "Grace", force=("all",))
    part = promote_flight(catalog, broken_off, "Grace", "part", force=("whole",))
    assert "overruled, whole" in catalog.demonstration(part.demonstration_id).notes


def test_photos_say_when_the_camera_saw(catalog, log, tmp_path):
    times = tmp_path / "photos.csv"
    times.write_text("name,t_ns\n" + "".join(f"p{s},{START_NS + s * 10**9}\n" for s in range(90)))
    row = judged(catalog, log, photos=times).row
    assert row["photos"] == 90 and row["photos_missing"] == 0
    assert row["required_pct"] <= judged(catalog, log).row["required_pct"]


@pytest.mark.parametrize("text", ["", "noon\n", "1.5\n", "t_ns\n", "12345678901234567890123\n"])
def test_photos_that_are_no_times_are_told(tmp_path, text):
    path = tmp_path / "photos.csv"
    path.write_text(text)
    with pytest.raises(InputError, match="photos"):
        photo_times(path)


def noisy(path: Trajectory, seed: int = 0) -> Trajectory:
    """As a vehicle flies: a few centimetres beside it."""
    off = np.random.default_rng(seed).normal(0, 0.05, path.positions.shape)
    return replace(path, positions=path.positions + off)


def written(folder, path: Trajectory, name: str = "back", start_ns: int = START_NS, **more):
    """The log of a path."""
    t_ns = start_ns + np.round(path.t_s * 1e9).astype(np.int64)
    poses = {"t_ns": t_ns, "positions": path.positions, "quat_xyzw": path.quat_xyzw}
    record = replace(FLOWN, demonstration_id=name, **poses)
    return write_log(folder / f"{name}.mcap", record, CUBE, heavy_topic=False, **more)


@pytest.mark.ci
def test_photos_after_a_hover_are_placed_by_the_clock_of_the_log(catalog, plan, tmp_path):
    """A hover is shortened in demonstrations; here that would move every photo after it."""
    flown = noisy(interpolate(plan.trajectory, np.arange(0.0, plan.trajectory.t_s[-1], 0.1)))
    middle = int(np.searchsorted(flown.t_s, 60.0))
    still = noisy(flown.take(np.full(1200, middle)), 1)
    t_s = np.concatenate(
        [flown.t_s[:middle], flown.t_s[middle] + np.arange(1200) * 0.1, flown.t_s[middle:] + 120]
    )
    path = Trajectory(
        t_s,
        np.concatenate([flown.positions[:middle], still.positions, flown.positions[middle:]]),
        np.concatenate([flown.quat_xyzw[:middle], still.quat_xyzw, flown.quat_xyzw[middle:]]),
    )
    log = written(tmp_path, path)
    # Photos before the hover alone, then after it alone: each shows its own half.
    shown = []
    for name, moments in (("before", np.arange(1.0, 60.0)), ("after", np.arange(181.0, 238.0))):
        times = tmp_path / f"{name}.csv"
        times.write_text("\n".join(str(START_NS + int(s * 1e9)) for s in moments))
        flight = judged(catalog, log, photos=times)
        assert flight.row["duration_s"] == pytest.approx(path.t_s[-1], abs=0.2)
        assert re.search(r"waited for 12\d s at (59|60) s", flight.row["findings"])
        truth = looks_of(path, flight.surface, FLOWN.camera, scene_of(CUBE), moments).seen
        assert (flight.flown.looks.seen == truth).mean() > 0.995
        shown.append(truth)
    assert (shown[0] != shown[1]).mean() > 0.2  # so the half that is shown does tell


@pytest.mark.ci
def test_an_export_of_a_plan_is_no_flight_of_it(catalog, plan, tmp_path):
    path = tmp_path / "plan.mcap"
    path.write_bytes(mcap_bytes(plan, CUBE))
    with pytest.raises(InputError, match="is an export of a plan: its metadata say so"):
        judged(catalog, path)
    every = interpolate(plan.trajectory, np.arange(0.0, plan.trajectory.t_s[-1], 0.1))
    with pytest.raises(RefusedError, match=f"holds the poses of the plan {ID} itself"):
        judged(catalog, written(tmp_path, every))
    slower = replace(every, t_s=every.t_s * 1.3)
    with pytest.raises(RefusedError, match="holds the poses of the plan"):
        judged(catalog, written(tmp_path, slower))
    assert judged(catalog, written(tmp_path, noisy(every))).row["kind"] == "flown"


@pytest.mark.ci
def test_a_simulated_flight_is_never_a_flown_one(catalog, plan, tmp_path):
    path = fly_trajectory(plan.trajectory, wind=Wind(4.0), seed=2)
    marked = written(tmp_path, path, "marked", simulated=True)
    with pytest.raises(InputError, match="is the log of a simulated flight"):
        judged(catalog, marked)
    plain = written(tmp_path, path)
    assert judged(catalog, plain).row["kind"] == "flown"  # nobody can know it yet
    catalog.add_flight(simulated_row(catalog, "f" * 64, catalog.transfer(ID), path, SIMULATED), path)
    with pytest.raises(RefusedError, match="holds the poses of the simulated flight"):
        judged(catalog, plain)


@pytest.mark.parametrize("start_ns", [0, 915_148_800_000_000_000, 2_100_000_000_000_000_000])
def test_a_flight_of_no_possible_day_is_refused(catalog, plan, tmp_path, start_ns):
    path = fly_trajectory(plan.trajectory, wind=Wind(4.0), seed=2)
    with pytest.raises(InputError, match=r"by its own clock .rule: a date from 2000 to now"):
        judged(catalog, written(tmp_path, path, start_ns=start_ns + 10**9))


@pytest.mark.slow
def test_a_flight_of_another_mission_is_told_by_its_fit(catalog, plan, tmp_path):
    """Both lie round the same structure, a metre and a half apart."""
    path = plan.trajectory
    middle = path.positions.mean(axis=0)
    wide = replace(path, positions=middle + (path.positions - middle) * [1.2, 1.2, 1.0] + [0, 0, 0.8])
    other = hashlib.sha256(b"wide").hexdigest()
    catalog.add_plans([(other, replace(plan, trajectory=wide, preset="baseline"), {})])
    for mine, theirs, flown in ((ID, other[:20], wide), (other[:20], ID, path)):
        log = written(tmp_path, fly_trajectory(flown, wind=Wind(3.0), seed=1))
        with pytest.raises(RefusedError, match=f"is a flight of plan {theirs}"):
            judged(catalog, log, plan=mine)
        assert judged(catalog, log, plan=theirs).row["transfer_id"] == theirs
    assert judged(catalog, log, plan="").row["transfer_id"] == ID
    log = written(tmp_path, fly_trajectory(wide, wind=Wind(3.0), seed=1))
    with pytest.raises(RefusedError, match=f"is a flight of plan {other[:20]}"):
        judged(catalog, log, plan="")  # without a name it is laid on the recommended one


@pytest.mark.slow
def test_what_holds_only_if_the_log_was_rightly_moved_is_told_apart(catalog, plan, tmp_path, capsys):
    """A vehicle that flew 2.5 m beside its plan, and a log that is 2.5 m off, are the same log."""
    flown = fly_trajectory(plan.trajectory, wind=Wind(2.0), seed=2)
    beside = replace(flown, positions=flown.positions + np.array([2.0, -1.5, 0.0]))
    log = written(tmp_path, beside)
    row = keep(catalog, judged(catalog, log))
    assert row["shift_m"] == pytest.approx(2.5, abs=0.3) and row["place_error_m"] >= row["shift_m"]
    assert row["inspected_pct"] + 5 < row["inspected_if_corrected_pct"] <= 100
    (stored,) = catalog.flights(kind="flown")["inspected_if_corrected_pct"]
    assert stored == row["inspected_if_corrected_pct"]
    looks = catalog.looks.get(row["looks_sha256"])
    surface = catalog.surface(ID)
    truth, scene = [], scene_of(CUBE)
    for path in (beside, flown):
        truth.append(looks_of(path, Cloud(surface.points, surface.normals), FLOWN.camera, scene).seen)
    certain = np.isin(np.arange(len(surface.points)), looks.certain.patch)
    assert (certain & ~(truth[0] & truth[1])).mean() < 0.01
    required = surface.state == 1
    assert row["required_pct"] == pytest.approx(100 * certain[required].mean())
    assert row["assumed_pct"] > 2 and len(looks.certain.patch) < len(looks.patch)
    unseen = looks.patch[np.flatnonzero(looks.assumed)[0]]
    assert not catalog.looks_at("cube-v1", surface.points[unseen])["seen"].any()
    publish_pages(catalog, tmp_path / "reports", pictures=0)
    (page,) = (tmp_path / "reports" / "transfers").glob("*.html")
    sentence = f"{row['assumed_pct']:.1f} % more in view if the correction of the log is right"
    assert sentence in page.read_text() and "was certainly in view" in page.read_text()
    sentence = f"inspected as planned, {stored:.1f} % if the correction of the log is right"
    assert sentence in page.read_text()
    assert main(["flights", "show", row["flight_id"][:8], "--catalog", catalog.location]) == 0
    listed = " ".join(capsys.readouterr().out.split())
    assert re.search(rf"the same if the alignment is right \(%\) [^a-z]*{stored:.2f}", listed), listed
    states = {SURFACE_STATES[state] for state in np.unique(seen_as_flown(surface, looks).state)}
    assert states >= {"shown", "in view only", "inspected if corrected"}
    besides = np.intersect1d(looks.patch[looks.assumed > 0], np.flatnonzero(required))
    doubtful = [SURFACE_STATES.index(name) for name in ("seen if corrected", "inspected if corrected")]
    assert np.isin(seen_as_flown(surface, looks).state[besides], doubtful).all() and len(besides)
    colour = seen_as_flown(surface, looks).state == SURFACE_STATES.index("inspected if corrected")
    both = row["inspected_pct"] + 100 * colour[required].mean()
    assert both == pytest.approx(stored)  # the two figures are what the two colours show
    # With a stated accuracy no more than that is corrected.
    fixed = judge_log(catalog.location, str(log), ID, None, LogOptions(accuracy_m=0.1)).row
    assert fixed["shift_m"] == 0 and fixed["assumed_pct"] == 0 and "left as logged" in fixed["findings"]
    assert fixed["inspected_if_corrected_pct"] is None  # nothing of it hangs on a correction


def test_a_log_of_another_structure_or_on_no_plan_is_refused(catalog, log, tmp_path):
    other = replace(CUBE, structure_id="other-v1", sha256="other")
    catalog.add_structures([other])
    elsewhere = replace(FLOWN, structure_id="other-v1", positions=FLOWN.positions)
    path = write_log(tmp_path / "other.mcap", elsewhere, other, heavy_topic=False)
    with pytest.raises(InputError, match="was flown round other-v1, plan"):
        judged(catalog, path)
    with pytest.raises(RefusedError, match="no plan of that structure is in the catalog"):
        judged(catalog, path, plan="")
    far = Demonstration(
        "far", "cube-v1", FLOWN.t_ns, FLOWN.positions + 50.0, FLOWN.quat_xyzw, camera=FLOWN.camera
    )
    path = write_log(tmp_path / "far.mcap", far, CUBE, heavy_topic=False)
    with pytest.raises(RefusedError, match="does not lie on the plan"):
        judged(catalog, path)


@pytest.mark.ci
def test_a_simulated_flight_is_a_flight(catalog, plan):
    path = fly_trajectory(plan.trajectory, wind=Wind(4.0), seed=2)
    half = Trajectory(path.t_s[:600], path.positions[:600], path.quat_xyzw[:600])
    catalog.add_flight(simulated_row(catalog, "f" * 64, catalog.transfer(ID), half, SIMULATED), half)
    row = catalog.flight("ffff")
    assert (row["kind"], row["seed"], row["target_id"]) == ("simulated", 2, "cube-v1")
    assert 0 < row["required_pct"] < 100 and row["min_clearance_m"] == 3.0
    assert catalog.plan(plan_gap(catalog, "ffff")).status == "ok"


def test_new_drafts_are_flown_and_those_that_come_too_near_are_told(catalog, plan, monkeypatch):
    from upplied.fleet import flights

    seen: list[str] = []

    def flown(_catalog, plan, *_):
        seen.append(plan)
        return {"min_clearance_m": 1.25}

    monkeypatch.setattr(flights, "fly_plan", flown)
    other = hashlib.sha256(b"baseline").hexdigest()
    catalog.add_plans([(other, replace(plan, preset="baseline"), {})])
    messages = flights.fly_drafts(catalog, [KEY, other, "0" * 64])
    assert seen == [ID]  # plans for comparison are not flown
    assert "comes within 1.25 m (limit 2 m)" in messages[0] and "not in the catalog" in messages[1]


@pytest.mark.slow
def test_a_plan_that_a_person_changed_is_judged_anew_and_is_a_draft(catalog, tmp_path, capsys):
    where, file = ["--catalog", catalog.location], tmp_path / "plan.json"
    assert main(["edit", ID[:8], "--out", str(file), *where]) == 0
    edit = json.loads(file.read_text())
    count = len(edit["viewpoints"])
    assert main(["edit", ID, "--from", str(file), "--by", "Ada", *where]) == 2
    assert "changes nothing" in capsys.readouterr().err
    edit["viewpoints"] = [row for row in edit["viewpoints"] if row["viewpoint"] not in (4, 5)]
    edit["viewpoints"][0]["pitch_deg"] -= 5.0
    file.write_text(json.dumps(edit))
    code = main(["edit", ID, "--from", str(file), "--by", "Ada", *where])
    out = capsys.readouterr().out
    draft = out.split(":")[0].strip()
    assert "changed by Ada: viewpoint 4 left out, viewpoint 5 left out, viewpoint 0 changed" in out
    row = catalog.transfer(draft)
    assert row["n_viewpoints"] == count - 2 and code == int(not row["flyable"])
    assert row["min_clearance_m"] >= 1.99 and row["coverage_inspected_pct"] > 0
    assert list(catalog.transfers()["transfer_id"]) == [draft] and not len(catalog.in_force())
    assert row["planned_on"] == f"changed by Ada, from {ID}" and verify(catalog) == []


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"plan": "other", "viewpoints": []}',
        f'{{"plan": "{ID}", "viewpoints": [{{"viewpoint": 900}}]}}',
        f'{{"plan": "{ID}", "viewpoints": [], "keep_out": [[1, 2]]}}',
        f'{{"plan": "{ID}", "viewpoints": [], "clearance_m": NaN}}',
    ],
)
def test_a_file_that_is_no_edit_of_the_plan_is_told(catalog, tmp_path, text):
    from upplied.fleet.edits import edit_plan

    path = tmp_path / "plan.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"plan\.json"):
        edit_plan(catalog, ID, path, "Ada")


@pytest.mark.ci
def test_the_wind_of_a_log_is_kept_and_told(catalog, plan, tmp_path, capsys):
    flown = fly_trajectory(plan.trajectory, wind=Wind(4.0), seed=2)
    t_ns = START_NS + np.round(flown.t_s * 1e9).astype(np.int64)
    body = poses("/pose", "geometry_msgs/msg/PoseStamped", Flight(t_ns, flown.positions, flown.quat_xyzw))
    winds = [{"timestamp": int(t) // 1000, "windspeed_north": 4.0, "windspeed_east": 3.0} for t in t_ns[::50]]
    wind = Topic("/fmu/out/wind", "px4_msgs/msg/Wind", list(zip(t_ns[::50].tolist(), winds, strict=True)))
    facts = {"structure_id": "cube-v1", "body_frame": "camera"}
    row = keep(catalog, judged(catalog, made_log(tmp_path / "a.mcap", [body, wind], facts)))
    assert row["wind_mps"] == pytest.approx(5.0) == row["wind_most_mps"]
    assert CUBE.placement is not None
    towards = (CUBE.placement.heading_deg - np.degrees(np.arctan2(3.0, 4.0))) % 360
    assert row["towards_deg"] == pytest.approx(towards)
    assert main(["flights", "show", row["flight_id"], "--catalog", catalog.location]) == 0
    assert f"wind of 5.0 m/s, up to 5.0 m/s, towards {towards:.0f}" in " ".join(
        capsys.readouterr().out.split()
    )
    publish_pages(catalog, tmp_path / "reports", pictures=0)
    (page,) = (tmp_path / "reports" / "transfers").glob("*.html")
    assert "wind of 5.0 m/s" in page.read_text()
