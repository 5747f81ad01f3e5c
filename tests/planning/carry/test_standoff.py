"""Stand-offs asked and kept: medians, middles of pictures and shares of it, by plain numpy."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.config import TransferSettings
from upplied.planning.carry.affine import AxisMap
from upplied.planning.carry.standoff import (
    Counted,
    Standoff,
    carried_sight,
    counted,
    median_distance,
    picture_share,
)
from upplied.records import Camera, Cloud, Floats

CAMERA = Camera(hfov_deg=90.0, min_range_m=1.0, max_range_m=100.0, width_px=1000)
CARRIER = AxisMap(np.diag([2.0, 1.0, 3.0]), np.array([5.0, 6.0, 7.0]))


def samples(seed: int = 0) -> tuple[Floats, Floats, Floats]:
    """Cameras, points and how much of each picture each fills; the last camera sees nothing."""
    rng = np.random.default_rng(seed)
    weight = rng.random((5, 30)) * (rng.random((5, 30)) < 0.6)
    weight[4] = 0
    return rng.normal(0, 1, (5, 3)) + np.array([20.0, 0, 0]), rng.normal(0, 3, (30, 3)), weight


def weighted_median(values: Floats, weight: Floats) -> float:
    """The least value up to which half of the weight lies."""
    if not weight.any():
        return float("nan")
    for value in np.sort(values):
        if weight[values <= value].sum() >= weight.sum() / 2:
            return float(value)
    raise AssertionError


@pytest.mark.parametrize("seed", range(3))
def test_median_distances_are_those_of_what_is_seen(seed: int) -> None:
    positions, points, weight = samples(seed)
    distance = np.linalg.norm(positions[:, None] - points, axis=2)
    known = [weighted_median(far, share) for far, share in zip(distance, weight, strict=True)]
    assert median_distance(positions, points, weight) == pytest.approx(known, nan_ok=True)
    assert np.isnan(known[4])
    even = np.array([[1.0, 1, 0, 0], [1, 1, 1, 0], [0, 0, 0, 2]])
    line = np.array([[1.0, 0, 0], [2, 0, 0], [4, 0, 0], [8, 0, 0]])
    assert median_distance(np.zeros((3, 3)), line, even).tolist() == [1, 2, 8]


def test_scaled_stand_offs_are_carried_by_the_structures_map() -> None:
    positions, here, weight = samples()
    there = CARRIER.points(here)
    standoff = counted(positions, weight, here, there, CARRIER, TransferSettings(), CAMERA, 0.0)
    stretched = positions * [2, 1, 3]
    distance = np.linalg.norm(stretched[:, None] - here * [2, 1, 3], axis=2)
    known = [weighted_median(far, share) for far, share in zip(distance, weight, strict=True)]
    assert standoff.wanted_m == pytest.approx(known, nan_ok=True)
    assert standoff.middle is None
    assert standoff.distance(CARRIER.points(positions)) == pytest.approx(known, nan_ok=True)


def test_kept_stand_offs_are_those_to_the_middle_of_the_picture() -> None:
    # A wall straight ahead, a floor beside it and a far background: the wall is in the middle.
    here = np.array([[10.0, 0, 0], [10, 0.2, 0], [10, -0.2, 0], [4, 3, 0], [4, -3, 0], [90, 0, 0.5]])
    there = here + np.array([100.0, 0, 0])
    weight = np.array([[1.0, 1, 1, 1, 1, 0]])
    standoff = counted(
        np.zeros((1, 3)), weight, here, there, CARRIER, TransferSettings(standoff="kept"), CAMERA, 0.0
    )
    assert standoff.middle is not None
    assert standoff.wanted_m == pytest.approx([10.0], abs=1e-6)
    assert standoff.middle == pytest.approx(np.array([[110.0, 0, 0]]), abs=1e-6)
    assert standoff.distance(np.array([[103.0, 0, 0]])) == pytest.approx([7.0], abs=1e-6)


def test_the_middle_is_weighted_by_how_near_it_is() -> None:
    positions, here, weight = samples(4)
    standoff = counted(
        positions, weight, here, 2 * here, CARRIER, TransferSettings(standoff="kept"), CAMERA, 0.0
    )
    assert standoff.middle is not None
    for row in range(4):
        towards = weight[row] @ here / weight[row].sum() - positions[row]
        towards /= np.linalg.norm(towards)
        ray = here - positions[row]
        ahead = ray @ towards
        tangent = (ray**2).sum(axis=1) / ahead**2 - 1
        near = weight[row] * np.exp(-(tangent - tangent[weight[row] > 0].min()) / (2 * 0.1**2))
        middle = near @ here / near.sum()
        assert standoff.middle[row] == pytest.approx(2 * middle)
        assert standoff.wanted_m[row] == pytest.approx(np.linalg.norm(positions[row] - middle))
    assert np.isnan(standoff.wanted_m[4])


def test_a_ground_sampling_distance_sets_the_stand_off() -> None:
    positions, here, weight = samples()
    standoff = counted(positions, weight, here, here, CARRIER, TransferSettings(gsd_m=0.03), CAMERA, 0.0)
    assert standoff.wanted_m == pytest.approx([15.0] * 4 + [np.nan], nan_ok=True)  # 0.03 m times 500 pixels
    blind = Camera(hfov_deg=90.0, min_range_m=1.0, max_range_m=100.0)
    assert (
        counted(positions, weight, here, here, CARRIER, TransferSettings(gsd_m=0.03), blind, 0.0).middle
        is None
    )


def test_stand_offs_keep_to_the_range_and_the_safety_distance() -> None:
    here, weight = np.array([[0.0, 0, 0]]), np.ones((3, 1))
    positions = np.array([[1.0, 0, 0], [50, 0, 0], [99, 0, 0]])
    same = AxisMap(np.eye(3), np.zeros(3))
    standoff = counted(positions, weight, here, here, same, TransferSettings(), CAMERA, 0.5)
    assert standoff.wanted_m == pytest.approx([1.05, 50, 95])
    standoff = counted(positions, weight, here, here, same, TransferSettings(), CAMERA, 4.0)
    assert standoff.wanted_m == pytest.approx([4.2, 50, 95])
    standoff = counted(positions, weight, here, here, same, TransferSettings(), CAMERA, 100.0)
    assert standoff.wanted_m == pytest.approx([105.0] * 3)


def test_viewpoints_speak_by_equal_shares_of_their_pictures() -> None:
    _, points, weight = samples()
    distances = np.array([3.0, 4.0, np.nan, 6.0, 5.0])
    standoff = Counted(weight, points, None, distances).at(np.array([3, 0, 2, 4]))
    assert standoff.station.tolist() == [3, 0] and standoff.wanted_m.tolist() == [6, 3]
    assert standoff.usual_m == 4.5 and not standoff.in_metres
    for row, camera in enumerate((3, 0)):
        share = np.cumsum(weight[camera]) / weight[camera].sum()
        known = [points[np.flatnonzero(share >= (part + 0.5) / 32)[0]] for part in range(32)]
        assert np.array_equal(standoff.seen[row], known)
    middle = np.arange(15.0).reshape(5, 3)
    single = Counted(weight, points, middle, distances).at(np.array([3, 0, 2, 4]))
    assert single.in_metres and np.array_equal(single.seen, middle[[3, 0], None])
    assert Standoff(np.empty(0, np.int64), np.empty((0, 1, 3)), np.empty(0)).usual_m == 0.0


@pytest.mark.parametrize("normals", [True, False])
def test_a_picture_is_about_the_solid_angles_of_the_subject(normals: bool) -> None:
    rng = np.random.default_rng(3)
    facing = rng.normal(size=(20, 3))
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    area, attention = rng.uniform(1, 3, 20), rng.random(20)
    attention[[4, 12]] = 0.0, 0.001  # what is beside the subject counts a hundredth
    cloud = Cloud(rng.normal(0, 2, (20, 3)), facing if normals else None, area)
    known, positions = np.array([1, 4, 12, 19]), rng.normal(0, 8, (3, 3))
    seen = rng.random((3, 4)) < 0.7
    share = picture_share(positions, cloud, known, seen, attention)
    assert share.any() and not share[~seen].any()
    for row, at in enumerate(positions):
        for column, sample in enumerate(known):
            ray = at - cloud.points[sample]
            length = np.linalg.norm(ray)
            cosine = max(ray @ facing[sample] / length, 0) if normals else 1.0
            angle = area[sample] * seen[row, column] * cosine / length**2
            assert share[row, column] == pytest.approx(angle * max(attention[sample], 0.01))


def test_a_camera_on_a_sample_sees_it_as_from_a_millimetre() -> None:
    cloud = Cloud(np.zeros((1, 3)), np.array([[1.0, 0, 0]]))
    at, about = np.array([[1e-4, 0, 0]]), (np.array([0]), np.ones((1, 1), bool), np.ones(1))
    assert picture_share(at, cloud, *about)[0, 0] == pytest.approx(1e-4 / 1e-9)
    assert picture_share(at, Cloud(np.zeros((1, 3))), *about)[0, 0] == pytest.approx(1e6)


def test_lines_of_sight_are_carried_only_where_they_scale() -> None:
    assert carried_sight(CARRIER, TransferSettings()) is CARRIER.matrix
    assert np.array_equal(carried_sight(CARRIER, TransferSettings(standoff="kept")), np.eye(3))
