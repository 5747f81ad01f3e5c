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

Broken = Callable[[Measured, PassportSettings], str]  # in words, empty where the rule is kept


@dataclass(frozen=True)
class FlightRule:
    """A rule, the settings that it asks, and how it is told that a flight breaks it."""

    rule: Rule
    bounds: tuple[str, ...]
    broken: Broken


def _rule(
    name: str, severity: Severity, bounds: tuple[str, ...], reason: str, remedy: str, broken: Broken
) -> FlightRule:
    return FlightRule(Rule(name, severity, reason, remedy, ", ".join(bounds)), bounds, broken)


def _below(m: Measured, s: PassportSettings) -> str:
    if m.below_ground_pct <= s.most_below_ground_pct:
        return ""
    return f"{m.below_ground_pct:.0f} % of the poses lie below the ground, down to {m.lowest_m:.1f} m"


def _inside(m: Measured, s: PassportSettings) -> str:
    return f"{m.inside_pct:.1f} % of the poses lie inside the structure" * (m.inside_pct > s.most_inside_pct)


def _touches(m: Measured, s: PassportSettings) -> str:
    return f"the camera comes within {m.min_clearance_m:.2f} m of the structure" * (
        m.min_clearance_m < s.least_clearance_m
    )


def _near(m: Measured, s: PassportSettings) -> str:
    return f"{m.near_pct:.1f} % of the poses are nearer than {s.near_m:g} m" * (m.near_pct > 0)


def _looks_away(m: Measured, s: PassportSettings) -> str:
    doubtful = m.axis_pct < s.odd_axis_pct and m.fit_pct < s.least_fit_pct
    if m.axis_pct >= s.least_axis_pct and not doubtful:
        return ""
    return (
        f"the camera's axis meets the structure in {m.axis_pct:.0f} % of the poses,"
        f" {m.fit_pct:.0f} % could be of an inspection"
    )


def _looks_aside(m: Measured, s: PassportSettings) -> str:
    return f"the camera's axis misses the structure in {100 - m.axis_pct:.0f} % of the poses" * (
        m.axis_pct < s.odd_axis_pct
    )


def _shows_nothing(m: Measured, s: PassportSettings) -> str:
    if m.shown_pct >= s.least_shown_pct:
        return ""
    return f"{m.shown_pct:.0f} % of the pictures show the structure within the camera's range"


def _fits_otherwise(m: Measured, s: PassportSettings) -> str:
    if m.other_fit_pct - m.fit_pct < s.fit_gain_pct or m.other_fit_pct < s.fit_least_pct:
        return ""
    return (
        f"as {m.other_words} ({m.other}), {m.other_fit_pct:.0f} % of the poses could be of an inspection,"
        f" as given {m.fit_pct:.0f} %"
    )


def _off_centre(m: Measured, s: PassportSettings) -> str:
    off = math.hypot(*m.off_centre_m)
    if m.off_centre_sure < 0.8 or not s.off_centre_m <= off < 100:
        return ""
    return f"the stand-off changes from side to side as if the log lay off by {m.off_centre_m} m (x, y)"


def _little_off_centre(m: Measured, s: PassportSettings) -> str:
    off = math.hypot(*m.off_centre_m)
    if m.off_centre_sure < 0.8 or not s.odd_off_centre_m <= off < s.off_centre_m:
        return ""
    return f"the stand-off changes from side to side as if the log lay off by {m.off_centre_m} m (x, y)"


def _aim_drifts(m: Measured, s: PassportSettings) -> str:
    side = "left" if m.aim_drift_deg > 0 else "right"
    return (
        f"the camera turns {abs(m.aim_drift_deg):.0f} deg to the {side} of the nearest surface"
        " from end to end"
    ) * (abs(m.aim_drift_deg) > s.aim_drift_deg)


def _aim_off(m: Measured, s: PassportSettings) -> str:
    side = "left" if m.aim_off_deg > 0 else "right"
    return (
        f"the camera looks {abs(m.aim_off_deg):.0f} deg to the {side} of the nearest surface throughout"
        * (abs(m.aim_off_deg) > s.aim_off_deg)
    )


