"""The rules that a structure keeps when it is taken in, their bounds, and what is known of common kinds."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from upplied.inputs.rules import Rule, Verdict, broken, with_bounds
from upplied.records import Floats


@dataclass(frozen=True)
class StructureSettings:
    """Bounds of the rules for structures; no plan depends on them (docs/checks.md).

    Those that compare with other structures were chosen on 40 real structures of 7 kinds and the 14 of the
    sample fleet, each among all others of its kind, and are judged on the same (bench/structure_rules.py):
    none is refused as it is, all in millimetres, 49 in inches, 25 in feet, 36 with another axis up.
    """

    nominal_pct: float = 7.0  # off a declared length; real models of a type keep within, toys do not
    least_m: float = 0.01  # of the longest side
    most_m: float = 5000.0
    odd_least_m: float = 0.5
    odd_most_m: float = 2000.0
    size_ratio: float = 5.0  # to the nearest of its kind, beyond the smallest or the largest
    odd_size_ratio: float = 1.5  # as many as there are; a third more where there is one other alone
    alike: float = 0.6  # unlikeness of shapes below which two structures are of one form
    unit_slack: float = 0.25  # |log| by which a size may miss that of the one most alike, in another unit
    turned_share: float = 0.7  # what the unlikeness must fall to, turned, to be taken for turned
    odd_unlikeness: float = 1.0  # to the one of its kind most alike: what planning's acceptance allows
    other_kind_share: float = 0.6  # what the unlikeness to another kind must fall to


RULES = {
    rule.name: rule
    for rule in (
        Rule("nominal", "refuse", "the declared real size is the best evidence there is",
             "check units, up, forward and scale", "nominal_pct"),
        Rule("extent", "refuse", "nothing so large or small is inspected by a drone",
             "check units and scale", "most_m"),
        Rule("size", "refuse", "a mesh in other units is larger or smaller than all others of its kind",
             "correct units or scale in the manifest", "size_ratio"),
        Rule("units", "refuse", "a size that misses its like by just what two units differ is no chance",
             "correct units or scale in the manifest", "unit_slack"),
        Rule("up-axis", "refuse", "a structure on its side is planned for as it lies",
             "correct up and forward in the manifest", "turned_share"),
        Rule("forward-axis", "warn", "parts correspond to parts on the wrong side",
             "correct forward in the manifest", "turned_share"),
        Rule("odd-up-axis", "warn", "it fits its kind with another axis up better, but as declared as well",
             "compare its picture with the real one", "turned_share"),
        Rule("odd-extent", "warn", "few structures are so large or small", "check units and scale",
             "odd_most_m"),
        Rule("odd-size", "warn", "it may be in other units, or the first of its size",
             "compare its size with the real one, declare nominal_length_m", "odd_size_ratio"),
        Rule("size-unconfirmed", "warn", "units are often mistaken, and nothing here tells this one",
             "declare nominal_length_m, nominal_width_m or nominal_height_m"),
        Rule("kind", "warn", "plans between structures that do not correspond are refused or poor",
             "check its kind", "odd_unlikeness"),
        Rule("declared-unit", "warn", "file and manifest differ: one of them is wrong", "check units"),
        Rule("declared-up", "warn", "file and manifest differ: one of them is wrong", "check up"),
        Rule("far", "warn", "projected coordinates leave little room for millimetres",
             "set local_origin = [x, y, z]"),
        Rule("below-ground", "warn", "nobody sees what lies below the ground", "set clip_ground = true"),
        Rule("floating", "warn", "what stands on the ground reaches it",
             "check units, ground_z and the mesh"),
        Rule("cut-off", "warn", "nobody sees what a scan or a crop left out",
             "take the whole structure, or look at the picture"),
        Rule("effects", "warn", "lights and wakes are no structure", "take them out of the file"),
        Rule("landmark", "warn", "a landmark off the structure names nothing", "check the landmark"),
        Rule("hidden", "warn", "hidden parts take surface that nobody can see", "set drop_hidden = true"),
        Rule("outlier", "warn", "a part far off makes the structure larger than it is",
             "set drop_outliers = true"),
        Rule("looks-scanned", "warn", "what a scan lacks is kept clear of where it is declared to be one",
             'declare surface = "scanned", or "drawn" where it was'),
    )
}  # fmt: skip


def changed(assignments: Iterable[str]) -> StructureSettings:
    """The defaults, with bounds that are given as ``name=value``."""
    return with_bounds(StructureSettings(), assignments, "structures.")


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
