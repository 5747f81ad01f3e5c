"""Rules for imported files, verdicts on those that are broken, and how a person overrules one by name.

A rule is data (`rules.toml`). `decided` marks verdicts that are overruled, `refuse` raises the others.
"""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal, TypeVar

import numpy as np

from upplied.errors import InputError, SettingsError
from upplied.inputs.files import table
from upplied.records import Floats

Severity = Literal["refuse", "warn"]
Settings = TypeVar("Settings", bound=Any)


@dataclass(frozen=True)
class Rule:
    """A bound that every imported file keeps."""

    name: str  # by which it is overruled
    severity: Severity  # what cannot be right is refused, what is odd is warned of
    reason: str  # why there is this rule
    remedy: str = ""  # what to do where it is broken
    bounds: tuple[str, ...] = ()  # the settings that hold its limits
    broken: str = ""  # figure, sign and bound that break it; empty where code decides
    finding: str = ""  # in words, to be filled with figures and bounds


def rules_of(group: str) -> dict[str, Rule]:
    """The rules of a group of `rules.toml` (flight, reading, structure) by their names, in order."""
    rules = {}
    for severity, rows in table("rules.toml")[group].items():
        for name, row in rows.items():
            bound = row.get("broken", "0").split()[-1]
            bounds = row.get("bounds", "" if bound == "0" else bound).split()
            rules[name] = Rule(name, severity, **row | {"bounds": tuple(bounds)})
    return rules


@dataclass(frozen=True)
class Verdict:
    """A rule that is broken: what was found, and what is allowed."""

    rule: str
    severity: Severity
    found: str
    allowed: str = ""
    remedy: str = ""
    overruled: bool = False

    def __str__(self) -> str:
        allowed = f" ({self.allowed})" if self.allowed else ""
        return f"{self.rule}: {self.found}{allowed}" + (" [overruled]" if self.overruled else "")


def broken(rule: Rule, finding: str, allowed: str = "", remedy: str = "") -> Verdict:
    """The verdict that a rule is broken; its own remedy where no better one is known."""
    return Verdict(rule.name, rule.severity, finding, allowed, remedy or rule.remedy)


def check_allowed(names: Iterable[str], rules: Mapping[str, Rule]) -> tuple[str, ...]:
    """The names of rules to overrule, each once.

    Raises SettingsError if there is no rule of that name.
    """
    wanted = tuple(sorted(set(names)))
    for name in wanted:
        if name not in rules:
            raise SettingsError(f"--allow {name}", "is no rule", f"one of {', '.join(sorted(rules))}")
    return wanted


def decided(
    verdicts: Iterable[Verdict], allow: Iterable[str] = (), strict: bool = False
) -> tuple[Verdict, ...]:
    """Verdicts as they count: those overruled by name are marked, and `strict` makes warnings refusals."""
    more: dict[str, Any] = {"severity": "refuse"} if strict else {}
    names = set(allow)
    return tuple(replace(it, overruled=it.overruled or it.rule in names, **more) for it in verdicts)


def refusals(verdicts: Iterable[Verdict]) -> tuple[Verdict, ...]:
    """Those for which a file is refused."""
    return tuple(verdict for verdict in verdicts if verdict.severity == "refuse" and not verdict.overruled)


def refuse(what: str, verdicts: Iterable[Verdict]) -> None:
    """Raise what a file is refused for, if anything.

    Raises InputError naming each rule, what was found, what is allowed, the remedy, and how it is
    overruled.
    """
    if broken_rules := refusals(verdicts):
        remedy = "; ".join(dict.fromkeys(it.remedy for it in broken_rules if it.remedy))
        names = " ".join(dict.fromkeys(f"--allow {it.rule}" for it in broken_rules))
        how = f"{remedy}; or, if it is right as it is, {names}" if remedy else f"if it is right, {names}"
        raise InputError(what, "; ".join(map(str, broken_rules)), remedy=how)


def to_json(verdicts: Iterable[Verdict]) -> str:
    """Verdicts as they are stored."""
    return json.dumps([asdict(verdict) for verdict in verdicts], separators=(",", ":"), ensure_ascii=False)


def from_json(text: str | None) -> tuple[Verdict, ...]:
    """The verdicts that were stored; none where nothing was."""
    return tuple(Verdict(**item) for item in json.loads(text or "[]"))


def with_bounds(settings: Settings, assignments: Iterable[str], prefix: str) -> Settings:
    """Settings with bounds that are given as ``name=value``, with or without a prefix.

    Raises SettingsError if a name is unknown, or a value no number from 0 to 1e9.
    """
    known = {item.name: item for item in fields(settings)}
    values: dict[str, float] = {}
    for text in assignments:
        name, _, value = text.removeprefix(prefix).partition("=")
        if name not in known:
            raise SettingsError(f"setting {name!r}", "is unknown", f"one of {', '.join(known)}")
        try:
            number = int(value) if known[name].type == "int" else float(value)
        except ValueError:
            number = -1
        if not 0 <= number < 1e9:
            raise SettingsError(f"setting {name}", f"got {value!r}", "a number from 0 to 1e9")
        values[name] = number
    return replace(settings, **values)


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
