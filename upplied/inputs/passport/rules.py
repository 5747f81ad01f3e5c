"""A flight's passport: its figures, the rules it breaks, as it is stored and as a refusal."""

import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Any

from upplied.inputs.passport.fits import NEARER
from upplied.inputs.passport.measured import Measured, Reading, measure
from upplied.inputs.rules import PassportSettings, Rule, Verdict, broken, decided, refusals, refuse, rules_of
from upplied.inputs.sidecar import LogOptions
from upplied.records import Structure

_NED = re.compile(r"(^|[_/-])(ned|frd)([_/-]|$)", re.IGNORECASE)
_SURE = 0.8  # least share of the stand-off's variance that a place off the structure explains
# Of those that name a convention the first alone counts.
_STEADIER = {"fits-otherwise", "stand-off", "horizon", "aim-otherwise", "near-otherwise"}
_STILL_DEG = 0.01  # between the pitches of a flight: no gimbal is as still
_ROLLED_OVER = range(1995, 2010)  # years of receivers that count 1024 weeks too few
_SIGNS = {"<": operator.lt, ">": operator.gt}

#: Every rule, in the order in which findings are listed.
CHECKS: tuple[Rule, ...] = tuple(rules_of("flight").values())
#: With those of the reader itself, before there is a flight to measure.
RULES: dict[str, Rule] = {rule.name: rule for rule in CHECKS} | rules_of("reading")


def judged(
    measured: Measured, settings: PassportSettings, allow: tuple[str, ...] = (), strict: bool = False
) -> tuple[Verdict, ...]:
    """The rules that a flight breaks, in the order of the table, those of the names in `allow` overruled."""
    verdicts: list[Verdict] = []
    for rule in CHECKS:
        if rule.name in _BROKEN:
            is_broken = _BROKEN[rule.name](measured, settings)
        else:
            figure, sign, bound = rule.broken.split()
            is_broken = _SIGNS[sign](getattr(measured, figure), getattr(settings, bound, 0))
        if is_broken and not (rule.name in _STEADIER and _STEADIER & {verdict.rule for verdict in verdicts}):
            words = _WORDS[rule.name](measured) if rule.name in _WORDS else ""
            finding = rule.finding.format(m=measured, s=settings, words=words)
            verdicts.append(broken(rule, finding, remedy=rule.remedy or measured.other_advice))
    return decided(verdicts, allow, strict)


def _off_m(m: Measured) -> float:
    return math.hypot(*m.off_centre_m) if m.off_centre_sure >= _SURE else 0.0


def _ratio(value: float) -> float:
    return max(value, 1 / max(value, 1e-9))


def _ned(m: Measured) -> list[str]:
    converted = any("converted as requested" in note for note in m.frames)
    return [] if converted else [name for name in (m.frame, m.child) if _NED.search(name)]


_BROKEN: dict[str, Callable[[Measured, PassportSettings], object]] = {
    "fits-otherwise": lambda m, s: (
        m.other_fit_pct - m.other_rare_pct - m.fit_pct >= s.fit_gain_pct
        and m.other_fit_pct >= s.fit_least_pct
    ),
    "stand-off": lambda m, s: s.steadier_ratio * max(m.other_varies, 0.05) <= m.stand_off_varies,
    "horizon": lambda m, s: s.steadier_ratio * max(m.other_rolls_deg, 1.0) <= m.rolls_deg,
    "aim-otherwise": lambda m, s: s.steadier_ratio * max(m.other_aside_deg, 5.0) <= m.aside_deg,
    "near-otherwise": lambda m, s: NEARER * m.min_clearance_m <= min(m.other_clearance_m, NEARER * s.near_m),
    "looks-away": lambda m, s: (
        m.axis_pct < s.least_axis_pct or (m.axis_pct < s.odd_axis_pct and m.fit_pct < s.least_fit_pct)
    ),
    "pitch-missing": lambda m, s: m.pitch_span_deg < _STILL_DEG and m.pitch_want_deg > s.missing_pitch_deg,
    "off-centre": lambda m, s: s.off_centre_m <= _off_m(m) < 100,
    "little-off-centre": lambda m, s: s.odd_off_centre_m <= _off_m(m) < s.off_centre_m,
    "frame-name": lambda m, s: _ned(m),
    "too-slow": lambda m, s: 0 < m.speed_p99_mps < s.least_speed_mps,
    "sparse": lambda m, s: m.step_s > s.odd_step_s and not m.stills,
    "undated": lambda m, s: m.timed and not 2010 <= m.year < s.odd_year,
    "clock-rate": lambda m, s: _ratio(m.clock_ratio) > s.clock_ratio,
    "leap-seconds": lambda m, s: min(abs(m.clock_ahead_s - ahead_s) for ahead_s in (18, 37)) < s.leap_slack_s,
    "velocity": lambda m, s: (
        m.motion_fit_pct < s.least_motion_fit_pct or _ratio(m.motion_ratio) > s.motion_ratio
    ),
    "aim-drifts": lambda m, s: abs(m.aim_drift_deg) > s.aim_drift_deg,
    "aim-off": lambda m, s: abs(m.aim_off_deg) > s.aim_off_deg,
    "pitch-unset": lambda m, s: (
        m.pitch_span_deg < s.least_pitch_span_deg and m.pitch_want_deg > s.most_pitch_want_deg
    ),
    "lens-differs": lambda m, s: _ratio(m.lens_ratio) > 1 + s.zoom_pct / 100,
    "gaps": lambda m, s: m.long_gaps > 0 or m.recorded_pct < s.odd_recorded_pct,
    "frozen": lambda m, s: m.frozen_s > max(10.0, 0.2 * m.span_s),
    "zoom": lambda m, s: len(m.hfov_deg) > 1,
    "assumed": lambda m, s: m.assumed,
    "salvaged": lambda m, s: m.losses,
}


