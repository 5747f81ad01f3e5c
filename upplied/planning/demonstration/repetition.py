"""One demonstration flown again on each matching part, or mirrored to the other side, in one plan.

That is what inspectors do: who showed one engine wants to see all four. How far the expert's own blur
and incidence widen what counts as sharp is asked of all takes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from upplied.config import InspectionSettings, Settings
from upplied.errors import SettingsError
from upplied.geometry.poses import from_yaw_pitch, in_a_row, yaw_pitch
from upplied.planning.correspondence.memo import Memo, no_memo, remembering
from upplied.planning.correspondence.naming import choices_for, side_of
from upplied.planning.correspondence.never_scanned import without
from upplied.planning.correspondence.pair import Pair, Task, grained, skin_of
from upplied.planning.correspondence.registration import declared_for
from upplied.planning.demonstration.inspection import Inspection, attended_by, inspect_demonstration
from upplied.planning.geometry.clouds import weighted_percentile
from upplied.planning.surface.frames import named_axes
from upplied.planning.surface.parts import Parts, labels_of, parts_of_both
from upplied.planning.surface.skin import Skin
from upplied.records import Demonstration, Floats, Ints, Record, Structure, SurfaceStates, Trajectory
from upplied.records.plans import RequiredSurface

_INTEREST = 0.05  # of attention, from which a sample lies on what was inspected
_INSPECTED = 0.1  # least share of what was inspected, for a part to be asked about
_TRANSIT_S = 10.0  # of the demonstration's time between two takes; the way itself is timed anew


@dataclass(frozen=True, eq=False, repr=False)
class Attended(Record):
    """What a flight was about, and what corresponds to it, as the even samples of both structures tell."""

    flight: Demonstration
    pair: Pair
    weight: Floats  # (N,) attention, 0 to 1, of the source's samples
    stretch: Ints  # (N,) the stretch of the skin on which each of them lies
    part: int = -1  # of the source, that is repeated; -1 where nothing is
    choice: int = -1  # of the target, that it is repeated on


@dataclass(frozen=True, eq=False, repr=False)
class Take(Record):
    """One flying of a demonstration: what was looked at, and what corresponds to it on the target."""

    inspection: Inspection
    pair: Pair  # with fine samples of what was inspected, and of its counterpart
    attended: Attended
    required: RequiredSurface | None = None  # of the target, that is to be shown before all else


def takes_of(
    demonstration: Demonstration, pair: Pair, settings: Settings, memo: Memo = no_memo
) -> list[Take]:
    """The demonstration as flown, and its repetitions as the settings ask for them.

    A `SettingsError` says that a repetition is asked for with a preset that knows no parts.
    """
    skin = skin_of(pair.source, pair.source_scene, pair.surface.source, settings.clouds, memo)
    return _with_fine_samples(_attended(demonstration, pair, skin, settings, memo), skin, settings, memo)


def _attended(
    demonstration: Demonstration, pair: Pair, skin: Skin, settings: Settings, memo: Memo
) -> list[Attended]:
    """The takes as the even samples tell."""

    def about(flight: Demonstration) -> Attended:
        attention = attended_by(flight, pair, skin, settings, memo)[1]
        return Attended(flight, pair, attention.weight, attention.part)

    first = about(demonstration)
    if not settings.correspondence.repeat:
        return [first]
    if settings.correspondence.method != "parts":
        reason = f"was requested with preset {settings.preset!r}"
        raise SettingsError("correspondence.repeat", reason, "preset 'recommended' only")
    if settings.correspondence.repeat == "each" and _shows_each(first):
        return [first]
    across = about(mirrored(demonstration, pair.source))
    if settings.correspondence.repeat == "mirror":
        return [first, across]
    takes = []
    for take in (first, across):
        part = demonstrated_part(take)
        for choice in _on_this_side(part, pair):
            pairs = (*settings.correspondence.counterparts, (f"part_{part}", f"part_{choice}"))
            chosen = replace(settings, correspondence=replace(settings.correspondence, counterparts=pairs))
            takes.append(replace(take, pair=_matched_anew(pair, chosen, memo), part=part, choice=choice))
    return takes or [first]


def _with_fine_samples(flights: Sequence[Attended], skin: Skin, settings: Settings, memo: Memo) -> list[Take]:
    """The takes with fine samples of what was inspected, and of the counterparts of all of that."""
    pair, zones = flights[0].pair, [one.weight > _INTEREST for one in flights]
    counterparts = np.zeros(len(pair.surface.target), bool)
    for one, mine in zip(flights, zones, strict=True):
        index = one.pair.surface.correspondences.target_index
        counterparts[index[mine & (index >= 0)]] = True
    source = grained(pair.source, pair.surface.source, np.any(zones, axis=0), settings.clouds, memo)
    target = grained(pair.target, pair.surface.target, counterparts, settings.clouds, memo)
    takes = []
    for one in flights:
        refined = one.pair.with_samples(source, target)
        inspection = inspect_demonstration(one.flight, refined, skin, settings, memo, source.key)
        takes.append(Take(inspection, refined, one))
    return takes


def _shows_each(take: Attended) -> bool:
    """Whether the flight as it was flown shows every part of the kind already: all piers of a bridge."""
    fit, part = take.pair.surface, demonstrated_part(take)
    counterparts, choices = fit.correspondences.target_parts, _choices(part, take.pair)[2]
    shown = [mine for mine, _ in inspected_parts(take, labels_of(fit.source))]
    matched = {other for mine in shown for other in counterparts(mine).tolist()}
    return len(shown) > 1 and part in shown and len(choices) > 0 and set(choices) <= matched


def _matched_anew(pair: Pair, settings: Settings, memo: Memo) -> Pair:
    """The same pair with the surfaces matched as the settings ask."""
    fit, structures = pair.surface, (pair.source, pair.target)
    memo = remembering(memo, *(each.sha256 for each in structures))
    labelled = () if fit.labelling is None else (fit.labelling.sha256,)
    clouds, names = (fit.source, fit.target), ("repeated", *labelled)
    task = Task(*structures, settings, memo, clouds, declared_for(*structures), names)
    match = without(task.matched(fit).correspondences, pair.missing, *clouds, fit.carried)
    return replace(pair, surface=replace(fit, correspondences=match))


def mirrored(demonstration: Demonstration, source: Structure) -> Demonstration:
    """The same flight on the other side of the structure's middle plane, left for right, without roll."""
    across = int(np.abs(named_axes(source.frame)[1]).argmax())  # the axis from right to left
    ends = source.vertices[:, across]
    positions = np.array(demonstration.positions)
    positions[:, across] = ends.min() + ends.max() - positions[:, across]
    yaw, pitch = yaw_pitch(demonstration.quat_xyzw)
    return replace(
        demonstration,
        positions=positions,
        quat_xyzw=from_yaw_pitch(-yaw if across == 1 else np.pi - yaw, pitch),
        sha256=demonstration.sha256 and f"{demonstration.sha256}-mirrored",
    )


