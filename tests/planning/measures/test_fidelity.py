"""How like the demonstration a plan looks: four patches reckoned by hand, and paths of known turns."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.geometry.vectors import sphere
from upplied.planning.carry.inspected_surface import InspectedSurface
from upplied.planning.measures.fidelity import (
    Patches,
    _compared,
    _smoothness,
    bent_rad,
    order_kept,
    turned_rad,
)
from upplied.planning.visibility.looks import Looks
from upplied.planning.visibility.observations import Moments, moments
from upplied.records import Bools, Cloud, Floats, Trajectory

NAN, INF = float("nan"), float("inf")


def dwelt(
    near: list[float], frontal: list[float], dwell: list[float], time: list[float], sides: Bools
) -> Looks:
    known = np.array(near)
    finest = [np.zeros(len(known))] * 5  # what is not asked for here
    return Looks(known, known, np.array(frontal), np.array(dwell), np.array(time), sides, *finest)


def surface(standoff: list[float], need: list[float] | None = None) -> InspectedSurface:
    number = len(standoff)
    return InspectedSurface(
        Cloud(np.zeros((number, 3))), np.array(need or [1.0] * number), np.array(standoff), 0.0
    )


def four_patches() -> tuple[Patches, Looks]:
    """The second and third are shown by the same target sample, the fourth's counterpart is never shown."""
    way = sphere(60)
    one = 7
    near_one = int(np.argsort(-(way @ way[one]))[1])  # told apart from it, but within 30 deg
    other = int(np.argmin(way @ way[one]))
    before, after = np.zeros((4, 60), bool), np.zeros((3, 60), bool)
    before[0, [one, other]] = before[1, one] = before[3, other] = True
    after[0, near_one] = True
    half = np.cos(np.radians(60))
    shown = dwelt(
        [10, 10, 20, 30], [1, half, 1, np.cos(np.radians(30))], [4, 2, 0, 1], [1, 2, NAN, 3], before
    )
    looks = dwelt([40, INF, 10], [half, -1, 1], [1, 0, 5], [5, NAN, 3], after)
    return Patches(np.array([1.0, 2, 1, 1]), np.array([0, 2, 2, 1]), shown), looks


def test_four_patches_reckoned_by_hand() -> None:
    patches, looks = four_patches()
    actual = _compared(patches, looks, surface([10, 30, 10]))
    expected = {
        "fidelity_resolution_p50": 1.0,  # 10/40, 1 (thrice as much) and 0
        "fidelity_resolution_p05": 0.0,
        "fidelity_incidence_deg_p95": 60.0,  # 60 - 0, 0 - 60, 0 and 90 - 30
        "fidelity_looks_kept_pct": 100 * 1 / 5,
        "fidelity_dwell_kept_pct": 100 * (0.25 + 2 + 0) / 4,
        "fidelity_order": -1.0,
    }
    assert actual == pytest.approx(expected)


def test_patches_of_several_takes_stand_in_a_row() -> None:
    patches, _ = four_patches()
    both = Patches.stacked([patches, patches])
    assert both.weight.tolist() == [1, 2, 1, 1] * 2 and both.target.tolist() == [0, 2, 2, 1] * 2
    for name in ("sampled_m", "carried_m", "frontal", "held_s", "time_s", "sides"):
        twice = np.concatenate([getattr(patches.shown, name)] * 2)
        assert np.array_equal(getattr(both.shown, name), twice, equal_nan=name == "time_s")


def test_nothing_demonstrated_is_no_share_of_anything() -> None:
    patches, looks = four_patches()
    none = Looks(*(0 * of if of.dtype != bool else of & False for of in vars(patches.shown).values()))
    measures = _compared(Patches(patches.weight, patches.target, none), looks, surface([10, 30, 10]))
    assert np.isnan(
        [measures[f"fidelity_{name}"] for name in ("looks_kept_pct", "dwell_kept_pct", "order")]
    ).all()


def along(corners: list[list[float]], number: int = 21, yaw_deg: float = 0.0) -> Moments:
    """A path through corners at even legs, its camera turning evenly; only poses and steps are given."""
    knots = np.linspace(0, number - 1, len(corners))
    at = np.column_stack([np.interp(np.arange(number), knots, axis) for axis in np.array(corners, float).T])
    yaw = np.linspace(0, yaw_deg, number)[:, None]
    poses = Trajectory(np.arange(float(number)), at, Rotation.from_euler("z", yaw, degrees=True).as_quat())
    return Moments(poses, np.ones(number), np.zeros((number, 3)), np.zeros((number, 3)))


