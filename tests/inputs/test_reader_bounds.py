"""Bounds of the reader, each by a case on either side of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_logs import Flight
from made_sources import WRITERS
from scipy.spatial.transform import Rotation
from test_separation import scanned

from upplied.errors import InputError
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.geometry.separation import separated
from upplied.inputs import repair
from upplied.inputs.concerns import concerns, cut_off
from upplied.inputs.flight.clean import UNSET, breaks, clean, paced, steady
from upplied.inputs.flight.inspection import phases
from upplied.inputs.flight.tracks import Track, at_times
from upplied.inputs.logs import read_demonstration
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.passport import fits
from upplied.inputs.passport.measured import _best, _off_centre
from upplied.inputs.passport.sight import aim_of, inside, sight_of, steadiness
from upplied.inputs.raw import RawMesh
from upplied.inputs.repair import topology_of
from upplied.inputs.rules import PassportSettings
from upplied.inputs.sidecar import LogOptions
from upplied.records import Camera, Surroundings
from upplied.samples.fleet import member

CUBE = member("cube-v1").structure
SCENE = scene_of(CUBE)
MIDDLE = (CUBE.vertices.min(axis=0) + CUBE.vertices.max(axis=0)) / 2
SIDE = float(np.ptp(CUBE.vertices[:, 0]))


def ring(count: int = 300, radius: float = 2.0, off: float = 0.0) -> Track:
    """Round the cube at some sides' distance, looking at its middle; `off` deg to the left."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    around = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    places = MIDDLE + radius * SIDE * around
    quats = from_yaw_pitch(angle + np.pi + np.radians(off), 0 * angle)
    t_ns = 1_700_000_000 * 10**9 + np.arange(count, dtype=np.int64) * 100_000_000
    return Track(t_ns, places, quats, t_ns)


def test_the_aim_is_a_line_only_where_most_of_the_flight_lies_near_it() -> None:
    flown = ring(off=20.0)
    assert aim_of(flown.positions, flown.quat_xyzw, SCENE).aim_off_deg == pytest.approx(20, abs=3)
    rng = np.random.default_rng(0)
    wild = ring(off=20.0).quat_xyzw.copy()
    some = np.arange(len(wild)) % 20 < 5  # every fourth look goes anywhere between 30 and 70 deg aside
    aside = np.radians(rng.uniform(30, 70, some.sum()) * rng.choice([-1, 1], some.sum()))
    wild[some] = (Rotation.from_rotvec(np.outer(aside, [0, 0, 1])) * Rotation.from_quat(wild[some])).as_quat()
    aim = aim_of(flown.positions, wild, SCENE)
    assert (aim.aim_off_deg, aim.aim_drift_deg) == (0.0, 0.0)


def test_a_camera_in_the_ground_fits_no_inspection() -> None:
    flown = ring(40)

    def share(ground_m: float) -> float:
        return float(fits.fits(flown.positions[None], flown.quat_xyzw[None], SCENE, ground_m, 1e3)[0])

    assert share(float(flown.positions[:, 2].min()) - 0.1) == 1.0
    assert share(float(flown.positions[:, 2].max()) + 0.1) == 0.0


def test_of_conventions_that_fit_alike_the_common_one_is_named() -> None:
    """Headings half a turn off: the compass, and a mount that looks back. Mounts are met more often."""
    flown = ring(60)
    back = replace(flown, quat_xyzw=from_yaw_pitch(np.arctan2(*flown.positions[:, [1, 0]].T), np.zeros(60)))
    _, candidates = fits.Comparison(back, lambda track: track, SCENE, -np.inf, 1e3).best_fits()
    alike = {fit.convention.name: fit for fit in candidates if fit.share > 0.99}
    assert {"heading offset -180 deg", "mount +180 +0"} <= alike.keys() | {"heading offset +180 deg"}
    assert candidates[0].convention.rare == min(fit.convention.rare for fit in alike.values())
    rare = [fit.convention.rare for fit in candidates if fit.share > 0.99]
    assert rare == sorted(rare)