def _velocity(m: Measured, s: PassportSettings) -> str:
    found = []
    if m.motion_fit_pct < s.least_motion_fit_pct:
        found.append(f"they move or turn in other directions (mean cosine {m.motion_fit_pct / 100:.2f})")
    if max(m.motion_ratio, 1 / max(m.motion_ratio, 1e-9)) > s.motion_ratio:
        found.append(f"they move {m.motion_ratio:.2f} times as fast")
    return "poses and velocity of the same messages differ: " + " and ".join(found) if found else ""


def _turns_otherwise(m: Measured, s: PassportSettings) -> str:
    if not m.felt_turn_pct < s.least_felt_turn_pct:
        return ""
    found = m.felt_turn_pct / 100
    return f"the poses turn about the vertical against what the gyroscope feels (correlation {found:.2f})"


def _frame_name(m: Measured, s: PassportSettings) -> str:
    named = [name for name in (m.frame, m.child) if _NED.search(name)]
    asked = any("converted as asked" in note for note in m.frames)
    if not named or asked:
        return ""
    return f"the frame {named[0]!r} is named for axes that point down, but was read as z up"


def _seldom(m: Measured, s: PassportSettings) -> str:
    if m.recorded_pct >= s.least_recorded_pct:
        return ""
    return f"{m.recorded_pct:.0f} % of the time was recorded ({m.gaps} gaps of {m.span_s:.0f} s in all)"


def _gaps(m: Measured, s: PassportSettings) -> str:
    if not m.long_gaps and m.recorded_pct >= s.odd_recorded_pct:
        return ""
    joined = f", {m.long_gaps} of them flown as transits" if m.long_gaps else ""
    return (
        f"{m.gaps} gaps of up to {m.longest_gap_s:.1f} s, {m.skipped_m:.1f} m from end to end{joined};"
        f" {m.recorded_pct:.0f} % of the time was recorded"
    )


def _zoom(m: Measured, s: PassportSettings) -> str:
    if len(m.hfov_deg) < 2:
        return ""
    told = zip(m.hfov_deg, m.hfov_from_s, strict=True)
    listed = [f"{angle:.1f} deg from {at:.0f} s on" for angle, at in told]
    return f"the field of view changes in flight ({', '.join(listed[:6])}{', ...' * (len(listed) > 6)})"


def _hovering(m: Measured, s: PassportSettings) -> str:
    return f"{m.hover_s:.0f} s of hovering, {m.cut_hover_s:.0f} s of it cut" * (m.cut_hover_s > 0)


def _jumps(m: Measured, s: PassportSettings) -> str:
    return f"the poses jump {m.jumps} times, by up to {m.jump_m:.1f} m" * (m.jumps > 0)


def _undated(m: Measured, s: PassportSettings) -> str:
    return f"the first stamp is of the year {m.year}" * (not 2001 <= m.year < s.odd_year)


def _clock_rate(m: Measured, s: PassportSettings) -> str:
    if not max(m.clock_ratio, 1 / max(m.clock_ratio, 1e-9)) > s.clock_ratio:
        return ""
    return f"the stamps run {m.clock_ratio:.2f} times as fast as the recorder's clock"


def _sparse(m: Measured, s: PassportSettings) -> str:
    return f"one pose in {m.step_s:.1f} s" * (m.step_s > s.odd_step_s and not m.stills)


def _above(value: str, bound: str, words: str) -> Broken:
    def above(m: Measured, s: PassportSettings) -> str:
        return words.format(getattr(m, value)) * (getattr(m, value) > getattr(s, bound))

    return above


