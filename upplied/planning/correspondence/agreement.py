"""How certain a counterpart is: by the two structures, and where a sibling told their parts, by way of it.

Source and target tell by their own evidence which part is which, and so do source and sibling, and sibling
and target. What both ways lead to is more certain than either says; where they lead to different parts, one
of them is wrong, and each speaks against the other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.planning.constants import MAJORITY
from upplied.planning.correspondence.certainty import (
    COUNTERPART,
    evidence_of_counterpart,
    probability,
)
from upplied.planning.correspondence.fit import Fit, Told
from upplied.planning.surface.parts import labels_of
from upplied.records import Bools

# Evidence of a part that another way of asking brings elsewhere altogether, as a displacement may
# (`certainty.evidence_of_counterpart`): what is disputed is no more certain than that.
_ELSEWHERE = np.array([0.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def certainty(fit: Fit, part: int, counterparts: Sequence[int], alone: bool = False) -> float:
    """Probability that parts of the target correspond to a part of the source.

    Parameters
    ----------
    fit : Fit
        Of surfaces with parts.
    part : int
        Of the source.
    counterparts : sequence of int
        Parts of the target, at least one.
    alone : bool
        Whether no other part of the target is like them.
    """
    found = _by_fit(fit, part, counterparts, alone)
    if fit.told is None:
        return found
    theirs, area, others = np.isin(labels_of(fit.target), counterparts), fit.target.areas, []
    for other, sure in (_by_source(fit.told, part), _by_way_of_sibling(fit.told, part)):
        agrees = area[theirs & other].sum() > MAJORITY * area[theirs | other].sum()
        others.append((bool(agrees), sure))
    (agrees, sure), (alike, by_way) = others
    found = max(found, sure) if agrees else found
    if alike:
        found = max(found, _both(found, by_way))
    for same, against in others:
        if not same and against > 0:
            found = min(found, _both(found, 1 - against), probability(_ELSEWHERE, COUNTERPART))
    return found


def wholes_of(fit: Fit) -> float:
    """How badly the target fits the structure that told its parts, of what was scanned of it."""
    return (fit if fit.told is None else fit.told.to_target).registration.scanned


def named_by(fit: Fit) -> Bools:
    """Which samples of the target (M,) lie on the part that their place on the source corresponds to."""
    here, there = fit.correspondences.source_class, fit.correspondences.target_class
    if fit.carried is None or here is None or there is None:
        return np.zeros(len(fit.target), bool)
    mine = np.where(fit.carried >= 0, here[fit.carried], -1)
    return np.asarray((mine >= 0) & (mine == there[labels_of(fit.target)]), bool)


def _by_fit(fit: Fit, part: int, counterparts: Sequence[int], alone: bool = False) -> float:
    if fit.carried is None:
        return 0.0
    known, match = (fit.registration.scanned, fit.inferred >= 0), fit.correspondences
    parts = [part]
    # Two wings may be one part of the target: together they are its counterpart.
    if match.source_class is not None and set(match.target_parts(part).tolist()) == set(counterparts):
        parts = np.flatnonzero(match.source_class == match.source_class[part]).tolist()
    found = evidence_of_counterpart(fit.source, parts, fit.registered, counterparts, *known, fit.carried)
    return probability(found, COUNTERPART, alone)


def _both(one: float, other: float) -> float:
    """Probability of an answer that two give who do not know of each other."""
    right, wrong = one * other, (1 - one) * (1 - other)
    return 0.0 if right <= 0 else right / (right + wrong)


def _by_source(told: Told, part: int) -> tuple[Bools, float]:
    """Which samples of the target (M,) correspond to a part as the source alone tells, and how certainly."""
    fit = told.by_source
    parts = [] if fit is None else fit.correspondences.target_parts(part).tolist()
    if fit is None or not parts:
        return np.zeros(len(told.to_target.target), bool), 0.0
    return np.isin(labels_of(fit.target), parts), _by_fit(fit, part, parts)


def _by_way_of_sibling(told: Told, part: int) -> tuple[Bools, float]:
    """The same from the source to a sibling to the target; 0 where the sibling knows of no such part.

    Where it has one and the target none, that is as certain as that it has.
    """
    if told.to_sibling is not None:
        parts, sure = _forth(told.to_sibling, [part])
    else:
        assert told.to_source is not None
        parts, sure = _back(told.to_source, part)
    found, known = _forth(told.to_target, parts)
    return np.isin(labels_of(told.to_target.target), found), sure * known if found else sure


def _forth(fit: Fit, parts: Sequence[int]) -> tuple[list[int], float]:
    """The target's parts that correspond to parts of the source, and how certain the least certain is."""
    each = {part: fit.correspondences.target_parts(part).tolist() for part in parts}
    sure = [_by_fit(fit, part, found) for part, found in each.items() if found]
    return sorted({other for found in each.values() for other in found}), min(sure, default=0.0)


def _back(fit: Fit, part: int) -> tuple[list[int], float]:
    """The source's parts that correspond to a part of the target, likewise."""
    every = range(int(labels_of(fit.source).max()) + 1)
    each = {one: fit.correspondences.target_parts(one).tolist() for one in every}
    found = [one for one, there in each.items() if part in there]
    return found, min((_by_fit(fit, one, each[one]) for one in found), default=0.0)