def _side(angle_deg: float) -> str:
    return f"{abs(angle_deg):.0f} deg to the {'left' if angle_deg > 0 else 'right'}"


# What a finding says beside its figures.
_WORDS: dict[str, Callable[[Measured], str]] = {
    "frame-name": lambda m: _ned(m)[0],
    "undated": lambda m: (
        f"; {m.year + 20} if its receiver counts 1024 weeks too few" if m.year in _ROLLED_OVER else ""
    ),
    "looks-aside": lambda m: f"{100 - m.axis_pct:.0f}",
    "aim-drifts": lambda m: _side(m.aim_drift_deg),
    "aim-off": lambda m: _side(m.aim_off_deg),
    "gaps": lambda m: (
        f"{m.gaps} gaps of up to {m.longest_gap_s:.1f} s, {m.skipped_m:.1f} m from end to end"
        + (f", {m.long_gaps} of them flown as transits" if m.long_gaps else "")
    ),
    "zoom": lambda m: ", ".join(
        [f"{fov:.1f} deg from {at:.0f} s on" for fov, at in zip(m.hfov_deg[:6], m.hfov_from_s, strict=False)]
        + ["..."] * (len(m.hfov_deg) > 6)
    ),
    "assumed": lambda m: ", ".join(m.assumed),
    "salvaged": lambda m: "; ".join(m.losses),
}


def passport_of(reading: Reading, structure: Structure, facts: LogOptions, what: str) -> Mapping[str, Any]:
    """The passport of a flight, in plain values; InputError if a rule is broken that refuses."""
    measured = measure(reading, structure, facts.passport)
    verdicts = (*reading.overruled, *judged(measured, facts.passport, facts.allow, facts.strict))
    refuse(f"{what}, flown on {facts.structure_id}", _with_hint(verdicts, measured))
    overruled = any(verdict.overruled for verdict in verdicts)
    return {
        "verdict": "overruled" if overruled else "warned" if verdicts else "good",
        "findings": [asdict(verdict) for verdict in verdicts],
        "allowed": sorted(facts.allow),
        "structure_sha256": structure.sha256,
        "measured": _plain(asdict(measured)),
        "bounds": _plain(asdict(facts.passport)),
    }


def findings_of(passport: Mapping[str, Any]) -> tuple[Verdict, ...]:
    """The rules that a flight was found to break; none where it has no passport."""
    return tuple(Verdict(**item) for item in passport.get("findings", ()))


def _with_hint(verdicts: tuple[Verdict, ...], measured: Measured) -> list[Verdict]:
    """What is refused, the last of it with the convention that comes nearest to making sense of it."""
    hinted, refused = list(verdicts), {verdict.rule for verdict in refusals(verdicts)}
    if refused and not refused & _STEADIER and measured.other_fit_pct - measured.fit_pct >= 5:
        share = f"{measured.other_fit_pct:.0f} %, as given {measured.fit_pct:.0f} %"
        hint = f"; the nearest other convention, {measured.other_words}, fits {share}"
        last = max(at for at, verdict in enumerate(hinted) if verdict.rule in refused)
        hinted[last] = replace(hinted[last], found=hinted[last].found + hint)
    return hinted


def _plain(value: Any) -> Any:
    """Numbers rounded to what they are worth; None for what is not finite."""
    if isinstance(value, float):
        return round(value, 3) if math.isfinite(value) else None
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple | list) else value
