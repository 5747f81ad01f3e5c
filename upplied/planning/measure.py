"""What a plan is judged by: the same code for every preset and the baseline (algorithm.md, section 8).

Two questions come first. `sought`: which points of the target answer for what the demonstration saw?
`views`: which points does a planned path see? `measure` then compares them, and the paths themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from upplied.config import VisibilitySettings
from upplied.planning.clearance import path_clearance
from upplied.planning.frechet import frechet, frechet_z
from upplied.planning.nearness import nearest, nearest_views
from upplied.planning.visibility import visible
from upplied.poses import angle_between, interpolate
from upplied.records import (
    Bools,
    Camera,
    Cloud,
    Correspondences,
    Floats,
    Measures,
    Record,
    SurfaceStates,
    Trajectory,
)
from upplied.scene import Scene

#: What `coverage_paper_pct` calls seen (paper, Sec. III-C), whatever the preset.
BY_FRUSTUM = VisibilitySettings(occlusion=False)
#: What `coverage_seen_pct` calls seen, whatever the preset.
TRULY = VisibilitySettings(occlusion=True, max_incidence_deg=75.0)

_STEP_M, _STEP_RAD = 0.5, np.radians(3.0)  # between the poses that are asked what they see
_MOST = 3000


@dataclass(frozen=True, eq=False, repr=False)
class Views(Record):
    """What a path sees of a cloud, asked at closely spaced poses."""

    stations: Trajectory  # P poses
    seen: Bools  # (P, N)

    @property
    def total(self) -> Bools:
        """(N,) seen from any pose."""
        return np.asarray(self.seen.any(axis=0), bool)


@dataclass(frozen=True, eq=False, repr=False)
class Sought(Record):
    """What a target path should see, since the demonstration saw its counterpart."""

    cloud: Cloud  # N points of the target
    need: Floats  # (N,) how much demonstrated surface each answers for: m^2, or points; 0: none
    standoff_m: Floats  # (N,) from how near the demonstration saw that surface, carried; NaN where need is 0
    without_pct: float  # share of what the demonstration saw that has no counterpart: in no coverage


def stations(trajectory: Trajectory, most: int = _MOST) -> Trajectory:
    """Closely spaced poses of a trajectory: its own, and between them every half metre or 3 degrees.

    Where that is more than `most`, the spacing grows; a trajectory with more poses than that is
    thinned evenly, so that what is found to be seen is never more than what is seen.
    """
    if len(trajectory) < 2:
        return trajectory
    progress = np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1) / _STEP_M
    progress += angle_between(trajectory.quat_xyzw[:-1], trajectory.quat_xyzw[1:]) / _STEP_RAD
    if len(trajectory) >= most:
        along = np.concatenate([[0.0], np.cumsum(progress + 1e-9)])
        chosen = np.searchsorted(along, np.linspace(0, along[-1], most), side="left")
        chosen = np.unique(np.clip(chosen, 0, len(trajectory) - 1))
        return Trajectory(trajectory.t_s[chosen], trajectory.positions[chosen], trajectory.quat_xyzw[chosen])
    coarseness = max(1.0, float(progress.sum()) / (most - len(trajectory)))
    pieces = np.maximum(np.ceil(progress / coarseness - 1e-9).astype(int), 1)
    legs = np.repeat(np.arange(len(pieces)), pieces)
    part = (np.arange(len(legs)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[legs]
    times = trajectory.t_s[legs] + part * np.diff(trajectory.t_s)[legs]
    return interpolate(trajectory, np.append(times, trajectory.t_s[-1]))


def views(
    trajectory: Trajectory,
    cloud: Cloud,
    camera: Camera,
    settings: VisibilitySettings,
    scene: Scene | None = None,
) -> Views:
    """What a trajectory sees of a cloud on its whole way; ask a demonstration in the same manner.

    Parameters
    ----------
    trajectory : Trajectory
    cloud : Cloud
    camera : Camera
    settings : VisibilitySettings
        `BY_FRUSTUM` or `TRULY` for the measures.
    scene : Scene, optional
    """
    asked = stations(trajectory)
    return Views(asked, visible(asked.positions, asked.quat_xyzw, cloud, camera, settings, scene).seen)


def sought(
    source: Cloud,
    target: Cloud,
    correspondences: Correspondences,
    demonstrated: Views,
    carry: Floats | None = None,
) -> Sought:
    """Which target points answer for what the demonstration saw, and for how much of it.

    Parameters
    ----------
    source, target : Cloud
        Both of one sort: the paper's voxel clouds, where every point counts 1, or surface samples,
        which count by the demonstrated area.
    correspondences : Correspondences
        From `source` to `target`; points without a counterpart are left out and reported.
    demonstrated : Views
        Of `source`.
    carry : array, shape (3, 3), optional
        How a line of sight is carried to the target where stand-offs scale with the structure.
    """
    weight = np.ones(len(source)) if source.area_m2 is None else source.area_m2
    seen = demonstrated.total
    paired = seen & (correspondences.target_index >= 0)
    index, number = correspondences.target_index[paired], len(target)
    need: Floats = np.bincount(index, weights=weight[paired], minlength=number).astype(float)
    jacobian = np.eye(3) if carry is None else carry
    near = nearest(
        np.ascontiguousarray(demonstrated.stations.positions @ jacobian.T),
        np.ascontiguousarray((source.points @ jacobian.T).T),
        demonstrated.seen,
    )
    with np.errstate(invalid="ignore"):
        standoff = np.bincount(index, weights=(weight * near)[paired], minlength=number) / need
    all_seen = float(weight[seen].sum())
    without = 100 * float(weight[seen & ~paired].sum()) / all_seen if all_seen else 0.0
    return Sought(target, need, standoff, without)


def together(parts: Sequence[Sought]) -> Sought:
    """What several flights over one target should see, each adding its need."""
    if len(parts) == 1:
        return parts[0]
    needs = np.array([part.need for part in parts])
    need = needs.sum(axis=0)
    distances = np.where(needs > 0, [part.standoff_m for part in parts], 0.0)
    with np.errstate(invalid="ignore"):
        standoff = (distances * needs).sum(axis=0) / need
    without = float(np.average([part.without_pct for part in parts], weights=needs.sum(axis=1) + 1e-12))
    return Sought(parts[0].cloud, need, standoff, without)


def coverage(sought: Sought, seen: Bools) -> float:
    """Share, in percent, of the demonstrated surface whose counterpart is in `seen` (N,); NaN if none was."""
    whole = float(sought.need.sum())
    missed = float(sought.need[~seen].sum())  # exactly 0, and so exactly 100 %, where nothing is missed
    return 100 * (1 - missed / whole) if whole > 0 else float("nan")


def measure(
    planned: Trajectory,
    carried: Floats,
    scene: Scene,
    paper: tuple[Sought, Views],
    true: tuple[Sought, Views] | None = None,
    attainable: Bools | None = None,
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
    paper : (Sought, Views)
        On the voxel clouds with the paper's correspondences, views by `BY_FRUSTUM`.
    true : (Sought, Views), optional
        On surface samples, views by `TRULY`.
    attainable : array of bool, shape (N,), optional
        Which of those samples some free pose could see.

    Returns
    -------
    Measures
        `standoff_ratio_p50` compares, sample by sample, the nearest view with the demonstration's;
        `incidence_p95_deg` takes for each sample its most frontal view.
    """
    speed, acceleration = peaks(planned)
    found: dict[str, float] = {}
    if true is not None:
        ratio, incidence = _view_quality(*true)
        found = {
            "coverage_seen_pct": coverage(true[0], true[1].total),
            "standoff_ratio_p50": ratio,
            "incidence_p95_deg": incidence,
        }
        if attainable is not None:
            found["coverage_attainable_pct"] = coverage(true[0], attainable)
    return Measures(
        coverage_paper_pct=coverage(paper[0], paper[1].total),
        frechet_z=frechet_z(carried, planned.positions),
        frechet_m=frechet(carried, planned.positions),
        min_clearance_m=path_clearance(scene, planned.positions).distance_m,
        path_length_m=path_length(planned.positions),
        duration_s=float(planned.t_s[-1] - planned.t_s[0]),
        peak_speed_mps=speed,
        peak_acceleration_mps2=acceleration,
        **found,
    )


