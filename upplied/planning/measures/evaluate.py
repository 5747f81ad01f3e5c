"""The measures of one plan, asked of the demonstration and the plan in the same manner, for every preset.

Two questions come first. `carry.inspected_surface`: which points of the target correspond to what the
demonstration saw, and for what it was about? `visibility.observations`: which points does a planned path see?
`measure` compares them, and the paths; `fidelity.shown_of` says what of the inspected surface is shown at
least as well as the expert did.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from upplied.config import Settings
from upplied.geometry.polylines import accelerations, chosen_evenly, leg_lengths
from upplied.geometry.scene import Scene
from upplied.planning.airspace.detours import airspace_of
from upplied.planning.airspace.rules import path_clearance
from upplied.planning.carry.affine import demonstrated_on_target, registered_map, standing
from upplied.planning.carry.forecast import evidence_of
from upplied.planning.carry.inspected_surface import InspectedSurface, coverage, inspected_surface
from upplied.planning.carry.standoff import carried_sight, counted, picture_share
from upplied.planning.demonstration.repetition import Take, begins_of
from upplied.planning.geometry.clouds import weighted_percentile
from upplied.planning.geometry.frechet import frechet, frechet_floored, frechet_z
from upplied.planning.measures.attainable import attainable_beside
from upplied.planning.measures.fidelity import (
    Compared,
    fidelity,
    inspected_measures,
    resolution,
    shown_of,
    surface_states,
)
from upplied.planning.measures.picture_score import picture_score
from upplied.planning.measures.verdict import by_camera, of_parts, of_scan, of_surface, too_near
from upplied.planning.visibility.observations import BY_FRUSTUM, TRULY, Views, views
from upplied.records import Bools, Floats, Measures, SurfaceStates, Trajectory

FRECHET = 1e-4  # of the distances of paths, to which they are known: a decision fewer for each half of it
_TOLERANCE = 0.2  # of the wanted stand-off, that a viewpoint may be off and still counts as keeping it
_LIKELY = 0.5  # probability from which correspondences count though the wholes were refused
_VIEWPOINTS = 200  # viewpoints, at most, whose stand-off is asked for


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
    if not pair.surface.registration.accepted and evidence_of(takes[0]).probability < _LIKELY:
        measures = measure(trajectory, carried, pair.target_scene, paper, standing=standing(pair))
        unmeasured = f"what is really seen was not measured: {pair.surface.registration.reason}"
        warnings = unmeasured, *too_near(measures, settings), *by_camera(measures, takes, settings)
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
        # How far the part of the plan that is carried from the demonstration departs from it.
        own_at, axes = trajectory.positions[~added], standing(pair)
        off = {"frechet_demonstrated_m": measures.frechet_m}
        if added.any():
            off["frechet_demonstrated_m"] = frechet(carried, own_at, FRECHET)
            off["frechet_floored"] = frechet_floored(carried @ axes.T, own_at @ axes.T, FRECHET)
        measures = replace(measures, **off)
    if demonstrated_s is not None:
        own = np.ones(len(trajectory), bool) if added is None or added.all() else ~added
        flown = trajectory.take(own), demonstrated_s[own]
        measures = replace(measures, standoff_kept_pct=_standoff_kept(*flown, takes, settings))
    warnings = (
        *of_surface(measures, seen, pair.target, pair.target_scene, settings),
        *of_parts(shown, pair, settings),
        *of_scan(pair.missing),
        *by_camera(measures, takes, settings),
    )
    return measures, surface_states(shown), warnings


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
        about = shown.seen[index][:, known], take.inspection.attention.weight
        weight = picture_share(positions, fit.source, known, *about)
        there, carrier = fit.correspondences.target_points[known], registered_map(fit.registration)
        rules = settings.transfer, take.inspection.camera, settings.route.clearance_m
        coarse = None if shown.coarse is None else shown.coarse[index]
        standoff = counted(positions, weight, here, there, carrier, *rules, coarse)
        ratio = standoff.distance(places) / standoff.wanted_m
        ratios.append(ratio[np.isfinite(ratio)])
    off = np.abs(np.concatenate(ratios) - 1)
    return 100 * float(np.mean(off <= _TOLERANCE)) if len(off) else float("nan")


def _seen(takes: Sequence[Take], settings: Settings, truly: bool) -> InspectedSurface:
    """What the takes saw, together: truly, or in the frustum, on the paper's voxel clouds."""
    parts = []
    for take in takes:
        pair, inspection = take.pair, take.inspection
        fit, shown = (pair.surface, inspection.truly) if truly else (pair.voxels, inspection.by_frustum)
        sight = carried_sight(registered_map(pair.surface.registration), settings.transfer)
        parts.append(inspected_surface(fit.source, fit.target, fit.correspondences, shown, sight))
    return InspectedSurface.together(parts)