@pytest.mark.parametrize(("share", "first"), [(0.93, "ned"), (0.99, "offset")])
def test_a_rare_mistake_is_named_where_it_fits_clearly_better(monkeypatch, share: float, first: str) -> None:
    def shares_of(positions, quats, *others):
        shares = np.full(len(positions), 0.2)
        if len(positions) > 1:
            shares[0], shares[-1] = 0.90, share
        return shares

    monkeypatch.setattr(fits, "fits", shares_of)
    flown = ring(60)
    candidates = fits.Comparison(flown, lambda track: track, SCENE, -np.inf, 1e3).best_fits()[1]
    assert candidates[0].convention.name.split(" ")[0] == first


def test_where_two_conventions_fit_alike_both_are_named() -> None:
    one, other = (fits.Fit(fits.NAMED[name], 0.9) for name in ("mirrored-x", "mirrored-y"))
    words = _best([one, other])
    assert "(mirrored-y)" in words["other_words"] and "fit both alike" in words["other_advice"]
    alone = _best([one, replace(other, share=0.8)])
    assert "(mirrored-y)" not in alone["other_words"] and "fit both alike" not in alone["other_advice"]


@pytest.mark.parametrize(("ratio", "named"), [(6.0, True), (8.0, False)])
def test_a_steadier_stand_off_is_named_beyond_its_ratio_alone(ratio: float, named: bool) -> None:
    """Before two sides of a box of 12 m x 10 m at 3 m; with x and y exchanged at 2 m and at 4 m."""
    box = replace(CUBE, vertices=(CUBE.vertices - MIDDLE) / SIDE * [12, 10, 10])
    along = np.linspace(-3, 3, 40)
    places = np.vstack([np.column_stack([0 * along + 9, along, 0 * along + 3]),
                        np.column_stack([along, 0 * along + 8, 0 * along + 3])])  # fmt: skip
    quats = from_yaw_pitch(np.repeat([np.pi, -np.pi / 2], 40), np.zeros(80))

    def steadier(poses: fits.Poses, reach: float = 1e3) -> tuple[np.ndarray, np.ndarray, list[fits.Fit]]:
        track = Track(np.arange(80) + 1, *poses, np.arange(80) + 1)
        near = lambda logged: logged.take(logged.positions[:, 0] < reach)  # noqa: E731 - what a mount is known for
        return fits.Comparison(track, near, scene_of(box), 0.0, 1e3).steadier(ratio)

    expected = pytest.approx([0, 0, 1 / 3, 0], abs=1e-4)  # the last in degrees, of single precision
    assert steadier((places, quats)) == (expected, expected, [])
    varies, least, best = steadier(fits.NAMED["swapped-xy-poses"].change(places, quats))
    assert varies == pytest.approx([np.log(2) / 2, 0, 1 / 2, 0], abs=1e-3)
    assert [fit.convention.name for fit in best] == ["swapped-xy-poses"] * named
    assert least == (expected if named else pytest.approx(varies, abs=1e-4))
    poses = fits.NAMED["swapped-xy-poses"].change(places, quats)
    assert not steadier(poses, 8.5)[2]  # by that convention half of the poses have no mount


@pytest.mark.parametrize(("near_m", "named"), [(1.4, ["mirrored-x-poses"]), (1.6, [])])
def test_a_flight_that_is_near_names_the_convention_in_which_it_keeps_clear(
    near_m: float, named: list
) -> None:
    """Before a wall that stands twice as far from the origin as the path would be nearest, mirrored."""
    wall = replace(CUBE, vertices=(CUBE.vertices - MIDDLE) / SIDE * [2, 30, 20] + [1, 0, 10])
    along = np.linspace(-8, 8, 60)
    places = np.column_stack([0 * along + 2 + near_m, along, 0 * along + 8])
    quats = from_yaw_pitch(np.full(60, np.pi), np.zeros(60))
    track = Track(np.arange(60) + 1, places, quats, np.arange(60) + 1)
    _, least, best = fits.Comparison(track, lambda each: each, scene_of(wall), 0.0, 1e3).steadier(3.0)
    assert [fit.convention.name for fit in best] == named
    assert 1 / least[2] == pytest.approx(2 + near_m if named else near_m)


