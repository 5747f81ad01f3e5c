"""Parts in words: by their place in the structure, since meshes give them no names."""

from __future__ import annotations

import numpy as np

from upplied.planning.matching import Matching
from upplied.planning.parts import Parts
from upplied.records import Bools, Ints

_WORDS = (("rear", "front"), ("right", "left"), ("low", "high"))
_CENTRAL = 0.08  # of the structure's extent: no word within this distance of the middle
_NAMED = 6  # parts without a counterpart that are named one by one


def place_of(parts: Parts, part: int) -> str:
    """Where a part lies in the structure, e.g. ``front left low``; ``middle`` where nothing stands out.

    Left is +Y, front +X.
    """
    low, high = parts.low.min(axis=0), parts.high.max(axis=0)
    offset = (parts.middle[part] - (low + high) / 2) / np.maximum(high - low, 1e-9)
    words = [pair[int(at > 0)] for pair, at in zip(_WORDS, offset, strict=True) if abs(at) > _CENTRAL]
    return " ".join(words) or "middle"


def summary_of(source: Parts, matching: Matching, label: Ints, gone: Bools, target: Parts) -> str:
    """Which parts found a partner, and which have no counterpart, in words."""
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
    unused = [part for part in np.flatnonzero(matching.target_class < 0) if target.area[part] > 0.005]
    if unused and len(matching):
        places = [f"part_{part} ({place_of(target, int(part))})" for part in unused[:_NAMED]]
        text += "; only on the target: " + ", ".join(places)
    return text