def measure(
    planned: Trajectory,
    carried: Floats,
    scene: Scene,
    paper: tuple[InspectedSurface, Views],
    true: tuple[InspectedSurface, Views] | None = None,
    attainable: Bools | None = None,
    standing: Floats | None = None,
) -> Measures:
    """Every measure of one planned path.

    Parameters
    ----------
    carried : array, shape (K, 3), m, target frame
        The demonstrated positions after the box transform, turned as the structures are to each
        other: what the path's shape is compared with.
    paper : (InspectedSurface, Views)
        On the voxel clouds with the paper's correspondences, views by `BY_FRUSTUM`.
    true : (InspectedSurface, Views), optional
        On surface samples, views by `TRULY`.
    attainable : array of bool, shape (N,), optional
        Which of those samples some free pose could see.
    standing : array, shape (3, 3), optional
        Turn of the target that makes it stand as the source does: paths are z-scored along its axes.

    Returns
    -------
    Measures
        `standoff_ratio_p50` compares, sample by sample, the nearest view with the demonstration's;
        `incidence_p95_deg` takes for each sample its most frontal view.
    """
    speed, acceleration = peaks(planned)
    axes = np.eye(3) if standing is None else standing
    quality: dict[str, float] = {}
    if true is not None:
        # Median of nearest view over the demonstration's, and 95th percentile of the least incidence.
        inspected, ratio, incidence = true[0], float("nan"), float("nan")
        near, cosine = true[1].nearest(inspected.cloud.points, inspected.cloud.normals)
        used = (inspected.need > 0) & np.isfinite(near)
        if used.any():
            ratio = weighted_percentile(near[used] / inspected.standoff_m[used], inspected.need[used], 50)
        if used.any() and inspected.cloud.normals is not None:
            angle = np.degrees(np.arccos(np.clip(cosine[used], -1, 1)))
            incidence = weighted_percentile(angle, inspected.need[used], 95)
        quality = {
            "coverage_seen_pct": coverage(true[0], true[1].total),
            "standoff_ratio_p50": ratio,
            "incidence_p95_deg": incidence,
        }
        if attainable is not None:
            quality["coverage_attainable_pct"] = coverage(true[0], attainable)
    return Measures(
        coverage_paper_pct=coverage(paper[0], paper[1].total),
        frechet_z=frechet_z(carried @ axes.T, planned.positions @ axes.T, FRECHET),
        frechet_floored=frechet_floored(carried @ axes.T, planned.positions @ axes.T, FRECHET),
        frechet_m=frechet(carried, planned.positions, FRECHET),
        min_clearance_m=path_clearance(scene, planned.positions).distance_m,
        surface_error_m=scene.error_m,
        path_length_m=path_length(planned.positions),
        duration_s=float(planned.t_s[-1] - planned.t_s[0]),
        peak_speed_mps=speed,
        peak_acceleration_mps2=acceleration,
        **quality,
    )


def path_length(positions: Floats) -> float:
    """Length of a polyline, m."""
    return float(leg_lengths(positions).sum())


def peaks(trajectory: Trajectory) -> tuple[float, float]:
    """Largest speed (m/s) and acceleration (m/s^2), Euclidean, by differences of the poses.

    The velocity is that of each leg, the acceleration its change from the middle of one leg to the
    middle of the next: a path flown through a corner without slowing down shows it.
    """
    if len(trajectory) < 2:
        return 0.0, 0.0
    speed = float((leg_lengths(trajectory.positions) / np.diff(trajectory.t_s)).max())
    return speed, float(accelerations(trajectory.t_s, trajectory.positions).max(initial=0.0))
