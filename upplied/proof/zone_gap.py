"""Zone surface that no flight shows as required, and the safe poses that a flight may show it from."""

from dataclasses import dataclass, replace

import numpy as np

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.poses import from_yaw_pitch, in_a_row, look_at, yaw_pitch
from upplied.planning.airspace.roadmap import Roadmap, links
from upplied.planning.measures.attainable import seen_from
from upplied.planning.visibility.line_of_sight import visible
from upplied.planning.visibility.observations import TRULY
from upplied.proof.inspected import narrowed
from upplied.records import Bools, Camera, Cloud, Floats, Record, Trajectory

_AT_A_TIME = 60  # patches that poses are set before; what those show as well needs none of its own
_MARGIN_DEG = 4.0  # of the picture, at each rim, that a flight in wind may lose


@dataclass(frozen=True, eq=False, repr=False)
class Part(Record):
    """Samples that are missing, and the looks that count as showing them."""

    cloud: Cloud  # M samples with normals
    camera: Camera  # its range is no farther than is required
    rule: VisibilitySettings = TRULY
    farthest_m: float = np.inf  # distance over the cosine of the incidence, for the required detail

    def seen(self, poses: Trajectory, graph: Roadmap, camera: Camera | None = None) -> Bools:
        """Which poses (P, M) show each sample; none does where the camera is not sharp so near."""
        if self.camera.max_range_m <= self.camera.min_range_m:
            return np.zeros((len(poses), len(self.cloud)), bool)
        where = poses.positions, poses.quat_xyzw, self.cloud, camera or self.camera
        seen = visible(*where, self.rule, graph.airspace.scene).seen
        pose, sample = np.nonzero(seen) if np.isfinite(self.farthest_m) else (np.zeros(0, np.int64),) * 2
        ray = poses.positions[pose] - self.cloud.points[sample]
        away2, frontal = (ray**2).sum(axis=1), (ray * self.cloud.outward[sample]).sum(axis=1)
        seen[pose, sample] = away2 <= self.farthest_m * frontal
        return seen

    def well(self, poses: Trajectory, graph: Roadmap) -> Bools:
        """Which poses (P, M) show each sample well inside the picture; at its rim what is nowhere else."""
        well = self.seen(poses, graph, narrowed(self.camera, _MARGIN_DEG))
        if not (rim := ~well.any(axis=0)).any():
            return well
        return well | (self.seen(poses, graph) & rim)


@dataclass(frozen=True, eq=False, repr=False)
class ZoneGap(Record):
    """What is missing of a zone."""

    zone: str  # its name
    cloud: Cloud  # M samples with normals and areas
    farthest_m: float = np.inf  # of a frontal look, for the required detail
    incidence_deg: float = 90.0  # from the normal, at most

    def part(self, camera: Camera) -> Part:
        """The samples with the looks that count; a zone never requires less than what counts as seen."""
        most = min(self.incidence_deg, TRULY.max_incidence_deg)
        near = replace(camera, max_range_m=min(camera.max_range_m, self.farthest_m))
        return Part(self.cloud, near, replace(TRULY, max_incidence_deg=most), self.farthest_m)


def poses_for(
    part: Part, known: Trajectory, graph: Roadmap, limits: RetimeSettings, usual_m: float
) -> Trajectory:
    """Safe poses beside the known ones that show what those do not.

    Each looks at a sample as near and as frontally as required: from the most frontal place that sees it, and
    on the same ray from the distance `usual_m` of the plan. The limits are those of the gimbal's pitch.
    """
    left: Bools = np.asarray(~part.well(known, graph).any(axis=0), bool)
    new_poses = known.take(np.zeros(0, np.int64))
    low, high = limits.min_gimbal_pitch_deg, limits.max_gimbal_pitch_deg
    rim = max(part.camera.vfov_deg / 2 - _MARGIN_DEG, 0.0)  # above and below the middle of the picture
    pitch = max(low - rim, -90.0), min(high + rim, 90.0)
    places = np.full((len(left), 3), np.nan)
    if left.any():
        rest = Cloud(part.cloud.points[left], part.cloud.outward[left])
        places[left] = seen_from(rest, graph.airspace, part.camera, part.rule, pitch_deg=pitch)
    left &= np.isfinite(places[:, 0])
    while left.any():
        open_ = np.flatnonzero(left)
        tried = open_[chosen_evenly(len(open_), _AT_A_TIME)]
        new = _before(part.cloud.points[tried], places[tried], part.camera, usual_m, (low, high))
        new = new.take(graph.airspace.allowed(new.positions))
        new = new.take(np.array([len(links(graph, place)) > 0 for place in new.positions], bool))
        if len(new):
            left &= ~part.well(new, graph).any(axis=0)
            new_poses = in_a_row([new_poses, new])
        left[tried] = False
    return new_poses


def _before(
    points: Floats, places: Floats, camera: Camera, usual_m: float, pitch_deg: tuple[float, float]
) -> Trajectory:
    """Poses that look at points from places, and from the usual distance on the same rays."""
    ray = places - points
    away = np.linalg.norm(ray, axis=1, keepdims=True)
    usual = np.clip(usual_m, camera.min_range_m * 1.001, camera.max_range_m * 0.999)
    both = np.concatenate([places, points + ray / away * usual])
    yaw, pitch = yaw_pitch(look_at(both, np.concatenate([points, points])))
    quats = from_yaw_pitch(yaw, np.clip(pitch, *np.radians(pitch_deg)))
    return Trajectory(np.arange(len(both), dtype=float), both, quats)
