"""How certain it is that a part of the target is the one that is meant: a probability from evidence.

Two questions are asked. Does this part correspond to that one? Then a smooth displacement without any parts
should bring one onto the other. Is this part another one of its kind, an outer engine beside the inner
one? Then it should have its shape and its size. Each is logistic in its evidence, and each weight is at least
0: no evidence against a part ever raises its probability.

Where a sibling labelled the parts, source and sibling, and sibling and target, tell by evidence of their own
which part is which. What both ways lead to is more certain than either; where they lead to different parts,
one of them is wrong, and each speaks against the other."""

from collections.abc import Sequence

import numpy as np

from upplied.planning.constants import MAJORITY
from upplied.planning.correspondence.fit import Fit, Labelling
from upplied.planning.correspondence.part_alignment import misfit_of_parts
from upplied.planning.geometry.clouds import diagonal_of
from upplied.planning.surface.parts import labels_of
from upplied.records import Bools, Cloud, Floats, Ints

#: Largest value of each piece of evidence that still tells something; the last piece has none, and disputes.
CAPS = (2.0, 1.0, 1.0, 1.5, 1.0)
# Calibrated by bench/as_built.py on 1 978 counterparts and 2 987 others of airliners, turbines, bridges and
# ships, as modelled, as shells and clouds, with noise, and with 10, 20 and 40 % never scanned, half of them
# of structures that nobody built. With those judged by the samples and the other way round: of counterparts
# said to be at least 97 % certain 99.3 % were right, of 90 to 97 % 94.4, of 80 to 90 % 85.0 (of 147); of
# others 99.3, 96.7 and 75.7 (of 107).
# First the offset, then a weight for each piece of evidence.
COUNTERPART = (8.88, 2.39, 3.76, 0.85, 2.66, 2.43)
SAME_KIND = (8.14, 1.53, COUNTERPART[2], 2.04, 0.55, 11.05)  # no displacement is asked about another one
# Where the smooth displacement brings most of either part elsewhere, and another part is like it, 6 of 16
# were right; a logistic curve through all says more.
_DISAGREES, _DISPUTED = 0.6, 0.4
# Evidence of a part that another way of asking brings elsewhere altogether: what is disputed is no more
# certain than that.
_ELSEWHERE = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 1.0])


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
    sure = _by_fit(fit, part, counterparts, alone)
    if fit.labelling is None:
        return sure
    mine, area, others = np.isin(labels_of(fit.target), counterparts), fit.target.areas, []
    for theirs, other in (_by_source(fit.labelling, part), _by_way_of_sibling(fit.labelling, part)):
        agrees = area[mine & theirs].sum() > MAJORITY * area[mine | theirs].sum()
        others.append((bool(agrees), other))
    (agrees, by_source), (alike, by_way) = others
    sure = max(sure, by_source) if agrees else sure
    sure = max(sure, _both(sure, by_way)) if alike else sure
    for same, against in others:
        if not same and against > 0:
            sure = min(sure, _both(sure, 1 - against), probability(_ELSEWHERE, COUNTERPART))
    return sure


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
    facts, match = (fit.registration.scanned, fit.inferred >= 0), fit.correspondences
    parts = [part]
    # Two wings may be one part of the target: together they are its counterpart.
    if match.source_class is not None and set(match.target_parts(part).tolist()) == set(counterparts):
        parts = np.flatnonzero(match.source_class == match.source_class[part]).tolist()
    evidence = evidence_of_counterpart(fit.source, parts, fit.registered, counterparts, *facts, fit.carried)
    return probability(evidence, COUNTERPART, alone)


def _both(one: float, other: float) -> float:
    """Probability of an answer that two give who do not know of each other."""
    right, wrong = one * other, (1 - one) * (1 - other)
    return 0.0 if right <= 0 else right / (right + wrong)


def _by_source(labelling: Labelling, part: int) -> tuple[Bools, float]:
    """Which samples of the target (M,) correspond to a part as the source alone tells, and how certainly."""
    fit = labelling.by_source
    parts = [] if fit is None else fit.correspondences.target_parts(part).tolist()
    if fit is None or not parts:
        return np.zeros(len(labelling.to_target.target), bool), 0.0
    return np.isin(labels_of(fit.target), parts), _by_fit(fit, part, parts)


