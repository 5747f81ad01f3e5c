"""What a plan is judged by: the same code for every preset and the baseline.

Two questions come first. `carry.inspected_surface`: which points of the target correspond to what the
demonstration saw, and for what it was about?
`visibility.path_views`: which points does a planned path see? `measure` compares them, and the paths.
"""

from __future__ import annotations

import numpy as np

from upplied.planning.airspace.clearance import path_clearance
from upplied.planning.carry.inspected_surface import InspectedSurface, coverage
from upplied.planning.geometry.frechet import frechet, frechet_floored, frechet_z
from upplied.planning.geometry.percentile import weighted_percentile
from upplied.planning.visibility.path_views import Views
from upplied.planning.visibility.view_quality import nearest_views
from upplied.polylines import leg_lengths
from upplied.records import (
    Bools,
    Floats,
    Measures,
    Trajectory,
)
from upplied.scene import Scene

_FRECHET = 1e-4  # of the distances of paths, to which they are known: a decision fewer for each half of it


def measure(
    planned: Trajectory,
    carried: Floats,
    scene: Scene,
    paper: tuple[InspectedSurface, Views],
    true: tuple[InspectedSurface, Views] | None = None,
    attainable: Bools | None = None,
    standing: Floats | None = None,
    added: Bools | None = None,
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
    added : array of bool, shape (M,), optional
        Which poses belong to passes that were added: the rest is compared with the demonstrated path.

    Returns
    -------
    Measures
        `standoff_ratio_p50` compares, sample by sample, the nearest view with the demonstration's;
        `incidence_p95_deg` takes for each sample its most frontal view.
    """
    speed, acceleration = peaks(planned)
    axes = np.eye(3) if standing is None else standing
    found: dict[str, float] = {}
    demonstrated = planned.positions if added is None else planned.positions[~added]
    if true is not None:
        ratio, incidence = _view_quality(*true)
        found = {
            "coverage_seen_pct": coverage(true[0], true[1].total),
            "standoff_ratio_p50": ratio,
            "incidence_p95_deg": incidence,
        }
        if attainable is not None:
            found["coverage_attainable_pct"] = coverage(true[0], attainable)
    by_shape = frechet_z(carried @ axes.T, demonstrated @ axes.T, _FRECHET)
    return Measures(
        coverage_paper_pct=coverage(paper[0], paper[1].total),
        frechet_z=by_shape,
        frechet_floored=frechet_floored(carried @ axes.T, demonstrated @ axes.T, _FRECHET),
        frechet_m=frechet(carried, demonstrated, _FRECHET),
        frechet_whole_z=(
            by_shape if added is None else frechet_z(carried @ axes.T, planned.positions @ axes.T, _FRECHET)
        ),
        added_s=0.0 if added is None else float(np.diff(planned.t_s)[added[1:]].sum()),
        min_clearance_m=path_clearance(scene, planned.positions).distance_m,
        surface_error_m=scene.error_m,
        path_length_m=path_length(planned.positions),
        duration_s=float(planned.t_s[-1] - planned.t_s[0]),
        peak_speed_mps=speed,
        peak_acceleration_mps2=acceleration,
        **found,
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
    step = np.diff(trajectory.t_s)
    velocity = np.diff(trajectory.positions, axis=0) / step[:, None]
    speed = float(np.linalg.norm(velocity, axis=1).max())
    if len(step) < 2:
        return speed, 0.0
    change = np.diff(velocity, axis=0) / ((step[1:] + step[:-1]) / 2)[:, None]
    return speed, float(np.linalg.norm(change, axis=1).max())


def _view_quality(inspected: InspectedSurface, views: Views) -> tuple[float, float]:
    """Median of nearest view over the demonstration's, and 95th percentile of the least incidence."""
    normals = inspected.cloud.normals
    near, cosine = nearest_views(
        np.ascontiguousarray(views.stations.positions),
        np.ascontiguousarray(inspected.cloud.points),
        np.zeros((len(inspected.need), 3)) if normals is None else np.ascontiguousarray(normals),
        views.seen,
        np.ascontiguousarray(views.coarseness),
    )
    used = (inspected.need > 0) & np.isfinite(near)
    if not used.any():
        return float("nan"), float("nan")
    ratio = weighted_percentile(near[used] / inspected.standoff_m[used], inspected.need[used], 50)
    if normals is None:
        return ratio, float("nan")
    angle = np.degrees(np.arccos(np.clip(cosine[used], -1, 1)))
    return ratio, weighted_percentile(angle, inspected.need[used], 95)
