"""The samples of a structure carried to another one: found out once for a pair, whatever is carried after.

How far off a sample may be follows from how much the ways of carrying it disagree (`evidence`), and from how
unevenly its neighbours are carried: where parts meet, and where a correspondence tears.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import Settings
from upplied.findings.evidence import ways_of_carrying
from upplied.planning.correspondence.certainty import certainty
from upplied.planning.correspondence.pair import Pair
from upplied.planning.geometry.clouds import spacing
from upplied.planning.surface.frames import frames_for
from upplied.planning.surface.parts import labels_of
from upplied.records import Floats, Ints, Record, Structure

NEIGHBOURS, NEAR, ALIKE = 8, 2.2, 0.3  # samples about one: how many, spacings off, cosine between normals
# Of the target's diagonal: the error of every sample, and what is added for the way to where the
# registration leads, the box of the part, what faces alike (the farthest of three cones, and of three slabs),
# and for unevenness, each up to `_MOST`. A quantile regression of 95 % on half of the structures of
# bench/findings.py.
_WEIGHTS, _MOST = (0.0016, 0.075, 1.75, 0.39, 0.59, 0.23), 0.05
_GROUPS = (slice(0, 1), slice(1, 2), slice(2, 5), slice(5, 8))  # of the ways


@dataclass(frozen=True, eq=False, repr=False)
class Carried(Record):
    """Samples of a source with their places on a target, each in its declared frame; NaN and -1 for none."""

    point: Floats  # (N, 3) m
    normal: Floats  # (N, 3) unit, outward
    own_part: Ints  # (N,) of the source
    part: Ints  # (N,) of the target
    place: Floats  # (N, 3) m
    towards: Floats  # (N, 3) unit, outward
    linear: Floats  # (N, 3, 3) how offsets from the sample are carried
    probability: Floats  # (N,) that it is the right part; NaN where that cannot be told
    error_m: Floats  # (N,) how far off it may be in 95 % of cases
    step_m: float  # spacing of the samples


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

    linear = np.repeat(((to_target(np.eye(3)) - to_target(np.zeros((1, 3)))).T)[None], len(label), axis=0)
    if match.displacement is not None and match.source_class is not None:
        linear = linear @ match.displacement.matrix[match.source_class[label]]
    linear = linear @ here.turn.T
    step, size = spacing(fit.source), target.diagonal_m
    off = to_target(ways_of_carrying(pair).reshape(-1, 3)).reshape(len(label), -1, 3) - place[:, None]
    off -= np.einsum("nwi,ni->nw", off, towards)[..., None] * towards[:, None]
    ways = np.linalg.norm(off, axis=2)
    others, weight = neighbours(point, normal, point, normal, step)
    apart = point[others] - point[:, None]
    uneven = place[others] - place[:, None] - np.einsum("nij,nkj->nki", linear, apart)
    uneven = np.where(weight > 0, np.nan_to_num(np.linalg.norm(uneven, axis=2)), 0.0).max(axis=1)
    evidence = np.column_stack([*(ways[:, group].max(axis=1) for group in _GROUPS), uneven])
    error = size * stated_error(np.minimum(evidence / size, _MOST))
    part = np.where(none, -1, labels_of(fit.target)[match.target_index])
    return Carried(point, normal, label, part, place, towards, linear, _sure(pair, label), error, step)


def stated_error(evidence: Floats) -> Floats:
    """The error (N,) that holds in 95 % of cases by evidence (N, 5) against places, in shares of a size."""
    return np.asarray(_WEIGHTS[0] + evidence @ np.array(_WEIGHTS[1:]), float)


def neighbours(
    points: Floats, normals: Floats, samples: Floats, facing: Floats, step_m: float
) -> tuple[Ints, Floats]:
    """Samples about points (N, K), the nearest first, and their weights (N, K): 0 if far or facing away."""
    away, nearest = cKDTree(samples).query(points, min(1 + NEIGHBOURS, len(samples)))
    cosine = np.einsum("nki,ni->nk", facing[nearest], normals)
    near = (away < NEAR * step_m) & (cosine > ALIKE)
    return nearest, np.where(near, 1 / (away + 0.1 * step_m) ** 2, 0.0)


def _sure(pair: Pair, part: Ints) -> Floats:
    """Probability (N,) that parts of the source have the counterparts that they were matched with."""
    fit, sure = pair.surface, np.full(len(part), np.nan)
    if fit.carried is None:
        one_piece = not labels_of(fit.source).any() and not labels_of(fit.target).any()
        drawn = not (pair.source.is_scan or pair.target.is_scan)
        return np.ones(len(part)) if one_piece and drawn else sure
    for one in np.unique(part):
        partners = fit.correspondences.target_parts(int(one)).tolist()
        if partners:
            sure[part == one] = certainty(fit, int(one), partners)
    return sure
