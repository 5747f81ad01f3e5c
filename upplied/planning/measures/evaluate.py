"""The measures of one plan, asked of the demonstration and the plan in the same manner."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from upplied.config import Settings
from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.poses import yaw_pitch
from upplied.geometry.reconstruction import looks_scanned
from upplied.geometry.scene import Scene
from upplied.planning.airspace.detours import airspace_of
from upplied.planning.carry.affine import demonstrated_on_target, registered_map, standing
from upplied.planning.carry.forecast import forecast_of
from upplied.planning.carry.inspected_surface import InspectedSurface, inspected_surface
from upplied.planning.carry.standoff import (
    carried_sight,
    counted,
    picture_share,
)
from upplied.planning.correspondence.never_scanned import NeverScanned
from upplied.planning.correspondence.pair import Pair
from upplied.planning.demonstration.repetition import Take, begins_of
from upplied.planning.geometry.frechet import frechet, frechet_floored
from upplied.planning.measures.attainable import attainable_beside
from upplied.planning.measures.fidelity import Compared, fidelity, resolution
from upplied.planning.measures.measure import FRECHET, inspected_measures, measure, shown_of, surface_states
from upplied.planning.measures.picture_score import picture_score
from upplied.planning.visibility.observations import BY_FRUSTUM, TRULY, views
from upplied.records import (
    Bools,
    Floats,
    Measures,
    Structure,
    SurfaceStates,
    Trajectory,
)

_KEPT = 0.2  # of the wanted stand-off, that a viewpoint may be off and still counts as keeping it
_LIKELY = 0.5  # probability from which correspondences count though the wholes were refused
_VIEWPOINTS = 200  # viewpoints, at most, whose stand-off is asked for
_ALMOST_DEG = 2.0  # beyond a limit, that jitter of the hand explains


def judge(
    trajectory: Trajectory,
    demonstrated_s: Floats | None,
    takes: Sequence[Take],
    settings: Settings,
    added: Bools | None = None,
) -> tuple[Measures, SurfaceStates | None, tuple[str, ...]]:
    """All measures of a planned trajectory, what becomes of the target's surface, and warnings in words.

    What a repeated demonstration should see is what all its takes should see together. `demonstrated_s` are
    the times of the joined flights that the poses correspond to; without them (of a flown path) it is
    not asked how many viewpoints keep their stand-off. `added` are the poses on added passes.
    """
    pair, camera = takes[0].pair, takes[0].inspection.camera
    carried = np.concatenate([demonstrated_on_target(take) for take in takes])
    paper = _seen(takes, settings, False), views(trajectory, pair.voxels.target, camera, BY_FRUSTUM)
    if not pair.surface.registration.accepted and forecast_of(takes).probability < _LIKELY:
        measures = measure(trajectory, carried, pair.target_scene, paper, standing=standing(pair))
        unmeasured = f"what is really seen was not measured: {pair.surface.registration.reason}"
        warnings = unmeasured, *_too_near(measures, settings), *_by_camera(measures, takes, settings)
        return measures, None, warnings
    seen = _seen(takes, settings, True)
    planned = views(trajectory, pair.surface.target, camera, TRULY, pair.target_scene)
    # What an allowed pose could see: the plan's own, where they are, or any other.
    airspace = airspace_of(pair, settings)
    allowed = airspace.allowed(planned.stations.positions)
    possible = np.asarray(planned.seen[allowed].any(axis=0), bool)
    missed = np.flatnonzero((seen.need > 0) & ~possible)
    possible[missed] = attainable_beside(missed, seen.cloud, airspace, camera)
    true = seen, planned
    measures = measure(trajectory, carried, pair.target_scene, paper, true, possible, standing(pair))
    shown = shown_of(planned, takes, settings)
    compared = Compared.of(trajectory, planned, shown.inspected, takes, settings)
    measures = replace(
        measures,
        **inspected_measures(shown, planned, takes),
        **fidelity(compared),
        **resolution(compared),
        **picture_score(compared),
        never_scanned_m2=pair.missing.area_m2,
    )
    if added is not None and not added.all():
        measures = replace(measures, **_shape_of_demonstrated(trajectory, added, carried, pair, measures))
    if demonstrated_s is not None:
        own = np.ones(len(trajectory), bool) if added is None or added.all() else ~added
        flown = trajectory.take(own), demonstrated_s[own]
        measures = replace(measures, standoff_kept_pct=_standoff_kept(*flown, takes, settings))
    warnings = (
        *_warnings(measures, seen, pair.target, pair.target_scene, settings),
        *_beyond(pair.missing),
        *_by_camera(measures, takes, settings),
    )
    return measures, surface_states(shown), warnings


def _shape_of_demonstrated(
    trajectory: Trajectory, added: Bools, carried: Floats, pair: Pair, measures: Measures
) -> dict[str, float]:
    """How far the part of a plan that is carried from the demonstration departs from it."""
    if not added.any():
        return {"frechet_demonstrated_m": measures.frechet_m}
    own, axes = trajectory.positions[~added], standing(pair)
    return {
        "frechet_demonstrated_m": frechet(carried, own, FRECHET),
        "frechet_floored": frechet_floored(carried @ axes.T, own @ axes.T, FRECHET),
    }


def _standoff_kept(
    trajectory: Trajectory, demonstrated_s: Floats, takes: Sequence[Take], settings: Settings
) -> float:
    """Share, in percent, of the viewpoints from which the plan sees what they saw as far off as wanted."""
    begins = begins_of([take.inspection.flight for take in takes])
    ratios = []
    for take, begin in zip(takes, begins, strict=True):
        first = take.inspection.flight.t_s[0]
        seen_at = take.inspection.viewpoints.t_s
        seen_at = seen_at[chosen_evenly(len(seen_at), _VIEWPOINTS)]
        places = np.column_stack(
            [np.interp(seen_at - first + begin, demonstrated_s, axis) for axis in trajectory.positions.T]
        )
        fit, shown = take.pair.surface, take.inspection.truly
        index = np.clip(np.searchsorted(shown.stations.t_s, seen_at), 0, len(shown.stations) - 1)
        known = np.flatnonzero(fit.correspondences.target_index >= 0)
        here, positions = fit.source.points[known], shown.stations.positions[index]
        weight = shown.seen[index][:, known] * picture_share(positions, fit.source, known, shown.total)
        there, carrier = fit.correspondences.target_points[known], registered_map(fit.registration)
        rules = settings.transfer, take.inspection.camera, settings.route.clearance_m
        coarse = None if shown.coarse is None else shown.coarse[index]
        standoff = counted(positions, weight, here, there, carrier, *rules, coarse)
        ratio = standoff.distance(places) / standoff.wanted_m
        ratios.append(ratio[np.isfinite(ratio)])
    off = np.abs(np.concatenate(ratios) - 1)
    return 100 * float(np.mean(off <= _KEPT)) if len(off) else float("nan")


def _seen(takes: Sequence[Take], settings: Settings, truly: bool) -> InspectedSurface:
    """What the takes saw, together: truly, or in the frustum, on the paper's voxel clouds."""
    parts = []
    for take in takes:
        pair, inspection = take.pair, take.inspection
        fit, shown = (pair.surface, inspection.truly) if truly else (pair.voxels, inspection.by_frustum)
        sight = carried_sight(registered_map(pair.surface.registration), settings.transfer)
        parts.append(inspected_surface(fit.source, fit.target, fit.correspondences, shown, sight))
    return InspectedSurface.together(parts)


def _warnings(
    measures: Measures, seen: InspectedSurface, target: Structure, scene: Scene, settings: Settings
) -> Iterator[str]:
    """What a person should know of the target's surface before this plan is flown, in words."""
    if seen.without_pct >= 1:
        yield (
            f"{seen.without_pct:.0f} % of what the demonstration saw has no counterpart on the target: "
            f"{seen.without:.0f} m2 of the source's surface"
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
    yield from _too_near(measures, settings)


def _beyond(missing: NeverScanned) -> Iterator[str]:
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


def _too_near(measures: Measures, settings: Settings) -> Iterator[str]:
    """That the path does not keep the safety distance."""
    least_m, reached_m = settings.route.clearance_m, measures.min_clearance_m
    if reached_m < least_m:
        yield f"comes within {reached_m:.2f} m of the structure; {least_m:g} m are required"


def _by_camera(measures: Measures, takes: Sequence[Take], settings: Settings) -> Iterator[str]:
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