def inspected_states(take: Take) -> SurfaceStates:
    """What of the source a demonstration was about, in three steps, and what of that has no counterpart."""
    cloud, weight = take.pair.surface.source, take.inspection.attention.weight
    state = np.select([weight >= 0.7, weight >= 0.4, weight >= 0.1], [7, 6, 5], 0)
    state[(weight >= 0.1) & (take.pair.surface.correspondences.target_index < 0)] = 4
    return SurfaceStates(cloud.points, state.astype(np.int64), cloud.normals)


def demonstrated_part(take: Attended) -> int:
    """The part of the source that the demonstration is about: the one with most of what was inspected."""
    parts = inspected_parts(take, labels_of(take.pair.surface.source))
    return parts[0][0] if parts else 0


def inspected_parts(take: Attended, label: Ints) -> list[tuple[int, float]]:
    """The parts on which most of what was inspected lies, and their shares; at least one if there are any."""
    area: Floats = take.pair.surface.source.areas
    share = np.bincount(label, weights=take.weight * area)
    if share.sum() <= 0:
        return []
    share = share / share.sum()
    return [(int(part), float(share[part])) for part in np.argsort(-share, kind="stable")
            if share[part] >= min(_INSPECTED, share.max())]  # fmt: skip


def joined(flights: Sequence[Trajectory]) -> Trajectory:
    """Several flights one after another, as one."""
    begin, times = 0.0, []
    for flight in flights:
        times.append(flight.t_s - flight.t_s[0] + begin)
        begin = float(times[-1][-1]) + _TRANSIT_S
    return replace(in_a_row(flights), t_s=np.concatenate(times))


