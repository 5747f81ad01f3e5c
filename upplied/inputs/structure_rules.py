"""The rules that a structure keeps on import, their bounds, and what is known of common kinds."""

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from upplied.inputs.files import table
from upplied.inputs.rules import Verdict, broken, rules_of, with_bounds
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


RULES = rules_of("structure")


def changed(assignments: Iterable[str]) -> StructureSettings:
    """The defaults, with bounds that are given as ``name=value``."""
    return with_bounds(StructureSettings(), assignments, "structures.")


def measured(rule: str, *figures: Any) -> Verdict:
    """The verdict that a rule is broken, its finding filled with figures."""
    return broken(RULES[rule], RULES[rule].finding.format(*figures))


@dataclass(frozen=True)
class KnownKind:
    """One kind: bounds of its longest side, m, and of the proportions of its box."""

    words: tuple[str, ...]  # of which one stands in the kind's name
    longest_m: tuple[float, float]
    width: tuple[float, float] = (0.0, math.inf)  # over the length
    height: tuple[float, float] = (0.0, math.inf)  # over the larger of length and width


KNOWN = tuple(
    KnownKind(**{name: tuple(values) for name, values in row.items()}) for row in table("rules.toml")["kind"]
)


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
        yield broken(RULES["odd-size"], f"it is {longest:.3g} m: units?", f"{name}: {low:g} to {high:g} m")
    for words, ratio, (low, high) in (
        ("as wide as long", width / length, kind.width),
        ("as high as long or wide", height / max(length, width), kind.height),
    ):
        if not low <= ratio <= high:
            bounds = f"at least {low:g}" if math.isinf(high) else f"{low:g} to {high:g}"
            finding = f"it is {ratio:.2g} times {words}: another kind, or other axes up and forward?"
            yield broken(RULES["kind"], finding, f"{name}: {bounds}")
