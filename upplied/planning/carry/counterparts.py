"""Which part of the target corresponds to each inspected part, and how certain that is.

An engine has a twin under the other wing, and may have four on the target. Where parts are not known, as
on scans, points have nearest neighbours still and a plan good figures, of the wrong engine. So it asks first.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from upplied.config import Settings
from upplied.geometry.scene import scene_of
from upplied.planning.carry.forecast import odd_number
from upplied.planning.constants import COMPACT, LEAST_PART, MAJORITY
from upplied.planning.correspondence.certainty import SAME_KIND, certainty, evidence_of_same_kind, probability
from upplied.planning.correspondence.naming import choices_for, place_of, side_of
from upplied.planning.demonstration.repetition import Attended, Take, choices_in, inspected_parts
from upplied.planning.geometry.clouds import diagonal_of
from upplied.planning.surface.frames import named_axes
from upplied.planning.surface.parts import Parts, labels_of, parts_of
from upplied.planning.surface.skin import skin_parts
from upplied.records import Bools, Counterpart, Ints, Record


@dataclass(frozen=True, eq=False, repr=False)
class _Side(Record):
    """One structure as its parts are known: from its pieces, or else from where its skin has creases."""

    parts: Parts  # source frame and scale, axes of the places' names
    label: Ints  # (N,) of its samples
    pieces: bool  # whether the pieces of its mesh tell parts


def counterparts_of(takes: Sequence[Take], settings: Settings) -> tuple[Counterpart, ...]:
    """What corresponds to each inspected part of all takes, the most inspected first, if parts are known."""
    if settings.correspondence.method != "parts":
        return ()
    counterparts: dict[str, Counterpart] = {}
    attended = [take.attended for take in takes]
    for take in attended:
        source = _source(take)
        registered, words = take.pair.surface.registered, named_axes(take.pair.source.frame)
        label, parts = labels_of(registered), parts_of(registered).in_axes(words).on(source.parts)
        target = _Side(parts, label, bool(label.max(initial=0) > 0))
        inspected = _bodies(inspected_parts(take, source.label), take, source)
        # Each taking is asked about the part that it repeats.
        for part, share in [one for one in inspected if one[0] == take.part] or inspected:
            one = _counterpart(take, part, share, source, target, settings)
            known = counterparts.get(one.part)
            counterparts[one.part] = one if known is None else _both(known, one)
    if settings.correspondence.repeat == "each":
        counterparts = _no_part_twice(counterparts, attended[0].pair.target.structure_id)
        for one in _not_repeated(attended):
            counterparts.setdefault(one.part, one)
    every = _without_flown(list(counterparts.values()), settings)
    return tuple(sorted(every, key=lambda one: -one.inspected_pct))


def _bodies(inspected: list[tuple[int, float]], take: Attended, source: _Side) -> list[tuple[int, float]]:
    """The same parts and shares, but an inlet that nothing answers counts to the nacelle that it touches."""
    compact = _compact(take, source)
    matched = {part: bool(compact[part] and _matched_parts(take, part, source)) for part, _ in inspected}
    shares = dict(inspected)
    for part, share in inspected:
        hosts = [one for one, _ in inspected if matched[one] and source.parts.touching[part, one]]
        if compact[part] and not matched[part] and hosts:
            shares[hosts[0]] += share
            del shares[part]
    return list(shares.items())


def _no_part_twice(counterparts: dict[str, Counterpart], there: str) -> dict[str, Counterpart]:
    """The same, in doubt where one part of the target is flown for two parts of the source."""
    # It lies in the middle, where the source has none of the kind: two in one, or what is left of another.
    times = Counter(name for one in counterparts.values() for name in one.flown)
    twice = [name for name, count in times.items() if count > 1]
    if not twice:
        return counterparts
    doubt = f"{twice[0]} of {there} is taken for several parts of the source"
    return {
        name: replace(one, doubt=doubt) if set(one.flown) & set(twice) and not one.doubt else one
        for name, one in counterparts.items()
    }


def _not_repeated(takes: Sequence[Attended]) -> list[Counterpart]:
    """The parts like the flown ones on a side of the source for which nothing is flown on the target."""
    take, source = takes[0], _source(takes[0])
    shown = [part for part, _ in inspected_parts(take, source.label) if _matched_parts(take, part, source)]
    flown = [take.part for take in takes if take.choice >= 0] or shown  # nothing like it may have been found
    if not flown:
        return []
    there = take.pair.target.structure_id
    alike = choices_for(source.parts, flown[0], source.parts, [flown[0]]).tolist()
    sides = {side_of(source.parts, part) for part in flown}
    names = [_name(source.parts, part) for part in alike if side_of(source.parts, part) not in sides]
    twins, lacks = len(alike) - 1, f"is on its side of {there}"
    return [Counterpart(name, 100.0, twins, 0, doubt=f"no part like {name} {lacks}") for name in names]


def _counterpart(
    take: Attended, part: int, share: float, source: _Side, target: _Side, settings: Settings
) -> Counterpart:
    name = _name(source.parts, part)
    matched = [take.choice] if take.choice >= 0 and part == take.part else _matched_parts(take, part, source)
    choices = partial(choices_in, take.pair) if source.pieces else choices_for
    alike = choices(source.parts, part, target.parts, matched).tolist() if target.pieces else []
    twins = {*choices_for(source.parts, part, source.parts, [part]).tolist()} - {part}
    if not (source.pieces or len(take.pair.missing.opening) or _compact(take, source)[part]):
        # Stretches of one piece are no parts: what was inspected of it is one, all together. But there may be
        # more of small ones on the target, and of a scan that lacks something one may be what it lacks.
        twins -= {other for other, _ in inspected_parts(take, source.label)}
    known = _probability(take, part, matched, alike, settings) if matched and source.pieces else None
    others = _others_within(take, part, source, target, matched)
    doubt = _doubt(take, name, share, target, known, settings) if not matched or known is not None else ""
    flown = matched or ([] if source.pieces else _lies_on(take, part, source, target, alike))
    if others and not doubt:
        apart = f"a part of its own, of which the source has {others} more, and it cannot be distinguished"
        doubt = f"what was inspected of {name} is {apart} on {take.pair.target.structure_id}"
    if settings.correspondence.repeat == "each" or settings.correspondence.counterparts:
        odd = f"{name} cannot be distinguished on {take.pair.source.structure_id}: its surface is one piece"
        if source.pieces:
            odd = odd_number(take, part, source.parts, target.parts, {*alike, *matched})
        doubt = doubt or odd
    # What the target's scan lacks of it, and where the scan ends on the parts that are flown to.
    surface, missing = take.pair.surface, take.pair.missing
    weight = np.where(source.label == part, surface.source.areas * take.weight, 0.0)
    gone = missing.beyond[surface.correspondences.target_index[missing.beyond] < 0]
    areas, label, opening = surface.target.areas, target.label, missing.opening
    whole = np.bincount(label, areas)
    ends = np.bincount(label[opening], areas[opening], minlength=len(whole))
    open_ = [other for other in matched or [0] if ends[other] > LEAST_PART * whole[other]]
    return Counterpart(
        part=name,
        inspected_pct=round(100 * share, 2),
        twins=len(twins) + others,
        found=len({*alike, *matched[:1]}),
        flown=tuple(_name(target.parts, other) for other in flown),
        left_out=tuple(_name(target.parts, other) for other in alike if other not in flown),
        probability=None if known is None else round(known, 4),
        doubt=doubt,
        never_scanned_pct=round(float(100 * weight[gone].sum() / max(weight.sum(), 1e-12)), 2),
        open=tuple(_name(target.parts, other) for other in open_),
    )


def _compact(take: Attended, source: _Side) -> Bools:
    """Which parts (K,) of the source are so small that there may be others of their kind: engines, piers."""
    least = COMPACT * diagonal_of(take.pair.surface.source.points)
    return np.asarray((source.parts.high - source.parts.low).max(axis=1) <= least, bool)


def _others_within(take: Attended, part: int, source: _Side, target: _Side, matched: list[int]) -> int:
    """How many stretches of skin are like the inspected one, where that is a piece of its part, as an engine
    that was modelled, or scanned, as one with its wing."""
    if not source.pieces or _compact(take, source)[part]:
        return 0  # or a body of its own
    cloud, skin = take.pair.surface.source, take.stretch
    area, mine, least = cloud.areas, source.label == part, COMPACT * diagonal_of(cloud.points)
    stretches = parts_of(replace(cloud, part=skin))
    whole, shown = np.bincount(skin, area), np.bincount(skin, area * take.weight)
    own, own_shown = (np.bincount(skin, area * of * mine) for of in (1.0, take.weight))
    most = int(own_shown.argmax())
    inspected = shown / whole > MAJORITY * shown[most] / whole[most]  # as that one was, or nearly
    alike = np.append(choices_for(stretches, most, stretches, [most]), most)
    apart = np.linalg.norm(stretches.middle[:, None] - stretches.middle[alike], axis=2)
    # What lies where this does is the same thing: the other half of a nacelle, the lower side of a wing.
    size = (stretches.high - stretches.low)[most]
    there = apart <= np.linalg.norm(size) / 2
    others = np.zeros(len(stretches), bool)
    others[alike] = (~inspected & ~there[:, -1])[alike]
    piece = own[inspected].sum() <= MAJORITY * own.sum() and size.max() <= least
    # Not a bar of a lattice: what was inspected are things of its kind.
    if not (others.any() and piece and own_shown[there.any(axis=1)].sum() > MAJORITY * own_shown.sum()):
        return 0
    elsewhere = not (others & (own > MAJORITY * whole)).any()
    if elsewhere and _is_one_there(take, stretches, most, target, matched):
        return 0  # what other parts have of the kind their counterparts tell
    return int(others.sum())


def _is_one_there(take: Attended, stretches: Parts, most: int, target: _Side, matched: list[int]) -> bool:
    """Whether a stretch of the source comes to a place like it, the only one on those parts of the target."""
    skin = skin_parts(take.pair.target, scene_of(take.pair.target), take.pair.surface.target).label
    index = take.pair.surface.correspondences.target_index[take.stretch == most]
    index = index[index >= 0]
    rest = np.isin(skin, skin[index])  # of what it is a piece of there
    rest[index] = False
    skin[index] = skin.max() + 1
    skin = np.unique(skin, return_inverse=True)[1].reshape(-1)
    lies = np.bincount(skin, np.isin(target.label, matched) & ~rest) > MAJORITY * np.bincount(skin)
    alike = choices_for(stretches, most, parts_of(replace(take.pair.surface.registered, part=skin)))
    return len(index) > 0 and alike[lies[alike]].tolist() == [skin.max()]


def _probability(
    take: Attended, part: int, matched: list[int], alike: list[int], settings: Settings
) -> float | None:
    """That these parts of the target are its counterpart, or where one was chosen, one of its kind."""
    fit = take.pair.surface
    if fit.carried is None:
        return None
    best = certainty(fit, part, matched, alone=set(alike) <= set(matched))
    if len(matched) == 1 and (take.choice >= 0 or settings.correspondence.counterparts):
        for other in alike:
            if other != matched[0]:
                # How badly the target fits the structure that labelled its parts, of what was scanned of it.
                wholes = fit if fit.labelling is None else fit.labelling.to_target
                known = wholes.registration.scanned, fit.inferred >= 0
                evidence = evidence_of_same_kind(fit.registered, other, matched[0], *known)
                best = max(best, certainty(fit, part, [other]) * probability(evidence, SAME_KIND))
    return best


def _both(one: Counterpart, other: Counterpart) -> Counterpart:
    """What two takes say of the same part."""
    names = (one.flown + other.flown, one.left_out + other.left_out, one.open + other.open)
    flown, left_out, ends = (tuple(dict.fromkeys(of)) for of in names)
    known = [each.probability for each in (one, other) if each.probability is not None]
    least = min(known) if len(known) == 2 else None
    return replace(
        one,
        flown=flown,
        left_out=left_out,
        probability=least,
        doubt=one.doubt or other.doubt,
        never_scanned_pct=max(one.never_scanned_pct, other.never_scanned_pct),
        open=ends,
    )


def _without_flown(counterparts: Sequence[Counterpart], settings: Settings) -> list[Counterpart]:
    """The same, with what is left out by all of them alone, and why."""
    flown = {name for one in counterparts for name in one.flown}
    repeat, why = settings.correspondence.repeat, "not requested (--repeat each)"
    if repeat:
        why = f"--repeat {repeat} flies what lies as the demonstrated part"
    return [
        replace(one, left_out=tuple(f"{name}: {why}" for name in one.left_out if name not in flown))
        for one in counterparts
    ]


def _doubt(
    take: Attended, name: str, share: float, target: _Side, known: float | None, settings: Settings
) -> str:
    """Why it is not certain what corresponds to a part, in words; empty where it is."""
    there, least = take.pair.target.structure_id, settings.correspondence.least_probability
    what = f"{name}, {100 * share:.0f} % of what was inspected,"
    if known is not None:
        if known >= least:
            return ""
        return (
            f"{what} has its counterpart on {there} with probability {known:.2f}, less than {least:g} "
            "(correspondence.least_probability)"
        )
    why = "no part of it was matched" if target.pieces else "its surface is one piece"
    return f"{what} cannot be distinguished on {there}: {why}, and what lies nearest may be another part"


def _matched_parts(take: Attended, part: int, source: _Side) -> list[int]:
    """The target's parts that were matched with a part of the source, none where it was not."""
    match = take.pair.surface.correspondences
    if source.pieces:
        return match.target_parts(part).tolist()
    # The one piece is matched as a whole, which tells nothing of less than the whole.
    return match.target_parts(0).tolist() if source.parts.area[part] > MAJORITY else []


def _lies_on(take: Attended, part: int, source: _Side, target: _Side, alike: list[int]) -> list[int]:
    """Of the target's parts that are like one of the source the one on which most of it lies, if any."""
    fit = take.pair.surface
    index = fit.correspondences.target_index
    mine = (source.label == part) & (index >= 0)
    area = np.bincount(target.label[index[mine]], fit.source.areas[mine], minlength=len(target.parts))
    most = int(area.argmax())
    return [most] if most in alike and area[most] > MAJORITY * area.sum() else []


def _source(take: Attended) -> _Side:
    cloud = take.pair.surface.source
    label, words = labels_of(cloud), named_axes(take.pair.source.frame)
    if label.max(initial=0) > 0:
        return _Side(parts_of(cloud).in_axes(words), label, True)
    label = take.stretch
    return _Side(parts_of(replace(cloud, part=label)).in_axes(words), label, False)


def _name(parts: Parts, part: int) -> str:
    return f"part_{part} ({place_of(parts, part)})"