def breaks_of(takes: Sequence[Take]) -> Ints:
    """First poses, in the joined flight, of each take but the first, and after each gap in a log."""
    starts = np.cumsum([0, *(len(take.inspection.flight) for take in takes)])
    inner = [take.inspection.breaks + start for take, start in zip(takes, starts[:-1], strict=True)]
    return np.unique(np.concatenate([starts[1:-1], *inner]).astype(np.int64))


def begins_of(flights: Sequence[Trajectory]) -> Floats:
    """When each of several flights begins in the joined one, s."""
    return joined(flights).t_s[np.cumsum([0, *map(len, flights[:-1])])]


def choices_in(pair: Pair, source: Parts, part: int, target: Parts, known: Sequence[int]) -> Ints:
    """Parts of the target like a source part (`choices_for`), but those that correspond to another kind.

    The nose of a fuselage that was scanned in two pieces may have the size of an engine.
    """
    choices, match = choices_for(source, part, target, known), pair.surface.correspondences
    if match.source_class is None or match.target_class is None:
        return choices
    others = np.delete(match.source_class, choices_for(source, part, source, [part]))
    return choices[~np.isin(match.target_class[choices], others[others >= 0])]


def _on_this_side(part: int, pair: Pair) -> list[int]:
    """Target parts like a source part, on its side or in the middle."""
    source, target, choices = _choices(part, pair)
    return [choice for choice in choices if side_of(target, choice) in (0, side_of(source, part))]


def _choices(part: int, pair: Pair) -> tuple[Parts, Parts, list[int]]:
    """Both structures' parts in the axes in which places are named, and the target's like a source part."""
    fit = pair.surface
    source, target = parts_of_both(fit.source, fit.registered, named_axes(pair.source.frame))
    known = fit.correspondences.target_parts(part).tolist()
    return source, target, choices_in(pair, source, part, target, known).tolist()


USUAL_PCT = 95.0  # of the demonstration's time


def look_limits(takes: Sequence[Take], rule: InspectionSettings) -> tuple[float, float]:
    """Largest motion (rad/s) and least cosine of the incidence of a look that counts.

    Those of the settings, unless 95 % of the expert's own looks were within a wider one.
    """
    attended, camera = [take.inspection.attention for take in takes], takes[0].inspection.camera
    own = rule.sharp_radps(camera.hfov_deg, camera.width_px, camera.exposure_s)
    sharp = max(own, *(one.motion_radps for one in attended))
    oblique = max(rule.max_incidence_deg, *(one.incidence_deg for one in attended))
    return float(sharp), float(np.cos(np.radians(min(oblique, 90.0))))


def steady_radps(takes: Sequence[Take], rule: InspectionSettings) -> float:
    """How fast the camera may turn, rad/s: while it is sharp, or as the expert did 95 % of the time."""
    flown, camera = [take.inspection.steps for take in takes], takes[0].inspection.camera
    own = np.concatenate([np.linalg.norm(part.turn, axis=1) for part in flown])
    time = np.concatenate([part.step_s for part in flown])
    usual = weighted_percentile(own, time, USUAL_PCT)
    sharp = rule.sharp_radps(camera.hfov_deg, camera.width_px, camera.exposure_s)
    return max(sharp, 0.0 if np.isnan(usual) else usual)
