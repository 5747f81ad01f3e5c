"""The rules that a flight is judged by: one table, each with a name by which it can be overruled."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from upplied.inputs.passport.measured import Measured
from upplied.inputs.passport.settings import PassportSettings
from upplied.inputs.rules import Rule, Severity, Verdict, broken, decided

_NED = re.compile(r"(^|[_/-])(ned|frd)([_/-]|$)", re.IGNORECASE)
_SURE = 0.8  # least share of the stand-off's variance that a place off the structure explains
_ROLLED_OVER = range(1995, 2010)  # years of receivers that count 1024 weeks too few
Broken = Callable[[Measured, PassportSettings], str]  # in words, empty where the rule is kept


@dataclass(frozen=True)
class FlightRule:
    """A rule, the settings that bound it, and the finding where a flight breaks it."""

    rule: Rule
    bounds: tuple[str, ...]
    broken: Broken


def _rule(
    name: str, severity: Severity, bounds: str, reason: str, remedy: str,
    condition: Callable[[Measured, PassportSettings], bool], words: str | Callable[[Measured], str],
) -> FlightRule:  # fmt: skip
    def finding(m: Measured, s: PassportSettings) -> str:
        if not condition(m, s):
            return ""
        return words.format(m=m, s=s) if isinstance(words, str) else words(m)

    listed = tuple(bounds.split())
    return FlightRule(Rule(name, severity, reason, remedy, ", ".join(listed)), listed, finding)


def _off_m(m: Measured) -> float:
    """How far the log lies off as the stand-off has it, m; 0 where that is not sure."""
    return math.hypot(*m.off_centre_m) if m.off_centre_sure >= _SURE else 0.0


def _ratio(value: float) -> float:
    """A ratio, or its inverse where that is larger; NaN stays."""
    return max(value, 1 / max(value, 1e-9))


def _side(angle_deg: float) -> str:
    return f"{abs(angle_deg):.0f} deg to the {'left' if angle_deg > 0 else 'right'} of the nearest surface"


def _doubtful_axis(m: Measured, s: PassportSettings) -> bool:
    return m.axis_pct < s.least_axis_pct or (m.axis_pct < s.odd_axis_pct and m.fit_pct < s.least_fit_pct)


def _fits_otherwise(m: Measured, s: PassportSettings) -> bool:
    return m.other_fit_pct - m.fit_pct >= s.fit_gain_pct and m.other_fit_pct >= s.fit_least_pct


def _moves_otherwise(m: Measured, s: PassportSettings) -> bool:
    return m.motion_fit_pct < s.least_motion_fit_pct or _ratio(m.motion_ratio) > s.motion_ratio


def _named_ned(m: Measured) -> list[str]:
    converted = any("converted as asked" in note for note in m.frames)
    return [] if converted else [name for name in (m.frame, m.child) if _NED.search(name)]


def _year(m: Measured) -> str:
    rolled = m.year in _ROLLED_OVER
    hint = f"; {m.year + 20} if its receiver counts 1024 weeks too few" if rolled else ""
    return f"the first stamp is of the year {m.year}{hint}"


def _gaps(m: Measured) -> str:
    joined = f", {m.long_gaps} of them flown as transits" if m.long_gaps else ""
    ends = f"{m.gaps} gaps of up to {m.longest_gap_s:.1f} s, {m.skipped_m:.1f} m from end to end{joined}"
    return f"{ends}; {m.recorded_pct:.0f} % of the time was recorded"


def _zoom(m: Measured) -> str:
    listed = [f"{fov:.1f} deg from {at:.0f} s on" for fov, at in zip(m.hfov_deg, m.hfov_from_s, strict=True)]
    return f"the field of view changes in flight ({', '.join(listed[:6])}{', ...' * (len(listed) > 6)})"


_BESIDE = "the stand-off changes from side to side as if the log lay off by {m.off_centre_m} m (x, y)"
_PLACE = "check where the structure stands in the log's frame"
#: Every rule, in the order in which findings are listed.
CHECKS: tuple[FlightRule, ...] = (
    _rule("fits-otherwise", "refuse", "fit_gain_pct fit_least_pct",
         "another convention makes sense of poses that make none as given", "", _fits_otherwise,
         "as {m.other_words} ({m.other}), {m.other_fit_pct:.0f} % of the poses could be of an inspection,"
         " as given {m.fit_pct:.0f} %"),
    _rule("stand-off", "refuse", "steadier_ratio",
         "a pilot keeps his distance: where another convention alone has it so, he flew that", "",
         lambda m, s: s.steadier_ratio * max(m.other_varies, 0.05) <= m.stand_off_varies,
         "as {m.other_words} ({m.other}), the stand-off would vary by {m.other_varies:.0%}, as given"
         " it varies by {m.stand_off_varies:.0%}"),
    _rule("below-ground", "refuse", "most_below_ground_pct ground_slack_m",
         "no vehicle flies in the ground", "check heights, axes and the declared ground",
         lambda m, s: m.below_ground_pct > s.most_below_ground_pct,
         "{m.below_ground_pct:.0f} % of the poses lie below the ground, down to {m.lowest_m:.1f} m"),
    _rule("inside-structure", "refuse", "most_inside_pct", "no vehicle flies in walls", _PLACE,
         lambda m, s: m.inside_pct > s.most_inside_pct,
         "{m.inside_pct:.1f} % of the poses lie inside the structure"),
    _rule("touches-structure", "refuse", "least_clearance_m", "a vehicle has a size", _PLACE,
         lambda m, s: m.min_clearance_m < s.least_clearance_m,
         "the camera comes within {m.min_clearance_m:.2f} m of the structure"),
    _rule("looks-away", "refuse", "least_axis_pct least_fit_pct",
         "an inspection looks at its structure", "check the attitude's convention and the camera's mount",
         _doubtful_axis, "the camera's axis meets the structure in {m.axis_pct:.0f} % of the poses,"
         " {m.fit_pct:.0f} % could be of an inspection"),
    _rule("shows-nothing", "refuse", "least_shown_pct", "an inspection shows its structure",
         "check units and place of the structure, or give camera_max_range_m",
         lambda m, s: m.shown_pct < s.least_shown_pct,
         "{m.shown_pct:.0f} % of the pictures show the structure within the camera's range"),
    _rule("off-centre", "refuse", "off_centre_m", "a pilot who circles keeps his distance",
         "place the structure by structure_position_m",
         lambda m, s: s.off_centre_m <= _off_m(m) < 100, _BESIDE),
    _rule("frame-name", "refuse", "", "a frame's name states its axes",
         'if they are so, write convention = "ned" into the side-car', lambda m, s: bool(_named_ned(m)),
         lambda m: f"the frame {_named_ned(m)[0]!r} is named for axes that point down, but was read as z up"),
    _rule("too-fast", "refuse", "max_speed_mps", "no inspecting vehicle is as fast", "check units and stamps",
         lambda m, s: m.speed_p99_mps > s.max_speed_mps,
         "{m.speed_p99_mps:.0f} m/s in the fastest hundredth of the flight"),
    _rule("too-jerky", "refuse", "max_acceleration_mps2", "no vehicle accelerates so",
         "check units and stamps, and whether several bodies publish",
         lambda m, s: m.acceleration_p99_mps2 > s.max_acceleration_mps2,
         "accelerations of {m.acceleration_p99_mps2:.0f} m/s2"),
    _rule("turns-too-fast", "refuse", "max_turn_degps", "no camera turns so", "check the attitude",
         lambda m, s: m.turn_p99_degps > s.max_turn_degps, "turns of {m.turn_p99_degps:.0f} deg/s"),
    _rule("clock-steps", "refuse", "max_clock_steps", "a clock that steps often gives no time",
         "record with one clock",
         lambda m, s: m.clock_steps > s.max_clock_steps, "the clock stepped {m.clock_steps} times"),
    _rule("mostly-missing", "refuse", "least_recorded_pct", "what was not recorded cannot be flown again",
         "record the flight again", lambda m, s: m.recorded_pct < s.least_recorded_pct,
         "{m.recorded_pct:.0f} % of the time was recorded ({m.gaps} gaps of {m.span_s:.0f} s in all)"),
    _rule("mostly-unread", "refuse", "least_read_pct", "what is lost of a log is lost of the inspection",
         "copy the log again, or record the flight again", lambda m, s: m.read_pct < s.least_read_pct,
         "{m.read_pct:.0f} % of the log could be read"),
    _rule("rolled", "refuse", "most_roll_deg", "cameras hang level, or their logs hold how they are turned",
         "check the attitude's convention and the mount", lambda m, s: m.roll_deg > s.most_roll_deg,
         "the camera is rolled by {m.roll_deg:.0f} deg in the middle"),
    _rule("tilted", "warn", "odd_roll_deg", "gimbals hold the horizon",
         "check the attitude's convention and the mount", lambda m, s: m.roll_deg > s.odd_roll_deg,
         "the camera is rolled by {m.roll_deg:.0f} deg in the middle"),
    _rule("jumps", "warn", "", "no vehicle is elsewhere from one pose to the next",
         "check whether the estimator was reset, or two logs were joined",
         lambda m, s: m.jumps > 0, "the poses jump {m.jumps} times, by up to {m.jump_m:.1f} m"),
    _rule("spikes", "warn", "", "single poses off all others are no flight",
         "check the estimator; they were left out where their speed is no flight's",
         lambda m, s: m.spikes > 0, "{m.spikes} single poses lie off their neighbours"),
    _rule("attitude-unset", "warn", "", "an attitude of exactly zero, turns and all, was never set",
         "check when the estimator began",
         lambda m, s: m.unset > 0, "{m.unset} poses without an attitude were left out"),
    _rule("sparse", "warn", "odd_step_s", "the camera's motion between far poses is unknown",
         "record poses more often",
         lambda m, s: m.step_s > s.odd_step_s and not m.stills, "one pose in {m.step_s:.1f} s"),
    _rule("planned", "warn", "", "nobody flew a mission that was only planned", "add the log of its flight",
         lambda m, s: m.planned, "this is a planned mission, not a flight"),
    _rule("undated", "warn", "odd_year", "stamps without a date cannot be compared with other logs",
         "check what the clock was set by", lambda m, s: not 2010 <= m.year < s.odd_year, _year),
    _rule("clock-rate", "warn", "clock_ratio", "two clocks of one flight run alike",
         "check the unit of the stamps, or whether the log was played back faster",
         lambda m, s: _ratio(m.clock_ratio) > s.clock_ratio,
         "the stamps run {m.clock_ratio:.2f} times as fast as the recorder's clock"),
    _rule("leap-seconds", "warn", "leap_slack_s",
         "satellites count no leap seconds: GPS time is 18 s ahead of UTC, atomic time 37 s",
         "set the source's clock to UTC before its photos are compared with other logs",
         lambda m, s: min(abs(m.clock_ahead_s - 18), abs(m.clock_ahead_s - 37)) < s.leap_slack_s,
         "the stamps are {m.clock_ahead_s:.1f} s ahead of the recorder's clock"),
    _rule("jerky", "warn", "odd_acceleration_mps2", "inspections are flown gently",
         "check units and stamps: time may run too fast",
         lambda m, s: m.acceleration_p99_mps2 > s.odd_acceleration_mps2,
         "accelerations of {m.acceleration_p99_mps2:.1f} m/s2"),
    _rule("turns-fast", "warn", "odd_turn_degps", "inspections turn the camera slowly",
         "check the attitude and the stamps: time may run too fast",
         lambda m, s: m.turn_p99_degps > s.odd_turn_degps, "turns of {m.turn_p99_degps:.0f} deg/s"),
    _rule("clock-stepped", "warn", "", "the flight was split where its clock stepped",
         "check what the clock was set by",
         lambda m, s: m.clock_steps > 0, "the clock stepped {m.clock_steps} times: split there"),
    _rule("near-structure", "warn", "near_m", "pilots stay farther away", _PLACE,
         lambda m, s: m.near_pct > 0, "{m.near_pct:.1f} % of the poses are nearer than {s.near_m:g} m"),
    _rule("looks-aside", "warn", "odd_axis_pct", "an inspection looks at its structure most of the time",
         "cut the log to the inspection", lambda m, s: m.axis_pct < s.odd_axis_pct,
         lambda m: f"the camera's axis misses the structure in {100 - m.axis_pct:.0f} % of the poses"),
    _rule("little-off-centre", "warn", "odd_off_centre_m", "a pilot who circles keeps his distance", _PLACE,
         lambda m, s: s.odd_off_centre_m <= _off_m(m) < s.off_centre_m, _BESIDE),
    _rule("velocity", "warn", "least_motion_fit_pct motion_ratio",
         "poses that were mirrored, turned or scaled move otherwise than their estimator's velocity",
         "check who wrote the log: its axes, its unit, its clock", _moves_otherwise,
         "poses and velocity of the same messages differ: mean cosine of their directions"
         " {m.motion_fit_pct:.0f} %, the poses {m.motion_ratio:.2f} times as fast"),
    _rule("turns-otherwise", "warn", "least_felt_turn_pct",
         "poses that were mirrored turn against the gyroscope",
         "check the axes: one of them is mirrored, or z points down",
         lambda m, s: m.felt_turn_pct < s.least_felt_turn_pct,
         "the poses turn about the vertical against the gyroscope (correlation {m.felt_turn_pct:.0f} %)"),
    _rule("aim-drifts", "warn", "aim_drift_deg", "a heading that drifts turns the camera steadily aside",
         "check the compass and the estimator", lambda m, s: abs(m.aim_drift_deg) > s.aim_drift_deg,
         lambda m: f"the camera turns {_side(m.aim_drift_deg)} from end to end"),
    _rule("aim-off", "warn", "aim_off_deg", "a heading or a mount that is off looks aside all the time",
         "check the compass and the mount", lambda m, s: abs(m.aim_off_deg) > s.aim_off_deg,
         lambda m: f"the camera looks {_side(m.aim_off_deg)} throughout"),
    _rule("pitch-otherwise", "warn", "least_pitch_fit_pct",
         "a camera follows the surface up and down; one whose pitch has the other sign does the reverse",
         'check the sign of the gimbal\'s pitch: convention = "pitch-sign" if it is wrong',
         lambda m, s: m.pitch_fit_pct < s.least_pitch_fit_pct,
         "the camera's pitch goes against the nearest surface (correlation {m.pitch_fit_pct:.0f} %)"),
    _rule("pitch-unset", "warn", "least_pitch_span_deg most_pitch_want_deg",
         "a gimbal whose pitch was not recorded looks level all the time",
         "check whether the log holds the gimbal's pitch, or give the mount",
         lambda m, s: m.pitch_span_deg < s.least_pitch_span_deg and m.pitch_want_deg > s.most_pitch_want_deg,
         "the camera's pitch stays within {m.pitch_span_deg:.1f} deg, while the nearest surface lies"
         " {m.pitch_want_deg:.0f} deg above or below it"),
    _rule("lens-differs", "warn", "zoom_pct", "a wrong field of view shows what nobody saw",
         "leave camera_hfov_deg out, or correct it",
         lambda m, s: _ratio(m.lens_ratio) > 1 + s.zoom_pct / 100,
         "the declared field of view is {m.lens_ratio:.2f} times that of the calibration in the log"),
    _rule("fast", "warn", "odd_speed_mps", "inspections are slow", "check units and stamps",
         lambda m, s: m.speed_p99_mps > s.odd_speed_mps,
         "{m.speed_p99_mps:.1f} m/s in the fastest hundredth of the flight"),
    _rule("gaps", "warn", "long_gap_s odd_recorded_pct", "what was not recorded is not flown",
         "record the flight again if it matters",
         lambda m, s: m.long_gaps > 0 or m.recorded_pct < s.odd_recorded_pct, _gaps),
    _rule("hovering", "warn", "hover_cap_s", "plans do not repeat what shows nothing new",
         "raise hover_cap_s to keep it",
         lambda m, s: m.cut_hover_s > 0, "{m.hover_s:.0f} s of hovering, {m.cut_hover_s:.0f} s of it cut"),
    _rule("frozen", "warn", "", "a flying vehicle is never quite still", "check whether the estimator ran",
         lambda m, s: m.frozen_s > max(10.0, 0.2 * m.span_s),
         "the pose did not change at all for {m.frozen_s:.0f} s"),
    _rule("zoom", "warn", "zoom_pct", "a plan zooms as the flight did: its aircraft must be able to",
         "export in a format that zooms, or take the part with one field of view by start_s and stop_s",
         lambda m, s: len(m.hfov_deg) > 1, _zoom),
    _rule("assumed", "warn", "", "what a log does not hold was assumed",
         "record it, or write it into the side-car",
         lambda m, s: bool(m.assumed), lambda m: ", ".join(m.assumed)),
    _rule("salvaged", "warn", "", "a damaged log may lack part of the inspection", "copy the log again",
         lambda m, s: bool(m.losses), lambda m: "; ".join(m.losses)),
)  # fmt: skip
#: Rules of the reader itself, before there is a flight to measure.
_READING = (
    Rule("several-publishers", "refuse", "a path through two bodies is nobody's", "name one by publisher"),
    Rule("zoom-untimed", "refuse", "without a common clock no pose has a known field of view",
         "record with one clock", "zoom_pct"),
    Rule("frame-unconnected", "refuse", "a structure cannot be placed in a frame that nothing leads to",
         "place the structure in the frame of the poses"),
)  # fmt: skip
RULES: dict[str, Rule] = {rule.name: rule for rule in (*(check.rule for check in CHECKS), *_READING)}


def judged(
    measured: Measured, settings: PassportSettings, allow: tuple[str, ...] = (), strict: bool = False
) -> tuple[Verdict, ...]:
    """The rules that a flight breaks, in the order of the table, those of the names in `allow` overruled."""
    findings = ((check.rule, check.broken(measured, settings)) for check in CHECKS)
    verdicts = [
        broken(rule, words, remedy=rule.remedy or measured.other_advice) for rule, words in findings if words
    ]
    return decided(verdicts, allow, strict)
