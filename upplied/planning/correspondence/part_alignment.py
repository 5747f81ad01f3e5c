"""Parts aligned with their counterparts: box on box, along their direction where they turned (blades), or,
where blades are known of one structure alone, with the rotor turned as it fits the other's surface best.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from upplied.geometry.vectors import scaled_normals, with_normals
from upplied.planning.constants import FACING, LEAST_PART, MAJORITY, MOST_RATIO, SLENDER, TOLERANCE
from upplied.planning.correspondence.coherent_point_drift import Patch
from upplied.planning.correspondence.part_assignment import Matching, match_parts, with_named
from upplied.planning.geometry.clouds import box_scale, diagonal_of
from upplied.planning.surface.parts import blades_of, extent_of, images, labels_of, names_of, parts_of
from upplied.records import Bools, Cloud, Floats, Ints

_MISFIT = 0.022  # largest mean distance, both ways, in these units, of parts whose boxes are not alike
_TRIED = 150  # samples by which that is judged
_FAR = 8.0  # how far the last `TOLERANCE` of a part's samples at either end must stick out to be stray
_TURNED = np.cos(np.radians(10))
_STEP_DEG = 7.5  # a blade is about as wide, seen from its hub, at half its length
_BLADE_SAMPLES = 400


def matched(
    source: Cloud, registered: Cloud, pinned: Mapping[int, int] | None = None, named: Ints | None = None
) -> Matching:
    """Match the parts of two clouds, the target's already in the frame and at the scale of the source.

    Where parts were inferred by the names (M,) of the target's samples, what boxes leave is matched by name.
    What corresponds on one side of structures that are their own mirror images does so on the other side.
    """
    diagonal, labels = diagonal_of(source.points), (labels_of(source), labels_of(registered))

    def fits(parts: Sequence[int], partners: Sequence[int]) -> bool:
        mine, theirs = np.isin(labels[0], parts), np.isin(labels[1], partners)
        return misfit_of_parts(source, mine, registered, theirs, diagonal) < 1

    here, there = parts_of(source), parts_of(registered)
    matching = match_parts(here, there, diagonal, fits, pinned)
    if named is not None:
        shares, known = np.zeros((len(there), len(here))), named >= 0
        np.add.at(shares, (labels[1][known], named[known]), registered.areas[known] / registered.areas.sum())
        matching = with_named(matching, names_of(registered, named), shares, there, pinned or {})
    return matching if pinned else _on_both_sides(matching, source, registered)


def _on_both_sides(matching: Matching, source: Cloud, registered: Cloud) -> Matching:
    """The same, and what is in no class joins what lies across from the counterparts of its mirror image."""
    mine, theirs = matching.source_class.copy(), matching.target_class.copy()
    for axis in (1, 0):
        # A part of the source in no class counts as one of its own.
        own = np.where(mine < 0, len(matching) + np.arange(len(mine)), mine)
        theirs = _kinds_across(registered, theirs, source, own, axis)
        mine = np.where(np.isin(own, theirs), own, -1)
        mine = _kinds_across(source, mine, registered, theirs, axis)
        kinds = np.unique(mine[mine >= 0])
        mine, theirs = (np.where(of >= 0, np.searchsorted(kinds, of), -1) for of in (mine, theirs))
        matching = Matching(mine, theirs)
    return matching


def _kinds_across(cloud: Cloud, kind: Ints, other: Cloud, other_kind: Ints, axis: int) -> Ints:
    """The kinds (K,) of a cloud's parts: of one without, what lies across from its image's, where small."""
    label, parts = other_kind[labels_of(other)], parts_of(cloud)
    classes = replace(other, part=np.where(label < 0, other_kind.max() + 1, label))
    image = names_of(cloud, _imaged(cloud, kind, axis))
    across = names_of(classes, _imaged(other, other_kind, axis))
    small = np.bincount(labels_of(classes), weights=other.areas) <= MAJORITY * other.areas.sum()
    lone = (kind < 0) & (parts.area > LEAST_PART) & (np.abs(parts.side[:, axis]) > MAJORITY)
    return np.where(lone & (image >= 0) & small[image], across[image], kind)


def _imaged(cloud: Cloud, kind: Ints, axis: int) -> Ints:
    """The kind (N,) of the part on which the mirror image of each sample lies, -1 for none."""
    image = images(cloud)[:, axis]
    return np.where(image >= 0, kind[labels_of(cloud)[image]], -1)


def patches(source: Cloud, registered: Cloud, matching: Matching) -> tuple[Patch, Patch]:
    """Both clouds with the class of each sample's part."""
    return (
        Patch(source.points, source.outward, matching.source_class[labels_of(source)]),
        Patch(registered.points, registered.outward, matching.target_class[labels_of(registered)]),
    )


