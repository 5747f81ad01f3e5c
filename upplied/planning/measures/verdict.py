"""Whether a plan may be flown: what it falls short of, with the figure, and what else should be known of it.

A plan of `recommended` that falls short is refused. Plans for comparison (`paper`, `baseline`) keep their
measures and carry the verdict beside them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import fields

import numpy as np

from upplied.config import FIDELITIES, Settings
from upplied.geometry.polylines import leg_lengths
from upplied.geometry.poses import yaw_pitch
from upplied.geometry.reconstruction import looks_scanned
from upplied.geometry.scene import Scene
from upplied.planning.airspace.detours import airspace_of
from upplied.planning.carry.affine import demonstrated_on_target
from upplied.planning.carry.inspected_surface import InspectedSurface, area_ratio, inspected_by
from upplied.planning.correspondence.label_transfer import fragments
from upplied.planning.correspondence.naming import place_of
from upplied.planning.correspondence.never_scanned import NeverScanned
from upplied.planning.correspondence.pair import Pair
from upplied.planning.demonstration.repetition import Take
from upplied.planning.measures.fidelity import Shown
from upplied.planning.surface.frames import named_axes
from upplied.planning.surface.parts import labels_of, parts_of_both
from upplied.records import Measures, Structure, Trajectory

_ALMOST_DEG = 2.0  # beyond a limit, that jitter of the hand explains
_TOLERANCE_M = 0.01  # within which a clearance is known (`airspace.rules`)
_TOLERANCE = 1.05  # of speeds and accelerations, which are read off differences of poses
_LEAST_NAMED = 0.05  # of what is to be shown, from which a part is named that is hardly shown
_TRANSIT_M, _TRANSIT_S = 50.0, 60.0  # that any plan may add for its ways


def shortfalls(
    trajectory: Trajectory, measures: Measures, takes: Sequence[Take], settings: Settings
) -> tuple[str, ...]:
    """Why a planned trajectory, target frame, must not be flown, in words; none where it may."""
    poses = (trajectory.t_s, trajectory.positions, trajectory.quat_xyzw)
    if not all(np.isfinite(values).all() for values in poses):
        return ("a waypoint is not finite",)
    known = {item.name: getattr(measures, item.name) for item in fields(measures)}
    if any(np.isinf(value) for value in known.values()):
        return ("a measure is not finite",)
    return tuple(_reasons(trajectory, measures, takes, settings))


def _reasons(
    trajectory: Trajectory, measures: Measures, takes: Sequence[Take], settings: Settings
) -> Iterator[str]:
    least, shown = settings.verdict.least_inspected_pct, measures.coverage_inspected_pct
    if np.isnan(shown) and least > 0:
        yield "what of the inspected surface it shows was not measured"
    elif shown < least:
        yield (
            f"shows {shown:.1f} % of what was inspected at least as well, {least:g} % are required "
            "(verdict.least_inspected_pct)"
        )
    # Clearance, or else any other rule of the airspace.
    clearance_m, reached_m = settings.route.clearance_m, measures.min_clearance_m
    airspace = airspace_of(takes[0].pair, settings)
    if reached_m < clearance_m - _TOLERANCE_M:
        yield f"comes within {reached_m:.2f} m of the structure, {clearance_m:g} m are required"
    elif len(outside := np.flatnonzero(~airspace.in_bounds(trajectory.positions))):
        place = trajectory.positions[outside[0]]
        yield f"{airspace.why(place)} at {airspace.frame.to_declared(place).round(1).tolist()} m"
    # Path and time beside the demonstration's, speed and acceleration beside what the vehicle can do.
    length_m, time_s = _at_size(takes, settings)
    floors, limits = settings.verdict, settings.retime
    if measures.path_length_m > floors.longest_path * length_m + _TRANSIT_M * len(takes):
        yield (
            f"flies {measures.path_length_m:.0f} m where the demonstration is {length_m:.0f} m long "
            f"at this size, {floors.longest_path:g} times as much is allowed (verdict.longest_path)"
        )
    if measures.duration_s > floors.longest_time * time_s + _TRANSIT_S * len(takes):
        yield (
            f"takes {measures.duration_s:.0f} s where the demonstration takes {time_s:.0f} s at this size, "
            f"{floors.longest_time:g} times as much is allowed (verdict.longest_time)"
        )
    if measures.peak_speed_mps > limits.max_speed_mps * _TOLERANCE:
        yield f"flies {measures.peak_speed_mps:.1f} m/s, {limits.max_speed_mps:g} m/s are allowed"
    reached, most = measures.peak_acceleration_mps2, limits.max_acceleration_mps2
    if reached > most * _TOLERANCE:
        yield f"asks for {reached:.1f} m/s2, {most:g} m/s2 are allowed"


def _at_size(takes: Sequence[Take], settings: Settings) -> tuple[float, float]:
    """The demonstration's length, m, and time, s, carried to the target's size, or to its inspected area."""
    length_m = time_s = 0.0
    for take in takes:
        flown = take.inspection.by_frustum.stations
        both = flown.positions, demonstrated_on_target(take)
        before, carried = (float(leg_lengths(path).sum()) for path in both)
        larger = area_ratio([take], inspected_by(take, settings)) if settings.refine.added_passes else 1.0
        times = max(1.0, carried / max(before, 1e-9), larger)
        length_m += max(carried, before * times)
        time_s += float(flown.t_s[-1] - flown.t_s[0]) * times
    return length_m, time_s


def odd_shape(measures: Measures, settings: Settings) -> tuple[str, ...]:
    """That the path departs further from the demonstrated one than its fidelity leads to expect, in words."""
    level = settings.refine.fidelity
    usual, departure = FIDELITIES[level].deviation, measures.frechet_floored
    if settings.refine.method != "view" or not departure > usual:
        return ()
    return (
        f"the shape of the path departs from the demonstrated one by {departure:.2f} of its spread; with "
        f"--fidelity {level} {usual:g} is usual",
    )


def slow(measures: Measures, takes: Sequence[Take], settings: Settings) -> tuple[str, ...]:
    """That the flight takes longer than is usual, in words."""
    if settings.refine.method != "view":
        return ()
    limit_s = settings.refine.longer * _at_size(takes, settings)[1]
    if not measures.duration_s > limit_s:
        return ()
    return (
        f"the flight takes {measures.duration_s:.0f} s, {limit_s:.0f} s is usual at this size "
        "(refine.longer): a safe path, sharp pictures or the camera's interval need more time here",
    )


def in_the_way(pair: Pair) -> Iterator[str]:
    """What a path has no room for that may be none of the target, or was never scanned, in words."""
    if number := fragments(pair.surface.target):
        yield (
            f"{number} fragments of the target touch nothing, and the path stays clear of them: "
            "`upplied structures check --clean` removes what is not the target, such as birds and cables"
        )
    if pair.missing.reach_m > 0:
        yield (
            f"the scan ends where the target may go on, by up to {pair.missing.reach_m:.1f} m more than the "
            "source has, and the path stays clear of that: scan the whole of it"
        )


def of_surface(
    measures: Measures, seen: InspectedSurface, target: Structure, scene: Scene, settings: Settings
) -> Iterator[str]:
    """What a person should know of the target's surface before this plan is flown, in words."""
    if seen.without_pct >= 1:
        yield (
            f"{seen.without_pct:.0f} % of what the demonstration saw has no counterpart on the target: "
            f"{seen.without:.0f} m2 at the target's size"
        )
    if (short := measures.coverage_attainable_pct - measures.coverage_seen_pct) > 5:
        yield f"{short:.0f} % of the surface that a camera could see here is not seen"
    if looks_scanned(target):
        yield (
            "the target looks like a reconstruction of a scan and counts as drawn: "
            "declare surface = 'scanned' in the manifest, or 'drawn' where it was"
        )
    known_m, adds = f"{measures.surface_error_m:.2f} m", "the path adds that to the clearance"
    if target.is_scan and measures.surface_error_m > 0:
        known = f"the target is a scan, whose surface is known to {known_m} where it was scanned: {adds}"
        if scene.thin_m:
            known += (
                f", and {scene.thin_error_m:.2f} m where it is thinner than {scene.thin_m:.2f} m; what is so "
                "thin may be missing from it as a whole: antennas, masts, cables"
            )
        yield known
    elif target.surface_error_m:
        yield f"the target is known to {known_m}: {adds}"
    yield from too_near(measures, settings)


