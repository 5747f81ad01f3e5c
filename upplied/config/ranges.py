"""Checks of the type and the range of a setting."""

from __future__ import annotations

import math
from typing import Any, Literal, get_args, get_origin

from upplied.errors import SettingsError


def check_value(name: str, value: Any, wanted: Any) -> None:
    """Refuse a value of another type than its field declares, or out of its range."""
    choices = get_args(wanted)
    if get_origin(wanted) is Literal:
        fits, rule = value in choices, f"one of {', '.join(map(repr, choices))}"
    elif wanted is str:
        fits, rule = isinstance(value, str) and len(value) <= 1000, "text of at most 1000 characters"
    elif wanted is bool:
        fits, rule = isinstance(value, bool), "true or false"
    elif wanted is int or int in choices:
        optional = type(None) in choices
        fits = (isinstance(value, int) and not isinstance(value, bool)) or (optional and value is None)
        rule = "a whole number, or none" if optional else "a whole number"
    elif wanted is float or float in choices:
        optional = type(None) in choices
        fits = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        fits, rule = fits or (optional and value is None), "a number, or none" if optional else "a number"
    else:
        fits = all(isinstance(pair, tuple | list) and len(pair) == 2 for pair in value)
        rule = "pairs of names"
    if not fits:
        raise SettingsError(f"setting {name}", f"got {value!r}", rule)
    low, high = RANGES.get(name, (-math.inf, math.inf))
    if isinstance(value, int | float) and not low <= value <= high:
        raise SettingsError(f"setting {name}", f"got {value!r}", f"{low:g} to {high:g}")


#: Allowed range of each number, lowest and highest value.
RANGES = {
    "clouds.voxel_points": (50, 100_000),
    "clouds.raw_points": (1000, 10_000_000),
    "clouds.surface_samples": (100, 200_000),
    "registration.iterations": (1, 1000),
    "registration.gamma": (0, math.inf),
    "registration.acceptance": (0, math.inf),
    "registration.least_probability": (0, 1),
    "correspondence.expect": (1, 1000),
    "correspondence.least_probability": (0, 1),
    "correspondence.siblings": (0, 20),
    "visibility.max_incidence_deg": (1, 90),
    "viewpoints.shared": (0, 1),
    "viewpoints.most_poses": (2, 100_000),
    "transfer.gsd_m": (1e-5, 10),
    "refine.iterations": (0, 1000),
    "refine.deviation": (0.01, 10),
    "refine.least_counterpart": (0, 1),
    "optimise.context": (0, 1),
    "optimise.standoff": (0, 1000),
    "optimise.standoff_tolerance": (0, 1),
    "optimise.axis": (0, 1000),
    "optimise.leaving": (0, 1000),
    "optimise.clearance": (0, 1000),
    "optimise.turning": (0, 1000),
    "optimise.spacing": (0.05, 10),
    "optimise.rounds": (1, 20),
    "optimise.iterations": (1, 1000),
    "optimise.required": (0, 1000),
    "optimise.samples": (50, 100_000),
    "route.clearance_m": (0, 1000),
    "route.ground_clearance_m": (0, 1000),
    "retime.max_speed_mps": (0.01, 100),
    "retime.transit_speed_mps": (0.01, 100),
    "retime.max_climb_mps": (0.01, 100),
    "retime.max_descent_mps": (0.01, 100),
    "retime.max_acceleration_mps2": (0.01, 100),
    "retime.max_yaw_rate_degps": (0.1, 1000),
    "retime.max_yaw_acceleration_degps2": (0.1, 10_000),
    "retime.max_gimbal_rate_degps": (0.1, 1000),
    "retime.least_stop_s": (0, 3600),
    "retime.min_gimbal_pitch_deg": (-90, 90),
    "retime.max_gimbal_pitch_deg": (-90, 90),
    "inspection.least_resolution": (0, 1),
    "refine.added_passes": (0, 3),
    "refine.longer": (0, 10),
    "inspection.planned_resolution": (0, 1),
    "inspection.max_incidence_deg": (1, 90),
    "inspection.max_motion_px": (0.01, 1000),
    "inspection.exposure_s": (1e-6, 1),
    "inspection.width_px": (16, 100_000),
    "vehicle.payload": (0, 65_535),
    "vehicle.endurance_s": (1, 1e6),
    "vehicle.reserve_pct": (0, 99),
    "verdict.least_inspected_pct": (0, 100),
    "verdict.longest_path": (1, 1000),
    "verdict.longest_time": (1, 1000),
    "verdict.most_size_ratio": (1, 1e6),
    "verdict.odd_size_ratio": (1, 1e6),
}
