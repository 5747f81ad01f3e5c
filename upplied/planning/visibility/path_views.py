"""What a path sees of a cloud on its whole way: asked at closely spaced poses, of flights and plans alike."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from upplied.config import VisibilitySettings
from upplied.planning.visibility.frustum import coarseness
from upplied.planning.visibility.line_of_sight import visible
from upplied.polylines import cumulated, leg_lengths
from upplied.poses import angle_between, interpolate
from upplied.records import Bools, Camera, Cloud, Floats, Record, Trajectory
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
    # (P,) what distances are to be taken times, so that zooms compare (`frustum.coarseness`)
    coarse: Floats | None = field(default=None, metadata={"later": True})

    @property
    def coarseness(self) -> Floats:
        """(P,) the same; ones where the camera does not zoom."""
        return np.ones(len(self.stations)) if self.coarse is None else self.coarse

    @property
    def total(self) -> Bools:
        """(N,) seen from any pose."""
        return np.asarray(self.seen.any(axis=0), bool)


def stations(trajectory: Trajectory, most: int = _MOST) -> Trajectory:
    """Closely spaced poses of a trajectory: its own, and between them every half metre or 3 degrees.

    Where that is more than `most`, the spacing grows; a trajectory with more poses than that is
    thinned evenly, so that what is found to be seen is never more than what is seen.
    """
    if len(trajectory) < 2:
        return trajectory
    progress = leg_lengths(trajectory.positions) / _STEP_M
    progress += angle_between(trajectory.quat_xyzw[:-1], trajectory.quat_xyzw[1:]) / _STEP_RAD
    if len(trajectory) >= most:
        along = cumulated(progress + 1e-9)
        chosen = np.searchsorted(along, np.linspace(0, along[-1], most), side="left")
        chosen = np.unique(np.clip(chosen, 0, len(trajectory) - 1))
        return trajectory.take(chosen)
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
    seen = visible(
        asked.positions, asked.quat_xyzw, cloud, camera, settings, scene, fov_deg=asked.fov_deg
    ).seen
    return Views(asked, seen, coarseness(camera, asked.fov_deg))
