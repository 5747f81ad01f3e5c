"""What is known of common kinds whoever else is in the catalog: their size, and the shape of their boxes.

The bounds take in every one of 40 real structures, and what has been built: the smallest business jet and the
An-225, a day sailer and the longest tanker, farm turbines and those at sea.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from upplied.inputs.rules import Verdict, broken
from upplied.inputs.structure_rules import RULES
from upplied.records import Floats


@dataclass(frozen=True)
class KnownKind:
    """One kind: bounds of its longest side, m, and of the proportions of its box."""

    words: tuple[str, ...]  # of which one stands in the kind's name
    longest_m: tuple[float, float]
    width: tuple[float, float] = (0.0, math.inf)  # over the length
    height: tuple[float, float] = (0.0, math.inf)  # over the larger of length and width


KNOWN = (
    KnownKind(
        ("airliner", "airplane", "aeroplane", "aircraft", "plane", "jet"),
        (4, 100), width=(0.5, 1.8), height=(0.08, 0.6)
    ),
    KnownKind(("turbine", "windmill"), (8, 450), height=(1.0, math.inf)),
    KnownKind(("ship", "ferry", "tanker", "freighter", "vessel", "cruiser"), (5, 500), width=(0.03, 0.6)),
    KnownKind(("yacht", "boat", "sailboat", "lifeboat"), (2, 200), width=(0.05, 0.8)),
    KnownKind(("building", "house", "hotel", "office", "highrise", "skyscraper"), (2, 1000)),
    KnownKind(("tower", "mast", "chimney", "pylon", "lighthouse"), (5, 900), height=(0.8, math.inf)),
)  # fmt: skip


def known_kind(name: str) -> KnownKind | None:
    """The kind that a name tells of; None where it is none of these.

    Examples
    --------
    >>> known_kind("wind_turbine").longest_m
    (8, 450)
    """
    words = set(re.split(r"[^a-z]+", name.lower()))
    words |= {word.removesuffix("s") for word in words}
    return next((kind for kind in KNOWN if words & set(kind.words)), None)


def unlike_its_kind(size_m: Floats, name: str) -> Iterator[Verdict]:
    """What in the box (3,), m, of a structure is as in no other of its kind."""
    kind = known_kind(name)
    if kind is None:
        return
    length, width, height = (float(side) for side in np.maximum(size_m, 1e-9))
    longest, (low, high) = max(length, width, height), kind.longest_m
    if not low <= longest <= high:
        yield broken(
            RULES["odd-size"], f"it is {longest:.3g} m large: units?", f"{name}: {low:g} to {high:g} m"
        )
    for words, ratio, (low, high) in (
        ("as wide as long", width / length, kind.width),
        ("as high as long or wide", height / max(length, width), kind.height),
    ):
        if not low <= ratio <= high:
            bounds = f"at least {low:g}" if math.isinf(high) else f"{low:g} to {high:g}"
            found = f"it is {ratio:.2g} times {words}: another kind, or other axes up and forward?"
            yield broken(RULES["kind"], found, f"{name}: {bounds}")