def path_length(positions: Floats) -> float:
    """Length of a polyline, m."""
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())


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


def surface_states(sought: Sought, seen: Bools, attainable: Bools | None = None) -> SurfaceStates:
    """What became of each sample of the target: other, seen, missed or unattainable."""
    state = np.zeros(len(sought.need), np.int64)
    wanted = sought.need > 0
    state[wanted] = 2
    if attainable is not None:
        state[wanted & ~attainable] = 3
    state[wanted & seen] = 1
    return SurfaceStates(sought.cloud.points, state, sought.cloud.normals)


def _view_quality(sought: Sought, views: Views) -> tuple[float, float]:
    """Median of nearest view over the demonstration's, and 95th percentile of the least incidence."""
    normals = sought.cloud.normals
    near, cosine = nearest_views(
        np.ascontiguousarray(views.stations.positions),
        np.ascontiguousarray(sought.cloud.points),
        np.zeros((len(sought.need), 3)) if normals is None else np.ascontiguousarray(normals),
        views.seen,
    )
    used = (sought.need > 0) & np.isfinite(near)
    if not used.any():
        return float("nan"), float("nan")
    ratio = float(_weighted_percentile(near[used] / sought.standoff_m[used], sought.need[used], 50))
    if normals is None:
        return ratio, float("nan")
    angle = np.degrees(np.arccos(np.clip(cosine[used], -1, 1)))
    return ratio, float(_weighted_percentile(angle, sought.need[used], 95))


def _weighted_percentile(values: Floats, weights: Floats, percent: float) -> float:
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order]) / weights.sum()
    rank = int(np.searchsorted(share, percent / 100))
    return float(values[order][min(rank, len(values) - 1)])
