"""What was never scanned of a target is kept with its plan, and every room after the plan counts it."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shutil
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_missions import PLACE
from made_scans import body, cut

from upplied.catalog import Catalog, export_dataset, import_dataset, open_catalog, vacuum, verify
from upplied.config import settings_for
from upplied.errors import CatalogError, RefusedError
from upplied.fleet import recheck
from upplied.fleet.editing import Editing
from upplied.fleet.edits import edit_plan, write_edit
from upplied.fleet.gaps import plan_gap
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.geometry.supposed_scene import scene_for
from upplied.outputs.missions import MissionOptions
from upplied.outputs.pairs import pairs_of
from upplied.outputs.render import export_transfer
from upplied.outputs.reports import Reader, plan_of
from upplied.planning.airspace.rules import path_clearance
from upplied.planning.plan import plan_transfer
from upplied.proof.looks import looks_of
from upplied.records import Camera, Cloud, Demonstration, Plan, Structure, Trajectory

SIZE = np.array([1.4, 1.1, 1.2])  # of the target, in sources
FIRST, LAST = -1.5, 5.0  # m along x of the source: the stretch that was not scanned
MIDDLE = 1.4 * (FIRST + LAST) / 2
CAMERA = replace(Camera(), max_range_m=9.0)
SETTINGS = settings_for("recommended", verdict={"enforce": False})


def target(structure: Structure, sha256: str) -> Structure:
    vertices = structure.vertices * SIZE
    return replace(structure, structure_id="larger", vertices=vertices, placement=PLACE, sha256=sha256)


SOURCE = replace(body(), sha256="body")
WHOLE, SCAN = target(body(), "whole"), target(cut(body(), FIRST, LAST), "scan")


def ring(number: int = 160) -> Demonstration:
    """Once round the source from the middle of its left side, 6 m before its walls, looking at them."""
    turn = np.linspace(0, 2 * np.pi, number) + 1.5
    out = np.column_stack([np.cos(turn), np.sin(turn)])
    at = np.column_stack([np.clip(out * 30, [-7, -2], [7, 2]) + 6 * out, np.full(number, 2.0)])
    quats = from_yaw_pitch(np.arctan2(-out[:, 1], -out[:, 0]), np.zeros(number))
    t_ns = (np.arange(number) * 5e8).astype(np.int64)
    return Demonstration("ring", "body", t_ns, at, quats, CAMERA, sha256="ring")


@pytest.fixture(scope="module")
def planned(tmp_path_factory) -> tuple[Path, Plan]:
    """A catalog with a plan for the scan, and the plan as it was made."""
    place = tmp_path_factory.mktemp("planned") / "catalog"
    catalog = open_catalog(place)
    catalog.add_structures([SOURCE, SCAN])
    catalog.add_demonstrations([ring()])
    plan = plan_transfer(ring(), SOURCE, SCAN, SETTINGS, catalog.cache)
    assert plan.supposed is not None and plan.flyable
    catalog.add_plans([(key("plan"), plan, {"settings": SETTINGS})])
    return place, plan


@pytest.fixture
def catalog(planned, tmp_path) -> Catalog:
    shutil.copytree(planned[0], tmp_path / "catalog")
    return open_catalog(tmp_path / "catalog")


def key(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()


def only(catalog: Catalog) -> str:
    (name,) = catalog.transfers()["transfer_id"]
    return str(name)


def clear_m(positions: np.ndarray) -> float:
    """Of the structure as it is, of which the plan was given a scan."""
    return path_clearance(scene_of(WHOLE), positions).distance_m


def exported(catalog: Catalog, plan: str, goal: Path) -> tuple[bytes, float]:
    """A mission from the side where the plan does not begin; its bytes, and how near its legs come."""
    options = MissionOptions(home_m=(MIDDLE, -12.0, 0.0), draft=True)
    files = export_transfer(catalog, plan, "csv", goal, options)
    return files.paths[0].read_bytes(), clear_m(files.missions[0].local)


def as_though_all_was_scanned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Catalog, "supposed", lambda *_: None)


@pytest.mark.slow
def test_the_ways_of_a_mission_lead_round_what_was_never_scanned(catalog, tmp_path, monkeypatch) -> None:
    assert exported(catalog, only(catalog), tmp_path / "made.csv")[1] > 1.9
    as_though_all_was_scanned(monkeypatch)
    assert exported(catalog, only(catalog), tmp_path / "blind.csv")[1] < 1.5  # else nothing is tested


@pytest.mark.slow
def test_of_a_model_nothing_is_supposed(planned) -> None:
    whole = plan_transfer(ring(), SOURCE, WHOLE, SETTINGS)
    assert whole.status == "ok" and whole.supposed is None


@pytest.mark.ci
def test_it_is_kept_with_the_plan_whatever_becomes_of_the_cache(catalog, planned, tmp_path) -> None:
    plan, supposed = only(catalog), planned[1].supposed
    before, _ = exported(catalog, plan, tmp_path / "before.csv")
    shutil.rmtree(Path(catalog.location) / "cache")
    catalog = open_catalog(catalog.location)
    for stored in (catalog.supposed(plan), catalog.plan(plan).supposed,
                 plan_of(catalog, catalog.transfer(plan)).supposed):  # fmt: skip
        assert np.array_equal(stored.points, supposed.points) and stored.error_m == supposed.error_m
    assert exported(catalog, plan, tmp_path / "after.csv")[0] == before
    assert verify(catalog) == []
    (stored,) = (Path(catalog.location) / "supposed").iterdir()
    stored.write_bytes(stored.read_bytes()[:-9])
    assert "supposed" in str(verify(open_catalog(catalog.location))[0])
    with pytest.raises(CatalogError):  # never as though nothing were missing
        exported(open_catalog(catalog.location), plan, tmp_path / "never.csv")


def test_it_goes_out_and_in_with_the_plan_and_stays_as_long_as_a_row_names_it(
    catalog, planned, tmp_path
) -> None:
    export_dataset(catalog, tmp_path / "set", "a-v1", catalog.transfers(), "CC0-1.0")
    other = open_catalog(tmp_path / "other")
    import_dataset(other, tmp_path / "set")
    assert np.array_equal(other.supposed(only(other)).points, planned[1].supposed.points)
    other.keep_surface(replace(planned[1], supposed=replace(planned[1].supposed, error_m=7.0)))
    folder = Path(other.location) / "supposed"
    assert len(list(folder.iterdir())) == 2
    for path in folder.iterdir():
        os.utime(path, (time.time() - 40 * 86_400,) * 2)
    vacuum(open_catalog(other.location))
    assert len(list(folder.iterdir())) == 1 and other.supposed(only(other)) is not None
    next((tmp_path / "set" / "supposed").iterdir()).unlink()
    with pytest.raises(CatalogError):
        import_dataset(open_catalog(tmp_path / "third"), tmp_path / "set")


@pytest.mark.slow
def test_the_page_tells_the_clearance_of_all_of_it(catalog, planned) -> None:
    (pair,) = pairs_of(catalog.transfers(), catalog.transfers(every=True))
    (plan,) = Reader(catalog).pair_data(pair)["plans"]
    assert plan["gate"] == []
    along, at = (unpacked(plan["path"][name]) for name in ("clearance", "xyz"))
    places = at.reshape(-1, 3) + plan["origin"]
    assert along == pytest.approx(scene_for(SCAN, planned[1].supposed).distance(places), abs=1e-3)
    assert (along < scene_of(SCAN).distance(places) - 0.5).any()


def unpacked(packed: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed["data"]), packed["type"]).astype(float)


def dragged(catalog: Catalog, goal: Path, number: int) -> Path:
    """The file of the plan with a viewpoint in the middle of what was not scanned."""
    path = write_edit(catalog, only(catalog), goal)
    edit = json.loads(path.read_text())
    edit["viewpoints"][number] |= {"x_m": MIDDLE, "y_m": 0.0, "z_m": 1.8}
    path.write_text(json.dumps(edit))
    return path


def test_no_viewpoint_is_put_where_the_structure_is_though_nobody_scanned_it(catalog, tmp_path) -> None:
    assert path_clearance(scene_of(SCAN), np.array([[MIDDLE, 0.0, 1.8]])).distance_m > 2.0
    path = dragged(catalog, tmp_path / "edit.json", 3)
    with pytest.raises(RefusedError, match="never scanned"):
        edit_plan(catalog, only(catalog), path, "Ada")
    editing = Editing(catalog, only(catalog))
    place = np.array([[MIDDLE, 0.0, 1.8]])
    assert editing.scene.distance(place)[0] < 1.9 < scene_of(SCAN).distance(place)[0]


def flown_but(catalog: Catalog, plan: str, left_out: np.ndarray, name: str) -> str:
    """A flight of the plan that saw all of what it shows but some samples; its id."""
    path, seen = catalog.plan(plan).trajectory, catalog.surface(plan)
    surface = Cloud(seen.points, seen.normals)
    looks = looks_of(path, surface, CAMERA, scene_of(SCAN))
    row = {
        "flight_id": name * 64, "transfer_id": plan, "kind": "flown", "target_id": "larger",
        "demonstration_id": "ring", "flown_at": catalog.clock.now(), "required_pct": 90.0,
        "looks_sha256": catalog.put_looks(seen.points, seen.normals, looks.seen & ~left_out, looks.values),
    }  # fmt: skip
    catalog.add_flight(row, path)
    return name * 64


@pytest.mark.ci
def test_a_gap_is_closed_by_a_flight_round_what_was_never_scanned(catalog) -> None:
    plan = only(catalog)
    x, y, _ = catalog.surface(plan).points.T
    # On both long walls, beside the stretch that is missing: the short way between leads through it.
    beside = (y > 2.1) & (x > MIDDLE) & (x < 7.6) | (y < -2.1) & (x < MIDDLE) & (x > -3)
    closing = catalog.plan(plan_gap(catalog, flown_but(catalog, plan, beside, "a")))
    sides = closing.trajectory.positions[:, 1]
    assert sides.min() < -4 and sides.max() > 4
    assert clear_m(closing.trajectory.positions) > 1.9 and closing.measures.min_clearance_m > 1.9
    assert np.array_equal(closing.supposed.points, catalog.supposed(plan).points)
    # Else nothing is tested: in the scan alone the straight way between the walls is open.
    straight = np.linspace(*closing.trajectory.positions[[0, -1]])
    assert path_clearance(scene_for(SCAN, None), straight).distance_m > 1.9 > 1.0 > clear_m(straight)


def for_the_whole(catalog: Catalog, height: float) -> str:
    """A plan in force for the whole structure, flown across it, which is then replaced by the scan."""
    y = np.linspace(-8.0, 8.0, 60)
    at = np.column_stack([np.full(60, MIDDLE), y, np.full(60, height)])
    path = Trajectory(np.arange(60.0), at, from_yaw_pitch(0 * y, np.full(60, -1.2)))
    fields = {"trajectory": path, "is_viewpoint": np.arange(60) % 8 == 0, "flyable": True}
    record = Plan("ring", "body", "larger", "tank", "recommended", "ok", **fields)
    catalog.add_structures([WHOLE])
    catalog.add_plans([(key(f"whole {height}"), record, {"settings": SETTINGS})])
    plan = only(catalog)
    catalog.release(plan, "Grace")
    catalog.add_structures([SCAN])
    assert catalog.supposed(plan) is None
    return plan


@pytest.mark.slow
def test_what_a_new_file_lacks_is_found_when_a_plan_is_judged_again(catalog, planned) -> None:
    plan = for_the_whole(catalog, 8.0)
    (verdict,) = recheck(catalog)
    assert not verdict.recalled
    assert np.allclose(catalog.supposed(plan).points, planned[1].supposed.points, atol=1e-6)
    assert np.allclose(catalog.plan(plan).supposed.points, planned[1].supposed.points, atol=1e-6)
    assert verify(catalog) == []
    catalog.add_structures([WHOLE])
    recheck(catalog)
    assert catalog.supposed(plan) is None


@pytest.mark.slow
def test_a_plan_that_comes_too_near_to_what_a_new_file_lacks_is_recalled(catalog) -> None:
    for_the_whole(catalog, 4.2)  # 0.6 m above the structure, 2.8 m from what was scanned
    (verdict,) = recheck(catalog)
    assert verdict.recalled and "from unscanned surface" in verdict.note
