"""Parts of scans from a sibling: a structure of the same kind, modelled in pieces, that fits the scan better.

Of two scans neither tells its parts; and of a target with four engines a source with two tells half. A
sibling that lies clearly better on the target tells it instead. What it tells is held against the source: all
of its parts that were matched without the sibling must be matched with it, and `correspondence.agreement`
asks whether both ways lead to the same part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from upplied.config import Settings
from upplied.planning.constants import CLEARLY_BETTER, LEAST_PART
from upplied.planning.correspondence.fit import Fit, Told, unasked
from upplied.planning.correspondence.memo import Memo, no_memo
from upplied.planning.correspondence.never_scanned import without
from upplied.planning.correspondence.pair import (
    Pair,
    samples_of,
    study_pair,
    surfaces,
    surfaces_registered,
    told_surfaces,
)
from upplied.planning.surface.frames import own_frame, structure_in
from upplied.planning.surface.parts import parts_of, pieces_tell_parts
from upplied.records import Bools, Floats, Structure


def study(
    source: Structure,
    target: Structure,
    settings: Settings,
    memo: Memo = no_memo,
    siblings: Sequence[Structure] = (),
) -> Pair:
    """A pair as `study_pair` finds it, the parts of scans told by a sibling where one fits clearly better.

    Parameters
    ----------
    source, target : Structure
        May be given in frames of their own (`surface.frames`).
    settings : Settings
    memo : callable, optional
    siblings : sequence of Structure
        In their declared frames and in any order. Those of another kind, of which the pieces tell no parts,
        or that are the source or the target themselves, are left out.

    Returns
    -------
    Pair
        With `Pair.surface.told` where a sibling told parts. Without siblings that of `study_pair`.
    """
    told = None
    if siblings and settings.correspondence.method == "parts":
        told = _told(source, target, settings, memo, siblings)
    if told is None:
        return study_pair(source, target, settings, memo)
    pair = study_pair(source, target, unasked(settings), memo)
    match = without(told.correspondences, pair.missing, told.source, told.target, told.carried)
    return replace(pair, surface=replace(told, correspondences=match))


def _told(
    source: Structure, target: Structure, settings: Settings, memo: Memo, siblings: Sequence[Structure]
) -> Fit | None:
    """The fit of the surfaces as siblings tell their parts; None where none is asked, or does better."""
    if _tells(target, settings, memo):
        return None
    modelled, plain = _tells(source, settings, memo), unasked(settings)
    some = _those_that_tell(siblings, source, target, settings, memo)
    sibling = _best(some, source, target, modelled, settings, memo)
    if sibling is None:
        return None
    by_source = surfaces(source, target, plain, memo)
    first = surfaces(*((source, sibling) if modelled else (sibling, source)), plain, memo)
    to_target = surfaces(sibling, target, plain, memo)
    told = Told(
        sibling.structure_id,
        sibling.sha256,
        to_sibling=first if modelled else None,
        to_source=None if modelled else first,
        to_target=to_target,
        by_source=by_source if modelled else None,
    )
    clouds = (by_source.source if modelled else first.target), to_target.target
    fit = told_surfaces(clouds, source, target, settings, sibling.sha256, memo)
    if modelled and (_matched(by_source) & ~_matched(fit)).any():
        return None  # what the source finds of its parts, the sibling must not lose
    return replace(fit, told=told)


def nearest_in_proportions(
    size_m: Sequence[float] | Floats, names: Sequence[str], sizes_m: Floats, most: int
) -> tuple[str, ...]:
    """The structures of which the boxes are most like another's but for their size, the nearest first.

    Parameters
    ----------
    size_m : sequence of float, (3,) m
        Extents of a structure along its declared axes.
    names : sequence of str
        Ids of N others, in any order.
    sizes_m : array, shape (N, 3), m
        Their extents.
    most : int
        How many at most.
    """
    ratio = np.log(np.maximum(sizes_m, 1e-9)) - np.log(np.maximum(size_m, 1e-9))
    unlike = np.round(ratio.std(axis=1), 9)  # so that libraries do not choose among equals
    near = np.arange(len(unlike))
    if 0 < most < len(unlike):  # sorting a large fleet for each scan would take long
        near = np.flatnonzero(unlike <= np.partition(unlike, most - 1)[most - 1])
    chosen = sorted((float(unlike[at]), names[at]) for at in near.tolist())[:most]
    return tuple(name for _, name in chosen)


def _tells(structure: Structure, settings: Settings, memo: Memo) -> bool:
    return pieces_tell_parts(samples_of(structure, settings, memo))


def _those_that_tell(
    siblings: Sequence[Structure], source: Structure, target: Structure, settings: Settings, memo: Memo
) -> list[Structure]:
    """The siblings that may tell parts, in an order of their own."""
    others = [
        structure_in(own_frame(one), one)
        for one in sorted(siblings, key=lambda one: (one.structure_id, one.sha256))
        if one.kind == target.kind and one.structure_id not in (source.structure_id, target.structure_id)
    ]
    return [one for one in others if _tells(one, settings, memo)]


def _best(
    siblings: Sequence[Structure],
    source: Structure,
    target: Structure,
    modelled: bool,
    settings: Settings,
    memo: Memo,
) -> Structure | None:
    """The sibling that fits the scans best, by what was scanned of them; None where none fits.

    Where the source tells its parts, one that fits the target clearly better than it does. Else one for both:
    no two modellers cut alike.
    """
    least, best = np.inf, None
    if modelled:
        least = CLEARLY_BETTER * surfaces_registered(source, target, settings, memo).scanned
    for one in siblings:
        scans = (target,) if modelled else (source, target)
        found = [surfaces_registered(one, scan, settings, memo) for scan in scans]
        badly = sum(each.scanned for each in found)
        if all(each.accepted for each in found) and badly < least:
            least, best = badly, one
    return best


def _matched(fit: Fit) -> Bools:
    """Which parts of the source (K,), of those that count, have a counterpart."""
    known, area = fit.correspondences.source_class, parts_of(fit.source).area
    return np.zeros(len(area), bool) if known is None else (known >= 0) & (area > LEAST_PART)
