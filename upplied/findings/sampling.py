"""The samples of a structure carried to another one: computed once for a pair, whatever is carried after.

On a featureless skin a place could lie a little farther along and look as right. So each sample is carried by
other maps as well: the registration, the box of its part, and the boxes of the samples that face as it does,
in all and within a slab of the part. Its stated error follows from how much these maps disagree, and from how
unevenly its neighbours are carried, as where parts meet and where a correspondence tears.
"""

import numpy as np

from upplied.config import Settings
from upplied.findings.counterparts import Carried, about
from upplied.planning.correspondence.certainty import certainty
from upplied.planning.correspondence.coherent_point_drift import Patch
from upplied.planning.correspondence.correspondences import facing_nearest
from upplied.planning.correspondence.pair import Pair
from upplied.planning.correspondence.part_alignment import aligned, patches
from upplied.planning.correspondence.part_assignment import Matching
from upplied.planning.geometry.clouds import diagonal_of, spacing
from upplied.planning.surface.frames import frames_for
from upplied.planning.surface.parts import labels_of
from upplied.records import Bools, Floats, Structure

_COSINES = (0.7, 0.85, 0.95)  # least cosine between normals of what faces alike
_SLAB_CONE, _SLAB = 0.6, 0.2  # the same within a slab of the part, and half its width of the part's extent
_FEWEST = 8  # samples that have a box
_EVERY = 4  # of a part's samples, for which boxes are made: they differ little between neighbours
_STRETCH = 1.4  # most by which such boxes differ
_CONES = slice(2, 2 + len(_COSINES))  # the ways that follow from them
_WAYS = _CONES.stop + 3
_FAR_M = 1e9  # beyond any sample
# Of the target's diagonal: the error of every sample, and what is added for the way to where the
# registration leads, the box of the part, what faces alike (the farthest of three cones, and of three slabs),
# and for unevenness, each up to `_MOST`. A quantile regression of 95 % on half of the structures of
# bench/findings.py.
_WEIGHTS, _MOST = (0.0016, 0.075, 1.75, 0.39, 0.59, 0.23), 0.05
_GROUPS = (slice(0, 1), slice(1, 2), _CONES, slice(_CONES.stop, None))  # of the ways


def carried_samples(pair: Pair, source: Structure, target: Structure, settings: Settings) -> Carried:
    """The samples of a pair's source, carried as plans are; both structures in their declared frames."""
    here, there = frames_for(source, target, settings)
    fit, match, label = pair.surface, pair.surface.correspondences, labels_of(pair.surface.source)
    point, normal = here.to_declared(fit.source.points), fit.source.outward @ here.turn.T
    place = there.to_declared(match.target_points)
    none = ~np.isfinite(place[:, 0]) | (match.target_index < 0)
    place[none] = np.nan
    towards = fit.target.outward[match.target_index] @ there.turn.T

    def to_target(points: Floats) -> Floats:
        return there.to_declared(fit.registration.to_target(points))

    linear = (to_target(np.eye(3)) - to_target(np.zeros((1, 3)))).T
    maps = np.repeat(np.eye(3)[None], label.max() + 1, axis=0)
    if match.displacement is not None and match.source_class is not None:
        maps = match.displacement.matrix[match.source_class]
    linear = linear @ maps @ here.turn.T
    step, size = spacing(fit.source), target.diagonal_m
    off = to_target(_ways_of_carrying(pair).reshape(-1, 3)).reshape(len(label), -1, 3) - place[:, None]
    off -= np.einsum("nwi,ni->nw", off, towards)[..., None] * towards[:, None]
    ways = np.linalg.norm(off, axis=2)
    # Where nothing faces as a sample does it has no place: that no way is known is no agreement.
    ways[np.isnan(ways[:, _CONES]).all(axis=1), _CONES.start] = np.inf
    near = about(np.hstack([point, normal]), point, normal, step)
    apart = point[near.samples] - point[:, None]
    uneven = place[near.samples] - place[:, None] - np.einsum("nij,nkj->nki", linear[label], apart)
    uneven = np.where(near.weight > 0, np.nan_to_num(np.linalg.norm(uneven, axis=2)), 0.0).max(axis=1)
    ways = np.nan_to_num(ways, posinf=np.inf)
    evidence = np.column_stack([*(ways[:, group].max(axis=1) for group in _GROUPS), uneven])
    error = size * (_WEIGHTS[0] + np.minimum(evidence / size, _MOST) @ np.array(_WEIGHTS[1:]))
    part = np.where(none, -1, labels_of(fit.target)[match.target_index])
    return Carried(point, normal, label, part, place, towards, error, label, linear, _sure(pair), step)


