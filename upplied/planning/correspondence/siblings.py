"""Parts of scans from a sibling: a structure of the same kind, modelled in pieces, that fits the scan better.

Of two scans neither tells its parts; and of a target with four engines a source with two tells half. A
sibling that lies clearly better on the target labels it instead. Its labels are held against the source: all
of its parts that were matched without the sibling must be matched with it, and `correspondence.fit`
asks whether both ways lead to the same part.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from upplied.config import Settings
from upplied.planning.constants import CLEARLY_BETTER, LEAST_PART
from upplied.planning.correspondence.fit import Fit, Labelling, without_counterparts
from upplied.planning.correspondence.memo import Memo, no_memo, remembering
from upplied.planning.correspondence.pair import Pair, Task, pair_of, samples_of, surface_fit, surfaces_of
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
    """A pair as `study_pair` finds it, the parts of scans labelled by a sibling that fits clearly better.

    Parameters
    ----------
    source, target : Structure
        May be given in frames of their own (`surface.frames`).
    siblings : sequence of Structure
        In their declared frames and in any order. Those of another kind, of which the pieces tell no parts,
        or that are the source or the target themselves, are left out.

    Returns
    -------
    Pair
        With `Pair.surface.labelling` where a sibling labelled parts. Without siblings that of `study_pair`.
    """
    task, labelled = surfaces_of(source, target, settings, memo), None
    if settings.correspondence.method == "parts" and not pieces_tell_parts(task.clouds[1]):
        others = [
            structure_in(own_frame(one), one)
            for one in sorted(siblings, key=lambda one: (one.structure_id, one.sha256))
            if one.kind == target.kind and one.structure_id not in (source.structure_id, target.structure_id)
        ]
        some = [one for one in others if pieces_tell_parts(samples_of(one, settings, memo))]
        labelled = _labelled_by_best(some, task, settings, memo)
    if labelled is not None:
        task = replace(task, settings=without_counterparts(task.settings))
    return pair_of(task, settings, labelled)


def _labelled_by_best(
    siblings: Sequence[Structure], task: Task, settings: Settings, memo: Memo
) -> Fit | None:
    """The fit of the surfaces with the parts that a sibling labels; None where none fits or does better."""
    plain, modelled = without_counterparts(settings), pieces_tell_parts(task.clouds[0])
    # One that fits the target clearly better than the source does, where that tells its parts. Else one for
    # both scans: no two modellers cut alike.
    scans = [task.target] if modelled else [task.source, task.target]
    tasks = [[surfaces_of(one, scan, plain, memo) for scan in scans] for one in siblings]
    best = _best(tasks, CLEARLY_BETTER * task.registration().scanned if modelled else np.inf)
    if best is None:
        return None
    sibling, to_target = siblings[best], surface_fit(tasks[best][-1])
    by_source = surface_fit(replace(task, settings=without_counterparts(task.settings)))
    first = surface_fit(surfaces_of(task.source, sibling, plain, memo) if modelled else tasks[best][0])
    clouds = by_source.source if modelled else first.target, to_target.target
    other = task.labelled(clouds, sibling.sha256)
    other = replace(other, memo=remembering(task.memo, sibling.sha256))
    fit = other.as_named(other.fit_labelled(1, by_source.registration))
    if modelled and (_matched(by_source) & ~_matched(fit)).any():
        return None  # what the source finds of its parts, the sibling must not lose
    labelling = Labelling(
        sibling.structure_id,
        sibling.sha256,
        to_target=to_target,
        to_sibling=first if modelled else None,
        to_source=None if modelled else first,
        by_source=by_source if modelled else None,
    )
    return replace(fit, labelling=labelling)


def _best(tasks: Sequence[Sequence[Task]], least: float) -> int | None:
    """Which sibling fits its scans best, by what was scanned of them; None where none fits."""
    best = None
    for index, scans in enumerate(tasks):
        lies = [task.registration() for task in scans]
        badly = sum(each.scanned for each in lies)
        if all(each.accepted for each in lies) and badly < least:
            least, best = badly, index
    return best


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


def _matched(fit: Fit) -> Bools:
    """Which parts of the source (K,), of those that count, have a counterpart."""
    known, area = fit.correspondences.source_class, parts_of(fit.source).area
    return np.zeros(len(area), bool) if known is None else (known >= 0) & (area > LEAST_PART)
