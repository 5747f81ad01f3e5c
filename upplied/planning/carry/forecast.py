"""Would this transfer show what the expert inspected, and are all parts there? Known before planning.

The probability is logistic in the evidence of how the inspected region corresponds. Each weight is at least
0: no evidence against a transfer ever raises its probability. A whole may differ elsewhere, in its
superstructure or where a rotor stopped, and a hull or a tower still be inspected alike; and another thing may
fill the same box. So the evidence is of what the flight was about.

Who asks for each engine, or for the outer one, asks about their number. A scan of which an engine is missing,
or lies in pieces that nothing recognizes, has one that is flown in its place.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from upplied.config import Settings
from upplied.planning.correspondence.certainty import logistic, named_by
from upplied.planning.correspondence.label_transfer import unnamed_like
from upplied.planning.correspondence.naming import choices_for, on_sides, side_of
from upplied.planning.demonstration.repetition import Attended, Take
from upplied.planning.geometry.clouds import weighted_percentile
from upplied.planning.surface.parts import Parts, labels_of
from upplied.records import Counterpart, Floats, Record, Registration

_LEAST = 16  # patches: of fewer nothing is told
_REFUSED = 0.25  # share of what was inspected from which doubts about it refuse the plan
_WORTH_SAYING_PCT = 1.0  # of what was inspected of a part, from which it is said that it was never scanned


@dataclass(frozen=True, eq=False, repr=False)
class Evidence(Record):
    """How well the inspected region corresponds to the target; 0 is perfect."""

    without: float  # share of what was inspected that has no counterpart
    bent: float  # what no scaling along the axes explains, over the region's size
    misfit: float  # of the wholes, `Registration.acceptance`

    @property
    def values(self) -> Floats:
        """In the order of the fields, (3,)."""
        return np.array([getattr(self, item.name) for item in fields(self)], float)

    @property
    def probability(self) -> float:
        """That most of what was inspected can be shown, 0 to 1."""
        return logistic(self.values, OFFSET, WEIGHTS, CAPS)

    @property
    def in_words(self) -> str:
        """As a row of figures."""
        whole = f"residual of the whole structures {self.misfit:.2f}"
        if self.without >= 1:
            return f"no inspected surface has a counterpart; {whole}"
        return (
            f"matched surface {100 * (1 - self.without):.0f} %, deviation from the best scaling "
            f"{100 * self.bent:.0f} % of the region's size; {whole}"
        )


def evidence_of(take: Take) -> Evidence:
    """The evidence of one take; a flight that was about nothing has all against it."""
    fit, weight = take.pair.surface, take.inspection.attention.weight
    source, match = fit.source, fit.correspondences
    area = source.areas
    share = weight * area
    misfit = fit.registration.acceptance
    misfit = 3.0 if not np.isfinite(misfit) else min(misfit, 10.0)
    known = np.flatnonzero((share > 0) & (match.target_index >= 0) & np.isfinite(match.target_points[:, 0]))
    if share.sum() <= 0 or len(known) < _LEAST:
        return Evidence(1.0, 1.0, misfit)
    mine, here, there = share[known], source.points[known], match.target_points[known]
    # What is left by the best map along the axes: weighted root mean square.
    root = np.sqrt(mine / mine.sum())[:, None]
    mapped = np.column_stack([here - here.mean(axis=0), np.ones(len(here))])
    best = np.linalg.lstsq(root * mapped, root * there, rcond=None)[0]
    left = float(np.sqrt(np.average(((there - mapped @ best) ** 2).sum(axis=1), weights=mine)))
    return Evidence(1 - float(mine.sum() / share.sum()), left / _size(there, mine), misfit)


def _size(points: Floats, share: Floats) -> float:
    """Diagonal of the middle nine tenths of the region, m."""
    low, high = (np.array([weighted_percentile(axis, share, p) for axis in points.T]) for p in (5, 95))
    return max(float(np.linalg.norm(high - low)), 1e-6)


#: Largest value of each piece of evidence that still tells something, in the order of its fields; a misfit
#: tells no more of a region than of a part (`correspondence.certainty.CAPS`).
CAPS = (1.0, 0.3, 1.5)
# Calibrated by bench/forecast.py on 116 pairs of like kind of one half, and 113 of other kinds that count a
# hundredth. Of the other half 108 of 108 that show at least 90 % pass 0.8, and 17 of 124 misdeclared.
OFFSET = 5.94
WEIGHTS = (6.29, 3.94, 2.93)


def unlikely(likely: Evidence, least: float, wholes: Registration) -> str:
    """Why a transfer is refused, in words."""
    reason = (
        f"what was inspected cannot be shown here: probability {likely.probability:.2f}, "
        f"{least:g} is required (registration.least_probability); {likely.in_words}"
    )
    return reason if wholes.accepted else f"{reason}; {wholes.reason}"


def undecided(counterparts: Sequence[Counterpart], settings: Settings) -> str:
    """Why a plan is refused for ambiguous parts, or another number than expected; empty where it is not.

    A part that none is like may be unsure. It is refused where it is the wrong one for as certain as is
    required of the right one. Doubts about several parts add up.
    """
    rule = settings.correspondence
    wrong = min(rule.least_probability, 1 - rule.least_probability)

    def counts(one: Counterpart) -> bool:
        mistaken = one.probability is not None and one.probability < wrong
        alike = one.twins or one.found > 1 or (one.found and not one.flown)
        return bool(one.doubt and (rule.repeat or alike or mistaken))

    unsure = [one for one in counterparts if counts(one)]
    doubtful_pct = sum(one.inspected_pct for one in unsure)
    if doubtful_pct >= 100 * _REFUSED:
        first = max(unsure, key=lambda one: one.inspected_pct)
        reason = (
            f"--repeat {rule.repeat} was requested and {first.doubt}" if rule.repeat else doubts([first])[0]
        )
        further = f"doubts about {len(unsure)} parts concern {doubtful_pct:.0f} % of what was inspected"
        return f"{reason}; {further}" if len(unsure) > 1 else reason
    if rule.expect is not None and counterparts and (first := counterparts[0]).found != rule.expect:
        number = f"{first.found} parts like {first.part} are on the target"
        reason = f"{number}, {rule.expect} are expected (correspondence.expect)"
        return f"{reason}; {first.doubt}" if first.doubt else reason
    return ""


def least_probability(counterparts: Sequence[Counterpart]) -> float:
    """Of the least certain counterpart; NaN where none is known."""
    known = [one.probability for one in counterparts if one.probability is not None]
    return min(known, default=float("nan"))


def doubts(counterparts: Sequence[Counterpart]) -> tuple[str, ...]:
    """What is not certain of the inspected parts, as warnings."""
    return tuple(
        f"{one.doubt} ({f'{one.twins} more' if one.twins else 'none'} like it on the source, "
        f"{one.found} on the target, as far as its parts are known)"
        for one in counterparts
        if one.doubt
    )


def missing_of(counterparts: Sequence[Counterpart]) -> tuple[str, ...]:
    """What was never scanned of the inspected parts, as warnings."""
    warnings = []
    for one in counterparts:
        if one.never_scanned_pct >= _WORTH_SAYING_PCT:
            warnings.append(
                f"{one.never_scanned_pct:.0f} % of what was inspected of {one.part} was never scanned on the "
                "target: it has no counterpart"
            )
        elif one.open:
            warnings.append(f"the scan ends on {' and on '.join(one.open)}, to which {one.part} corresponds")
    return tuple(warnings)


def odd_number(take: Attended, part: int, source: Parts, target: Parts, like: set[int]) -> str:
    """What is odd about how many parts there are of the kind of an inspected one of the source, in words.

    Empty where nothing is. The parts are in the axes in which places are named; `like` are those of the
    target that correspond to it or are like it.
    """
    fit, own = take.pair.surface, side_of(source, part)
    kind = choices_for(source, part, source, [part]).tolist()
    of_kind = [set(fit.correspondences.target_parts(twin).tolist()) for twin in kind]
    lone = [*(min(each) for each in of_kind if each), *like.difference(*of_kind)]  # a part in pieces is one
    here, across = on_sides(source, kind, own)
    there, beyond = on_sides(target, lone, own)
    on = take.pair.target.structure_id
    if own and here == across and there < beyond:
        return (
            f"of parts like the inspected one {there} lie on its side of {on} and {beyond} on the other: "
            "some were not scanned or cannot be distinguished"
        )
    label, known = labels_of(fit.registered), sorted(like.union(*of_kind))
    if fit.inferred < 0 or fit.carried is None or not known:
        return ""
    explained = np.isin(label, known)
    if fit.labelling is not None:
        explained |= named_by(fit.labelling.to_target)
    named = np.where(explained, 0, fit.carried)
    if unnamed_like(fit.registered, named, np.isin(label, [max(known, key=lambda one: target.area[one])])):
        return f"something on {on} is of the size of the inspected part, and may be another one"
    return ""
