"""The shortest safe flight that shows what a flight left out, from viewpoints of its own plan.

Viewpoints are chosen among the poses of the plan, those that look from as near, as frontally and as finely as
the plan itself did at each place, and put in the order of a short way (`tour`) by the safe legs that join
them. Zone surface that those poses do not show as required has poses of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.config import InspectionSettings, RetimeSettings, VisibilitySettings
from upplied.errors import RefusedError
from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.poses import from_yaw_pitch, in_a_row, look_at, yaw_pitch
from upplied.planning.airspace.roadmap import Roadmap, links
from upplied.planning.measures.attainable import seen_from
from upplied.planning.visibility.line_of_sight import visible
from upplied.planning.visibility.looks import sampled_m
from upplied.planning.visibility.observations import TRULY, stations
from upplied.proof.inspected import narrowed
from upplied.proof.tour import STANDING_M, Toured, toured
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Trajectory

_STATIONS = 500  # poses of the plan, at most, that viewpoints are chosen from
_FARTHER, _ASLANT_DEG = 1.1, 5.0  # than the plan's own look at a place, that still counts as planned
_COARSER = 1.05  # than its finest look: a flight strays, and 1.1 is inspected as planned
_LOOKS = 3  # of the plan at each place that are matched: the nearest, the most frontal, the finest
_CREEPING_MPS = 0.1
_STEADY = 0.8  # of the motion that is still sharp, that a picture is planned with: a vehicle is unsteady
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


@dataclass(frozen=True, eq=False, repr=False)
class GapFlight(Toured):
    """A flight that shows what was left out."""

    shows: Bools  # (S,) of the samples, those that are missing and that it shows
    unattainable: Bools  # (S,) of the samples, those that are missing and that no pose of the plan shows
    zones: tuple[tuple[Bools, Bools], ...]  # (M,) of each zone's samples: shown, and unattainable


def gap_flight(
    plan: Trajectory, surface: Cloud, missing: Bools, camera: Camera, graph: Roadmap, limits: RetimeSettings,
    zones: Sequence[ZoneGap] = (), rule: InspectionSettings | None = None,
) -> GapFlight:  # fmt: skip
    """The flight that shows the missing samples (S,), and what is missing of zones.

    Refused if nothing is missing, no safe pose shows any of it, or no safe way joins the poses. The plan was
    to show the samples; the roadmap has the required clearance. Zones are what no flight shows of them as
    required, whether the plan shows it or not; the rule says how sharp pictures at viewpoints must be.
    """
    if not missing.any() and not zones:
        raise RefusedError("the gap", "is empty: the flight showed all that was required")
    poses, every = (
        along.take(graph.airspace.allowed(along.positions))
        for along in (stations(plan, _STATIONS), stations(plan))
    )
    part = np.flatnonzero(missing)
    parts = [Part(Cloud(surface.points[part], surface.outward[part]), camera)]
    parts += [zone.part(camera) for zone in zones]
    usual_m = float(np.median(graph.airspace.scene.distance(poses.positions))) if zones and len(poses) else 0
    looks, best = _planned_looks(parts[0], every, graph)
    lacking = ~_shown(parts[0], poses, looks, graph).any(axis=0)
    if len(every) and lacking.any():  # a look that so many poses miss
        poses = in_a_row([poses, every.take(np.unique(best[lacking]))])
    shown = _shown(parts[0], poses, looks, graph)
    for one in parts[1:]:
        poses = in_a_row([poses, poses_for(one, poses, graph, limits, usual_m)])
    others = np.zeros((len(poses) - len(shown), shown.shape[1]), bool)  # what was planned is shown as planned
    seen = np.hstack([np.vstack([shown, others]), *(one.well(poses, graph) for one in parts[1:])])
    if not seen.any():
        areas = "".join(f"; {zone.cloud.areas.sum():.1f} m2 of zone {zone.zone}" for zone in zones)
        remedy = "plan the structure again" + (", or lower the requirements of the zone" if zones else "")
        raise RefusedError("the gap", f"is not visible from any safe pose{areas}", "", remedy)
    tour = toured(poses, seen, graph, plan, limits, lambda some: _sharp_pace(parts[0], some, graph, rule))
    shows, unattainable = np.zeros(len(missing), bool), np.zeros(len(missing), bool)
    along = stations(tour.trajectory)
    again = _as_planned(parts[0], along, parts[0].seen(along, graph), looks)
    flown = [_all(np.asarray(again.any(axis=0), bool))]
    flown += [np.asarray(one.seen(along, graph).any(axis=0), bool) for one in parts[1:]]
    cannot = np.split(~tour.covered, np.cumsum([shown.shape[1], *(len(one.cloud) for one in parts[1:])])[:-1])
    cannot[0] = ~_all(~cannot[0])
    both = [(seen, none & ~seen) for seen, none in zip(flown, cannot, strict=True)]
    shows[part], unattainable[part] = both[0]
    return GapFlight(**vars(tour), shows=shows, unattainable=unattainable, zones=tuple(both[1:]))


def _planned_looks(part: Part, plan: Trajectory, graph: Roadmap) -> tuple[Floats, Ints]:
    """What the plan's nearest, most frontal and finest look at each sample reach, (5, M), in m and deg."""
    # A sample that the plan does not see requires nothing. The poses of those looks are returned too, (3 M,).
    count = len(part.cloud)
    if not len(plan):
        return np.full((5, count), np.inf), np.zeros(_LOOKS * count, np.int64)
    values = _looks(part, plan)
    distance, angle, finest = values
    unseen = ~part.seen(plan, graph)
    best = [np.where(unseen, np.inf, value).argmin(axis=0) for value in values]
    at = np.arange(count)
    looks = [value[pose, at] for pose in best[:2] for value in (distance, angle)] + [finest[best[2], at]]
    return np.where(unseen.all(axis=0), np.inf, looks), np.concatenate(best)