def test_an_offset_is_told_with_its_sign() -> None:
    """The log lies 3 m to +X of where it was flown: the stand-off is larger on that side."""
    flown = ring(400, radius=2.0)
    shift = np.array([3.0, 0.0, 0.0])
    sight = sight_of(flown.positions + shift, flown.quat_xyzw, Camera(max_range_m=1e3), CUBE, SCENE)
    (x, y), sure = _off_centre(sight, flown.quat_xyzw)
    assert x == pytest.approx(3.0, abs=1.0) and abs(y) < 0.5 and sure > 0.3


def test_between_two_walls_is_not_inside_one() -> None:
    """A place in the hollow of a box with walls: every ray crosses two surfaces, an even number."""
    low, high = CUBE.vertices.min(axis=0), CUBE.vertices.max(axis=0)
    inner = (CUBE.vertices - MIDDLE) * 0.9 + MIDDLE
    walls = replace(
        CUBE,
        vertices=np.vstack([CUBE.vertices, inner]),
        triangles=np.vstack([CUBE.triangles, CUBE.triangles[:, ::-1] + len(CUBE.vertices)]),
    )
    scene = scene_of(walls)
    in_wall = np.array([MIDDLE[0], MIDDLE[1], high[2] - 0.02 * (high - low)[2]])
    assert inside(in_wall[None], SCENE).all() and inside(MIDDLE[None], SCENE).all()
    assert inside(in_wall[None], scene).all()
    assert not inside(MIDDLE[None] + 0.01, scene).any()


def test_a_flight_breaks_where_its_estimator_was_reset() -> None:
    flown = replace(ring(50), epoch=np.repeat([0, 7], 25))
    where, words = breaks(flown, 0.5)
    assert list(where) == [25] and words == ["1 estimator reset"]


@pytest.mark.parametrize(("passed_s", "counted_s"), [(3, 3), (59, 59), (61, 0)])
def test_a_clock_that_steps_goes_on_by_the_recorders(passed_s: int, counted_s: int) -> None:
    """Unless the recorder's own stepped as well: by more than a minute."""
    flown = ring(100)
    log_ns = flown.t_ns.copy()
    log_ns[50:] += passed_s * 10**9  # the recorder saw it pass
    t_ns = log_ns.copy()
    t_ns[50:] -= (17 + passed_s) * 10**9
    track = steady(replace(flown, t_ns=t_ns, log_ns=log_ns))
    assert track.clock_steps == 1
    log_ns[50:] += (counted_s - passed_s) * 10**9
    assert np.array_equal(track.t_ns, log_ns)


@pytest.mark.parametrize(("silence_s", "long"), [(4.9, 0), (5.1, 1)])
def test_a_gap_is_a_transit_beyond_its_bound_alone(silence_s: float, long: int) -> None:
    flown = ring(100)
    t_ns = flown.t_ns.copy()
    t_ns[50:] += round(silence_s * 1e9) - 100_000_000
    _, pace = paced(replace(flown, t_ns=t_ns), 0.5, PassportSettings())
    assert (pace.gaps, pace.long_gaps) == (1, long)


def test_nothing_is_interpolated_across_a_reset() -> None:
    flown = replace(ring(20), epoch=np.repeat([0, 1], 10))
    between = flown.t_ns[[4, 9]] + 50_000_000
    positions, quats = at_times(flown, between, 0.5)
    assert np.isfinite(positions[0]).all() and np.isnan(positions[1]).all() and np.isnan(quats[1]).all()


@pytest.mark.parametrize(("slope", "has_ground"), [(0.2, True), (0.5, False)])
def test_ground_that_is_steep_is_none(slope: float, has_ground: bool) -> None:
    scene, _ = scanned("turbine-1-v1", slope)
    assert (separated(scene).ground_z_m is not None) == has_ground


