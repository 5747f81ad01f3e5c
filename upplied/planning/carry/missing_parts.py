"""What of the inspected parts was never scanned on the target, and on which of its parts the scan ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.planning.constants import LEAST_PART
from upplied.planning.demonstration.repetition import Attended
from upplied.records import Bools, Counterpart, Ints

_SAID_PCT = 1.0  # of what was inspected of a part, from which it is said that it was never scanned


def never_scanned_pct(take: Attended, mine: Bools) -> float:
    """Share of what was inspected of a part, samples (N,) of the source, that the target's scan lacks."""
    cloud, beyond = take.pair.surface.source, take.pair.missing.beyond
    weight = np.where(mine, cloud.areas * take.weight, 0.0)
    gone = beyond[take.pair.surface.correspondences.target_index[beyond] < 0]
    return float(100 * weight[gone].sum() / max(weight.sum(), 1e-12))


def open_parts(take: Attended, flown: Sequence[int], label: Ints) -> list[int]:
    """Which parts of the target, (M,) of its samples, of those that are flown to, the scan ends on."""
    area, opening = take.pair.surface.target.areas, take.pair.missing.opening
    whole = np.bincount(label, area)
    ends = np.bincount(label[opening], area[opening], minlength=len(whole))
    return [part for part in flown if ends[part] > LEAST_PART * whole[part]]


def missing_of(found: Sequence[Counterpart]) -> tuple[str, ...]:
    """What was never scanned of the inspected parts, as warnings."""
    return tuple(_missing(one) for one in found if one.never_scanned_pct >= _SAID_PCT or one.open)


def _missing(one: Counterpart) -> str:
    if one.never_scanned_pct < _SAID_PCT:
        return f"the scan ends on {' and on '.join(one.open)}, to which {one.part} corresponds"
    return (
        f"{one.never_scanned_pct:.0f} % of what was inspected of {one.part} was never scanned on the target: "
        "it has no counterpart"
    )
