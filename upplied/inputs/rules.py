"""Rules for imported files (`rules.toml`), their bounds, and verdicts on those that are broken."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np

from upplied.errors import InputError, SettingsError
from upplied.inputs.files import table
from upplied.records import Floats

Severity = Literal["refuse", "warn"]


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
    """The names of rules to overrule, each once; SettingsError if there is no rule of that name."""
    for name in (allowed := tuple(sorted(set(names)))):
        if name not in rules:
            raise SettingsError(f"--allow {name}", "is no rule", f"one of {', '.join(sorted(rules))}")
    return allowed


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
    """Raise InputError if a file is refused: rules, what was found, what is allowed, how to overrule it."""
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


@dataclass(frozen=True)
class Bounds:
    """Bounds of rules, each with its default."""

    group: ClassVar[str]

    @classmethod
    def changed(cls, assignments: Iterable[str]) -> Self:
        """The defaults, with bounds given as ``[group.]name=value``; SettingsError if one is wrong."""
        known = [item.name for item in fields(cls)]
        values: dict[str, float] = {}
        for text in assignments:
            name, _, value = text.removeprefix(f"{cls.group}.").partition("=")
            if name not in known:
                raise SettingsError(f"setting {name!r}", "is unknown", f"one of {', '.join(known)}")
            try:
                values[name] = float(value)
            except ValueError:
                values[name] = -1.0
            if not 0 <= values[name] < 1e9:
                raise SettingsError(f"setting {name}", f"got {value!r}", "a number from 0 to 1e9")
        return cls(**values)


@dataclass(frozen=True)
class StructureSettings(Bounds):
    """Bounds of the rules for structures; no plan depends on them (docs/checks.md).

    Those that compare with other structures were chosen on 40 real structures of 7 kinds and the 14 of the
    sample fleet, each among all others of its kind, and are judged on the same (bench/structure_rules.py):
    none is refused as it is, all in millimetres, 49 in inches, 25 in feet, 36 with another axis up.
    """

    group = "structures"
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


#: In which a log may be written, see `upplied.inputs.passport.fits`.
CONVENTIONS: Mapping[str, Any] = table("passport/conventions.toml")

#: Bounds that change what is kept of a flight, and so what is planned from it; the others only judge.
SHAPING = ("long_gap_s", "hover_cap_s")


@dataclass(frozen=True)
class PassportSettings(Bounds):
    """What a flight may be measured to be on import (docs/checks.md).

    Sample flights of 28 structures keep 2.8 m of clearance, look at their structure in 88 % of the poses
    or more, and would fit another convention by 7 % more at most; the bounds leave room beside that.
    """

    group = "passport"
    ground_slack_m: float = 1.0  # altitudes are no better
    most_below_ground_pct: float = 1.0  # of the poses, deeper than the slack
    most_inside_pct: float = 0.5  # of the poses, inside the structure
    least_clearance_m: float = 0.3  # no vehicle is smaller
    near_m: float = 1.5  # nearer is odd: right flights keep 2.8
    least_axis_pct: float = 30.0  # of the poses, the camera's axis meeting the structure
    least_fit_pct: float = 50.0  # of the poses, such as an inspection could hold
    odd_axis_pct: float = 70.0
    least_shown_pct: float = 50.0  # of the pictures, showing the structure within the camera's range
    fit_gain_pct: float = 15.0  # of the poses that would make sense in another convention alone
    fit_least_pct: float = 75.0  # of the poses, in that convention
    steadier_ratio: float = 3.0  # of how the stand-off varies; no right flight of 96 is steadier by 2.5
    off_centre_m: float = 3.0  # a stand-off that changes with the side, as if the log lay this far off
    odd_off_centre_m: float = 1.2  # of 150 right flights none is so by more than 0.2 m with as much certainty
    # Of 200 right flights none drifts by more than 10.7 deg or looks aside by more than 9.4.
    aim_drift_deg: float = 15.0  # by which the camera turns off the nearest surface from end to end
    aim_off_deg: float = 11.0  # by which it looks aside of it all the time
    least_motion_fit_pct: float = 60.0  # mean cosine: other axes give 0 or less, recordings 98.6 and more
    least_felt_turn_pct: float = -50.0  # mirrored poses give -100, right ones 100, others neither
    motion_ratio: float = 1.08  # of speeds, either way; public recordings keep within 1.01
    max_speed_mps: float = 25.0  # in 99 % of the flight, over half a second
    least_speed_mps: float = 0.1  # no flight is slower in all but a hundredth of its time
    odd_speed_mps: float = 12.0
    max_acceleration_mps2: float = 30.0
    max_turn_degps: float = 720.0
    odd_acceleration_mps2: float = 6.0  # right flights keep within 3.3
    odd_turn_degps: float = 100.0  # and within 49
    most_roll_deg: float = 60.0  # of the camera, in the middle of its poses
    odd_roll_deg: float = 15.0
    least_pitch_fit_pct: float = -50.0  # correlation of the pitch with the elevation of the surface
    least_pitch_span_deg: float = 1.0  # of a pitch that changes at all
    most_pitch_want_deg: float = 10.0  # elevation of the nearest surface to which it should have changed
    missing_pitch_deg: float = 15.0  # the same of a pitch that never changes by a hundredth of a degree
    odd_step_s: float = 2.0  # between poses, but for photos
    odd_year: int = 2100
    clock_ratio: float = 1.1  # of the source's clock and the recorder's, either way
    leap_slack_s: float = 0.5  # round the leap seconds between GPS time, or atomic time, and UTC
    max_clock_steps: int = 5
    zoom_pct: float = 3.0  # of the field of view
    long_gap_s: float = 5.0  # a longer silence is flown as a transit
    least_recorded_pct: float = 20.0  # of the time from the first pose to the last
    odd_recorded_pct: float = 95.0
    hover_cap_s: float = 30.0  # of standing still with a still camera: more is cut
    register_m: float = 0.5  # by which a flight may miss its named points
    least_read_pct: float = 50.0  # of a damaged log


RULES = rules_of("structure")


def measured(rule: str, *figures: Any) -> Verdict:
    """The verdict that a rule is broken, its finding filled with figures."""
    return broken(RULES[rule], RULES[rule].finding.format(*figures))


_KINDS: list[dict[str, Any]] = table("rules.toml")["kind"]
_ANY = (0.0, math.inf)


def known_kind(name: str) -> Mapping[str, Any] | None:
    """The kind that a name as ``wind_turbine`` tells of: bounds of its size and proportions; else None."""
    words = set(re.split(r"[^a-z]+", name.lower()))
    words |= {word.removesuffix("s") for word in words}
    return next((kind for kind in _KINDS if words & set(kind["words"])), None)


def unlike_its_kind(size_m: Floats, name: str) -> Iterator[Verdict]:
    """What in the box (3,), m, of a structure is as in no other of its kind."""
    if (kind := known_kind(name)) is None:
        return
    length, width, height = (float(side) for side in np.maximum(size_m, 1e-9))
    longest, (low, high) = max(length, width, height), kind["longest_m"]
    if not low <= longest <= high:
        yield broken(RULES["odd-size"], f"it is {longest:.3g} m: units?", f"{name}: {low:g} to {high:g} m")
    for words, ratio, (low, high) in (
        ("as wide as long", width / length, kind.get("width", _ANY)),
        ("as high as long or wide", height / max(length, width), kind.get("height", _ANY)),
    ):
        if not low <= ratio <= high:
            bounds = f"at least {low:g}" if math.isinf(high) else f"{low:g} to {high:g}"
            finding = f"it is {ratio:.2g} times {words}: another kind, or other axes up and forward?"
            yield broken(RULES["kind"], finding, f"{name}: {bounds}")
