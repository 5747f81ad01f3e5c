"""Whether all parts of a kind were found on a target of which some was not scanned, or not told apart.

Who asks for each engine, or for the outer one, asks about their number. A scan of which an engine is missing,
or lies in pieces that nothing recognizes, has one that is flown in its place.
"""

from __future__ import annotations

import numpy as np

from upplied.planning.correspondence.agreement import named_by
from upplied.planning.correspondence.label_transfer import unnamed_like
from upplied.planning.correspondence.landmarks import choices_for, on_sides, side_of
from upplied.planning.demonstration.repetition import Attended
from upplied.planning.surface.parts import Parts, labels_of


def odd_number(take: Attended, part: int, source: Parts, target: Parts, found: set[int]) -> str:
    """What is odd about how many parts of a kind there are, in words; empty where nothing is.

    Parameters
    ----------
    take : Attended
    part : int
        Of the source, that was inspected.
    source, target : Parts
        In the axes in which places are named.
    found : set of int
        The target's parts that correspond to it or are like it.
    """
    fit, own = take.pair.surface, side_of(source, part)
    kind = choices_for(source, part, source, [part]).tolist()
    of_kind = [set(fit.correspondences.target_parts(twin).tolist()) for twin in kind]
    lone = [*(min(each) for each in of_kind if each), *found.difference(*of_kind)]  # a part in pieces is one
    here, across = on_sides(source, kind, own)
    there, beyond = on_sides(target, lone, own)
    on = take.pair.target.structure_id
    if own and here == across and there < beyond:
        return (
            f"of parts like the inspected one {there} lie on its side of {on} and {beyond} on the other: "
            "some were not scanned or are not told apart"
        )
    label, known = labels_of(fit.registered), sorted(found.union(*of_kind))
    if fit.inferred < 0 or fit.carried is None or not known:
        return ""
    explained = np.isin(label, known)
    if fit.told is not None:
        explained |= named_by(fit.told.to_target)
    named = np.where(explained, 0, fit.carried)
    if unnamed_like(fit.registered, named, np.isin(label, [max(known, key=lambda one: target.area[one])])):
        return f"something on {on} is of the size of the inspected part, and may be another one"
    return ""
