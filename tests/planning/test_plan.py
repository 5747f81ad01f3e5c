"""Laws of the whole method: what must hold for any structure and any flight."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.config import settings_for
from upplied.errors import SettingsError
from upplied.geometry.poses import angle_between, from_yaw_pitch, moved, yaw_pitch
from upplied.planning.plan import plan_transfer, transfer_key
from upplied.records import Demonstration
from upplied.samples.fleet import sample_structures
from upplied.samples.pilot import fly


@pytest.fixture(scope="module")
def fleet():
    return {structure.structure_id: structure for structure in sample_structures()}


@pytest.fixture(scope="module")
def around_cube(fleet):
    return fly(fleet["cube-v1"], "sides", seed=3)


def shifted(structure, turn, shift):
    return replace(structure, vertices=structure.vertices @ turn.T + shift)


def same_plan(a, b, atol):
    np.testing.assert_allclose(a.trajectory.positions, b.trajectory.positions, atol=atol)
    assert angle_between(a.trajectory.quat_xyzw, b.trajectory.quat_xyzw).max() < max(atol, 1e-6)


@pytest.mark.ci
@pytest.mark.parametrize("preset", ["paper", "recommended", "baseline"])
def test_on_the_demonstrated_structure_itself_everything_is_seen_again(fleet, around_cube, preset):
    cube = fleet["cube-v1"]
    plan = plan_transfer(around_cube, cube, cube, settings_for(preset))
    assert plan.status == "ok", plan.reason
    assert plan.measures.coverage_paper_pct == 100
    assert plan.registration.score_m2 == pytest.approx(0, abs=1e-9)
    if preset != "paper":
        # What `recommended` moves for the pixels of what was inspected may cost a little of the background.
        # A plan is made for 1.1 times the demonstrated mm/px, without the jitter that brought a hand nearer.
        assert plan.measures.coverage_inspected_pct > (99.6 if preset == "recommended" else 99.9)
        assert plan.measures.coverage_seen_pct > (99.5 if preset == "recommended" else 99.9)
        # What `recommended` changes is the jitter of the pilot's hand, 0.3 m on a path of 80 m.
        assert plan.measures.frechet_floored < (0.15 if preset == "recommended" else 1e-9)


def test_paper_gives_the_demonstrated_viewpoints_back_on_the_same_structure(fleet, around_cube):
    from upplied.planning.correspondence.pair import study_pair
    from upplied.planning.demonstration.repetition import takes_of

    cube, settings = fleet["cube-v1"], settings_for("paper")
    plan = plan_transfer(around_cube, cube, cube, settings)
    (take,) = takes_of(around_cube, study_pair(cube, cube, settings), settings)
    viewpoints = take.inspection.viewpoints
    np.testing.assert_allclose(plan.trajectory.positions, viewpoints.positions, atol=1e-6)
    assert angle_between(plan.trajectory.quat_xyzw, viewpoints.quat_xyzw).max() < 1e-6


@pytest.mark.ci
def test_stand_off_is_kept_where_geometry_says_so(fleet, around_cube):
    """On a cube of twice the size the box ratio doubles every distance: kept if scaled, lost if in metres."""
    cube = fleet["cube-v1"]
    twice = replace(cube, structure_id="twice", vertices=2 * cube.vertices, sha256="")
    for standoff, percent in (("scaled", 100.0), ("kept", 0.0)):
        settings = settings_for("baseline", transfer={"standoff": standoff})
        assert plan_transfer(around_cube, cube, twice, settings).measures.standoff_kept_pct == percent
    nearer = replace(cube, structure_id="wider", vertices=cube.vertices * [1, 1.5, 1], sha256="")
    plan = plan_transfer(around_cube, cube, nearer, settings_for("baseline", transfer={"standoff": "kept"}))
    assert 0 < plan.measures.standoff_kept_pct < 100  # before two faces as demonstrated, farther from two


@pytest.mark.ci
@pytest.mark.parametrize("preset", ["paper", pytest.param("recommended", marks=pytest.mark.slow), "baseline"])
def test_shifting_both_structures_shifts_the_plan(fleet, around_cube, preset):
    cube, cuboid = fleet["cube-v1"], fleet["cuboid-v1"]
    shift_d, shift_t, turn = np.array([64.0, -32.0, 8.0]), np.array([-16.0, 48.0, 4.0]), np.eye(3)
    settings = settings_for(preset)
    flown = moved(around_cube.trajectory, turn, shift_d)
    there = plan_transfer(
        replace(around_cube, positions=flown.positions),
        without_ground(shifted(cube, turn, shift_d)),
        without_ground(shifted(cuboid, turn, shift_t)),
        settings,
    )
    here = plan_transfer(around_cube, without_ground(cube), without_ground(cuboid), settings)
    back = moved(there.trajectory, turn, -shift_t)
    # An iterative search carries the rounding of the last bit as far as some millimetres.
    same_plan(here, replace(there, trajectory=back), atol=1e-2)
    assert (there.status, len(there.trajectory)) == (here.status, len(here.trajectory))


def without_ground(structure):
    return replace(structure, surroundings=type(structure.surroundings)())


@pytest.mark.ci
@pytest.mark.anew
def test_the_same_inputs_give_the_same_bytes(fleet, around_cube):
    first = plan_transfer(around_cube, fleet["cube-v1"], fleet["cuboid-v1"], settings_for("recommended"))
    again = plan_transfer(around_cube, fleet["cube-v1"], fleet["cuboid-v1"], settings_for("recommended"))
    assert first.trajectory.positions.tobytes() == again.trajectory.positions.tobytes()
    assert first.trajectory.quat_xyzw.tobytes() == again.trajectory.quat_xyzw.tobytes()
    assert first.trajectory.t_s.tobytes() == again.trajectory.t_s.tobytes()
    assert first.measures == again.measures or repr(first.measures) == repr(again.measures)


@pytest.mark.slow
def test_remembered_results_give_the_same_plan(fleet, around_cube):
    store = {}

    def memo(stage, record_type, key, compute):
        record = store.setdefault((stage, key), None) or compute()
        assert isinstance(record, record_type)
        store[stage, key] = record
        return record

    cube, cuboid = replace(fleet["cube-v1"], sha256="c1"), replace(fleet["cuboid-v1"], sha256="c2")
    flown = replace(around_cube, sha256="f1")
    cold = plan_transfer(flown, cube, cuboid, settings_for("recommended"), memo)
    entries = len(store)
    warm = plan_transfer(flown, cube, cuboid, settings_for("recommended"), memo)
    assert entries >= 6 and len(store) == entries
    same_plan(cold, warm, atol=0)


@pytest.mark.ci
def test_another_kind_is_refused_with_a_reason(fleet, around_cube):
    cube, turbine, settings = fleet["cube-v1"], fleet["turbine-1-v1"], settings_for("recommended")
    plan = plan_transfer(around_cube, cube, turbine, settings)
    assert plan.status == "refused" and plan.trajectory is None
    assert "is of kind wind_turbine, the source of kind box" in plan.reason and "declare one" in plan.reason
    # Declared to be of the kind, it is refused for what it is.
    plan = plan_transfer(around_cube, cube, replace(turbine, kind=cube.kind), settings)
    assert plan.status == "refused" and "has a counterpart on turbine-1-v1" in plan.reason
    # For comparison it is planned, and not to be flown.
    plan = plan_transfer(around_cube, cube, turbine, settings_for("baseline"))
    assert plan.trajectory is not None and not plan.flyable and "is of kind wind_turbine" in plan.not_flyable


def test_the_key_depends_on_all_that_goes_in(fleet, around_cube):
    cube, cuboid, settings = fleet["cube-v1"], fleet["cuboid-v1"], settings_for("paper")
    keys = {
        transfer_key(around_cube, cube, cuboid, settings),
        transfer_key(replace(around_cube, sha256="other"), cube, cuboid, settings),
        transfer_key(around_cube, replace(cube, sha256="other"), cuboid, settings),
        transfer_key(around_cube, cube, replace(cuboid, sha256="other"), settings),
        transfer_key(around_cube, cube, cuboid, settings_for("paper", route={"clearance_m": 3.0})),
        transfer_key(around_cube, cube, cuboid, settings_for("baseline")),
    }
    assert len(keys) == 6


@pytest.mark.ci
def test_the_camera_keeps_within_its_gimbal(fleet, around_cube):
    limits = {"min_gimbal_pitch_deg": -20.0, "max_gimbal_pitch_deg": 5.0}
    settings = settings_for("recommended", retime=limits)
    plan = plan_transfer(around_cube, fleet["cube-v1"], fleet["cuboid-v1"], settings)
    pitch = np.degrees(yaw_pitch(plan.trajectory.quat_xyzw)[1])
    assert pitch.min() >= -20 - 1e-6 and pitch.max() <= 5 + 1e-6


def test_settings_that_do_not_go_together_say_so(fleet, around_cube):
    settings = settings_for("recommended", visibility={"occlusion": False})
    with pytest.raises(SettingsError, match="occlusion"):
        plan_transfer(around_cube, fleet["cube-v1"], fleet["cuboid-v1"], settings)


@pytest.mark.ci
def test_a_roof_seen_from_straight_above_is_seen_with_the_same_heading(fleet):
    cube, cuboid = fleet["cube-v1"], fleet["cuboid-v1"]
    low, high = cube.vertices.min(axis=0), cube.vertices.max(axis=0)
    across = np.linspace(low[0] + 1, high[0] - 1, 120)
    lanes = [
        np.column_stack([across[:: (-1) ** lane], np.full(120, y), np.full(120, high[2] + 7)])
        for lane, y in enumerate(np.linspace(low[1] + 1, high[1] - 1, 4))
    ]
    positions = np.concatenate(lanes)
    trembling = Rotation.from_rotvec(np.random.default_rng(5).normal(0, np.radians(0.5), positions.shape))
    down = Rotation.from_quat(from_yaw_pitch(np.full(480, 0.6), np.full(480, -np.pi / 2)))
    flight = Demonstration(
        "roof", cube.structure_id, np.arange(480) * 300_000_000, positions, (down * trembling).as_quat()
    )
    plan = plan_transfer(flight, cube, cuboid, settings_for("recommended"))
    assert plan.status == "ok", plan.reason
    assert plan.measures.coverage_seen_pct > 99 * plan.measures.coverage_attainable_pct / 100
    yaw = np.unwrap(yaw_pitch(plan.trajectory.quat_xyzw)[0])
    assert np.degrees(np.abs(np.diff(yaw)).sum()) < 90


@pytest.mark.parametrize("preset", ["paper", "recommended", "baseline"])
def test_a_flight_that_looks_away_is_refused_with_the_reason(fleet, around_cube, preset):
    yaw, pitch = yaw_pitch(around_cube.quat_xyzw)
    away = replace(around_cube, quat_xyzw=from_yaw_pitch(yaw + np.pi, pitch))
    plan = plan_transfer(away, fleet["cube-v1"], fleet["cuboid-v1"], settings_for(preset))
    assert plan.status == "refused" and plan.trajectory is None
    assert "shows nothing of cube-v1" in plan.reason


@pytest.mark.ci
def test_a_camera_that_looked_higher_than_the_gimbal_may_is_told(fleet, around_cube):
    settings = settings_for("recommended")
    cube, cuboid = fleet["cube-v1"], fleet["cuboid-v1"]
    low = replace(settings, retime=replace(settings.retime, max_gimbal_pitch_deg=-10.0))
    warnings = plan_transfer(around_cube, cube, cuboid, low).warnings
    assert any("max_gimbal_pitch_deg" in warning for warning in warnings)
    untold = plan_transfer(around_cube, cube, cuboid, settings).warnings
    assert not any("gimbal" in warning for warning in untold)


@pytest.mark.slow
def test_a_stand_off_in_metres_is_kept_round_a_structure_twice_as_large(fleet):
    settings = settings_for("recommended")
    unscaled = replace(settings, transfer=replace(settings.transfer, standoff="kept"))
    flight = fly(fleet["a320-v1"], "fuselage", seed=1)
    plan = plan_transfer(flight, fleet["a320-v1"], fleet["b747-v1"], unscaled)
    assert plan.status == "ok", plan.reason
    assert plan.measures.standoff_kept_pct > 90  # 94 with this flight, 97 with another
    # With passes added: the surface is 3.5 times as large, so the carried part may stray, 10 m along 70 m.
    # The other measure divides metres up by a tenth of a level deviation: 1.4 or 1.8 by the processor.
    assert plan.measures.frechet_demonstrated_m < 12 and plan.added.any()
    assert plan.measures.frechet_floored < 2.0
    assert (
        plan.measures.gsd_within_pct > 97 and plan.measures.frechet_demonstrated_m < plan.measures.frechet_m
    )


@pytest.mark.ci
def test_what_comes_too_near_is_said_though_the_surfaces_do_not_correspond(fleet, around_cube):
    """A baseline flight carried to another kind: no correspondence is measured, the distance is."""
    settings = settings_for("baseline", route={"clearance_m": 10.0})
    plan = plan_transfer(around_cube, fleet["cube-v1"], fleet["turbine-1-v1"], settings)
    assert plan.measures.min_clearance_m < 10
    *_, unmeasured, too_near = plan.warnings  # before them: the sizes differ
    assert "was not measured" in unmeasured and "10 m are required" in too_near
