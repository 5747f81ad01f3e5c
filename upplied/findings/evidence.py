"""How else a place could be carried: where the ways disagree, its counterpart is less certain.

A place in the middle of a featureless skin could be carried a little further along it and look as right. So
each is carried by other maps as well: by the registration alone, by the box of its part, and by the boxes of
what of its part faces as it does, or does so at its length, breadth or height.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.planning.correspondence.coherent_point_drift import Patch
from upplied.planning.correspondence.correspondences import facing_nearest
from upplied.planning.correspondence.pair import Pair
from upplied.planning.correspondence.part_alignment import aligned, patches
from upplied.planning.correspondence.part_assignment import Matching
from upplied.planning.geometry.clouds import diagonal_of
from upplied.records import Floats, Ints

_COSINES = np.array([0.7, 0.85, 0.95])  # least cosine between normals of what faces alike
_SLAB_CONE, _SLAB = 0.6, 0.2  # the same within a slab of the part, and half its width of the part's extent
_FEWEST = 8  # samples that have a box
_EVERY = 4  # of a part's samples, of which boxes are asked: they differ little between neighbours
_STRETCH = 1.4  # most by which such boxes differ
CONES = slice(2, 2 + len(_COSINES))  # the ways that follow from them
WAYS = CONES.stop + 3


def ways_of_carrying(pair: Pair) -> Floats:
    """Where other maps carry the source's samples (N, WAYS, 3), m, frame of the registered target.

    They are the registration, the box of each part, what faces alike in three cones, and in slabs
    across each axis; NaN where too little does.
    """
    fit, match = pair.surface, pair.surface.correspondences
    points = fit.source.points
    if match.displacement is None or match.source_class is None or match.target_class is None:
        return np.repeat(points[:, None], WAYS, axis=1)
    matching = Matching(match.source_class, match.target_class)
    moving, fixed = patches(fit.source, fit.registered, matching)
    boxed = aligned(moving, match.displacement.matrix, match.displacement.offset_m)
    order, first = np.argsort(boxed.label, kind="stable"), np.unique(boxed.label, return_index=True)[1]
    some = boxed.rows(np.union1d(order[::_EVERY], first))
    alike = facing_boxes(some, boxed, fixed) - some.points[:, None]
    alike = alike[facing_nearest(boxed, some, diagonal_of(points))]
    return np.concatenate([points[:, None], boxed.points[:, None], boxed.points[:, None] + alike], axis=1)


def facing_boxes(some: Patch, boxed: Patch, fixed: Patch) -> Floats:
    """Where the boxes of what faces alike carry some of the samples of aligned parts (N, 6, 3), m."""
    extent = np.zeros((1 + int(max(boxed.label.max(initial=0), fixed.label.max(initial=0))), 3))
    for label in np.unique(fixed.label[fixed.label >= 0]):
        extent[label] = np.ptp(fixed.points[fixed.label == label], axis=0)
    sides = [(np.hstack([one.points, one.normals]), np.ascontiguousarray(one.label))
             for one in (some, boxed, fixed)]  # fmt: skip
    return np.asarray(_facing_boxes(*sides[0], *sides[1], *sides[2], _SLAB * extent))


@njit(cache=True)
def _facing_boxes(
    some: Floats, label: Ints, own: Floats, own_label: Ints, others: Floats, others_label: Ints, slab: Floats
) -> Floats:
    """The same of samples with their normals (N, 6)."""
    number = len(_COSINES) + 3
    places = np.empty((len(some), number, 3))
    for at in range(len(some)):
        here = _boxes(some[at], label[at], own, own_label, slab)
        there = _boxes(some[at], label[at], others, others_label, slab)
        for way in range(number):
            known = min(here[way, 6], there[way, 6]) >= _FEWEST
            for axis in range(3):
                places[at, way, axis] = np.nan
                if known:
                    low, high = here[way, axis], here[way, 3 + axis]
                    other_low, other_high = there[way, axis], there[way, 3 + axis]
                    scale = (other_high - other_low) / max(high - low, 1e-9)
                    scale = min(max(scale, 1 / _STRETCH), _STRETCH)
                    offset = some[at, axis] - (low + high) / 2
                    places[at, way, axis] = (other_low + other_high) / 2 + scale * offset
    return places


@njit(cache=True)
def _boxes(sample: Floats, label: int, samples: Floats, labels: Ints, slab: Floats) -> Floats:
    """Boxes (6, 7) of the samples of a class that face alike: low, high, and how many they are."""
    cones = len(_COSINES)
    boxes = np.zeros((cones + 3, 7))
    boxes[:, :3], boxes[:, 3:6] = np.inf, -np.inf
    for row in range(len(samples)):
        if labels[row] != label or label < 0:
            continue
        other = samples[row]
        cosine = sample[3] * other[3] + sample[4] * other[4] + sample[5] * other[5]
        if cosine <= _SLAB_CONE:
            continue
        for way in range(cones + 3):
            if way < cones:
                if cosine <= _COSINES[way]:
                    continue
            elif abs(other[way - cones] - sample[way - cones]) >= slab[label, way - cones]:
                continue
            boxes[way, 6] += 1
            for axis in range(3):
                boxes[way, axis] = min(boxes[way, axis], other[axis])
                boxes[way, 3 + axis] = max(boxes[way, 3 + axis], other[axis])
    return boxes