def _shown(part: Part, poses: Trajectory, looks: Floats, graph: Roadmap) -> Bools:
    """Which poses (P, 3 M) show each sample as planned, at the rim of the picture what is nowhere else."""
    well = _as_planned(part, poses, part.well(poses, graph), looks)
    rim = _as_planned(part, poses, part.seen(poses, graph), looks)
    return np.asarray(well | (rim & ~well.any(axis=0)), bool)


def _as_planned(part: Part, poses: Trajectory, seen: Bools, looks: Floats) -> Bools:
    """Which poses show each sample as the plan's nearest, most frontal and finest look did, (P, 3 M)."""
    distance, angle, sampled = _looks(part, poses)
    ways = [(distance <= _FARTHER * looks[at]) & (angle <= looks[at + 1] + _ASLANT_DEG) for at in (0, 2)]
    return np.concatenate([seen & way for way in (*ways, sampled <= _COARSER * looks[4])], axis=1)


def _looks(part: Part, poses: Trajectory) -> tuple[Floats, Floats, Floats]:
    """Distance, m, angle from the normal, deg, and what a pixel covers over its angle, m, (P, M)."""
    normal = part.cloud.outward
    ray = part.cloud.points[None] - poses.positions[:, None]
    distance = np.maximum(np.linalg.norm(ray, axis=2), 1e-12)
    cosine = np.clip(-(ray * normal[None]).sum(axis=2) / distance, -1, 1)
    return distance, np.degrees(np.arccos(cosine)), sampled_m(distance, cosine)


def _all(flags: Bools) -> Bools:
    """Of flags (3 M,) for one way of looking after the other, where all are set, (M,)."""
    return np.asarray(flags.reshape(_LOOKS, -1).all(axis=0), bool)


def square_metres(cloud: Cloud, part: Bools) -> float:
    """Area of some samples of a cloud, m2."""
    return float(cloud.areas[part].sum())


def _sharp_pace(part: Part, chosen: Trajectory, graph: Roadmap, rule: InspectionSettings | None) -> Floats:
    """How fast each of some poses (K,) may be passed, m/s, so that the picture of what it shows is sharp."""
    camera, rule = part.camera, rule or InspectionSettings()
    sharp = _STEADY * rule.sharp_radps(camera.hfov_deg, camera.width_px, camera.exposure_s)
    seen = part.seen(chosen, graph)
    most = np.full(len(chosen), np.inf)
    for first, last in pairwise(range(len(chosen))):
        step = chosen.positions[last] - chosen.positions[first]
        length = max(float(np.linalg.norm(step)), STANDING_M)
        turns = Rotation.from_quat(chosen.quat_xyzw[[first, last]])
        turn = (turns[1] * turns[0].inv()).as_rotvec() / length
        for pose in (first, last):
            ray = part.cloud.points[seen[pose]] - chosen.positions[pose]
            distance = np.maximum(np.linalg.norm(ray, axis=1, keepdims=True), 1e-9)
            sight, ahead = ray / distance, step / length
            moved = np.cross(turn, sight) + (ahead - (sight @ ahead)[:, None] * sight) / distance
            per_m = float(np.linalg.norm(moved, axis=1).max(initial=1e-9))
            most[pose] = min(most[pose], sharp / per_m)
    return np.maximum(most, _CREEPING_MPS)
