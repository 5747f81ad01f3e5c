"""Correspondences by parts: parts first, then points within them, warped and facing the same way.

The paper pairs nearest neighbours (Sec. III-B). On real structures a third of those pairs join the
top of one wing to the bottom of the other, and an inner engine to an outer one where that is nearer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial import cKDTree

from upplied.planning.cpd import Patch, drift, farthest_points
from upplied.planning.matching import match_parts
from upplied.planning.parts import labels_of, parts_of
from upplied.planning.register import box_scale, spacing
from upplied.planning.wording import summary_of
from upplied.records import Bools, Cloud, Correspondences, Floats, Ints, Registration

_CONTROLS, _ANCHORS = 200, 450  # points of the source that move, points of the target that pull
_FACING = 0.03  # of the diagonal: what turning a normal by a right angle counts beside distance
_MISFIT = 0.025  # largest mean distance, in these units, of parts whose boxes are not alike
_TRIED = 150  # samples by which that is judged
_LONG = 3.0  # length over width of a part whose direction is its own: a blade
_OUTWARD = 0.25  # of its length: how far from the structure's middle such a part lies, along itself
_TURNED = np.cos(np.radians(10))
_GONE = 0.05  # of the diagonal: a point that stays this far from the target has no counterpart there
_SAME_FACE = 0.3  # least cosine between a normal and its counterpart's, for a part that has no partner
_CLAIM = 1.5  # spacings: how near a counterpart of a matched part makes a target sample taken
_BODY = 0.4  # length of the mean normal below which a part is a body of its own, not a patch of a skin
_WHOLE = 0.6  # least share of a part without a partner that must find its like, or all of it has none


def by_parts(
    source: Cloud, target: Cloud, registration: Registration, pinned: Mapping[int, int] | None = None
) -> Correspondences:
    """Counterparts of all samples of the source.

    Parameters
    ----------
    source, target : Cloud
        Surface samples with normals and parts, each in its own frame.
    registration : Registration
    pinned : mapping, optional
        Source part to target part, as the user said.
    """
    if source.normals is None or target.normals is None:
        raise ValueError("correspondences by parts need normals")
    diagonal = float(np.linalg.norm(np.ptp(source.points, axis=0)))
    lying = laid(target, registration)
    here, there = parts_of(source), parts_of(lying)

    def fits(parts: Sequence[int], partners: Sequence[int]) -> bool:
        mine, theirs = np.isin(labels_of(source), parts), np.isin(labels_of(lying), partners)
        return _misfit(source, mine, lying, theirs, diagonal) < _MISFIT

    matching = match_parts(here, there, diagonal, fits, pinned)
    moving = Patch(source.points, source.normals, matching.source_class[labels_of(source)])
    fixed = Patch(lying.points, _normals(lying), matching.target_class[labels_of(lying)])
    warped = _warped(_placed(moving, fixed, len(matching)), fixed, diagonal)
    index = _facing_nearest(warped, fixed, diagonal)
    on_skin = _on_skin(warped.points, fixed, index, spacing(source))
    claimed = _claimed(on_skin, moving.label, fixed, spacing(lying))
    gone = _without(warped, fixed, index, claimed, labels_of(source), diagonal)
    carried = registration.to_target(on_skin)
    carried[gone] = np.nan
    return Correspondences(
        target_index=np.where(gone, -1, index),
        distance_m=np.where(gone, np.nan, np.linalg.norm(source.points - on_skin, axis=1)),
        target_points=carried,
        summary=summary_of(here, matching, labels_of(source), gone, there),
    )


def laid(target: Cloud, registration: Registration) -> Cloud:
    """The target's samples in the frame and at the scale of the demonstration structure."""
    normals = None
    if target.normals is not None:
        normals = (target.normals / registration.scale) @ registration.rotation.T
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Cloud(registration.to_demo(target.points), normals, target.area_m2, target.part, target.leaf_m)


def _normals(cloud: Cloud) -> Floats:
    assert cloud.normals is not None
    return cloud.normals


