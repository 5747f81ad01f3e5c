"""How certain it is that a part of the target is the one that is meant: a probability from evidence.

Two questions are asked. Does this part correspond to that one? Then a smooth displacement without any parts
should bring one onto the other. Is this part another one of its kind, an outer engine beside the inner
one? Then it should have its shape and its size. Each is logistic in its evidence, and each weight is at least
0: no evidence against a part ever raises its probability.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.planning.correspondence.part_alignment import misfit_of_parts
from upplied.planning.geometry.boxes import diagonal_of
from upplied.planning.surface.parts import labels_of
from upplied.records import Bools, Cloud, Floats, Ints

#: Largest value of each piece of evidence that still tells something.
CAPS = (2.0, 1.0, 1.0, 1.0, 1.5, 1.0)
# Calibrated by bench/as_built.py on 1 978 counterparts and 2 987 others of airliners, turbines, bridges and
# ships, as modelled, as shells and clouds, with noise, and with 10, 20 and 40 % never scanned, half of them
# of structures that nobody built. With those judged by the samples and the other way round: of counterparts
# said to be at least 97 % certain 99.3 % were right, of 90 to 97 % 94.4, of 80 to 90 % 85.0 (of 147); of
# others 99.3, 96.7 and 75.7 (of 107).
# First the offset, then a weight for each piece of evidence.
COUNTERPART = (8.88, 2.39, 0.0, 3.76, 0.85, 2.66, 2.43)
SAME_KIND = (8.14, 1.53, 0.0, 0.0, 2.04, 0.55, 11.05)

# Where the smooth displacement brings most of either part elsewhere, and another part is like it, 6 of 16
# were right; a logistic curve through all says more.
_DISAGREES, _DISPUTED = 0.6, 0.4


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

    Parameters
    ----------
    source, registered : Cloud
        Samples with parts, in the source's frame and at its scale.
    parts : sequence of int
        Of the source: one, or all that were matched with these as one.
    counterparts : sequence of int
        Parts of the target.
    wholes : float
        `Registration.scanned`.
    inferred : bool
        Whether parts were inferred from those of the other structure.
    carried : array of int, shape (M,)
        The part of the source that a smooth displacement alone brings onto each sample of the target.
    """
    mine, theirs = np.isin(labels_of(source), parts), np.isin(labels_of(registered), counterparts)
    named = np.isin(carried, parts)
    both, area = named & theirs, registered.areas
    return np.array(
        [
            _shape(source, mine, registered, theirs),
            1 - area[both].sum() / max(area[theirs].sum(), 1e-12),
            1 - area[both].sum() / max(area[named].sum(), 1e-12),
            float(inferred),
            _whole(wholes),
            abs(np.log(max(area[theirs].sum(), 1e-12) / max(source.areas[mine].sum(), 1e-12))),
        ]
    )


def evidence_of_same_kind(
    registered: Cloud, counterpart: int, other: int, wholes: float, inferred: bool
) -> Floats:
    """Evidence against a part of the target being of the kind of another, (6,); 0 is perfect."""
    one, two = (labels_of(registered) == part for part in (counterpart, other))
    area = registered.areas
    ratio = abs(np.log(max(area[two].sum(), 1e-12) / max(area[one].sum(), 1e-12)))
    return np.array(
        [_shape(registered, one, registered, two), 0.0, 0.0, float(inferred), _whole(wholes), ratio]
    )


def probability(evidence: Floats, model: Sequence[float], alone: bool = False) -> float:
    """Probability that the part is the one that is meant, 0 to 1; `alone` where no other is like it."""
    against = float(np.dot(model[1:], np.minimum(evidence, CAPS)))
    known = float(1 / (1 + np.exp(against - model[0])))
    return min(known, _DISPUTED) if not alone and evidence[1:3].max() > _DISAGREES else known


def _shape(source: Cloud, mine: Bools, registered: Cloud, theirs: Bools) -> float:
    """How unlike two parts are, box on box; 1 is what is matched at most where boxes are not alike."""
    if not mine.any() or not theirs.any():
        return CAPS[0]
    return misfit_of_parts(source, mine, registered, theirs, diagonal_of(source.points))


def _whole(wholes: float) -> float:
    return 3.0 if not np.isfinite(wholes) else float(wholes)