def _by_way_of_sibling(labelling: Labelling, part: int) -> tuple[Bools, float]:
    """The same from the source to a sibling to the target; 0 where the sibling knows of no such part."""
    # Where it has one and the target none, that is as certain as that it has.
    if labelling.to_sibling is not None:
        parts, sure = _forth(labelling.to_sibling, [part])
    else:
        assert labelling.to_source is not None
        fit = labelling.to_source
        every = range(int(labels_of(fit.source).max()) + 1)
        each = {one: fit.correspondences.target_parts(one).tolist() for one in every}
        parts = [one for one, there in each.items() if part in there]
        sure = min((_by_fit(fit, one, each[one]) for one in parts), default=0.0)
    theirs, known = _forth(labelling.to_target, parts)
    return np.isin(labels_of(labelling.to_target.target), theirs), sure * known if theirs else sure


def _forth(fit: Fit, parts: Sequence[int]) -> tuple[list[int], float]:
    """The target's parts that correspond to parts of the source, and how certain the least certain is."""
    each = {part: fit.correspondences.target_parts(part).tolist() for part in parts}
    sure = [_by_fit(fit, part, others) for part, others in each.items() if others]
    return sorted({other for others in each.values() for other in others}), min(sure, default=0.0)


def evidence_of_counterpart(
    source: Cloud,
    parts: Sequence[int],
    registered: Cloud,
    counterparts: Sequence[int],
    wholes: float,
    inferred: bool,
    carried: Ints,
) -> Floats:
    """Evidence against parts of the target corresponding to parts of the source, (6,); 0 is perfect.

    Both clouds are in the source's frame and at its scale. `parts` are one, or all that were matched with it
    as one; `wholes` is `Registration.scanned`; `inferred` where parts follow from the other structure's.
    `carried` (M,) is the part of the source that a smooth displacement brings onto each target sample.

    The pieces: difference in shape, share of what is brought onto the target that lies elsewhere, whether
    inferred, misfit of the wholes, log ratio of areas, share of the counterparts onto which others come.
    """
    mine, theirs = np.isin(labels_of(source), parts), np.isin(labels_of(registered), counterparts)
    named = np.isin(carried, parts)
    both, area = named & theirs, registered.areas
    return np.array(
        [
            _shape(source, mine, registered, theirs),
            1 - area[both].sum() / max(area[named].sum(), 1e-12),
            float(inferred),
            wholes if np.isfinite(wholes) else 3.0,
            abs(np.log(max(area[theirs].sum(), 1e-12) / max(source.areas[mine].sum(), 1e-12))),
            1 - area[both].sum() / max(area[theirs].sum(), 1e-12),
        ]
    )


def evidence_of_same_kind(
    registered: Cloud, counterpart: int, other: int, wholes: float, inferred: bool
) -> Floats:
    """Evidence against a part of the target being of the kind of another, (6,); 0 is perfect."""
    one, two = (labels_of(registered) == part for part in (counterpart, other))
    area = registered.areas
    ratio = abs(np.log(max(area[two].sum(), 1e-12) / max(area[one].sum(), 1e-12)))
    shape = _shape(registered, one, registered, two)
    whole = wholes if np.isfinite(wholes) else 3.0
    return np.array([shape, 0.0, float(inferred), whole, ratio, 0.0])


def probability(evidence: Floats, model: Sequence[float], alone: bool = False) -> float:
    """Probability that the part is the one that is meant, 0 to 1; `alone` where no other is like it."""
    known = logistic(evidence[:-1], model[0], model[1:], CAPS)
    return min(known, _DISPUTED) if not alone and max(evidence[1], evidence[-1]) > _DISAGREES else known


def logistic(against: Floats, offset: float, weights: Sequence[float], caps: Sequence[float]) -> float:
    """Probability, 0 to 1, that falls with each piece of evidence (K,) up to its cap."""
    return float(1 / (1 + np.exp(np.dot(weights, np.minimum(against, caps)) - offset)))


def _shape(source: Cloud, mine: Bools, registered: Cloud, theirs: Bools) -> float:
    """How unlike two parts are, box on box; 1 is what is matched at most where boxes are not alike."""
    if not mine.any() or not theirs.any():
        return CAPS[0]
    return misfit_of_parts(source, mine, registered, theirs, diagonal_of(source.points))