def _ways_of_carrying(pair: Pair) -> Floats:
    """Where other maps carry the source's samples (N, _WAYS, 3), m, registered; NaN where too little does."""
    # The registration, the box of each part, what faces alike in three cones, and in slabs across each axis.
    fit, match = pair.surface, pair.surface.correspondences
    points = fit.source.points
    if match.displacement is None or match.source_class is None or match.target_class is None:
        return np.repeat(points[:, None], _WAYS, axis=1)
    matching = Matching(match.source_class, match.target_class)
    moving, fixed = patches(fit.source, fit.registered, matching)
    boxed = aligned(moving, match.displacement.matrix, match.displacement.offset_m)
    order, first = np.argsort(boxed.label, kind="stable"), np.unique(boxed.label, return_index=True)[1]
    some = boxed.rows(np.union1d(order[::_EVERY], first))
    alike = _facing_boxes(some, boxed, fixed) - some.points[:, None]
    alike = alike[facing_nearest(boxed, some, diagonal_of(points))]
    return np.concatenate([points[:, None], boxed.points[:, None], boxed.points[:, None] + alike], axis=1)


def _facing_boxes(some: Patch, boxed: Patch, fixed: Patch) -> Floats:
    """Where the boxes of what faces alike carry some of the samples of aligned parts (N, 6, 3), m."""
    places = np.full((len(some), _WAYS - _CONES.start, 3), np.nan)
    for label in np.unique(fixed.label[fixed.label >= 0]):
        rows = np.flatnonzero(some.label == label)
        sides = [side.rows(side.label == label) for side in (boxed, fixed)]
        slab, mine = _SLAB * np.ptp(sides[1].points, axis=0), some.rows(rows)
        (low, high, few), (other_low, other_high, fewer) = (_boxes(mine, side, slab) for side in sides)
        stretch = (other_high - other_low) / np.maximum(high - low, 1e-9)
        offset = np.clip(stretch, 1 / _STRETCH, _STRETCH) * (some.points[rows, None] - (low + high) / 2)
        known = ~(few | fewer)[..., None]
        places[rows] = np.where(known, (other_low + other_high) / 2 + offset, np.nan)
    return places


def _boxes(some: Patch, side: Patch, slab: Floats) -> tuple[Floats, Floats, Bools]:
    """Boxes of the samples of a side that face as each of some does: low, high (N, 6, 3), and if too few."""
    cosine = some.normals @ side.normals.T
    alike = [cosine > least for least in _COSINES]
    apart = np.abs(side.points - some.points[:, None])
    alike += [(cosine > _SLAB_CONE) & (apart[..., axis] < slab[axis]) for axis in range(3)]
    low, high = (
        np.stack([edge(np.where(one[..., None], side.points, far), 1, initial=far) for one in alike], axis=1)
        for edge, far in ((np.min, _FAR_M), (np.max, -_FAR_M))
    )
    return low, high, np.stack([one.sum(axis=1) < _FEWEST for one in alike], axis=1)


def _sure(pair: Pair) -> Floats:
    """Probability (P,) that each part of the source has the counterpart that it was matched with."""
    fit, label = pair.surface, labels_of(pair.surface.source)
    sure = np.full(label.max() + 1, np.nan)
    if fit.carried is None:
        one_piece = not label.any() and not labels_of(fit.target).any()
        drawn = not (pair.source.is_scan or pair.target.is_scan)
        return np.ones(len(sure)) if one_piece and drawn else sure
    for one in np.unique(label):
        partners = fit.correspondences.target_parts(int(one)).tolist()
        if partners:
            sure[one] = certainty(fit, int(one), partners)
    return sure