def _misfit(source: Cloud, mine: Bools, lying: Cloud, theirs: Bools, diagonal_m: float) -> float:
    """Mean two-way distance of two sets of parts, box on box, normals counted.

    Over the mean (geometric) of the structure's diagonal and theirs, since small parts misfit by less.
    """
    one, other = source.points[mine], lying.points[theirs]
    scale = box_scale(other, one)
    turned = _normals(source)[mine] / scale
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    weight = _FACING * diagonal_m
    here = np.hstack([scale * (one - one.min(axis=0)) + other.min(axis=0), weight * turned])
    there = np.hstack([other, weight * _normals(lying)[theirs]])
    step = [max(1, len(cloud) // _TRIED) for cloud in (here, there)]
    to_there = cKDTree(there).query(here[:: step[0]])[0].mean()
    to_here = cKDTree(here).query(there[:: step[1]])[0].mean()
    size = np.sqrt(diagonal_m * np.linalg.norm(np.ptp(other, axis=0)))
    return float(max(to_there, to_here) / max(size, 1e-9))


def _placed(moving: Patch, fixed: Patch, classes: int) -> Patch:
    """Each matched part laid on its partner: box on box, or along its own direction where that turned."""
    points, normals = moving.points.copy(), moving.normals.copy()
    for label in range(classes):
        mine, theirs = moving.label == label, fixed.label == label
        if mine.any() and theirs.any():
            points[mine], normals[mine] = _laid_part(
                moving.points[mine], moving.normals[mine], fixed.points[theirs], moving.points, fixed.points
            )
    return Patch(points, normals, moving.label)


def _laid_part(
    part: Floats, normals: Floats, partner: Floats, whole: Floats, other_whole: Floats
) -> tuple[Floats, Floats]:
    axis, length, width, outward = _direction(part, whole)
    other_axis, other_length, other_width, other_outward = _direction(partner, other_whole)
    pointing = outward and other_outward and length > _LONG * width and other_length > _LONG * other_width
    if pointing and axis @ other_axis < _TURNED:
        turn = _smallest_turn(axis, other_axis)
        stretch = np.eye(3) * (other_width / width)
        stretch += np.outer(axis, axis) * (other_length / length - other_width / width)
        middle, other_middle = _middle_along(part, axis), _middle_along(partner, other_axis)
        return (part - middle) @ (turn @ stretch).T + other_middle, normals @ turn.T
    scale = box_scale(partner, part)
    laid_normals = normals / scale
    laid_normals /= np.linalg.norm(laid_normals, axis=1, keepdims=True)
    return scale * (part - part.min(axis=0)) + partner.min(axis=0), laid_normals


def _direction(part: Floats, whole: Floats) -> tuple[Floats, float, float, bool]:
    """Long axis of a part, its length and width, and whether it points away from the structure's middle."""
    offset = part - part.mean(axis=0)
    axis = np.linalg.eigh(offset.T @ offset)[1][:, 2]
    outward = (part.mean(axis=0) - (whole.min(axis=0) + whole.max(axis=0)) / 2) @ axis
    axis = axis if outward >= 0 else -axis
    along = offset @ axis
    across = np.linalg.norm(offset - along[:, None] * axis, axis=1)
    length = float(np.ptp(along))
    return axis, length, float(2 * np.sqrt(np.mean(across**2))), bool(abs(outward) > _OUTWARD * length)


def _middle_along(part: Floats, axis: Floats) -> Floats:
    mean = part.mean(axis=0)
    along = (part - mean) @ axis
    return mean + axis * (along.min() + along.max()) / 2


def _smallest_turn(a: Floats, b: Floats) -> Floats:
    """The rotation matrix of the smallest turn from unit vector `a` to unit vector `b`."""
    v, cosine = np.cross(a, b), float(a @ b)
    skew = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + skew + skew @ skew / max(1 + cosine, 1e-9)


def _warped(placed: Patch, fixed: Patch, diagonal_m: float) -> Patch:
    controls = farthest_points(placed.points, _CONTROLS)
    anchors = farthest_points(fixed.points, _ANCHORS)
    found = drift(placed.at(controls), fixed.at(anchors), diagonal_m)
    moved = placed.points + found.at(placed.points, placed.label)
    return Patch(moved, placed.normals, placed.label)


def _facing_nearest(warped: Patch, fixed: Patch, diagonal_m: float) -> Ints:
    """For each point the sample of its partner part that is near and faces the same way."""
    weight = _FACING * diagonal_m
    index = np.full(len(warped), -1)
    for label in np.unique(warped.label):
        mine = warped.label == label
        theirs = np.flatnonzero(fixed.label == label) if label >= 0 else np.arange(len(fixed))
        tree = cKDTree(np.hstack([fixed.points[theirs], weight * fixed.normals[theirs]]))
        found = tree.query(np.hstack([warped.points[mine], weight * warped.normals[mine]]))[1]
        index[mine] = theirs[found]
    return index


def _claimed(on_skin: Floats, label: Ints, fixed: Patch, step_m: float) -> Bools:
    """Which target samples (M,) are counterparts of parts that were matched."""
    claimed = np.zeros(len(fixed), bool)
    for part in np.unique(label[label >= 0]):
        theirs = np.flatnonzero(fixed.label == part)
        reach = cKDTree(on_skin[label == part]).query(fixed.points[theirs])[0]
        claimed[theirs] = reach < _CLAIM * step_m
    return claimed


def _without(
    warped: Patch, fixed: Patch, index: Ints, claimed: Bools, part: Ints, diagonal_m: float
) -> Bools:
    """Which samples have no counterpart: far from everything, or of a part that finds no like."""
    free = warped.label < 0
    distance = np.linalg.norm(warped.points - fixed.points[index], axis=1)
    same_face = np.einsum("ij,ij->i", warped.normals, fixed.normals[index]) > _SAME_FACE
    count = np.maximum(np.bincount(part), 1)
    facing = np.column_stack([np.bincount(part, weights=axis) for axis in warped.normals.T]) / count[:, None]
    body = np.linalg.norm(facing, axis=1) < _BODY
    found = same_face & (distance < _GONE / 2 * diagonal_m) & ~(claimed[index] & body[part])
    share = np.bincount(part, weights=found) / count
    return free & ((distance > _GONE * diagonal_m) | (share[part] < _WHOLE))


def _on_skin(points: Floats, fixed: Patch, index: Ints, step_m: float) -> Floats:
    """The warped points dropped onto the target's skin, no farther than one spacing from a sample."""
    sample, normal = fixed.points[index], fixed.normals[index]
    offset = points - sample
    offset = offset - np.einsum("ij,ij->i", offset, normal)[:, None] * normal
    length = np.linalg.norm(offset, axis=1, keepdims=True)
    return sample + offset * np.minimum(1.0, step_m / np.maximum(length, 1e-12))
