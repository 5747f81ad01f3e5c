"""Names of parts, landmarks and boxes, on a made cloud."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.errors import SettingsError
from upplied.planning.demonstration.inspection import zone_of
from upplied.records import Cloud, Structure

GRID = np.array([[x, y, 0.0] for x in range(10) for y in range(10)], float)
SKIN = (GRID[:, 0] >= 6).astype(np.int64)
PART = (GRID[:, 1] >= 5).astype(np.int64)
CLOUD = Cloud(GRID, np.tile([0.0, 0, 1], (100, 1)), part=PART)
STRUCTURE = Structure(
    "made",
    "box",
    GRID,
    np.empty((0, 3), np.int64),
    landmarks={"tip": (8.0, 5.0, 0.3), "rim": (5.1, 4.0, 0.0)},
)


def zone(about: str, cloud: Cloud = CLOUD) -> np.ndarray:
    zone = zone_of(about, STRUCTURE, cloud, SKIN)
    assert zone is not None
    return zone


def test_a_landmark_is_the_skin_that_most_samples_near_it_lie_on() -> None:
    assert np.array_equal(zone("tip"), SKIN == 1)
    assert np.array_equal(zone("rim"), SKIN == 0)


def test_a_part_is_named_by_its_number() -> None:
    assert np.array_equal(zone("part_0"), PART == 0) and np.array_equal(zone("part_1"), PART == 1)
    assert zone("part_0", Cloud(GRID)).all()
    for bad in ("part_2", "part_", "part_-1", "1"):
        with pytest.raises(SettingsError, match=r"is unknown; landmarks of made: rim, tip"):
            zone(bad)


def test_a_box_is_between_two_corners_in_any_order() -> None:
    inside = ((GRID >= [2, 3, 0]) & (GRID <= [4, 8, 0])).all(axis=1)
    assert np.array_equal(zone("box 2 3 0 4 8 0"), inside) and np.array_equal(
        zone("BOX 4 3 1 2 8 -1"), inside
    )
    for bad in ("box 1 2 3 4 5", "box 1 2 3 4 5 6 7", "box 1 2 3 4 5 inf", "box 1 2 3 4 5 x"):
        with pytest.raises(SettingsError, match="cannot be read as a box"):
            zone(bad)
    with pytest.raises(SettingsError, match="names no surface"):
        zone("box 20 20 20 30 30 30")


def test_several_names_add_up() -> None:
    assert np.array_equal(zone(" tip ,part_1, "), (SKIN == 1) | (PART == 1))
    assert zone_of(" , ", STRUCTURE, CLOUD, SKIN) is None
