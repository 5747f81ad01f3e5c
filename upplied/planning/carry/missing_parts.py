"""What of the inspected parts was never scanned on the target, and whether all parts of a kind were found.

Who asks for each engine, or for the outer one, asks about their number. A scan of which an engine is missing,
or lies in pieces that nothing recognizes, has one that is flown in its place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.planning.constants import LEAST_PART
from upplied.planning.correspondence.certainty import named_by
from upplied.planning.correspondence.label_transfer import unnamed_like
from upplied.planning.correspondence.naming import choices_for, on_sides, side_of
from upplied.planning.demonstration.repetition import Attended
from upplied.planning.surface.parts import Parts, labels_of
from upplied.records import Bools, Counterpart, Ints

_WORTH_SAYING_PCT = 1.0  # of what was inspected of a part, from which it is said that it was never scanned


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


def missing_of(counterparts: Sequence[Counterpart]) -> tuple[str, ...]:
    """What was never scanned of the inspected parts, as warnings."""
    return tuple(
        _missing(one) for one in counterparts if one.never_scanned_pct >= _WORTH_SAYING_PCT or one.open
    )


def _missing(one: Counterpart) -> str:
    if one.never_scanned_pct < _WORTH_SAYING_PCT:
        return f"the scan ends on {' and on '.join(one.open)}, to which {one.part} corresponds"
    return (
        f"{one.never_scanned_pct:.0f} % of what was inspected of {one.part} was never scanned on the target: "
        "it has no counterpart"
    )


def odd_number(take: Attended, part: int, source: Parts, target: Parts, like: set[int]) -> str:
    """What is odd about how many parts of a kind there are, in words; empty where nothing is.

    Parameters
    ----------
    take : Attended
    part : int
        Of the source, that was inspected.
    source, target : Parts
        In the axes in which places are named.
    like : set of int
        The target's parts that correspond to it or are like it.
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
