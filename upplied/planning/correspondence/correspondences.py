"""Which point of the target corresponds to each point of the demonstration's cloud (paper, Sec. III-B).

The paper pairs nearest neighbours. On real structures a third of those pairs join the top of one wing to the
bottom of the other, and an inner engine to an outer one where that is nearer. So parts are matched first,
then points within them, warped and facing the same way.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import CorrespondenceSettings
from upplied.geometry.vectors import with_normals
from upplied.planning.constants import CLEARLY_BETTER, FACING, MAJORITY, SAME_FACE, TOLERANCE, TOUCH
from upplied.planning.correspondence.coherent_point_drift import ANCHORS, CONTROLS, Drift, Patch, drift
from upplied.planning.correspondence.naming import Landmarks, pinned_parts, summary_of
from upplied.planning.correspondence.part_alignment import (
    aligned,
    alignments,
    blade_classes,
    matched,
    patches,
)
from upplied.planning.correspondence.part_assignment import Matching
from upplied.planning.geometry.clouds import UNTURNED, diagonal_of, in_source_frame, spacing
from upplied.planning.surface.parts import Parts, labels_of, parts_of, parts_of_both
from upplied.records import Bools, Cloud, Correspondences, Displacement, Floats, Ints, Registration

_TRIED = 300  # samples of a part by which it is judged whether a drift brings it nearer
_FACES_AWAY, _ADJACENT = 0.7, 0.5  # cosine of normals; how much nearer, with normals, an adjacent part is


def correspond(
    source: Cloud,
    target: Cloud,
    registration: Registration,
    settings: CorrespondenceSettings,
    source_landmarks: Landmarks | None = None,
    target_landmarks: Landmarks | None = None,
    words: Floats = UNTURNED,
    named: Ints | None = None,
) -> Correspondences:
    """Counterparts of all points of the demonstration's cloud.

    Parameters
    ----------
    source, target : Cloud
        Of the demonstration structure and of the target, each in its own frame.
    settings : CorrespondenceSettings
        Method ``nearest`` as published, or ``parts``, for clouds with normals.
    source_landmarks, target_landmarks : mapping of name to x y z, m, optional
        What the names in `settings.counterparts` may refer to.
    words : array, shape (3, 3), optional
        Quarter turns of the source to the axes in which places such as ``left`` are named.
    named : array of int, shape (M,), optional
        The source's part that the parts of either were inferred by, of each target sample; -1 none.

    Raises
    ------
    SettingsError
        If `settings.counterparts` names a part that is not there.
    """
    if settings.method == "nearest" or source.normals is None or target.normals is None:
        return nearest(source, target, registration)
    landmarks = (source_landmarks or {}, target_landmarks or {})
    names = settings.counterparts, *landmarks, words, named
    pinned = pinned_parts(source, target, registration, *names)
    return by_parts(source, target, registration, pinned, words, named)


def nearest(source: Cloud, target: Cloud, registration: Registration) -> Correspondences:
    """The nearest point of the aligned target for every point (paper, Alg. 1, lines 8 to 12)."""
    aligned = registration.to_demo(target.points)
    distance, index = cKDTree(aligned).query(source.points)
    return Correspondences(
        target_index=np.asarray(index, np.int64),
        distance_m=np.asarray(distance, float),
        target_points=target.points[index],
        summary=f"nearest of {len(target)} target points for each of {len(source)}",
    )


def by_parts(
    source: Cloud,
    target: Cloud,
    registration: Registration,
    pinned: Mapping[int, int] | None = None,
    words: Floats = UNTURNED,
    named: Ints | None = None,
) -> Correspondences:
    """Counterparts of all samples of the source, see `correspond`; samples have normals and parts."""
    registered = in_source_frame(target, registration)
    matching = matched(source, registered, pinned, named)
    moving, fixed = patches(source, registered, matching)
    # Each matched part on its counterpart, and a smooth field besides.
    matrix, offset, _ = alignments(moving, fixed, blade_classes(source, registered, matching))
    field, smooth = _smooth_field(aligned(moving, matrix, offset), fixed, diagonal_of(source.points))
    control = field.control.points, field.control.label, field.weights, field.reach_m
    step = np.array([spacing(source), spacing(registered)])
    displacement = Displacement(matrix, offset, smooth, *control, step)
    match = by_displacement(source, registered, registration, matching, displacement)
    here, there = parts_of_both(source, registered, words)
    gone = match.target_index < 0
    return replace(match, summary=summary_of(here, matching, labels_of(source), gone, there))


def by_displacement(
    source: Cloud, registered: Cloud, registration: Registration, matching: Matching, carrier: Displacement
) -> Correspondences:
    """Counterparts of samples of the source by a displacement that is known; parts correspond as it knew.

    `registered` is the target in the frame and at the scale of the source.
    """
    diagonal = diagonal_of(source.points)
    moving, fixed = patches(source, registered, matching)
    warped = carried_by(carrier, moving)
    index = facing_nearest(warped, fixed, diagonal)
    index = _on_adjacent_parts(warped, fixed, index, labels_of(registered), parts_of(registered), diagonal)
    on_skin = _on_skin(warped.points, fixed, index, carrier.step_m[0])
    claimed = _claimed(on_skin, moving.label, fixed, carrier.step_m[1])
    continues = _continues(parts_of(source), matching)[labels_of(source), fixed.label[index]]
    gone = _without(warped, fixed, index, claimed[index] & ~continues, source, diagonal)
    carried = registration.to_target(on_skin)
    carried[gone] = np.nan
    return Correspondences(
        target_index=np.where(gone, -1, index),
        distance_m=np.where(gone, np.nan, np.linalg.norm(source.points - on_skin, axis=1)),
        target_points=carried,
        source_class=matching.source_class,
        target_class=matching.target_class,
        displacement=carrier,
    )


def carried_by(carrier: Displacement, moving: Patch) -> Patch:
    """Samples of the source where a displacement brings them, with their normals."""
    there = aligned(moving, carrier.matrix, carrier.offset_m)
    control = Patch(carrier.control_points, carrier.control_points, carrier.control_class)
    field = Drift(control, carrier.weights, carrier.reach_m).at(there.points, there.label)
    return replace(there, points=there.points + field * carrier.smooth[there.label][:, None])


def _smooth_field(there: Patch, fixed: Patch, diagonal: float) -> tuple[Drift, Floats]:
    """The drift of aligned parts, and how much of it each class (C + 1,) takes, 0 to 1."""
    # All of it where it brings the surfaces much nearer, nothing where it brings them no nearer: in between a
    # share, so that no small change of a mesh decides.
    field = drift(there.rows(slice(CONTROLS)), fixed.rows(slice(ANCHORS)), diagonal)
    drifted = replace(there, points=there.points + field.at(there.points, there.label))
    smooth = np.zeros(int(there.label.max(initial=-1)) + 2)
    for label in np.unique(there.label):
        mine = np.flatnonzero(there.label == label)
        tried = mine[:: max(1, len(mine) // _TRIED)]
        before = _off(there.rows(tried), fixed, diagonal)
        gain = 1 - _off(drifted.rows(tried), fixed, diagonal) / max(before, 1e-12)
        smooth[label] = np.clip(gain / (2 * (1 - CLEARLY_BETTER)), 0, 1)
    return field, smooth


def _off(patch: Patch, fixed: Patch, diagonal_m: float) -> float:
    """Mean distance of points from the skin of their counterparts, along its normal."""
    index = facing_nearest(patch, fixed, diagonal_m)
    offset = np.einsum("ij,ij->i", patch.points - fixed.points[index], fixed.normals[index])
    return float(np.abs(offset).mean())


def facing_nearest(warped: Patch, fixed: Patch, diagonal_m: float) -> Ints:
    """For each point the sample of its counterpart that is near and faces the same way."""
    weight = FACING * diagonal_m
    index = np.full(len(warped), -1)
    for label in np.unique(warped.label):
        mine = warped.label == label
        theirs = np.flatnonzero(fixed.label == label) if label >= 0 else np.arange(len(fixed))
        tree = cKDTree(with_normals(fixed.points[theirs], fixed.normals[theirs], weight))
        nearest_one = tree.query(with_normals(warped.points[mine], warped.normals[mine], weight))[1]
        index[mine] = theirs[nearest_one]
    return index


def _on_adjacent_parts(
    warped: Patch, fixed: Patch, index: Ints, part: Ints, parts: Parts, diagonal_m: float
) -> Ints:
    """The counterparts, but of a part adjacent to it where that alone has such a face."""
    # Modellers cut where it suits them: what is a strip of the fuselage's side in one wing's mesh is the
    # fuselage's in another, and nothing of the other wing faces that way.
    weight = FACING * diagonal_m
    here, there = (with_normals(patch.points, patch.normals, weight) for patch in (warped, fixed))
    faces_away = np.einsum("ij,ij->i", warped.normals, fixed.normals[index]) < _FACES_AWAY
    index = index.copy()
    for label in np.unique(warped.label[faces_away & (warped.label >= 0)]):
        mine = np.flatnonzero(faces_away & (warped.label == label))
        counterparts = np.unique(part[fixed.label == label])
        adjacent = parts.touching[counterparts].any(axis=0)
        theirs = np.flatnonzero(adjacent[part] & (fixed.label != label))
        if len(theirs) == 0:
            continue
        distance, nearest_one = cKDTree(there[theirs]).query(here[mine])
        nearer = distance < _ADJACENT * np.linalg.norm(here[mine] - there[index[mine]], axis=1)
        index[mine[nearer]] = theirs[nearest_one[nearer]]
    return index


def _claimed(on_skin: Floats, label: Ints, fixed: Patch, step_m: float) -> Bools:
    """Which target samples (M,) are counterparts of parts that were matched."""
    claimed = np.zeros(len(fixed), bool)
    for part in np.unique(label[label >= 0]):
        theirs = np.flatnonzero(fixed.label == part)
        reach = cKDTree(on_skin[label == part]).query(fixed.points[theirs])[0]
        claimed[theirs] = reach < TOUCH * step_m
    return claimed


def _continues(parts: Parts, matching: Matching) -> Bools:
    """Whether a part (row) continues the skin of one that corresponds to the class (column)."""
    continues = np.zeros((len(parts), max(len(matching), 1)), bool)
    for part in np.flatnonzero(~parts.body):
        classes = matching.source_class[parts.touching[part]]
        continues[part, classes[classes >= 0]] = True
    return continues


def _without(
    warped: Patch, fixed: Patch, index: Ints, taken: Bools, source: Cloud, diagonal_m: float
) -> Bools:
    """Which samples have no counterpart: far from everything, or of a part without counterpart."""
    free = warped.label < 0
    distance = np.linalg.norm(warped.points - fixed.points[index], axis=1)
    same_face = np.einsum("ij,ij->i", warped.normals, fixed.normals[index]) > SAME_FACE
    part, area = labels_of(source), source.areas
    whole = np.maximum(np.bincount(part, weights=area), 1e-12)
    lies_there = same_face & (distance < TOLERANCE / 2 * diagonal_m) & ~taken
    share = np.bincount(part, weights=area * lies_there) / whole
    return free & ((distance > TOLERANCE * diagonal_m) | (share[part] < MAJORITY))


def _on_skin(points: Floats, fixed: Patch, index: Ints, step_m: float) -> Floats:
    """The warped points dropped onto the target's skin, no farther than one spacing from a sample."""
    sample, normal = fixed.points[index], fixed.normals[index]
    offset = points - sample
    offset = offset - np.einsum("ij,ij->i", offset, normal)[:, None] * normal
    length = np.linalg.norm(offset, axis=1, keepdims=True)
    return sample + offset * np.minimum(1.0, step_m / np.maximum(length, 1e-12))
