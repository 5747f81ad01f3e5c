"""Would this transfer show what the expert inspected? A probability from evidence, before planning.

The probability is logistic in the evidence of the inspected region. Each weight is
at least 0: no evidence against a transfer ever raises its probability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from upplied.planning.carry.evidence import Evidence, evidence_of
from upplied.planning.demonstration.repetition import Take
from upplied.records import Record, Registration

#: Largest value of each piece of evidence that still tells something, in the order of its fields.
CAPS = (1.0, 0.5, 0.6, 1.0, 0.3, 0.3, 0.2, 3.0)
# Calibrated by bench/forecast.py on 183 pairs of samples, made structures and real ones. With half of the
# targets held back in turn, 97 % of those whose forced plan shows at least 90 % pass 0.6, and 1 of 102
# below 60 % (a building, which the plan's own measures then refuse); forecast and frequency: 1 point apart.
OFFSET = 6.19
WEIGHTS = (5.24, 10.30, 3.59, 1.20, 7.76, 2.60, 2.88, 2.94)


@dataclass(frozen=True, eq=False, repr=False)
class Forecast(Record):
    """Whether most of what was inspected can be shown on a target."""

    probability: float  # 0 to 1
    evidence: str  # its figures, in words


def forecast_of(takes: Sequence[Take]) -> Forecast:
    """The forecast of a demonstration on its target; of several takes that of the first."""
    found = evidence_of(takes[0])
    return Forecast(probability_of(found), in_words(found))


def probability_of(found: Evidence) -> float:
    """Probability that most of what was inspected can be shown, 0 to 1."""
    against = float(np.dot(WEIGHTS, np.minimum(found.values, CAPS)))
    return float(1 / (1 + np.exp(against - OFFSET)))


def unlikely(likely: Forecast, least: float, wholes: Registration) -> str:
    """Why a transfer is refused, in words."""
    said = (
        f"what was inspected cannot be shown here: probability {likely.probability:.2f}, "
        f"{least:g} is asked for (registration.least_probability); {likely.evidence}"
    )
    return said if wholes.accepted else f"{said}; {wholes.reason}"


def in_words(found: Evidence) -> str:
    """The evidence as a sentence of figures."""
    if found.without >= 1:
        return "nothing of what was inspected has a counterpart" + _whole(found)
    return (
        f"{100 * (1 - found.without):.0f} % of what was inspected has a counterpart"
        f", {100 * found.facing_away:.0f} % of that faces another way"
        f" and all by {np.degrees(found.turned):.0f} deg"
        f", patches are stretched unevenly by {100 * np.expm1(found.uneven):.0f} %"
        f", {100 * found.bent:.0f} % of the region's size is left by the best scaling"
        f", the surfaces are {100 * found.gap:.0f} % of its size apart" + _whole(found)
    )


def _whole(found: Evidence) -> str:
    return f"; misfit of the wholes {found.misfit:.2f}"