def blade_classes(source: Cloud, registered: Cloud, matching: Matching) -> Ints:
    """The classes of parts that are blades on both structures, and may point anywhere."""
    sides = (source, matching.source_class), (registered, matching.target_class)
    here, there = (classes[parts_of(cloud).blade] for cloud, classes in sides)
    return np.intersect1d(here, there)


def alignments(moving: Patch, fixed: Patch, blades: Ints) -> tuple[Floats, Floats, Bools]:
    """The affine map of each class of parts onto its counterparts, and one more row that changes nothing.

    Matrices (C + 1, 3, 3), offsets (C + 1, 3), m, and which classes (C + 1,) turned, as the blades of a rotor
    that stopped elsewhere do. The classes `blades` may: a wing that is swept otherwise has not turned.
    """
    number = int(moving.label.max(initial=-1)) + 1
    matrix, offset = np.tile(np.eye(3), (number + 1, 1, 1)), np.zeros((number + 1, 3))
    turned = np.zeros(number + 1, bool)
    for label in range(number):
        mine, theirs = moving.label == label, fixed.label == label
        if not mine.any() or not theirs.any():
            continue
        part, partner = moving.points[mine], fixed.points[theirs]
        turn = _turned(part, moving.points, partner, fixed.points) if label in blades else None
        turned[label] = turn is not None
        if turn is None:
            # Do extents differ by more than those of counterparts do: along the axes, and along their own?
            # What little sticks out does not count, nor a blade that hardly turned.
            boxes = [np.ptp(_core(points), axis=0) for points in (part, partner)]
            own = [extent_of(points) for points in (part, partner)]
            least = LEAST_PART * float(np.linalg.norm(boxes[0]))
            ratios = [np.log(np.maximum(a, least) / np.maximum(b, least)) for a, b in (boxes, own)]
            if min(np.abs(ratio).max() for ratio in ratios) > np.log(MOST_RATIO):
                continue
        matrix[label], offset[label] = _box_on_box(part, partner) if turn is None else turn
    return matrix, offset, turned


def aligned(moving: Patch, matrix: Floats, offset: Floats) -> Patch:
    """A patch by the affine maps (C + 1, ...) of its classes."""
    points = np.einsum("nij,nj->ni", matrix[moving.label], moving.points) + offset[moving.label]
    normals = np.einsum("nji,nj->ni", np.linalg.inv(matrix)[moving.label], moving.normals)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return Patch(points, normals / np.maximum(length, 1e-12), moving.label)


def aligned_parts(moving: Patch, fixed: Patch, blades: Ints, turned_only: bool = False) -> Patch:
    """Each matched part aligned with its counterpart; only those that turned, if asked."""
    matrix, offset, turned = alignments(moving, fixed, blades)
    if turned_only:
        matrix[~turned], offset[~turned] = np.eye(3), 0.0
    return aligned(moving, matrix, offset)


def _turned(
    part: Floats, whole: Floats, partner: Floats, other_whole: Floats
) -> tuple[Floats, Floats] | None:
    """The map onto the direction of a counterpart, None unless both parts are long and point apart."""
    axis, length, width, outward, middle = _direction(part, whole)
    other_axis, other_length, other_width, other_outward, other_middle = _direction(partner, other_whole)
    pointing = outward and other_outward and length > SLENDER * width and other_length > SLENDER * other_width
    if not pointing or axis @ other_axis > _TURNED:
        return None
    v, cosine = np.cross(axis, other_axis), float(axis @ other_axis)
    skew = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    turn = np.eye(3) + skew + skew @ skew / max(1 + cosine, 1e-9)  # the smallest between the axes
    stretch = np.eye(3) * (other_width / width)
    stretch += np.outer(axis, axis) * (other_length / length - other_width / width)
    matrix = turn @ stretch
    return matrix, other_middle - matrix @ middle


def _box_on_box(part: Floats, partner: Floats) -> tuple[Floats, Floats]:
    """The map of a part's box onto its counterpart's."""
    box, other = _core(part), _core(partner)
    scale = box_scale(other, box)
    return np.diag(scale), other[0] - scale * box[0]