def test_what_floats_or_was_cut_off_is_told() -> None:
    entry = StructureEntry("hall", "building", Path("hall.stl"), surroundings=Surroundings(ground_z_m=0.0))
    assert rules_of(CUBE.vertices, entry) == set()
    assert rules_of(CUBE.vertices + np.array([0, 0, 30.0]), entry) == {"floating"}
    ship = member("cruise-v1").structure
    vertices, triangles, _, _ = repair.clean(ship.vertices, ship.triangles)
    assert not list(cut_off(vertices, topology_of(triangles).rim))
    flat = vertices[:, [2, 1, 0]] * [-1, 1, 1]  # on its stern, and cut 35 % below its bow
    at = float(np.quantile(flat[:, 2], 0)) + 0.35 * float(np.ptp(flat[:, 2]))
    rest, corners, _ = repair.clip_below(flat, triangles, at)
    rest, corners, _, _ = repair.clean(rest[:, [2, 1, 0]] * [1, 1, -1], corners)
    (verdict,) = cut_off(rest, topology_of(corners).rim)
    assert verdict.rule == "cut-off" and f"x = {at:.1f} m" in verdict.found


def rules_of(vertices: np.ndarray, entry: StructureEntry) -> set[str]:
    raw = RawMesh(vertices)
    return {item.rule for item in concerns(vertices, raw, entry, np.eye(3))} & {"floating", "below-ground"}


def test_an_attitude_that_was_never_set_is_left_out_and_one_that_is_level_stays() -> None:
    flown = ring(100)
    flown.quat_xyzw[40:60] = [0, 0, 0, 1]
    cleaned = clean(flown, LogOptions(), "a flight")
    assert len(cleaned) == 80 and cleaned.dropped[UNSET] == 20
    level = replace(ring(100), quat_xyzw=np.tile([0.0, 0, 0, 1], (100, 1)))
    assert len(clean(level, LogOptions(), "a flight")) == 100


def test_jumps_spikes_and_a_rolled_camera_are_measured() -> None:
    flown = ring(300)
    assert (steadiness(flown, flown, 0.5).jumps, steadiness(flown, flown, 0.5).spikes) == (0, 0)
    places = flown.positions.copy()
    places[150:] += [0.0, 0.0, 1.1]
    jumped = steadiness(flown, replace(flown, positions=places), 0.5)
    assert (jumped.jumps, jumped.spikes) == (1, 0) and jumped.jump_m == pytest.approx(1.1, abs=0.2)
    places = flown.positions.copy()
    places[[50, 120, 200]] += [0.0, 0.0, 3.0]
    assert steadiness(flown, replace(flown, positions=places), 0.5).spikes == 3
    for degrees in (0.0, 90.0, 180.0):
        turns = Rotation.from_quat(flown.quat_xyzw) * Rotation.from_euler("x", degrees, degrees=True)
        rolled = replace(flown, quat_xyzw=turns.as_quat())
        assert steadiness(flown, rolled, 0.5).roll_deg == pytest.approx(degrees, abs=1e-3)
    faster = replace(flown, t_ns=flown.t_ns[0] + (flown.t_ns - flown.t_ns[0]) * 3)
    assert steadiness(faster, faster, 0.5).clock_ratio == pytest.approx(3.0)


def whole(flown: Track, still_s: float = 30.0) -> Track:
    """The flight with a stand on the ground, a climb and a transit at either end."""
    first = flown.positions[0]
    home = np.array([*MIDDLE[:2] + 2.25 * (first - MIDDLE)[:2], MIDDLE[2] - SIDE / 2])
    top = np.array([*home[:2], first[2] + 6])
    legs = [np.tile(home, (int(still_s * 10), 1)), np.linspace(home, top, 40), np.linspace(top, first, 60)]
    out = np.concatenate(legs)
    places = np.concatenate([out, flown.positions, out[::-1]])
    away = np.tile(from_yaw_pitch(np.zeros(1), np.zeros(1)), (len(out), 1))  # it looks away from the cube
    quats = np.concatenate([away, flown.quat_xyzw, away])
    t_ns = flown.t_ns[0] + np.arange(len(places), dtype=np.int64) * 100_000_000
    return Track(t_ns, places, quats, t_ns)


