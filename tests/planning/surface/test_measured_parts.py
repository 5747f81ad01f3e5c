"""What is measured of parts: boxes, sides, blades, contacts and bodies, on boxes that are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.planning.surface.parts import (
    blades,
    blades_of,
    labels_of,
    mesh_pieces,
    names_of,
    part_labels,
    parts_of,
    sides,
)
from upplied.records import Cloud, Floats, Ints, Structure


def grid_box(low: list[float], size: list[float], step: float = 0.5) -> tuple[Floats, Floats]:
    """Samples on the faces of a box in a grid, with normals."""
    points, normals = [], []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        steps = [np.linspace(0, size[other], max(round(size[other] / step), 1) + 1) for other in others]
        for end in (0, 1):
            for a in steps[0]:
                for b in steps[1]:
                    place = np.zeros(3)
                    place[axis], place[others[0]], place[others[1]] = end * size[axis], a, b
                    points.append(np.array(low) + place)
                    normals.append(np.eye(3)[axis] * (2 * end - 1))
    return np.array(points), np.array(normals)


def cloud(*boxes: tuple[list[float], list[float]], step: float = 0.5) -> Cloud:
    samples = [grid_box(*box, step) for box in boxes]
    label = np.repeat(np.arange(len(samples)), [len(points) for points, _ in samples])
    points, normals = (np.concatenate(of) for of in zip(*samples, strict=True))
    return Cloud(points, normals, np.ones(len(points)), label)


BODY = ([0.0, -3, 0], [30.0, 6, 4])


def test_boxes_areas_and_contacts() -> None:
    whole = cloud(BODY, ([10.0, 3.3, 1], [4.0, 3, 2]), ([10.0, 9, 1], [4.0, 3, 2]))
    parts = parts_of(whole)
    assert parts.low.tolist() == [[0, -3, 0], [10, 3.3, 1], [10, 9, 1]]
    assert parts.high.tolist() == [[30, 3, 4], [14, 6.3, 3], [14, 12, 3]]
    assert parts.middle[1].tolist() == [12, 4.8, 2]
    assert parts.area == pytest.approx(np.bincount(whole.part) / len(whole.points))  # type: ignore[arg-type]
    # 0.015 of a diagonal of 33.8 m: a gap of 0.3 m touches, one of 2.7 m does not.
    assert parts.touching.tolist() == [[False, True, False], [True, False, False], [False, False, False]]
    assert parts_of(whole) is parts and len(parts) == 3


def test_extents_are_along_a_parts_own_axes() -> None:
    points, normals = grid_box([-5.0, -1, -0.5], [10.0, 2, 1])
    turn = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()
    parts = parts_of(
        Cloud(points @ turn.T, normals @ turn.T, np.ones(len(points)), np.zeros(len(points), int))
    )
    assert parts.extent[0] == pytest.approx([10, 2, 1], abs=1e-6)


def test_sides_of_boxes_in_a_whole() -> None:
    whole = np.array([-10.0, -5, 0]), np.array([10.0, 5, 3])
    low = np.array([[2.0, 1, 0], [-4, -4, 0], [-10, -5, 0], [3, -1, 0]])
    high = np.array([[6.0, 4, 1], [4, 4, 1], [10, 5, 1], [5, 0.5, 1]])
    known = [[8 / 6.5, 5 / 4.25], [0, 0], [0, 0], [8 / 5.5, -0.5 / 1.25]]
    assert sides(low, high, *whole) == pytest.approx(np.array(known))
    shifted = [each + np.array([7.0, 8, 9]) for each in (low, high, *whole)]
    assert sides(*shifted) == pytest.approx(np.array(known))


def test_what_has_no_mirror_image_lies_on_no_side() -> None:
    twins = parts_of(cloud(BODY, ([10.0, 6, 1], [4.0, 3, 2]), ([10.0, -9, 1], [4.0, 3, 2])))
    assert np.isfinite(twins.side[:, 1]).all() and twins.side[1, 1] > 1 > -1 > twins.side[2, 1]
    assert (
        np.isfinite(twins.side[0, 0]) and np.isnan(twins.side[1:, 0]).all()
    )  # the body alone, front to rear
    # Wide enough that the box's middle stays the body's: a mast with nothing across from it.
    lone = parts_of(cloud(([0.0, -8, 0], [30.0, 16, 4]), ([10.0, 5, 4], [2.0, 2, 3])))
    assert np.isfinite(lone.side[0, 1]) and np.isnan(lone.side[1, 1])
    odd = parts_of(cloud(([0.0, 0, 0], [30.0, 6, 4]), ([0.0, 6, 0], [4.0, 20, 4])))
    assert np.isnan(odd.side).all()


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_parts_turn_with_their_axes(quarter: int) -> None:
    turn = np.round(Rotation.from_rotvec([0, 0, quarter * np.pi / 2]).as_matrix())
    whole = cloud(BODY, ([10.0, 6, 1], [4.0, 3, 2]), ([10.0, -9, 1], [4.0, 3, 2]))
    there = parts_of(Cloud(whole.points @ turn.T, whole.normals @ turn.T, whole.area_m2, whole.part))  # type: ignore[operator]
    parts = parts_of(whole).in_axes(turn)
    assert parts.low == pytest.approx(there.low) and parts.high == pytest.approx(there.high)
    assert parts.side == pytest.approx(there.side, nan_ok=True)


def are_blades(extent: list[list[float]], area: list[float], apart: float = 0.3) -> list[bool]:
    """Whether parts are blades whose middles lie so far from their hub, of the length of the first."""
    angle = 2 * np.pi * np.arange(len(area)) / (len(area) - 1)
    middle = apart * extent[1][0] * np.column_stack([0 * angle, np.cos(angle), np.sin(angle)])
    return blades(np.array(extent), np.array(area), middle).tolist()


def test_blades_are_long_several_and_not_the_body() -> None:
    long, short = [20.0, 2, 1], [6.0, 2, 1]
    assert are_blades([long, long, long, short], [0.7, 0.1, 0.1, 0.1]) == [False, True, True, False]
    assert not any(are_blades([long, long, short], [0.7, 0.1, 0.2]))  # one alone is none
    assert not any(are_blades([long, long, [31.0, 2, 1]], [0.6, 0.2, 0.2], 1.0))  # not of one length
    assert are_blades([long, long, [29.0, 2, 1]], [0.6, 0.2, 0.2], 1.0) == [False, True, True]
    assert are_blades([long, long, long], [0.96, 0.03, 0.01]) == [False, False, False]
    assert are_blades([long, long, long], [0.949, 0.04, 0.011]) == [False, True, True]
    assert not any(are_blades([long, [8.0, 2, 1], [8.0, 2, 1]], [0.6, 0.2, 0.2]))


def test_what_lies_side_by_side_is_no_blade() -> None:
    """The parapets of a bridge, the floats of a seaplane."""
    long = [20.0, 2, 1]
    assert are_blades([long, long, long], [0.6, 0.2, 0.2], 0.26) == [False, True, True]
    assert are_blades([long, long, long], [0.6, 0.2, 0.2], 0.24) == [False, False, False]
    deck = ([-40.0, -5, 0], [80.0, 10, 2])
    bridge = cloud(deck, ([-40.0, -5, 2], [80.0, 1, 1]), ([-40.0, 4, 2], [80.0, 1, 1]))
    assert not blades_of(bridge).any()


def test_a_part_has_the_name_of_most_of_what_has_one_unless_little_has() -> None:
    label = np.repeat([0, 1, 2, 3], 10)
    named = np.array([5] * 6 + [-1] * 4 + [5] * 5 + [-1] * 5 + [3] * 5 + [5] * 5 + [3] * 6 + [5] * 4)
    known = Cloud(np.zeros((40, 3)), None, np.ones(40), label)
    assert names_of(known, named).tolist() == [5, -1, -1, 3]
    heavy = np.where(np.arange(40) == 10, 2.0, 1.0)  # by area, not by number
    assert names_of(Cloud(known.points, None, heavy, label), named).tolist() == [5, 5, -1, 3]


def test_samples_on_blades() -> None:
    hub = ([-2.0, -2, -2], [4.0, 4, 4])
    rotor = cloud(hub, ([-0.5, -0.5, 3], [1.0, 1, 12]), ([-0.5, 3, -0.5], [1.0, 12, 1]), step=0.25)
    assert np.array_equal(blades_of(rotor), labels_of(rotor) > 0)


def test_what_faces_all_ways_is_a_body() -> None:
    assert parts_of(cloud(BODY)).body.tolist() == [True]
    sheet = grid_box([0.0, 0, 0], [20.0, 10, 0], 0.25)[0]
    flat = np.unique(sheet, axis=0)
    label = (flat[:, 0] > 10).astype(np.int64)
    up = np.tile([0.0, 0, 1], (len(flat), 1))
    assert parts_of(Cloud(flat, up, None, label)).body.tolist() == [False, False]
    hinged = np.where(label[:, None] == 1, [1.0, 0, 0], [0.0, 0, 1])
    assert parts_of(Cloud(flat, hinged, None, label)).body.tolist() == [True, True]
    assert parts_of(Cloud(flat, None, None, label)).body.tolist() == [True, True]


def test_pieces_are_welded_within_some_millimetres() -> None:
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    near = np.array([[1.0, 0, 0], [0, 1, 0], [1, 1, 0]]) + 0.002
    apart = triangle + np.array([0, 0, 0.01])
    vertices = np.vstack([triangle, near, apart, [[30.0, 40, 0]]])
    mesh = Structure("made", "box", vertices, np.array([[0, 1, 2], [3, 5, 4], [6, 7, 8]]))
    pieces = mesh_pieces(mesh)
    assert pieces[0] == pieces[1] != pieces[2]


def labelled(*sizes: int) -> tuple[Floats, Ints]:
    """Patches of so many samples a step apart, far from each other along x."""
    points, piece = [], []
    for number, size in enumerate(sizes):
        at = np.arange(size)
        points.append(np.column_stack([100.0 * number + at % 10, at // 10, np.zeros(size)]))
        piece.append(np.full(size, number))
    return np.concatenate(points), np.concatenate(piece)


def test_labels_are_ordered_by_area() -> None:
    points, piece = labelled(30, 50, 40)
    assert np.bincount(part_labels(points, np.ones(120), piece)).tolist() == [50, 40, 30]
    area = np.where(piece == 0, 3.0, 1.0)
    label = part_labels(points, area, piece + 7)
    assert [label[piece == number][0] for number in range(3)] == [0, 1, 2]


def test_few_samples_join_what_most_of_them_are_nearest_to() -> None:
    points, piece = labelled(40, 30, 20)
    crumb = np.array([[105.0, 4, 0], [106, 4, 0], [107, 4, 0], [3, 6, 0]])
    label = part_labels(np.vstack([points, crumb]), np.ones(94), np.append(piece, [3] * 4))
    assert (label[90:] == label[piece.tolist().index(1)]).all() and label.max() == 2
    six = part_labels(np.vstack([points, crumb, crumb[:2] + 0.1]), np.ones(96), np.append(piece, [3] * 6))
    assert six.max() == 3
    only = part_labels(crumb, np.ones(4), np.zeros(4, int))
    assert only.tolist() == [0] * 4


@pytest.mark.parametrize("number", [38, 40, 41, 45])
def test_small_areas_join_whatever_the_number_of_pieces(number: int) -> None:
    """One piece more, of a few vertices that a millimetre parts, must not turn small pieces into none."""
    points, piece = labelled(*[10] * number)
    area = np.where(piece < number - 5, 1.0, 0.05)
    assert part_labels(points, area, piece).max() == number - 6
    assert part_labels(points, np.ones(10 * number), piece).max() == number - 1


@pytest.mark.parametrize(("gap", "together"), [(0.3, True), (3.0, False)])
def test_touching_compact_pieces_are_one_body(gap: float, together: bool) -> None:
    boxes = [([0.0, -3, 0], [60.0, 6, 4]), ([20.0, 9, 0], [4.0, 3, 3]), ([24.0 + gap, 9, 0], [4.0, 3, 3])]
    bodies = [grid_box(*box)[0] for box in boxes]
    piece = np.repeat(np.arange(3), [len(points) for points in bodies])
    label = part_labels(np.concatenate(bodies), np.ones(len(piece)), piece)
    assert label.max() == (1 if together else 2)
    assert (label[piece == 1][0] == label[piece == 2][0]) == together


def test_a_large_piece_is_no_body_with_its_neighbour() -> None:
    boxes = [([0.0, -3, 0], [60.0, 6, 4]), ([20.0, 9, 0], [4.0, 3, 3]), ([24.2, 9, 0], [16.0, 3, 3])]
    bodies = [grid_box(*box)[0] for box in boxes]
    piece = np.repeat(np.arange(3), [len(points) for points in bodies])
    assert part_labels(np.concatenate(bodies), np.ones(len(piece)), piece).max() == 2
