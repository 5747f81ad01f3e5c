"""A flight that zooms: each pose is judged, planned and exported by the camera that it had."""

from __future__ import annotations

import csv
import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from made_flights import flights
from mcap_ros2.reader import read_ros2_messages
from planning_ruler import seen_along
from pymavlink import mavutil
from random_members import random_member

from upplied.catalog import Catalog
from upplied.catalog.schema.plan_rows import transfer_id
from upplied.catalog.schema.steps import unlike
from upplied.catalog.verbs import queries
from upplied.config import settings_for
from upplied.errors import RefusedError
from upplied.geometry.poses import interpolate
from upplied.outputs.missions import MissionOptions, export
from upplied.outputs.render import export_transfer
from upplied.outputs.reports import plan_of
from upplied.planning.plan import plan_transfer
from upplied.records import Demonstration, Placement, Plan, Structure

WIDE, NARROW = 75.0, 30.0
ELSEWHERE = Placement(47.0, 8.0, 400.0, 0.0, "amsl")


def zooming(flown: Demonstration) -> Demonstration:
    """The flight, its second half through a narrow field of view."""
    angle = np.where(np.arange(len(flown)) < len(flown) // 2, WIDE, NARROW)
    camera = replace(flown.camera, hfov_deg=NARROW, vfov_deg=NARROW)
    return replace(flown, camera=camera, fov_deg=np.column_stack([angle, angle]), sha256="zoomed")


@pytest.fixture(scope="module")
def planned() -> tuple[Demonstration, Structure, Plan]:
    source, flown = flights("box", 0)
    target = replace(random_member("box", 2).structure, placement=ELSEWHERE)
    flown = zooming(flown)
    plan = plan_transfer(flown, source, target, settings_for("recommended"))
    assert plan.status == "ok" and plan.trajectory is not None
    return flown, target, plan


@pytest.mark.slow
def test_what_a_plan_claims_to_show_a_ray_caster_of_its_own_sees_with_the_camera_of_each_pose(
    planned,
) -> None:
    flown, target, plan = planned
    # Some samples are seen for less than half a second: the plan leads aside to see them.
    path = interpolate(plan.trajectory, np.arange(0, plan.trajectory.t_s[-1], 0.1))
    shown = np.flatnonzero(plan.surface.state == 1)[::7]
    points, normals = plan.surface.points[shown], plan.surface.normals[shown]
    seen = {
        angle: seen_along(target, path, fields, flown.camera, points, normals).mean()
        for angle, fields in (
            ("own", path.fov_deg),
            ("narrow", np.full((len(path), 2), NARROW)),
        )
    }
    assert seen["own"] > 0.99
    assert seen["narrow"] < 0.8, "one narrow camera does not show it: the claim rests on the zoom"


def test_a_plan_zooms_as_the_flight_did(planned) -> None:
    _, _, plan = planned
    angle = plan.trajectory.fov_deg[:, 0]
    assert angle.min() == pytest.approx(NARROW) and angle.max() == pytest.approx(WIDE)
    # A pass that is added back along the flight zooms out again, as the flight did there.
    demonstrated = angle[~plan.added]
    assert (np.diff(demonstrated) <= 1e-9).all(), "it zooms in once, and never out"
    assert 0.2 < np.mean(demonstrated > 60) < 0.85


@pytest.mark.slow
def test_a_wide_look_does_not_stand_in_for_a_narrow_one_from_as_near() -> None:
    """What was resolved by a narrow camera is not resolved as well by a wide one from the same place."""
    source, flown = flights("box", 0)
    near, wide = zooming(flown), zooming(flown)
    wide = replace(wide, fov_deg=np.full((len(flown), 2), WIDE), sha256="wide")
    near = replace(near, fov_deg=np.full((len(flown), 2), NARROW), sha256="near")
    results = [
        plan_transfer(each, source, source, settings_for("recommended")).measures for each in (near, wide)
    ]
    narrow_mm, wide_mm = (measures.gsd_demonstrated_mm_p50 for measures in results)
    # Not the same patches count: what the wide one has in its picture besides, it shows obliquely.
    assert wide_mm / narrow_mm == pytest.approx(
        np.tan(np.radians(WIDE / 2)) / np.tan(np.radians(NARROW / 2)), rel=0.2
    )


@pytest.mark.slow
def test_each_format_that_can_say_a_zoom_says_it_and_the_others_refuse(planned, tmp_path: Path) -> None:
    flown, target, plan = planned

    def written(format: str, **options) -> bytes:
        goal = tmp_path / f"a.{format}"
        return (
            export(plan, target, format, goal, MissionOptions(**options), flown.camera).paths[0].read_bytes()
        )

    rows = list(csv.DictReader(io.StringIO(written("csv").decode())))
    angles = [float(row["hfov_deg"]) for row in rows]
    assert min(angles) == pytest.approx(NARROW) and max(angles) == pytest.approx(WIDE)
    points = [each["properties"] for each in json.loads(written("geojson"))["features"][1:]]
    assert [point["hfov_deg"] for point in points] == pytest.approx(angles, abs=0.01)
    commands = [
        (int(item["command"]), item["params"]) for item in json.loads(written("qgc-plan"))["mission"]["items"]
    ]
    common = mavutil.mavlink
    zooms = [params[1] for command, params in commands if command == common.MAV_CMD_SET_CAMERA_ZOOM]
    ends = [WIDE if angle > 60 else NARROW for angle in (angles[0], angles[-1])]
    assert [zooms[0], zooms[-1]] == pytest.approx(ends, rel=0.02) and ends[0] == WIDE
    assert min(zooms) == pytest.approx(NARROW, rel=0.02)
    kinds = {params[0] for command, params in commands if command == common.MAV_CMD_SET_CAMERA_ZOOM}
    assert kinds == {common.ZOOM_TYPE_HORIZONTAL_FOV}
    with zipfile.ZipFile(io.BytesIO(written("dji-wpml", drone="m30t"))) as archive:
        lines = archive.read("wpmz/waylines.wpml").decode().split("<wpml:focalLength>")[1:]
    focal = [float(line.split("<")[0]) for line in lines]
    assert [focal[0], focal[-1]] == pytest.approx(18 / np.tan(np.radians(np.array(ends) / 2)), rel=0.02)
    assert max(focal) == pytest.approx(18 / np.tan(np.radians(NARROW / 2)), rel=0.02)
    infos = read_ros2_messages(io.BytesIO(written("mcap")), topics=["/plan/camera_info"])
    fields = [2 * np.degrees(np.arctan(each.ros_msg.width / 2 / each.ros_msg.k[0])) for each in infos]
    assert fields == pytest.approx(plan.trajectory.fov_deg[:, 0], abs=1e-6)
    for format, options in (("litchi", {}), ("qgc-plan", {"firmware": "ardupilot"})):
        with pytest.raises(RefusedError, match="zoom"):
            written(format, **options)
    forced = tmp_path / "forced.csv"
    overruled = MissionOptions(force=("zoom", "coverage"))
    notes = export(plan, target, "litchi", forced, overruled, flown.camera).notes
    assert any(note.startswith("OVERRULED zoom") for note in notes)


@pytest.mark.slow
def test_a_plan_that_does_not_zoom_is_told_nothing_of_it(tmp_path: Path) -> None:
    source, flown = flights("box", 0)
    source = replace(source, placement=ELSEWHERE)
    plan = plan_transfer(flown, source, source, settings_for("recommended"))
    for format in ("qgc-plan", "litchi", "csv"):
        written = export(plan, source, format, tmp_path / format, camera=flown.camera).paths[0].read_text()
        assert '"command": 531' not in written
    assert {row["hfov_deg"] for row in csv.DictReader(io.StringIO(written))} == {""}


def test_a_catalog_keeps_the_zoom_and_notices_when_it_is_changed(planned, tmp_path: Path) -> None:
    flown, target, plan = planned
    source, _ = flights("box", 0)
    catalog = Catalog(tmp_path / "catalog").create()
    catalog.add_structures([source, target])
    catalog.add_demonstrations([flown])
    assert np.array_equal(catalog.demonstration(flown.demonstration_id).fov_deg, flown.fov_deg)
    catalog.add_plans([("a" * 64, plan, {})])
    name = transfer_id("a" * 64)
    again = catalog.plan(name).trajectory
    assert np.array_equal(again.fov_deg, plan.trajectory.fov_deg)
    listed = catalog.transfers(every=True).iloc[0]
    assert np.array_equal(plan_of(catalog, listed).trajectory.fov_deg, again.fov_deg), "as it is exported"
    assert np.array_equal(catalog.path_of(catalog.transfer(name)).fov_deg, again.fov_deg)
    with pytest.raises(RefusedError, match="zoom"):
        export_transfer(catalog, name, "litchi", tmp_path / "a.csv", MissionOptions(draft=True))
    row = catalog.transfer(name)
    steps = queries.steps(catalog.tables["waypoints"], row)
    spoilt = np.array(steps["hfov_deg"]).copy()
    spoilt[len(spoilt) // 2] += 5
    at = steps.column_names.index("hfov_deg")
    wrong = steps.set_column(at, steps.schema.field(at), pa.chunked_array([spoilt]))
    hashes = {(name, row["commit_id"]): (row["n_waypoints"], row["waypoints_sha256"])}
    assert not list(unlike("waypoints", steps, hashes))
    assert [column for column, _ in unlike("waypoints", wrong, hashes)] == [name]
