"""What a plan is judged by: the same code for every preset and the baseline.

Two questions come first. `carry.inspected_surface`: which points of the target correspond to what the
demonstration saw, and for what it was about?
`visibility.observations`: which points does a planned path see? `measure` compares them, and the paths;
`shown_of` says what of the inspected surface is shown at least as well as the expert did.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from upplied.config import Settings
from upplied.geometry.polylines import accelerations, leg_lengths
from upplied.geometry.scene import Scene
from upplied.planning.airspace.detours import airspace_of
from upplied.planning.airspace.rules import path_clearance
from upplied.planning.carry.inspected_surface import (
    InspectedSurface,
    coverage,
    inspected_by,
    inspected_surface,
    target_attention,
)
from upplied.planning.demonstration.repetition import Take, look_limits
from upplied.planning.geometry.clouds import weighted_percentile
from upplied.planning.geometry.frechet import frechet, frechet_floored, frechet_z
from upplied.planning.measures.attainable import attainable_beside
from upplied.planning.visibility.observations import Views
from upplied.records import (
    Bools,
    Floats,
    Measures,
    Record,
    SurfaceStates,
    Trajectory,
)

FRECHET = 1e-4  # of the distances of paths, to which they are known: a decision fewer for each half of it


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
    planned : Trajectory
        M poses, target frame.
    carried : array, shape (K, 3), m, target frame
        The demonstrated positions after the box transform, turned as the structures are to each
        other: what the path's shape is compared with.
    scene : Scene
        Of the target.
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
        ratio, incidence = _view_quality(*true)
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


def _view_quality(inspected: InspectedSurface, views: Views) -> tuple[float, float]:
    """Median of nearest view over the demonstration's, and 95th percentile of the least incidence."""
    normals = inspected.cloud.normals
    near, cosine = views.nearest(inspected.cloud.points, normals)
    used = (inspected.need > 0) & np.isfinite(near)
    if not used.any():
        return float("nan"), float("nan")
    ratio = weighted_percentile(near[used] / inspected.standoff_m[used], inspected.need[used], 50)
    if normals is None:
        return ratio, float("nan")
    angle = np.degrees(np.arccos(np.clip(cosine[used], -1, 1)))
    return ratio, weighted_percentile(angle, inspected.need[used], 95)


@dataclass(frozen=True, eq=False, repr=False)
class Shown(Record):
    """The inspected surface on the target, and what became of it."""

    inspected: InspectedSurface
    as_well: Bools  # (N,) of the target's samples: shown at least as well as is asked
    never: Bools  # (N,) asked for, and no allowed camera could
    attention: Floats  # (N,) attention, 0 to 1, of what each target sample corresponds to, asked for or not


def shown_of(planned: Views, takes: Sequence[Take], settings: Settings) -> Shown:
    """What a plan shows at least as well as the demonstration, in one look each.

    A look does where it is near enough, frontal enough, and slow enough to be sharp. Target surface that
    corresponds to inspected surface without being anybody's nearest counterpart is judged like its neighbour.

    Parameters
    ----------
    planned : Views
        What the plan truly sees of the target's surface samples.
    takes : sequence of Take
    settings : Settings
    """
    pair, rule = takes[0].pair, settings.inspection
    inspected = InspectedSurface.together([inspected_by(take, settings) for take in takes])
    cloud = inspected.cloud
    attention, like = target_attention(takes, inspected)
    wanted_m = np.where(np.isfinite(inspected.standoff_m), inspected.standoff_m, inspected.standoff_m[like])
    farthest = wanted_m / rule.least_resolution
    as_well = planned.shown_well(cloud, farthest, *look_limits(takes, rule))
    missed = np.flatnonzero((inspected.need > 0) & ~as_well)
    never = np.zeros(len(cloud), bool)
    camera, airspace = takes[0].inspection.camera, airspace_of(pair, settings)
    never[missed] = ~attainable_beside(missed, cloud, airspace, camera, farthest)
    return Shown(inspected, as_well, never, attention)


def inspected_measures(shown: Shown, planned: Views, takes: Sequence[Take]) -> dict[str, float]:
    """The coverages of the inspected surface, there and back, and of what else was seen."""
    inspected, cloud = shown.inspected, shown.inspected.cloud
    area = cloud.areas
    attended = area * shown.attention
    whole = float(attended.sum())
    rest = [
        inspected_surface(
            take.pair.surface.source,
            take.pair.surface.target,
            take.pair.surface.correspondences,
            take.inspection.truly,
            weight=1 - take.inspection.attention.weight,
        )
        for take in takes
    ]
    nan = float("nan")
    return {
        "coverage_inspected_pct": coverage(inspected, shown.as_well, whole=True),
        "inspected_without_counterpart_pct": inspected.without_pct,
        "inspected_unattainable_pct": (
            100 * float(inspected.need[shown.never].sum()) / inspected.whole if inspected.whole > 0 else nan
        ),
        "coverage_of_target_pct": (100 * float(attended[shown.as_well].sum()) / whole if whole > 0 else nan),
        "coverage_context_pct": coverage(InspectedSurface.together(rest), planned.total),
    }


def surface_states(shown: Shown) -> SurfaceStates:
    """What became of each sample of the target: other, shown, missed or unattainable.

    Of what is missed as much area counts as the share of the need that is missed, the densest need first:
    a rim that hardly matters to the coverage does not look like a hole in it.
    """
    need, cloud = shown.inspected.need, shown.inspected.cloud
    well = shown.as_well & ((need > 0) | (shown.attention > 0.5))
    lost = np.flatnonzero((need > 0) & ~shown.as_well)
    lost = lost[np.argsort(-need[lost] / cloud.areas[lost], kind="stable")]
    painted = np.cumsum(cloud.areas[lost])
    missed = lost[painted * need[well].sum() <= need[lost].sum() * cloud.areas[well].sum()]
    state = np.zeros(len(need), np.int64)
    state[well] = 1
    state[missed] = np.where(shown.never[missed], 3, 2)
    return SurfaceStates(cloud.points, state, cloud.normals)