#: Every rule, in the order in which findings are told.
CHECKS: tuple[FlightRule, ...] = (
    _rule("fits-otherwise", "refuse", ("fit_gain_pct", "fit_least_pct"),
         "another convention makes sense of poses that make none as given", "", _fits_otherwise),
    _rule("below-ground", "refuse", ("most_below_ground_pct", "ground_slack_m"),
         "no vehicle flies in the ground", "check heights, axes and the declared ground", _below),
    _rule("inside-structure", "refuse", ("most_inside_pct",),
         "no vehicle flies in walls", "check where the structure stands in the log's frame", _inside),
    _rule("touches-structure", "refuse", ("least_clearance_m",),
         "a vehicle has a size", "check where the structure stands in the log's frame", _touches),
    _rule("looks-away", "refuse", ("least_axis_pct", "least_fit_pct"),
         "an inspection looks at its structure", "check the attitude's convention and the camera's mount",
         _looks_away),
    _rule("shows-nothing", "refuse", ("least_shown_pct",),
         "an inspection shows its structure",
         "check units and place of the structure, or give camera_max_range_m", _shows_nothing),
    _rule("off-centre", "refuse", ("off_centre_m",),
         "a pilot who circles keeps his distance", "place the structure by structure_position_m",
         _off_centre),
    _rule("frame-name", "refuse", (),
         "a frame's name says its axes", 'if they are so, write convention = "ned" into the side-car',
         _frame_name),
    _rule("too-fast", "refuse", ("max_speed_mps",),
         "no inspecting vehicle is as fast", "check units and stamps",
         _above("speed_p99_mps", "max_speed_mps", "{:.0f} m/s in the fastest hundredth of the flight")),
    _rule("too-jerky", "refuse", ("max_acceleration_mps2",),
         "no vehicle accelerates so", "check units and stamps, and whether several bodies publish",
         _above("acceleration_p99_mps2", "max_acceleration_mps2", "accelerations of {:.0f} m/s2")),
    _rule("turns-too-fast", "refuse", ("max_turn_degps",),
         "no camera turns so", "check the attitude",
         _above("turn_p99_degps", "max_turn_degps", "turns of {:.0f} deg/s")),
    _rule("clock-steps", "refuse", ("max_clock_steps",),
         "a clock that steps often tells no time", "record with one clock",
         _above("clock_steps", "max_clock_steps", "the clock stepped {} times")),
    _rule("mostly-missing", "refuse", ("least_recorded_pct",),
         "what was not recorded cannot be flown again", "record the flight again", _seldom),
    _rule("mostly-unread", "refuse", ("least_read_pct",),
         "what is lost of a log is lost of the inspection", "copy the log again, or record the flight again",
         lambda m, s: f"{m.read_pct:.0f} % of the log could be read" * (m.read_pct < s.least_read_pct)),
    _rule("rolled", "refuse", ("most_roll_deg",),
         "cameras hang level, or say that they are turned", "check the attitude's convention and the mount",
         _above("roll_deg", "most_roll_deg", "the camera is rolled by {:.0f} deg in the middle")),
    _rule("tilted", "warn", ("odd_roll_deg",),
         "gimbals hold the horizon", "check the attitude's convention and the mount",
         _above("roll_deg", "odd_roll_deg", "the camera is rolled by {:.0f} deg in the middle")),
    _rule("jumps", "warn", (), "no vehicle is elsewhere from one pose to the next",
         "check whether the estimator was reset, or two logs were joined", _jumps),
    _rule("spikes", "warn", (), "single poses off all others are no flight",
         "check the estimator; they were left out where the speed tells them",
         lambda m, s: f"{m.spikes} single poses lie off their neighbours" * (m.spikes > 0)),
    _rule("attitude-unset", "warn", (), "an attitude of exactly zero, turns and all, was never set",
         "check when the estimator began",
         lambda m, s: f"{m.unset} poses without an attitude were left out" * (m.unset > 0)),
    _rule("sparse", "warn", ("odd_step_s",), "what the camera did between far poses is not known",
         "record poses more often", _sparse),
    _rule("planned", "warn", (), "nobody flew a mission that was only planned", "take the log of its flight",
         lambda m, s: "this is a planned mission, not a flight" * m.planned),
    _rule("undated", "warn", ("odd_year",), "stamps without a date cannot be compared with other logs",
         "check what the clock was set by", _undated),
    _rule("clock-rate", "warn", ("clock_ratio",), "two clocks of one flight go alike",
         "check the unit of the stamps, or whether the log was played back faster", _clock_rate),
    _rule("jerky", "warn", ("odd_acceleration_mps2",), "who inspects flies gently",
         "check units and stamps: time may run too fast",
         _above("acceleration_p99_mps2", "odd_acceleration_mps2", "accelerations of {:.1f} m/s2")),
    _rule("turns-fast", "warn", ("odd_turn_degps",), "who inspects turns the camera slowly",
         "check the attitude and the stamps: time may run too fast",
         _above("turn_p99_degps", "odd_turn_degps", "turns of {:.0f} deg/s")),
    _rule("clock-stepped", "warn", (),
         "the flight was split where its clock stepped", "check what the clock was set by",
         lambda m, s: f"the clock stepped {m.clock_steps} times: split there" * (m.clock_steps > 0)),
    _rule("near-structure", "warn", ("near_m",),
         "pilots stay farther away", "check where the structure stands in the log's frame", _near),
    _rule("looks-aside", "warn", ("odd_axis_pct",),
         "an inspection looks at its structure most of the time", "cut the log to the inspection",
         _looks_aside),
    _rule("little-off-centre", "warn", ("odd_off_centre_m",),
         "a pilot who circles keeps his distance", "check where the structure stands in the log's frame",
         _little_off_centre),
    _rule("velocity", "warn", ("least_motion_fit_pct", "motion_ratio"),
         "poses that were mirrored, turned or scaled move otherwise than their estimator says",
         "check who wrote the log: its axes, its unit, its clock", _velocity),
    _rule("turns-otherwise", "warn", ("least_felt_turn_pct",),
         "poses that were mirrored turn against what the gyroscope feels",
         "check the axes: one of them is mirrored, or z points down", _turns_otherwise),
    _rule("aim-drifts", "warn", ("aim_drift_deg",),
         "a heading that drifts turns the camera steadily aside", "check the compass and the estimator",
         _aim_drifts),
    _rule("aim-off", "warn", ("aim_off_deg",),
         "a heading or a mount that is off looks aside all the time", "check the compass and the mount",
         _aim_off),
    _rule("fast", "warn", ("odd_speed_mps",),
         "inspections are slow", "check units and stamps",
         _above("speed_p99_mps", "odd_speed_mps", "{:.1f} m/s in the fastest hundredth of the flight")),
    _rule("gaps", "warn", ("long_gap_s", "odd_recorded_pct"),
         "what was not recorded is not flown", "record the flight again if it matters", _gaps),
    _rule("hovering", "warn", ("hover_cap_s",),
         "plans do not repeat what shows nothing new", "raise hover_cap_s to keep it", _hovering),
    _rule("frozen", "warn", (),
         "a flying vehicle is never quite still", "check whether the estimator ran",
         lambda m, s: f"the pose did not change at all for {m.frozen_s:.0f} s"
         * (m.frozen_s > max(10.0, 0.2 * m.span_s))),
    _rule("zoom", "warn", ("zoom_pct",),
         "a plan zooms as the flight did: what flies it must be able to",
         "export in a format that zooms, or take the part with one field of view by start_s and stop_s",
         _zoom),
    _rule("assumed", "warn", (),
         "what a log does not say was assumed", "record it, or say it in the side-car",
         lambda m, s: ", ".join(m.assumed)),
    _rule("salvaged", "warn", (),
         "a damaged log may lack part of the inspection", "copy the log again",
         lambda m, s: "; ".join(m.losses)),
)  # fmt: skip

#: Rules that the reader itself asks, before there is a flight to measure.
_READING = (
    Rule("several-publishers", "refuse", "a path through two bodies is nobody's", "name one by publisher"),
    Rule("zoom-untimed", "refuse", "without a common clock nothing says which pose had which field of view",
         "record with one clock", "zoom_pct"),
    Rule("frame-unconnected", "refuse", "a structure cannot be placed in a frame that nothing leads to",
         "place the structure in the frame of the poses"),
)  # fmt: skip
RULES: dict[str, Rule] = {rule.name: rule for rule in (*(check.rule for check in CHECKS), *_READING)}


def judged(
    measured: Measured, settings: PassportSettings, allow: tuple[str, ...] = (), strict: bool = False
) -> tuple[Verdict, ...]:
    """The rules that a flight breaks, in the order of the table.

    Parameters
    ----------
    measured : Measured
    settings : PassportSettings
    allow : tuple of str
        Names of rules that are overruled.
    strict : bool
        Whether what is odd is refused too.
    """
    found = [(check, check.broken(measured, settings)) for check in CHECKS]
    return decided(
        [
            broken(check.rule, words, remedy=check.rule.remedy or measured.other_advice)
            for check, words in found
            if words
        ],
        allow,
        strict,
    )
