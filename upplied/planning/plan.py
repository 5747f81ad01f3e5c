"""The whole method on one page: one demonstration, one target, one plan (paper, Fig. 2)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from upplied.cameras import least_interval
from upplied.config import Settings, digest
from upplied.errors import RefusedError, SettingsError
from upplied.photographed import photographed
from upplied.planning.carry.carried import carry
from upplied.planning.carry.counterparts import counterparts_of
from upplied.planning.carry.forecast import (
    doubts,
    evidence_of,
    least_probability,
    missing_of,
    undecided,
    unlikely,
)
from upplied.planning.carry.inspected_surface import InspectedSurface, inspected_by
from upplied.planning.correspondence.memo import METHOD_VERSION, Memo, no_memo
from upplied.planning.correspondence.misfit import of_other_kinds, sizes_beyond
from upplied.planning.correspondence.siblings import study
from upplied.planning.demonstration.inspection import nothing_shown
from upplied.planning.demonstration.repetition import Take, inspected_states, takes_of
from upplied.planning.measures.evaluate import judge
from upplied.planning.measures.picture_score import photos_of
from upplied.planning.measures.verdict import in_the_way, odd_shape, shortfalls, slow
from upplied.planning.surface.frames import (
    demonstration_in,
    frames_for,
    in_declared,
    in_frame,
    registration_from,
    structure_in,
)
from upplied.planning.trajectory.complete import propose
from upplied.planning.trajectory.retime import Timed
from upplied.provenance import method
from upplied.records import Demonstration, Measures, Plan, Structure
from upplied.records.plans import RequiredSurface
from upplied.threads import one_thread


def plan_transfer(
    demonstration: Demonstration,
    source: Structure,
    target: Structure,
    settings: Settings,
    memo: Memo = no_memo,
    required: RequiredSurface | None = None,
    siblings: Sequence[Structure] = (),
) -> Plan:
    """Plan the demonstrated inspection of one structure on another.

    Parameters
    ----------
    demonstration : Demonstration
        Flown on `source`.
    source, target : Structure
    settings : Settings
        From `upplied.config.settings_for`: preset `paper`, `recommended` or `baseline`.
    memo : callable, optional
        Remembers what is found out about structures and pairs; see `correspondence.memo.Memo`.
    required : RequiredSurface, optional
        Of the target, that is to be shown before all else; `settings.required.zones` names it.
    siblings : sequence of Structure, optional
        Of the target's kind and modelled in pieces, that may tell the parts of a scan; in any order
        (`correspondence.siblings`).

    Returns
    -------
    Plan
        With status ``ok``, or ``refused`` and a reason in words.

    Raises
    ------
    SettingsError
        If the settings name zones that are not given, or none and some are given.
    """
    if bool(settings.required.zones) != (required is not None):
        surface = "no surface is" if required is None else "a surface is"
        state = f"is {settings.required.zones[:12]!r}, and {surface} given"
        raise SettingsError("setting required.zones", state, "zones are required by `upplied require`")
    # A frame that turns and moves with the structures: the plan does not depend on the axes it is given in.
    here, there = frames_for(source, target, settings)
    flight = demonstration_in(here, demonstration)
    structures = structure_in(here, source), structure_in(there, target)
    zones = None if required is None else in_frame(there, required)
    with one_thread():
        plan = _planned(flight, *structures, settings, memo, zones, siblings)
    of_target = ("trajectory", "surface", "supposed", "photos")
    moved: dict[str, Any] = {name: in_declared(there, getattr(plan, name)) for name in of_target}
    moved["inspected"] = in_declared(here, plan.inspected)
    return replace(plan, **moved, registration=registration_from(here, there, plan.registration))


def _begun(demonstration: Demonstration, source: Structure, target: Structure, settings: Settings) -> Plan:
    plan = Plan(
        demonstration_id=demonstration.demonstration_id,
        source_id=source.structure_id,
        target_id=target.structure_id,
        kind=target.kind,
        preset=settings.preset,
        status="ok",
    )
    # Are they of one kind, and of like size, or was a unit mistaken?
    rule = settings.verdict
    wrong = of_other_kinds(source, target)
    wrong = wrong or sizes_beyond(source, target, rule.most_size_ratio, "most_size_ratio")
    if wrong and rule.enforce:
        return replace(plan, status="refused", reason=wrong)
    odd = "" if wrong else sizes_beyond(source, target, rule.odd_size_ratio, "odd_size_ratio")
    return replace(plan, warnings=(odd,) if odd else (), not_flyable=wrong)


def _on_pair(
    plan: Plan,
    demonstration: Demonstration,
    source: Structure,
    target: Structure,
    settings: Settings,
    memo: Memo,
    siblings: Sequence[Structure] = (),
) -> tuple[Plan, Sequence[Take]]:
    # Do the structures fit, and what on one corresponds to what on the other? (Algorithm 1)
    try:
        pair = study(source, target, settings, memo, siblings)
    except RefusedError as refusal:  # a part that was named is ambiguous
        return replace(plan, status="refused", reason=str(refusal)), ()
    registration = pair.fit_for(settings).registration
    labelling = pair.surface.labelling
    plan = replace(
        plan,
        registration=registration,
        counterpart_summary=pair.surface.correspondences.summary,
        parts_told_by="" if labelling is None else labelling.sibling_id,
    )
    least = settings.registration.least_probability
    if not registration.accepted and least is None:
        return replace(plan, status="refused", reason=registration.reason), ()
    # What did the expert look at, and from which viewpoints? (Algorithm 2, lines 1 to 13)
    takes = takes_of(demonstration, pair, settings, memo)
    plan = replace(plan, inspected=inspected_states(takes[0]))
    if nothing := nothing_shown(takes[0].inspection, takes[0].pair, settings):
        return replace(plan, status="refused", reason=nothing), takes
    # Would a transfer show that?
    likely = evidence_of(takes[0])
    measures = Measures(acceptance_probability=likely.probability)
    plan = replace(plan, acceptance_evidence=likely.in_words, measures=measures)
    if least is not None and likely.probability < least:
        return replace(plan, status="refused", reason=unlikely(likely, least, registration)), takes
    # Which part of the target is it, and how certain is that?
    counterparts = counterparts_of(takes, settings)
    known = replace(plan.measures, counterpart_probability=least_probability(counterparts))
    warnings = *plan.warnings, *doubts(counterparts), *missing_of(counterparts)
    plan = replace(plan, counterparts=counterparts, measures=known, warnings=warnings)
    if unsure := undecided(counterparts, settings):
        return replace(plan, status="refused", reason=unsure), takes
    return plan, takes


def decided(
    demonstration: Demonstration,
    source: Structure,
    target: Structure,
    settings: Settings,
    memo: Memo,
    siblings: Sequence[Structure] = (),
) -> tuple[Plan, Sequence[Take]]:
    """What is known before a path is sought: a refusal, or takes to plan from.

    The plan has no trajectory yet, and the warnings and shortfalls that are known so far; where it is refused
    there may be no takes. All is in the frames that the structures are given in.
    """
    plan = _begun(demonstration, source, target, settings)
    if plan.status != "ok":
        return plan, ()
    inputs = demonstration, source, target, settings, memo
    of_two = alone, takes = _on_pair(plan, *inputs)
    # A sibling is asked where the two leave a doubt of which part is meant, and heard where it leaves none.
    unknown = bool(takes) and takes[0].pair.surface.carried is None
    refused = alone.status == "refused" and (
        alone.registration is None or bool(alone.counterparts) or unknown
    )
    if siblings and (refused or doubts(alone.counterparts)):
        labelled = _on_pair(plan, *inputs, siblings)
        if labelled[0].parts_told_by and labelled[0].status == "ok" and not doubts(labelled[0].counterparts):
            return labelled
    return of_two


def _planned(
    demonstration: Demonstration,
    source: Structure,
    target: Structure,
    settings: Settings,
    memo: Memo,
    required: RequiredSurface | None,
    siblings: Sequence[Structure],
) -> Plan:
    plan, takes = decided(demonstration, source, target, settings, memo, siblings)
    if plan.status != "ok":
        return replace(plan, warnings=(), not_flyable="")
    takes = [replace(take, required=required) for take in takes]
    try:
        # Where is the same flown on the target? (lines 14 to 16)
        carried = carry(takes, settings)
        # Which path near there shows the most for what it costs, and how fast is it flown? (lines 17 and 18)
        timed = propose(carried, settings)
    except RefusedError as refusal:
        reason = "; ".join((str(refusal), *in_the_way(takes[0].pair)))
        return replace(plan, status="refused", reason=reason, warnings=(), not_flyable="")
    # A flight of photos becomes one: as many as its camera takes, where they are needed.
    timed = _photographed(takes, settings, timed) if demonstration.stills else timed
    trajectory, is_viewpoint, demonstrated_s, added = timed
    # How good is it? The same measures for every preset.
    measures, surface, warnings = judge(trajectory, demonstrated_s, takes, settings, added)
    likely, certain = plan.measures.acceptance_probability, plan.measures.counterpart_probability
    measures = replace(measures, acceptance_probability=likely, counterpart_probability=certain)
    # May it be flown? What falls short is refused, or says so where it is for comparison.
    reasons = shortfalls(trajectory, measures, takes, settings)
    short = "; ".join((*([plan.not_flyable] if plan.not_flyable else []), *reasons))
    warnings = (*plan.warnings, *warnings, *odd_shape(measures, settings), *slow(measures, takes, settings))
    if short and settings.verdict.enforce:
        return replace(plan, status="refused", reason=short, measures=measures, warnings=warnings)
    pair, camera, photos = takes[0].pair, takes[0].inspection.camera, None
    if demonstration.stills:
        seen = camera, pair.target_scene, settings.inspection
        photos = photos_of(trajectory, is_viewpoint, pair.surface.target, *seen)
    return replace(
        plan,
        flyable=not short,
        not_flyable=short,
        trajectory=trajectory,
        is_viewpoint=is_viewpoint,
        added=added if settings.refine.method == "view" else None,
        measures=measures,
        surface=surface,
        supposed=pair.supposed,
        warnings=warnings,
        photos=photos,
    )


def _photographed(takes: Sequence[Take], settings: Settings, timed: Timed) -> Timed:
    """The path with its photos for viewpoints, no two nearer in time than the camera takes them."""
    camera, pair = takes[0].inspection.camera, takes[0].pair
    inspected = InspectedSurface.together([inspected_by(take, settings) for take in takes])
    surface = inspected.cloud.at(inspected.need > 0)
    interval_s, most_mps2 = least_interval(camera)[0], settings.retime.max_acceleration_mps2
    shots = photographed(timed.trajectory, camera, pair.target_scene, surface, interval_s, most_mps2)
    t_s, planned_s = timed.trajectory.t_s, shots.planned_s
    at = np.clip(np.searchsorted(t_s, planned_s), 0, len(timed.added) - 1)
    return Timed(shots.path, shots.photo, np.interp(planned_s, t_s, timed.demonstrated_s), timed.added[at])


def transfer_key(
    demonstration: Demonstration,
    source: Structure,
    target: Structure,
    settings: Settings,
    siblings: Sequence[tuple[str, str]] = (),
) -> str:
    """Hex digest of all that a plan depends on: same key, same plan.

    `siblings` are id and hash of each that is given to `plan_transfer`, in any order.
    """
    others = {"siblings": sorted([list(one) for one in siblings])} if siblings else {}
    return digest(
        {
            "method": METHOD_VERSION,
            **method(),
            "demonstration": [demonstration.demonstration_id, demonstration.sha256],
            "source": [source.structure_id, source.sha256],
            "target": [target.structure_id, target.sha256],
            "settings": settings.sha256,
            **others,
        }
    )
