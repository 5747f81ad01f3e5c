"""Which way round a target stands: turns found again, and how sure that is."""

from __future__ import annotations

import numpy as np
import pytest
from made_clouds import boxes
from moved_scenes import about_z
from scipy.spatial.transform import Rotation

from upplied.planning.correspondence.orientation import find_orientation
from upplied.records import Cloud, Floats

#: An L with a tower at one end: no turn lays it on itself.
ODD_BOXES = ([0, 0, 0], [20, 4, 3]), ([0, 4, 0], [4, 6, 3]), ([16, 0, 3], [4, 4, 9])
ODD = boxes(*ODD_BOXES, number=500)
BRICK = boxes(([0, 0, 0], [20, 6, 3]), number=500)


def turned(cloud: Cloud, turn: Floats) -> Cloud:
    return Cloud(cloud.points @ turn.T, cloud.normals @ turn.T, cloud.area_m2)  # type: ignore[operator]


def off_deg(one: Floats, other: Floats) -> float:
    return float(np.degrees(Rotation.from_matrix(one @ other.T).magnitude()))


@pytest.mark.parametrize("degrees", [0.0, 33.0, 118.0, -77.0, 180.0])
def test_a_heading_is_found_again(degrees: float) -> None:
    orientation = find_orientation(ODD, turned(ODD, about_z(degrees)), "heading")
    assert off_deg(orientation.turn, about_z(-degrees)) < 1.5
    assert orientation.turn[2] == pytest.approx([0, 0, 1], abs=1e-9)
    assert orientation.gap > 0.3
    assert orientation.evidence.startswith("36 orientations tried; turned by ")
    turn_deg = float(orientation.evidence.split("turned by ")[1].split(" deg")[0])
    assert abs(turn_deg - abs((degrees + 180) % 360 - 180)) < 2.5
    assert orientation.evidence.endswith(f"the next best fits {100 * orientation.gap:.0f} % worse")


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 1.0, 0.3], [0.5, -0.5, 1.0]])
def test_any_orientation_is_found_again(axis: list[float]) -> None:
    turn = Rotation.from_rotvec(np.radians(75) * np.array(axis) / np.linalg.norm(axis)).as_matrix()
    orientation = find_orientation(ODD, turned(ODD, turn), "orientation")
    assert off_deg(orientation.turn, turn.T) < 2
    assert 40 < int(orientation.evidence.split()[0]) <= 60


@pytest.mark.parametrize("degrees", [0.0, 35.0, 90.0])
def test_what_stands_upright_is_turned_about_the_vertical_alone(degrees: float) -> None:
    """Principal axes of another sampling lean by tenths of a degree."""
    again = boxes(*ODD_BOXES, number=500, seed=5)
    orientation = find_orientation(ODD, turned(again, about_z(degrees)), "orientation")
    heading = find_orientation(ODD, turned(again, about_z(degrees)), "heading")
    assert off_deg(orientation.turn, about_z(-degrees)) < 2.5
    if degrees % 10 == 0:
        assert orientation.turn == pytest.approx(about_z(-degrees), abs=1e-9)
        assert orientation.turn == pytest.approx(heading.turn, abs=1e-9)


def test_a_larger_target_is_turned_as_a_small_one() -> None:
    large = turned(ODD, about_z(50.0))
    scaled = Cloud(large.points * 3 + [7, 8, 9], large.normals, large.area_m2)
    assert off_deg(find_orientation(ODD, scaled, "heading").turn, about_z(-50.0)) < 1.5


@pytest.mark.parametrize(("declared", "expected"), [(0.0, 0.0), (170.0, 180.0), (80.0, 0.0)])
def test_where_turns_fit_alike_the_declared_one_decides(declared: float, expected: float) -> None:
    orientation = find_orientation(BRICK, BRICK, "heading", about_z(declared))
    assert off_deg(orientation.turn, about_z(expected)) < 2
    assert orientation.gap < 0.15
    off = abs(declared - expected)
    assert "; 2 of them fit alike (the next best " in orientation.evidence
    assert f"nearest to the declared heading is used, {off:.0f} deg from it" in orientation.evidence
    gap = max(orientation.gap, 0)
    assert f"(the next best {100 * gap:.0f} % worse)" in orientation.evidence


def test_the_turn_is_told_from_the_declared_one() -> None:
    orientation = find_orientation(ODD, turned(ODD, about_z(60.0)), "heading", about_z(-60.0))
    assert "turned by 0 deg" in orientation.evidence or "turned by 1 deg" in orientation.evidence
    assert off_deg(orientation.turn, about_z(-60.0)) < 1.5
