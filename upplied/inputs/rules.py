"""Rules for imported files, a verdict on each that is broken, and how a person overrules one by name.

A rule is data (`rules.toml`). `decided` marks verdicts that are overruled, `refuse` raises the others.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal, TypeVar

from upplied.errors import InputError, SettingsError
from upplied.inputs.files import table

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
