"""The rules of an airspace at their very limits, and the words for what is broken."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import Airspace, crosses_box
from upplied.records import Floats, Frame, Surroundings

TRIANGLE = np.array([[-50.0, -50, 0], [50, -50, 0], [0, 80, 0]]), np.array([[0, 1, 2]])
KEEP_OUT = np.array([[[2.0, -3, 4], [6, 3, 9]]])
FENCE = np.array([[-20.0, -20], [20, -20], [20, 20], [-20, 20]])


def airspace(**surroundings: object) -> Airspace:
    """Over a large triangle at the height 0."""
    return Airspace(Scene(*TRIANGLE, 1), 2.0, Surroundings(**surroundings), 1.5)  # type: ignore[arg-type]


def test_limits_themselves_are_allowed() -> None:
    rules = airspace(ground_z_m=1.0, ceiling_z_m=12.0, keep_out_m=KEEP_OUT, geofence_m=FENCE)
    assert rules.floor_m == 2.5 and rules.ceiling_m == 12.0
    at = np.array([[-5.0, 0, 2.5], [-5, 0, 2.49], [-5, 0, 12], [-5, 0, 12.01], [2, 0, 5], [2.01, 0, 5],
                   [6, 0, 5], [5, 3, 5], [4, 0, 9], [4, 0, 4], [4, 0, 8.99], [19.9, 0, 5],
                   [20, 0, 5]])  # fmt: skip
    expected = [True, False, True, False, True, False, True, True, True, True, False, True, False]
    assert rules.in_bounds(at).tolist() == expected
    assert rules.allowed(at).tolist() == expected


def test_the_safety_distance_itself_is_allowed() -> None:
    rules = airspace()
    assert rules.floor_m == -np.inf and rules.ceiling_m == np.inf
    at = np.array([[0.0, 0, 2], [0, 0, 1.999], [0, 0, -2], [0, 0, -1], [0, 0, 300]])
    assert rules.in_bounds(at).all()
    assert rules.allowed(at).tolist() == [True, False, True, False, True]
    assert rules.broken(at[[0, 4, 1]]).tolist() == [False, True]
    assert rules.broken(at[[0, 2]]).tolist() == [True]  # through the surface


def test_what_is_wrong_is_said() -> None:
    rules = airspace(ground_z_m=1.0, ceiling_z_m=12.0, keep_out_m=KEEP_OUT, geofence_m=FENCE)
    assert rules.why(np.array([0.0, 0, 1])) == "1.00 m from the structure, 2 m are required"
    assert rules.why(np.array([0.0, 0, 2.25])) == "below 2.50 m, the least height above the ground"
    assert rules.why(np.array([0.0, 0, 12.5])) == "above the ceiling of 12.00 m"
    assert rules.why(np.array([30.0, 0, 5])) == "outside the geofence"
    assert rules.why(np.array([3.0, 0, 5])) == "in a keep-out box"
    for fine in ([0.0, 0, 2.5], [0.0, 0, 12], [-5.0, 0, 5]):
        assert rules.why(np.array(fine)) == ""
    assert airspace().why(np.array([0.0, 0, 2])) == ""


def test_boxes_and_fences_keep_to_the_declared_axes() -> None:
    frame = Frame(np.radians(90.0), np.array([3.0, 0.0, 0.0]))
    plain = airspace(keep_out_m=KEEP_OUT, geofence_m=FENCE)
    turned = Airspace(plain.scene, 2.0, plain.surroundings, 1.5, frame)
    declared = np.array([[3.0, 0, 5], [1, 0, 5], [30, 0, 5], [19, 19, 5]])
    here = frame.from_declared(declared)
    assert turned.in_bounds(here).tolist() == plain.in_bounds(declared).tolist() == [False, True, False, True]
    assert turned.why(here[0]) == "in a keep-out box" and turned.why(here[2]) == "outside the geofence"
    leg = np.array([[1.0, 0, 5], [7, 0, 5], [7, -30, 5], [1, -15, 5]])
    assert plain.broken(leg).tolist() == turned.broken(frame.from_declared(leg)).tolist() == [True] * 3


def inside_somewhere(start: Floats, end: Floats, low: Floats, high: Floats) -> bool:
    share = np.linspace(0, 1, 4001)[:, None]
    dense = start + share * (end - start)
    return bool(((dense > low + 1e-6) & (dense < high - 1e-6)).all(axis=1).any())


@pytest.mark.parametrize("seed", range(4))
def test_a_segment_enters_a_box_where_some_of_it_is_inside(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low, high = np.array([-1.0, -2, -3]), np.array([2.0, 1, 4])
    start, end = rng.uniform(-6, 6, (60, 3)), rng.uniform(-6, 6, (60, 3))
    start[:20, rng.integers(0, 3)] = end[:20, 0]
    end[:20, :2] = start[:20, :2]  # upright
    end[20:30, 1:] = start[20:30, 1:]
    crossings = crosses_box(start, end, low, high)
    assert crossings.tolist() == [inside_somewhere(a, b, low, high) for a, b in zip(start, end, strict=True)]
    assert crossings.any() and not crossings.all()


def test_a_segment_along_a_face_or_up_to_it_enters_nothing() -> None:
    low, high = np.zeros(3), np.ones(3)
    start = np.array(
        [[-1.0, 0, 0.5], [-1, 0.5, 0.5], [0.5, 0.5, 1], [-1, 1, 0.5], [0.5, 0.5, 0.5], [2, 0.5, 0.5]]
    )
    end = np.array([[2.0, 0, 0.5], [0, 0.5, 0.5], [0.5, 0.5, 3], [2, 1, 0.5], [0.5, 0.5, 0.5], [1, 0.5, 0.5]])
    assert crosses_box(start, end, low, high).tolist() == [False, False, False, False, True, False]
