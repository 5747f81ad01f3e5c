"""Parts laid on their partners: boxes, long parts that turned, strips that stick out."""

from __future__ import annotations

from collections.abc import Sequence

import made_clouds
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.planning.correspondence.coherent_point_drift import Patch
from upplied.planning.correspondence.part_alignment import aligned_parts, misfit_of_parts
from upplied.records import Cloud, Floats

WHOLE = np.array([[-50.0, -50, -50], [50, 50, 50]])


def box(
    low: Sequence[float], size: Sequence[float], number: int = 600, seed: int = 0
) -> tuple[Floats, Floats]:
    return made_clouds.box(low, size, number, np.random.default_rng(seed))


ANY = np.arange(1)  # the only part may be a blade


def patch(points: Floats, normals: Floats) -> Patch:
    """One part between the corners of a whole."""
    label = np.concatenate([np.zeros(len(points), np.int64), [-1, -1]])
    return Patch(np.vstack([points, WHOLE]), np.vstack([normals, np.eye(3)[:2]]), label)


def test_a_box_is_laid_on_its_partners_box() -> None:
    here, facing = box([2, 3, 4], [4, 3, 2])
    there, faces = box([10, -3, 0], [8, 3, 1], seed=1)
    moved = aligned_parts(patch(here, facing), patch(there, faces), ANY)
    assert moved.points[:600] == pytest.approx((here - [2, 3, 4]) * [2, 1, 0.5] + [10, -3, 0])
    assert moved.normals[:600] == pytest.approx(facing)
    assert np.array_equal(moved.points[600:], WHOLE)
    leaning = np.tile([0.6, 0.0, 0.8], (600, 1))
    stretched = aligned_parts(patch(here, leaning), patch(there, faces), ANY).normals[0]
    assert stretched == pytest.approx(np.array([0.3, 0, 1.6]) / np.hypot(0.3, 1.6))
    assert np.array_equal(
        aligned_parts(patch(here, facing), patch(there, faces), ANY, turned_only=True).points[:600], here
    )


def test_a_part_of_quite_another_shape_is_not_stretched_to_its_partners_box() -> None:
    """A fin that is named as a fin with a tailplane across it stays as thick as it is."""
    fin, facing = box([0, -0.25, 0], [6, 0.5, 7])
    across, faces = box([0, -6.0, 6.5], [6, 12.0, 0.5], seed=1)
    both = patch(np.vstack([fin[:300], across[:300]]), np.vstack([facing[:300], faces[:300]]))
    assert np.array_equal(aligned_parts(patch(fin, facing), both, ANY).points[:600], fin)
    alike, alikes = box([0, -0.5, 0], [6, 1.2, 7], seed=2)  # within three times it is
    assert np.ptp(aligned_parts(patch(fin, facing), patch(alike, alikes), ANY).points[:600, 1]) > 1.1


def blade(degrees: float, length: float = 30.0, width: float = 1.0) -> tuple[Floats, Floats]:
    turn = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    points, normals = box([-width / 2, -width / 2, 3], [width, width, length], 900)
    return points @ turn.T, normals @ turn.T


@pytest.mark.parametrize("degrees", [25.0, 90.0, 179.0])
def test_a_blade_that_stopped_elsewhere_is_turned(degrees: float) -> None:
    here, there = blade(0.0), blade(degrees, 45.0, 2.0)
    moved = aligned_parts(patch(*here), patch(*there), ANY, turned_only=True)
    expected = blade(degrees, 45.0, 2.0)[0]
    assert np.linalg.norm(moved.points[:900] - expected, axis=1).max() < 0.8
    assert moved.points[:900] @ [1, 0, 0] == pytest.approx(expected @ [1, 0, 0], abs=0.25)
    turn = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    assert moved.normals[:900] == pytest.approx(here[1] @ turn.T, abs=0.08)


def test_what_is_no_blade_has_not_turned() -> None:
    """A wing may be swept by ten degrees more on another aircraft: it is laid on its box there."""
    here, there = blade(0.0, 8.0), blade(14.0, 8.0)
    none = np.empty(0, np.int64)
    assert np.array_equal(
        aligned_parts(patch(*here), patch(*there), none, turned_only=True).points[:900], here[0]
    )
    assert not np.array_equal(
        aligned_parts(patch(*here), patch(*there), ANY, turned_only=True).points[:900], here[0]
    )


def test_a_blade_that_hardly_turned_is_laid_box_on_box() -> None:
    here, there = blade(0.0), blade(8.0)
    moved = aligned_parts(patch(*here), patch(*there), ANY, turned_only=True)
    assert np.array_equal(moved.points[:900], here[0])
    assert not np.array_equal(aligned_parts(patch(*here), patch(*there), ANY).points[:900], here[0])


def test_short_parts_and_those_across_the_middle_do_not_turn() -> None:
    stout = blade(0.0, 6.0, 2.5), blade(60.0, 6.0, 2.5)
    through = [(points - [0, 0, 18], normals) for points, normals in (blade(0.0), blade(0.0))]
    turn = Rotation.from_euler("x", 60, degrees=True).as_matrix()
    through[1] = through[1][0] @ turn.T, through[1][1] @ turn.T
    for here, there in (stout, through):
        moved = aligned_parts(patch(*here), patch(*there), ANY, turned_only=True)
        assert np.array_equal(moved.points[:900], here[0])


def test_a_part_without_partner_stays() -> None:
    here, facing = box([2, 3, 4], [4, 3, 2])
    lonely = Patch(here, facing, np.full(600, 1))
    assert np.array_equal(aligned_parts(lonely, patch(here, facing), ANY).points, here)


def test_little_that_sticks_out_does_not_count() -> None:
    here, facing = box([0, 0, 0], [4, 4, 4])
    strip = np.column_stack([np.linspace(4, 40, 20), np.full((20, 2), 2.0)])
    there = np.vstack([here + np.array([10, 0, 0]), strip + np.array([10, 0, 0])])
    faces = np.vstack([facing, np.tile([0.0, 0, 1], (20, 1))])
    moved = aligned_parts(patch(here, facing), patch(there, faces), ANY).points[:600]
    assert moved[:, 0].max() == pytest.approx(14, abs=0.6) and moved[:, 0].min() == pytest.approx(
        10, abs=1e-9
    )
    assert moved[:, 1:] == pytest.approx(here[:, 1:], abs=1e-9)


def test_the_misfit_of_parts_grows_with_what_differs() -> None:
    here, facing = box([0, 0, 0], [8, 4, 4])
    same, faces = box([30, 5, 1], [8, 4, 4], seed=3)
    wedge = same.copy()
    wedge[:, 2] = 1 + (wedge[:, 2] - 1) * (1 - (wedge[:, 0] - 30) / 9)
    area = np.ones(600)
    misfits = [
        misfit_of_parts(
            Cloud(here, facing, area),
            np.ones(600, bool),
            Cloud(there, normals, area),
            np.ones(600, bool),
            50.0,
        )
        for there, normals in ((here, facing), (same, faces), (wedge, faces), (same, -faces))
    ]
    assert misfits[0] == pytest.approx(0, abs=1e-9)
    assert misfits[0] < misfits[1] < misfits[2] and misfits[1] < 1 < misfits[3]
