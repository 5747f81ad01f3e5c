"""Where a skin goes on: creases, necks and borders of pieces, on made surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.config import CloudSettings
from upplied.geometry.scene import Scene, scene_of
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_parts
from upplied.records import Bools, Cloud, Floats, Ints, Structure
from upplied.samples.surfaces import box

STEP = 0.25


def sheet(
    x: Floats, y: Floats, height: Floats | float, normal: Floats | list[float]
) -> tuple[Floats, Floats]:
    at, across = (of.ravel() for of in np.meshgrid(x, y, indexing="ij"))
    count = len(at)
    return np.column_stack([at, across, np.broadcast_to(height, count)]), np.broadcast_to(normal, (count, 3))


def labels(points: Floats, normals: Floats) -> Ints:
    """Of a structure given as points with normals: every point is a fine sample and is asked."""
    structure = Structure("made", "box", points, np.empty((0, 3), np.int64), normals)
    cloud = Cloud(points, np.array(normals), np.full(len(points), STEP**2))
    nothing = Scene(np.array([[0.0, 0, -99], [1, 0, -99], [0, 1, -99]]), np.array([[0, 1, 2]]), 1)
    return skin_parts(structure, nothing, cloud).label


def alike(label: Ints, mine: Bools) -> float:
    """Share of some samples that lie on the part that most of them lie on."""
    return float(np.bincount(label[mine]).max() / mine.sum())


STEPS = np.arange(0, 12, STEP)


def folded(degrees: float) -> tuple[Floats, Floats]:
    """Two halves of a sheet along y, the second one folded up by an angle."""
    angle = np.radians(degrees)
    flat = sheet(STEPS, STEPS, 0.0, [0.0, 0, 1])
    up = sheet(STEPS + STEP, STEPS, 0.0, [0.0, 0, 1])[0]
    risen = np.column_stack([12 - STEP + up[:, 0] * np.cos(angle), up[:, 1], up[:, 0] * np.sin(angle)])
    normal = np.tile([-np.sin(angle), 0, np.cos(angle)], (len(risen), 1))
    return np.vstack([flat[0], risen]), np.vstack([flat[1], normal])


@pytest.mark.parametrize(("degrees", "parts"), [(0.0, 1), (10.0, 1), (45.0, 2), (90.0, 2), (-60.0, 1)])
def test_a_crease_inwards_parts_a_skin_and_an_edge_outwards_does_not(degrees: float, parts: int) -> None:
    points, normals = folded(degrees)
    label = labels(points, normals)
    assert label.max() + 1 == parts
    half = np.arange(len(points)) < len(points) // 2
    assert alike(label, half) > 0.95 and alike(label, ~half) > 0.95


@pytest.mark.parametrize(("neck", "parts"), [(8.0, 1), (1.5, 2)])
def test_a_narrow_neck_parts_what_it_joins(neck: float, parts: int) -> None:
    left, right = sheet(STEPS, STEPS, 0.0, [0, 0, 1])[0], sheet(STEPS + 14, STEPS, 0.0, [0, 0, 1])[0]
    low = 6 - neck / 2
    bridge = sheet(np.arange(12, 14, STEP), np.arange(low, low + neck, STEP), 0.0, [0, 0, 1])[0]
    # A wall round the outline makes its rim: without one a flat sheet has none.
    flat = np.vstack([left, right, bridge])
    cells = {(round(x / STEP), round(y / STEP)) for x, y in flat[:, :2]}
    walls = [
        (x * STEP, y * STEP, z)
        for x, y in {(a + i, b + j) for a, b in cells for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))} - cells
        for z in np.arange(STEP, 1, STEP)
    ]
    inward = np.tile([0.0, 0, -1], (len(walls), 1))
    points = np.vstack([flat, np.array(walls)])
    normals = np.vstack([np.tile([0.0, 0, 1], (len(flat), 1)), inward])
    label = labels(points, normals)[: len(flat)]
    count = np.sort(np.bincount(label))[::-1]
    assert (count > 0.2 * len(flat)).sum() == parts
    if parts == 2:
        assert alike(label, np.arange(len(flat)) < len(left)) > 0.9
        assert label[0] != label[len(left)]


def test_few_points_are_one_part() -> None:
    points, normals = sheet(np.arange(3.0), np.arange(3.0), 0.0, [0, 0, 1])
    assert labels(points, normals).tolist() == [0] * 9


def test_both_sides_of_a_box_are_one_skin_and_a_box_upon_it_is_another() -> None:
    low, high = box((20.0, 20.0, 6.0), "low").structure, box((6.0, 6.0, 8.0), "high").structure
    stacked = np.vstack([low.vertices, high.vertices + np.array([0, 0, 6])])
    triangles = np.vstack([low.triangles, high.triangles + len(low.vertices)])
    both = Structure("both", "box", stacked, triangles)
    scene = scene_of(both, 1)
    cloud = surface_samples(both, scene, CloudSettings(surface_samples=800))
    label = skin_parts(both, scene, cloud).label
    upper = cloud.points[:, 2] > 6.6
    assert alike(label, upper) > 0.95 and alike(label, ~upper) > 0.95
    assert np.bincount(label[upper]).argmax() != np.bincount(label[~upper]).argmax()
    assert np.array_equal(label, skin_parts(both, scene, cloud).label)
