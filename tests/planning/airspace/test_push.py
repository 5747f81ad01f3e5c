"""Positions pushed out of what they break, to where closed forms say."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import Airspace, inside_fence, pushed_out
from upplied.records import Floats, Frame, Surroundings

CLEARANCE, BEYOND, INSIDE = 2.0, 0.02, 0.05
FLOOR = np.array([[-500.0, -500, 0], [500, -500, 0], [0, 800, 0]]), np.array([[0, 1, 2]])
NOTCHED = np.array([(0, 0), (40, 0), (40, 40), (28, 40), (28, 10), (12, 10), (12, 40), (0, 40)], float)


def airspace(frame: Frame | None = None, height: float = 0.0, **surroundings: object) -> Airspace:
    """Over a large level triangle."""
    scene = Scene(FLOOR[0] + [0, 0, height], FLOOR[1], 1)
    return Airspace(scene, CLEARANCE, Surroundings(**surroundings), 1.0, frame or Frame())  # type: ignore[arg-type]


def alone(positions: list[list[float]], rules: Airspace) -> Floats:
    """Each pushed with no neighbour within reach."""
    places = [
        pushed_out(np.array([place, [place[0] + 300.0, place[1], 60.0]]), rules)[0] for place in positions
    ]
    return np.array(places)


def test_what_is_too_near_is_pushed_to_the_safety_distance() -> None:
    places = alone([[3.0, 4, 0.5], [3, 4, -1.2], [3, 4, 2.0], [3, 4, 2.03], [3, 4, 9]], airspace())
    assert places[:, 2] == pytest.approx([2.02, -2.02, 2.02, 2.03, 9], abs=1e-5)
    assert places[:, :2] == pytest.approx(np.tile([3.0, 4], (5, 1)), abs=1e-4)


def test_heights_are_brought_to_the_limits() -> None:
    rules = airspace(height=-50.0, ground_z_m=5.0, ceiling_z_m=70.0)
    places = alone([[0.0, 0, 2], [0, 0, 6], [0, 0, 70], [0, 0, 75.5]], rules)
    assert places[:, 2] == pytest.approx([6, 6, 70, 70], abs=1e-9)


@pytest.mark.parametrize("heading_deg", [0.0, 35.0])
def test_a_box_is_left_by_its_nearest_face(heading_deg: float) -> None:
    frame = Frame(np.radians(heading_deg), np.array([2.0, -1.0, 0.0]))
    box = np.array([[[10.0, 10, 20], [20, 30, 40]]])
    rules = airspace(frame, height=-50.0, keep_out_m=box)
    inside = np.array([[11.0, 20, 30], [18, 20, 30], [15, 12, 30], [15, 28, 30], [15, 20, 21], [15, 20, 39]])
    expected = inside.copy()
    expected[range(6), [0, 0, 1, 1, 2, 2]] = [9.98, 20.02, 9.98, 30.02, 19.98, 40.02]
    actual = alone(frame.from_declared(inside).tolist(), rules)
    assert frame.to_declared(actual) == pytest.approx(expected, abs=1e-9)
    on_face = alone(frame.from_declared(np.array([[10.0, 20, 30]])).tolist(), rules)
    assert frame.to_declared(on_face) == pytest.approx(np.array([[10.0, 20, 30]]), abs=0.03)


def test_two_boxes_push_as_both() -> None:
    boxes = np.array([[[0.0, 0, 20], [10, 10, 40]], [[8.0, 0, 20], [30, 10, 40]]])
    places = alone([[9.0, 5, 21]], airspace(height=-50.0, keep_out_m=boxes))
    assert places[0, 2] < 20


@pytest.mark.parametrize("heading_deg", [0.0, -70.0])
def test_what_is_outside_a_fence_is_brought_a_little_inside(heading_deg: float) -> None:
    frame = Frame(np.radians(heading_deg), np.zeros(3))
    rules = airspace(frame, height=-50.0, geofence_m=NOTCHED)
    outside = np.array(
        [[-3.0, 20, 30], [20, -4, 30], [14, 30, 30], [27, 30, 30], [20, 10, 30], [5, 40.01, 30]]
    )
    expected = np.array([[INSIDE, 20], [20, INSIDE], [12 - INSIDE, 30], [28 + INSIDE, 30], [20, 10 - INSIDE],
                       [5, 40 - INSIDE]])  # fmt: skip
    declared = frame.to_declared(alone(frame.from_declared(outside).tolist(), rules))
    expected[5, 1] = declared[5, 1]
    assert declared[:, :2] == pytest.approx(expected, abs=1e-9)
    assert 39.9 < declared[5, 1] < 40
    assert declared[:, 2] == pytest.approx(np.full(6, 30.0))
    corner = frame.to_declared(alone(frame.from_declared(np.array([[-3.0, -4, 30]])).tolist(), rules))
    assert corner[0, :2] == pytest.approx([INSIDE * 0.6, INSIDE * 0.8], abs=1e-9)
    assert inside_fence(NOTCHED, declared).all()


def test_neighbours_along_the_path_move_with_what_is_pushed() -> None:
    path = np.column_stack([np.linspace(-20, 20, 81), np.zeros(81), np.full(81, 3.0)])
    path[38:43, 2] = 1.0
    places = pushed_out(path, airspace())
    assert places[38:43, 2].min() >= 2.0
    rise = places[:, 2] - path[:, 2]
    assert rise[36] > rise[34] > 0  # within twice the safety distance, along the path
    assert rise[:34] == pytest.approx(np.zeros(34), abs=1e-12)
    assert places[:, :2] == pytest.approx(path[:, :2], abs=1e-3)


def test_the_middle_of_a_short_leg_is_pushed_with_its_ends() -> None:
    ridge = np.array([[-9.0, 0, -5], [9, 0, -5], [0, 0, 0]]), np.array([[0, 1, 2]])
    rules = Airspace(Scene(*ridge, 1), CLEARANCE, Surroundings(), 1.0)
    level = np.array([[-0.9, 0.0, 1.93], [0.9, 0, 1.93]])
    places = pushed_out(level, rules)
    assert np.linalg.norm(places.mean(axis=0)) >= CLEARANCE
    long = np.array([[-1.2, 0.0, 1.7], [1.2, 0, 1.7]])  # its middle is a matter for ways round
    apart = pushed_out(long, rules)
    assert np.linalg.norm(apart, axis=1).min() >= CLEARANCE and apart.mean(axis=0)[2] < CLEARANCE


def test_a_path_that_keeps_the_rules_is_left_as_it_is() -> None:
    path = np.column_stack([np.linspace(0, 9, 10), np.zeros(10), np.full(10, 2.5)])
    assert np.array_equal(pushed_out(path, airspace()), path)
