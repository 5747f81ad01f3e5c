"""The bounds of the rules that a flight is judged by on import, each with its default."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from upplied.inputs.files import table
from upplied.inputs.rules import with_bounds

#: In which a log may be written, see `upplied.inputs.passport.conventions`.
CONVENTIONS: Mapping[str, Any] = table("passport/conventions.toml")

#: Bounds that change what is kept of a flight, and so what is planned from it; the others only judge.
SHAPING = ("long_gap_s", "hover_cap_s")


@dataclass(frozen=True)
class PassportSettings:
    """What a flight may be measured to be on import (docs/checks.md).

    Sample flights of 28 structures keep 2.8 m of clearance, look at their structure in 88 % of the poses
    or more, and would fit another convention by 7 % more at most; the bounds leave room beside that.
    """

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


def changed(assignments: tuple[str, ...]) -> PassportSettings:
    """The defaults with bounds that are given as ``name=value``."""
    return with_bounds(PassportSettings(), assignments, "passport.")