ELL = [[0, 0, 0], [20, 0, 0], [20, 20, 0]]


def test_turns_are_told_by_how_much_the_demonstration_turned() -> None:
    plan, flown = along(ELL, yaw_deg=120), along(ELL, yaw_deg=80)
    measures = _smoothness(plan, [flown, flown], surface([20, 20]), 1.0)
    assert measures == pytest.approx(
        {"camera_turn_ratio": 120 / 160, "path_turn_ratio": 0.5, "pan_fast_pct": 0.0}
    )
    straight = along([[0, 0, 0], [20, 0, 0]])
    measures = _smoothness(plan, [straight], surface([20, 20]), 1.0)
    assert measures["camera_turn_ratio"] == pytest.approx(120 / 30)  # never by less than 30 deg
    assert measures["path_turn_ratio"] == pytest.approx(90 / 30)


def test_bends_are_counted_on_legs_of_a_tenth_of_the_standoff_and_no_less_than_a_metre() -> None:
    """Teeth of two metres, along 40 m: seen on legs of one metre, and none on legs of four."""
    x = np.arange(0, 41.0)
    teeth = along(np.column_stack([x, np.tile([0.0, 1.0], 21)[:41], 0 * x]).tolist(), 41)
    line = along([[0, 0, 0], [40, 0, 0]])
    near = _smoothness(teeth, [line], surface([5, 500], [1, 0]), 1.0)["path_turn_ratio"]
    nothing = _smoothness(teeth, [line], surface([NAN], [0]), 1.0)["path_turn_ratio"]
    far = _smoothness(teeth, [line], surface([140, 1], [1, 0]), 1.0)["path_turn_ratio"]
    assert near == nothing == bent_rad(teeth.poses.positions, 1.0) / np.radians(30)
    assert far == bent_rad(teeth.poses.positions, 14.0) / np.radians(30) < 0.1 * near


def test_fast_panning_is_a_share_of_the_time() -> None:
    plan = along(ELL, 3)
    turn = np.array([[0, 0, 0.5], [0, 0.8, 0.8], [1.2, 0, 0]])
    plan = Moments(plan.poses, np.array([5.0, 2, 1]), plan.velocity, turn)
    assert _smoothness(plan, [plan], surface([20]), 1.0)["pan_fast_pct"] == pytest.approx(100 * 3 / 8)


def test_a_camera_is_followed_in_steps_of_three_degrees() -> None:
    yaw = np.array([[0, 2, 4, 8, 5.5, 4.9]]).T
    quats = Rotation.from_euler("z", yaw, degrees=True).as_quat()
    assert np.degrees(turned_rad(quats)) == pytest.approx(4 + 4 + 3.1)
    assert turned_rad(quats[[0, 1]]) == 0 and np.degrees(turned_rad(quats[[0, 2]])) == pytest.approx(4)


def bent(angles: list[float]) -> Floats:
    """A path of legs of one metre that turns by these angles, deg."""
    way = np.radians(np.cumsum([0.0, *angles]))
    steps = np.column_stack([np.cos(way), np.sin(way), 0 * way])
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


def test_a_path_is_followed_in_bends_of_eight_degrees() -> None:
    assert np.degrees(bent_rad(bent([90.0]), 1.0 - 1e-9)) == pytest.approx(90)  # two legs are enough
    assert bent_rad(bent([90.0]), 1.1) == 0  # and one is none
    assert np.degrees(bent_rad(bent([6.0, 6, -20]), 1.0 - 1e-9)) == pytest.approx(12 + 20)
    assert bent_rad(bent([7.0, -7]), 1.0 - 1e-9) == 0
    assert bent_rad(np.zeros((3, 3)), 1.0) == 0


def test_of_many_patches_the_order_of_an_even_choice_is_compared() -> None:
    """Every fiftieth pair of neighbours is exchanged: the choice is asked, over the whole length."""
    times = np.arange(6001.0)
    chosen = np.linspace(0, 6000, 2000).astype(int)
    after = times.copy()
    after[np.setdiff1d(np.arange(6001), chosen)] = -1  # what is not chosen says something else
    assert order_kept(times, after) == 1
    assert order_kept(times[:2], -times[:2]) == -1
    assert order_kept(times, np.where(times < 6000, times, -1)) == pytest.approx(1 - 4 * 1999 / (2000 * 1999))


def test_steps_of_a_flight_turn_as_the_flight_does() -> None:
    flight = along(ELL, 41, 90).poses
    assert np.degrees(turned_rad(moments(flight).poses.quat_xyzw)) == pytest.approx(90, abs=3)