def test_the_inspection_is_found_between_ground_climb_and_transit() -> None:
    flown = ring(300)
    parts = phases(whole(flown), SCENE, 1e3)
    assert parts is not None
    assert [name for name, *_ in parts.parts] == [
        "ground",
        "climb",
        "transit",
        "inspection",
        "return",
        "ground",
    ]
    starts = [start for _, start, _ in parts.parts]
    assert starts == pytest.approx([0, 30, 34, 40, 70, 80], abs=1.5)
    assert starts[1] == pytest.approx(30, abs=1.0) and starts[5] == pytest.approx(80, abs=1.0)
    assert "inspection 40 to 70 s" in str(parts)


def test_between_two_flights_of_a_log_the_stay_on_the_ground_is_left_out() -> None:
    """A battery is changed half way; a hop on the spot is no inspection, a low hover no landing."""
    one, other = whole(ring(300).take(np.arange(150))), whole(ring(300).take(np.arange(150, 300)))
    hop = whole(ring(300).take(np.arange(1)), 20.0)
    names = ("positions", "quat_xyzw")
    both = {name: np.concatenate([getattr(each, name) for each in (one, hop, other)]) for name in names}
    t_ns = one.t_ns[0] + np.arange(len(both["positions"]), dtype=np.int64) * 100_000_000
    parts = phases(Track(t_ns, **both, log_ns=t_ns), SCENE, 1e3)
    assert parts is not None
    assert [name for name, *_ in parts.parts].count("inspection") == 2 and "another flight" in str(parts)
    inspected = parts.inspected((t_ns - t_ns[0]) * 1e-9)
    near = np.linalg.norm(both["positions"] - MIDDLE, axis=1) < 2.01 * SIDE
    assert (inspected == near).mean() > 0.97
    assert parts.between_s == pytest.approx((len(one) - 150 + len(hop)) / 10, abs=4.0)
    low = Track(t_ns[: len(one)], one.positions, one.quat_xyzw, t_ns[: len(one)])
    hover = replace(low, positions=low.positions.copy())
    hover.positions[480:540] = [*low.positions[480, :2], low.positions[0, 2]]
    assert [name for name, *_ in phases(hover, SCENE, 1e3).parts].count("inspection") == 1


def test_of_a_whole_log_the_right_convention_is_named_though_it_fits_a_third_of_it() -> None:
    """Shrunk to a point at the structure, a flight would look at it all the time; but it would not move."""
    flown = whole(ring(600))
    down = replace(flown, positions=flown.positions * [1, 1, -1])
    ground_m = float(flown.positions[:, 2].min()) - 0.1
    share, best = fits.Comparison(down, lambda track: track, SCENE, ground_m, 1e3).best_fits()
    shares = {fit.convention.name: fit.share for fit in best}
    assert share == 0 and shares["z-down"] > 0.95 and best[0].share == shares["ned"]  # alike, round a cube
    assert shares["millimetres"] == shares["inches"] == 0


def test_a_log_of_places_on_the_earth_is_told_of_no_other_axes(tmp_path: Path) -> None:
    """Heights 12 m too low: no side-car moves satellites, so the placement is to be corrected."""
    flown = ring(300)
    low = Flight(flown.t_ns, flown.positions - [0, 0, 12.0], flown.quat_xyzw)
    path, facts = WRITERS["airdata"](tmp_path, low)
    with pytest.raises(InputError, match="structure's place on the Earth, or takeoff_alt_m") as error:
        read_demonstration(path, LogOptions(structure_id="cube-v1", **facts), structures=lambda name: CUBE)
    assert "convention =" not in str(error.value) and "structure_position_m" not in str(error.value)


def test_a_log_that_begins_and_ends_in_the_air_is_taken_whole() -> None:
    assert phases(ring(300), SCENE, 1e3) is None
    aside = ring(300, off=90.0)  # whatever its camera sees
    assert phases(aside, SCENE, 1e3) is None