def _core(part: Floats) -> Floats:
    """Lower and upper corner (2, 3) of a part without what little sticks out of it."""
    # A strip of the wing that was modelled with the engine would double the engine's box. Where the outermost
    # samples widen an axis by far more than their number, they do not count.
    low, high = part.min(axis=0), part.max(axis=0)
    inner_low, inner_high = np.quantile(part, [TOLERANCE, 1 - TOLERANCE], axis=0)
    usual = (inner_high - inner_low) * TOLERANCE / (1 - 2 * TOLERANCE)
    low = np.where(inner_low - low > _FAR * usual, inner_low - usual, low)
    high = np.where(high - inner_high > _FAR * usual, inner_high + usual, high)
    return np.stack([low, high])


def _direction(part: Floats, whole: Floats) -> tuple[Floats, float, float, bool, Floats]:
    """Long axis of a part, its length and width, whether it points outward, and its middle along the axis."""
    mean = part.mean(axis=0)
    offset = part - mean
    axis = np.linalg.eigh(offset.T @ offset)[1][:, 2]
    outward = (mean - (whole.min(axis=0) + whole.max(axis=0)) / 2) @ axis
    axis = axis if outward >= 0 else -axis
    along = offset @ axis
    across = np.linalg.norm(offset - along[:, None] * axis, axis=1)
    length, width = float(np.ptp(along)), float(2 * np.sqrt(np.mean(across**2)))
    middle = mean + axis * (along.min() + along.max()) / 2
    return axis, length, width, bool(abs(outward) > length / SLENDER), middle


def misfit_of_parts(source: Cloud, mine: Bools, registered: Cloud, theirs: Bools, diagonal_m: float) -> float:
    """Mean two-way distance of two sets of parts, box on box, normals counted; from 1 they are not matched.

    Over the mean (geometric) of the structure's diagonal and theirs, since small parts misfit by less.
    """
    one, other = source.points[mine], registered.points[theirs]
    matrix, offset = _box_on_box(one, other)
    weight = FACING * diagonal_m
    turned = scaled_normals(source.outward[mine], np.diag(matrix))
    here = with_normals(one @ matrix + offset, turned, weight)
    there = with_normals(other, registered.outward[theirs], weight)
    step = [max(1, len(cloud) // _TRIED) for cloud in (here, there)]
    to_there = cKDTree(there).query(here[:: step[0]])[0].mean()
    to_here = cKDTree(here).query(there[:: step[1]])[0].mean()
    size = np.sqrt(diagonal_m * np.linalg.norm(np.ptp(other, axis=0)))
    return float((to_there + to_here) / 2 / max(size, 1e-9)) / _MISFIT


def rotor_turned(known: Cloud, whole: Cloud) -> Cloud:
    """Samples with parts, their rotor turned as that of a surface in one frame on which no blades are known.

    Where no part is a blade they come back as they are; else their bounding box is that of `whole`, since
    where a rotor stopped shifts and widens the box.
    """
    blades = blades_of(known)
    if not blades.any() or known.normals is None:
        return known
    number = len(np.unique(labels_of(known)[blades]))
    middle, axis = _hub(known.points[blades], labels_of(known)[blades])
    tree, diagonal = cKDTree(whole.points), diagonal_of(whole.points)
    best, least = known, np.inf
    for angle in np.radians(np.arange(0, 360 / number, _STEP_DEG)):
        turn = Rotation.from_rotvec(angle * axis).as_matrix()
        points, normals = known.points.copy(), known.normals.copy()
        points[blades] = (points[blades] - middle) @ turn.T + middle
        normals[blades] = normals[blades] @ turn.T
        fitted = _in_box_of(replace(known, points=points, normals=normals), whole.points)
        some = fitted.points[blades][:: max(1, int(blades.sum()) // _BLADE_SAMPLES)]
        off = float(np.minimum(tree.query(some)[0], TOLERANCE * diagonal).mean())
        if off < least:
            best, least = fitted, off
    return best


def _hub(points: Floats, label: np.ndarray) -> tuple[Floats, Floats]:
    """The middle of a rotor, m, and its axis: across all blades."""
    middle = np.mean([points[label == blade].mean(axis=0) for blade in np.unique(label)], axis=0)
    offset = points - middle
    return middle, np.linalg.eigh(offset.T @ offset)[1][:, 0]


def _in_box_of(cloud: Cloud, points: Floats) -> Cloud:
    """A cloud scaled and shifted until its bounding box is that of some points."""
    scale = box_scale(points, cloud.points)
    normals = scaled_normals(cloud.outward, scale)
    return replace(cloud, points=scale * (cloud.points - cloud.points.min(axis=0)) + points.min(axis=0),
                   normals=normals)  # fmt: skip