def of_parts(shown: Shown, pair: Pair, settings: Settings) -> Iterator[str]:
    """Which parts of the target are hardly shown though the whole is, in words."""
    label, need, fit = labels_of(shown.inspected.cloud), shown.inspected.need, pair.surface
    whole, well = (np.bincount(label, need * of) for of in (np.ones(len(need)), shown.as_well))
    parts = parts_of_both(fit.source, fit.registered, named_axes(pair.source.frame))[1]
    hardly = (whole > _LEAST_NAMED * need.sum()) & (100 * well < settings.verdict.least_inspected_pct * whole)
    for part in np.flatnonzero(hardly & (whole < need.sum())).tolist():
        yield (
            f"part_{part} ({place_of(parts, part)}) of the target, {100 * whole[part] / need.sum():.0f} % of "
            f"what is to be shown, is shown by {100 * well[part] / whole[part]:.0f} %"
        )


def of_scan(missing: NeverScanned) -> Iterator[str]:
    """That the scan of the target is open, and how much of it is not there."""
    if len(missing.beyond):
        yield (
            f"about {missing.area_m2:.0f} m2 of the target were never scanned: path and transit legs "
            f"stay clear of where the source has them, known to {missing.error_m:.2f} m where the "
            "target is shaped as the source is"
        )
    if missing.reach_m > 0:
        yield (
            f"where the scan ends the target may go on by up to {missing.reach_m:.1f} m more: the path "
            "stays clear of that as well"
        )


def too_near(measures: Measures, settings: Settings) -> Iterator[str]:
    """That the path does not keep the safety distance."""
    least_m, reached_m = settings.route.clearance_m, measures.min_clearance_m
    if reached_m < least_m:
        yield f"comes within {reached_m:.2f} m of the structure; {least_m:g} m are required"


def by_camera(measures: Measures, takes: Sequence[Take], settings: Settings) -> Iterator[str]:
    """That the expert's camera looked further up or down than the planned one may, or that pictures smear."""
    rule, limits, inspection = settings.inspection, settings.retime, takes[0].inspection
    low, high = np.percentile(np.degrees(yaw_pitch(inspection.flight.quat_xyzw)[1]), [5, 95])
    least, most = limits.min_gimbal_pitch_deg, limits.max_gimbal_pitch_deg
    if limits.limits and not (high <= most + _ALMOST_DEG and low >= least - _ALMOST_DEG):
        yield (
            f"the demonstration looks from {low:.0f} to {high:.0f} deg of pitch, the plan only from "
            f"{least:g} to {most:g} (retime.min_gimbal_pitch_deg and max_gimbal_pitch_deg)"
        )
    if measures.blur_px_p99 > rule.max_motion_px:
        yield (
            f"1 % of what is shown moves by {measures.blur_px_p99:.1f} px or more during an exposure of "
            f"1/{1 / (inspection.camera.exposure_s or rule.exposure_s):.0f} s, {rule.max_motion_px:g} px is "
            "sharp (inspection.max_motion_px)"
        )
