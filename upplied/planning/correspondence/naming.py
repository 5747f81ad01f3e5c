"""Parts in words: by landmarks and by their place in the structure, since meshes give them no names."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from upplied.errors import RefusedError, SettingsError
from upplied.planning.constants import LEAST_PART, MOST_RATIO, SAME_SIZE, TOLERANCE
from upplied.planning.correspondence.part_assignment import Matching, like_shape
from upplied.planning.geometry.clouds import UNTURNED, in_source_frame
from upplied.planning.surface.parts import Parts, labels_of, names_of, parts_of_both
from upplied.records import Bools, Cloud, Floats, Ints, Registration

Landmarks = Mapping[str, tuple[float, float, float]]

_PLACES = ("left", "right", "inner", "outer", "front", "rear", "high", "low")
_WORDS = (("rear", "front"), ("right", "left"), ("low", "high"))
_CENTRAL = 0.08  # of the structure's extent: no word within this distance of the middle
_NAMED = 6  # parts without a counterpart that are named one by one


def pinned_parts(
    source: Cloud,
    target: Cloud,
    registration: Registration,
    pairs: tuple[tuple[str, str], ...],
    source_landmarks: Landmarks,
    target_landmarks: Landmarks,
    words: Floats = UNTURNED,
    named: Ints | None = None,
) -> dict[int, int]:
    """Source part to target part for each pair of names, on the source and on the target.

    A name is a landmark of its structure or ``part_7``. On the target it may be places as well, ``outer`` or
    ``left_inner``: they choose among the parts of the source part's shape, on its side unless they name one.
    Places are asked on the registered target, however it is turned.

    Parameters
    ----------
    source, target : Cloud
        Surface samples with parts, each in its own frame; so are the landmarks.
    words : array, shape (3, 3), optional
        Quarter turns of the source to the axes in which places are named: +X front, +Y left.
    named : array of int, shape (M,), optional
        The source's part by which each target sample is named, -1 for none: no place means another kind.

    Raises
    ------
    SettingsError
        If a name is unknown, with the names that would be known.
    RefusedError
        If a name is known and the parts of the target, as they were found, do not tell what it means.
    """
    registered = in_source_frame(target, registration)
    here, there = parts_of_both(source, registered, words)
    names = np.full(len(there), -1) if named is None else names_of(registered, named)
    pinned = {}
    for name, name_there in pairs:
        one = _named(name, source, here, source_landmarks)
        if one is None:
            raise _unknown(name, "source", source_landmarks, len(here), "")
        other, reason = _named(name_there, target, there, target_landmarks), ""
        if other is not None:
            # As much larger along both sides as a matched part may be along one: no engine and airliner.
            ratio = there.area[other] / max(here.area[one], 1e-12)
            if not 1 / MOST_RATIO**2 < ratio < MOST_RATIO**2:
                reason = (
                    f"there lies part_{other} of the target with {100 * there.area[other]:.1f} % of its "
                    f"surface, and part_{one} of the source has {100 * here.area[one]:.1f} %"
                )
        elif set(name_there.split("_")) <= set(_PLACES):
            other = _by_place(name_there.split("_"), here, one, there, names)
            reason = "no part of the target has the shape and size of it" if other is None else ""
        if reason:
            raise RefusedError(
                f"counterpart {name}={name_there}",
                f"cannot be distinguished on the target: {reason}",
                "a named counterpart is one part of the target",
                "give a model of the target in which that part is a piece of its own",
            )
        if other is None:
            places = " or places among " + ", ".join(_PLACES)
            raise _unknown(name_there, "target", target_landmarks, len(there), places)
        pinned[one] = other
    return pinned


def choices_for(source: Parts, part: int, target: Parts, known: Sequence[int] = ()) -> Ints:
    """Parts of the registered target of a source part's shape, those on its side first; boxes made equal.

    Where it is known which one corresponds to it, the others are of its size too: no abutment beside piers.
    """
    alike = _alike(source, part, target)
    if len(known) == 1:
        size = target.area[known[0]]
        alike = [other for other in alike if 1 / SAME_SIZE < target.area[other] / size < SAME_SIZE]
    side = side_of(source, part)
    return np.array(sorted(alike, key=lambda other: side_of(target, other) != side), np.int64)


def _named(name: str, cloud: Cloud, parts: Parts, landmarks: Landmarks) -> int | None:
    if name in landmarks:
        nearest = np.linalg.norm(cloud.points - np.asarray(landmarks[name], float), axis=1).argmin()
        return int(labels_of(cloud)[nearest])
    number = name.removeprefix("part_")
    if number != name and number.isdecimal() and int(number) < len(parts):
        return int(number)
    return None


def _by_place(words: list[str], source: Parts, part: int, target: Parts, names: Ints) -> int | None:
    kind = [-1, part, *_alike(source, part, source)]
    alike = choices_for(source, part, target, np.flatnonzero(names == part).tolist()).tolist()
    candidates = [other for other in alike if names[other] in kind]
    side = {"left": 1, "right": -1}.get(next((word for word in words if word in ("left", "right")), ""), 0)
    side = side or side_of(source, part)
    candidates = [other for other in candidates if side_of(target, other) == side] or candidates
    offset = _in_unit_box(target).middle - 0.5
    score = {"outer": np.abs(offset[:, 1]), "inner": -np.abs(offset[:, 1])}
    score |= {"front": offset[:, 0], "rear": -offset[:, 0], "high": offset[:, 2], "low": -offset[:, 2]}
    worth = sum((score[word] for word in words if word in score), np.zeros(len(target)))
    return max(candidates, key=lambda other: float(worth[other]), default=None)


def _alike(source: Parts, part: int, target: Parts) -> list[int]:
    """Target parts of like shape, with the structures' boxes made equal."""
    return like_shape(_in_unit_box(source), part, _in_unit_box(target), np.sqrt(3.0)).tolist()


