"""The gap of a flight holds the zones that neither it nor its plan showed as they ask."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
import pytest
from made_plans import plan_as_demonstrated

from upplied.catalog import open_catalog, verify
from upplied.catalog.database import Catalog
from upplied.cli import main
from upplied.config import CloudSettings
from upplied.errors import RefusedError
from upplied.fleet.flight_logs import add_flight_logs, zones_left_out
from upplied.fleet.gaps import plan_gap
from upplied.geometry.poses import matrices, yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.outputs.logs import write_log
from upplied.outputs.zones import zones
from upplied.planning.airspace.rules import path_clearance
from upplied.planning.surface.samples import surface_samples
from upplied.planning.visibility.observations import stations
from upplied.proof import required_zones
from upplied.proof.looks import looks_of
from upplied.records import Camera, Plan, Surroundings, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
from upplied.simulate import fly_trajectory

CUBE = replace(member("cube-v1").structure, surroundings=Surroundings(ground_z_m=0.0))
LOW, HIGH = CUBE.vertices.min(axis=0), CUBE.vertices.max(axis=0)
CAMERA = Camera(70.0, 55.0, 1.0, 25.0, 4000, 3000)  # 2 mm a pixel from 5.7 m
FLOWN = replace(fly(CUBE, "sides", seed=1), camera=CAMERA)
COARSE = CloudSettings(surface_samples=1500)
SURFACE = surface_samples(CUBE, scene_of(CUBE), COARSE)
STRIP = SURFACE.points[:, 0] <= LOW[0] + 3.0
TOP, UNDER = STRIP & (SURFACE.normals[:, 2] > 0.9), STRIP & (SURFACE.normals[:, 2] < -0.9)
ROOF_M2, FLOOR_M2 = (float(SURFACE.area_m2[side].sum()) for side in (TOP, UNDER))


def box(low_z: float, high_z: float) -> str:
    corners = [*LOW[:2], low_z, LOW[0] + 3.0, HIGH[1], high_z]
    return "box " + " ".join(map(str, corners))


ROOF = {"zone": "roof", "where": box(HIGH[2] - 1e-6, HIGH[2] + 1e-6), "gsd_mm": 2.0, "incidence_deg": 20.0}
FLOOR = {"zone": "floor", "where": box(LOW[2] - 1e-6, LOW[2] + 1e-6)}


@pytest.fixture(scope="module")
def base_plan() -> Plan:
    return plan_as_demonstrated(CUBE, FLOWN, SURFACE)


@pytest.fixture
def catalog(tmp_path, base_plan, monkeypatch) -> Catalog:
    monkeypatch.setattr(
        required_zones, "CloudSettings", lambda: COARSE
    )  # as fine as a gap needs to be told by
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([CUBE])
    catalog.add_demonstrations([FLOWN])
    catalog.add_plans([(hashlib.sha256(b"plan").hexdigest(), base_plan, {})])
    return catalog


def flown(catalog: Catalog, plan: str, path: Trajectory, name: str) -> dict[str, object]:
    """A path that was flown as it was planned."""
    looks = looks_of(path, SURFACE, CAMERA, scene_of(CUBE))
    row = {
        "flight_id": name * 64, "transfer_id": plan, "kind": "flown", "target_id": "cube-v1",
        "demonstration_id": FLOWN.demonstration_id, "flown_at": catalog.clock.now(), "required_pct": 100.0,
        "looks_sha256": catalog.put_looks(SURFACE.points, SURFACE.normals, looks.seen, looks.values),
    }  # fmt: skip
    catalog.add_flight(row, path)
    return row


def shown_as_asked(path: Trajectory, points: np.ndarray, farthest_m: float, incidence_deg: float):
    """Which points of the roof some pose shows; a cube hides none of it from whoever is above it."""
    poses = stations(path)
    ray = points[None] - poses.positions[:, None]
    ahead, left, up = np.moveaxis(np.einsum("pij,pni->pnj", matrices(poses.quat_xyzw), ray), 2, 0)
    away = np.linalg.norm(ray, axis=2)
    inside = (ahead > 0) & (abs(left) <= ahead * np.tan(np.radians(CAMERA.hfov_deg / 2)))
    inside &= abs(up) <= ahead * np.tan(np.radians(CAMERA.vfov_deg / 2))
    frontal = -ray[..., 2] / away >= np.cos(np.radians(incidence_deg))
    return (inside & frontal & (away <= farthest_m) & (away >= CAMERA.min_range_m)).any(axis=0)


@pytest.mark.slow
def test_a_zone_that_the_plan_does_not_show_is_flown_as_it_asks(catalog, base_plan, capsys):
    (plan,) = catalog.transfers()["transfer_id"]
    row = flown(catalog, plan, base_plan.trajectory, "a")
    with pytest.raises(RefusedError, match="is empty"):  # all that is planned was seen
        plan_gap(catalog, "aaa")
    catalog.require("structure", "cube-v1", "monthly", [ROOF, FLOOR], "Ada")
    assert zones_left_out(catalog, row) == "zone roof"  # of the floor nothing can be seen
    assert main(["flights", "gap", "aaa", "--catalog", catalog.location]) == 0
    output = capsys.readouterr().out
    (gap,) = catalog.transfers(every=True).query("purpose != ''")["transfer_id"]
    closing = catalog.plan(gap)
    assert pytest.approx(36.0, rel=0.05) == ROOF_M2 and pytest.approx(36.0, rel=0.05) == FLOOR_M2
    roof, floor = (
        next(w for w in closing.warnings if f"zone {name} (monthly 1)" in w) for name in ("roof", "floor")
    )
    assert roof in output and floor in output
    assert roof.endswith(f"shows {ROOF_M2:.1f} of {ROOF_M2:.1f} m2 that was not seen as it asks")
    assert f"shows 0.0 of {FLOOR_M2:.1f} m2" in floor and f"{FLOOR_M2:.1f} m2 of it no safe pose" in floor
    # by an own test of every look, from near and frontally enough; safe, and for a gimbal
    top = SURFACE.points[TOP]
    farthest = 2e-3 * 2000 / np.tan(np.radians(35.0))
    path = closing.trajectory
    assert not shown_as_asked(base_plan.trajectory, top, farthest, 20.0).any()
    assert shown_as_asked(path, top, farthest + 1e-6, 20.001).all()
    assert path_clearance(scene_of(CUBE), path.positions).distance_m >= 1.99
    assert np.degrees(yaw_pitch(path.quat_xyzw)[1]).max() <= 30.001 and path.positions[:, 2].min() >= 0
    # the same again, and once it was flown, the zone is met and nothing is left that can be seen
    assert plan_gap(catalog, "aaa") == gap and verify(catalog) == []
    after = flown(catalog, gap, path, "b")
    verdict = {each["zone"]: each["flown"] for each in zones(catalog, "cube-v1")}
    assert verdict == {"roof": "met", "floor": "unattainable"} and zones_left_out(catalog, after) == ""
    with pytest.raises(RefusedError, match=rf"from any safe pose; {FLOOR_M2:.1f} m2 of zone floor"):
        plan_gap(catalog, "aaa")


@pytest.mark.slow
def test_what_a_zone_asks_beyond_the_plan_is_added_to_what_the_flight_missed(catalog, base_plan):
    (plan,) = catalog.transfers()["transfer_id"]
    half = base_plan.trajectory.take(base_plan.trajectory.t_s <= 70.0)
    flown(catalog, plan, half, "a")
    before = plan_gap(catalog, "aaa")
    catalog.require("structure", "cube-v1", "monthly", [ROOF], "Ada")
    both = plan_gap(catalog, "aaa")
    one, two = catalog.plan(before), catalog.plan(both)
    states = [catalog.surface(name).state for name in (before, both)]
    assert (states[1][TOP] == 1).all() and not (states[0][TOP] == 1).all()
    assert ((states[1] == 1) >= (states[0] == 1)).all()
    shows = "shows 100.0 % of the gap as near and as frontally as planned; "
    assert len(one.warnings) == 2 and one.warnings[0].startswith(shows)
    assert two.warnings[0].startswith(shows) and len(two.warnings) == 3
    # nothing is asked any more: the very plan of before
    catalog.require("structure", "cube-v1", "monthly", [], "Ada")
    assert plan_gap(catalog, "aaa") == before


@pytest.mark.slow
def test_more_than_a_camera_tells_is_said_to_be_unattainable(catalog, base_plan):
    (plan,) = catalog.transfers()["transfer_id"]
    half = base_plan.trajectory.take(base_plan.trajectory.t_s <= 70.0)
    flown(catalog, plan, half, "a")
    catalog.require("structure", "cube-v1", "fine", [{**ROOF, "gsd_mm": 0.2, "looks": 2}], "Ada")
    closing = catalog.plan(plan_gap(catalog, "aaa"))  # from 0.6 m alone: nearer than is safe
    assert f"shows 0.0 of {ROOF_M2:.1f} m2" in closing.warnings[1]
    assert f"{ROOF_M2:.1f} m2 of it no safe pose shows so; it requires 2 pictures" in closing.warnings[1]


@pytest.mark.ci
def test_a_log_that_comes_in_tells_once_which_zones_it_left_out(catalog, base_plan, tmp_path):
    catalog.require("structure", "cube-v1", "monthly", [ROOF], "Ada")
    path = fly_trajectory(base_plan.trajectory.take(base_plan.trajectory.t_s <= 70.0), seed=1)
    t_ns = FLOWN.t_ns[0] + np.round(path.t_s * 1e9).astype(np.int64)
    record = replace(
        FLOWN, demonstration_id="back", t_ns=t_ns, positions=path.positions, quat_xyzw=path.quat_xyzw
    )
    log = write_log(tmp_path / "back.mcap", record, CUBE, heavy_topic=False)
    (first,), (again,) = (add_flight_logs(catalog, [log]) for _ in range(2))
    assert first["status"] == "added" and first["left_out"].endswith("% of what its plan shows, zone roof")
    assert again["status"] == "unchanged" and again["left_out"].endswith("% of what its plan shows")
