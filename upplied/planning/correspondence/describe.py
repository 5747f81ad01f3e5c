"""Parts in words: by their place in the structure, since meshes give them no names."""

from __future__ import annotations

import numpy as np

from upplied.planning.constants import LEAST_PART
from upplied.planning.correspondence.part_assignment import Matching
from upplied.planning.surface.parts import Parts
from upplied.records import Bools, Floats, Ints

_WORDS = (("rear", "front"), ("right", "left"), ("low", "high"))
_CENTRAL = 0.08  # of the structure's extent: no word within this distance of the middle
_NAMED = 6  # parts without a counterpart that are named one by one


def place_of(parts: Parts, part: int) -> str:
    """Where a part lies in the structure, e.g. ``front left low``; ``middle`` where nothing stands out.

    Left is +Y, front +X.
    """
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
    """The third of a structure along each axis in which most of some points lie, in words.

    Parameters
    ----------
    whole : array, shape (N, 3), m
        All of the structure, +X front and +Y left.
    points : array, shape (K, 3), m
    weight : array, shape (K,)

    Returns
    -------
    str
        E.g. ``the rear high section``.
    array of bool, shape (K,)
        Which of the points lie there.
    """
    low, size = whole.min(axis=0), np.maximum(np.ptp(whole, axis=0), 1e-9)
    third = np.clip(((points - low) / size * 3).astype(int), 0, 2)
    cell = third @ [9, 3, 1]
    best = int(np.bincount(cell, weights=weight, minlength=27).argmax())
    at = (best // 9, best // 3 % 3, best % 3)
    words = [pair[side // 2] for pair, side in zip(_WORDS, at, strict=True) if side != 1]
    return f"the {' '.join(words) or 'middle'} section", cell == best