def _in_unit_box(parts: Parts) -> Parts:
    low, size = parts.box[0], np.maximum(np.ptp(parts.box, axis=0), 1e-9)
    return replace(
        parts,
        low=(parts.low - low) / size,
        high=(parts.high - low) / size,
        extent=parts.extent / size.max(),
        registered=np.array([[0.0] * 3, [1.0] * 3]),
    )


def side_of(parts: Parts, part: int) -> int:
    """Side on which a part lies: 1 left (+Y), -1 right, 0 in the middle."""
    offset = _in_unit_box(parts).middle[part, 1] - 0.5
    return 0 if abs(offset) < TOLERANCE else int(np.sign(offset))


def on_sides(parts: Parts, some: Iterable[int], side: int) -> tuple[int, int]:
    """How many of some parts lie on a side (1 left, -1 right), and how many on the other."""
    each = [side_of(parts, part) for part in some]
    return each.count(side), each.count(-side)


def _unknown(name: str, which: str, landmarks: Landmarks, number: int, places: str) -> SettingsError:
    known = ", ".join(sorted(landmarks)) or "none declared"
    return SettingsError(
        f"counterpart {name!r}",
        f"names no part of the {which} structure",
        f"landmarks ({known}), part_0 to part_{number - 1}{places}",
        "declare the landmark in the manifest, or take the part's number from the counterpart summary",
    )


def place_of(parts: Parts, part: int) -> str:
    """Where a part lies, e.g. ``front left low`` (left is +Y, front +X); ``middle`` where nothing does."""
    low, high = parts.box
    offset = (parts.middle[part] - (low + high) / 2) / np.maximum(high - low, 1e-9)
    words = [pair[int(at > 0)] for pair, at in zip(_WORDS, offset, strict=True) if abs(at) > _CENTRAL]
    return " ".join(words) or "middle"


def summary_of(source: Parts, matching: Matching, label: Ints, gone: Bools, target: Parts) -> str:
    """Which parts have a counterpart, and which have none, in words."""
    text = f"{int((matching.source_class >= 0).sum())} of {len(source)} parts matched one to one"
    count = np.bincount(label, minlength=len(source))
    lost = np.bincount(label, weights=gone, minlength=len(source)) / np.maximum(count, 1)
    without = [part for part in np.argsort(-source.area, kind="stable") if lost[part] > 0.5]
    if without:
        named = [
            f"part_{part} ({place_of(source, part)}, {100 * source.area[part]:.1f} % of the surface)"
            for part in without[:_NAMED]
        ]
        more = len(without) - len(named)
        text += "; no counterpart on the target: " + ", ".join(named) + (f" and {more} more" if more else "")
    unused = [part for part in np.flatnonzero(matching.target_class < 0) if target.area[part] > LEAST_PART]
    if unused and len(matching):
        places = [f"part_{part} ({place_of(target, int(part))})" for part in unused[:_NAMED]]
        text += "; only on the target: " + ", ".join(places)
    return text


def place_in(whole: Floats, points: Floats, weight: Floats) -> tuple[str, Bools]:
    """The third of a structure (N, 3) along each axis in which most of some points (K, 3) lie, in words.

    E.g. ``the rear high section``, with which of the points (K,), of a weight (K,), lie there. The structure
    stands with +X front and +Y left.
    """
    low, size = whole.min(axis=0), np.maximum(np.ptp(whole, axis=0), 1e-9)
    third = np.clip(((points - low) / size * 3).astype(int), 0, 2)
    cell = third @ [9, 3, 1]
    best = int(np.bincount(cell, weights=weight, minlength=27).argmax())
    at = (best // 9, best // 3 % 3, best % 3)
    words = [pair[side // 2] for pair, side in zip(_WORDS, at, strict=True) if side != 1]
    return f"the {' '.join(words) or 'middle'} section", cell == best
