"""Zones that must be seen: whether they were shown as required, and safe poses that show what was not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from upplied.config import RetimeSettings, VisibilitySettings, focal_px
from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.poses import from_yaw_pitch, in_a_row, look_at, yaw_pitch
from upplied.planning.airspace.roadmap import Roadmap, links
from upplied.planning.measures.attainable import seen_from
from upplied.planning.visibility.line_of_sight import visible
from upplied.planning.visibility.observations import TRULY
from upplied.proof.inspected import narrowed
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Trajectory

_AT_A_TIME = 60  # patches that poses are set before; what those show as well needs none of its own
_MARGIN_DEG = 4.0  # of the picture, at each rim, that a flight in wind may lose


@dataclass(frozen=True)
class Demand:
    """A zone that must be seen, and how."""

    zone: str  # its name
    where: str  # landmarks, part_0, or "box X Y Z X Y Z" (m), separated by commas
    on: str = ""  # the structure that the place is on, and is carried from; empty: each structure itself
    looks: int = 1  # pictures that show each patch, at least; all other limits hold for one of them
    gsd_mm: float | None = None  # a pixel covers this much of the surface at most
    incidence_deg: float | None = None  # from the normal, at most
    max_age_days: float | None = None  # of a look, at most


@dataclass(frozen=True, eq=False, repr=False)
class Looked(Record):
    """How each of N patches was seen at one time; NaN where it was not."""

    distance_m: Floats  # (N,)
    incidence_deg: Floats  # (N,)
    age_days: float  # of the looks; 0 for what is planned
    camera: Camera
    pictures: Ints | None = None  # (N,) that show it; None: one where it was seen, more are not known
    more: tuple[tuple[Floats, Floats], ...] = ()  # distance and incidence (N,) of other looks then

    @property
    def each(self) -> list[tuple[Floats, Floats]]:
        """Distance and incidence of every look that is known."""
        return [(self.distance_m, self.incidence_deg), *self.more]


@dataclass(frozen=True)
class ZoneVerdict:
    """What became of a zone."""

    status: str  # "met", "missed" or "unattainable"
    shown_pct: float  # of what could be seen of it; NaN where nothing could
    why: str  # empty where it is met


def judged(demand: Demand, zone: Bools, attainable: Bools, looks: Sequence[Looked]) -> ZoneVerdict:
    """Judge a zone by all looks at it; each patch must be shown by one look within every limit.

    Where more than one look is required, as many pictures that are young enough must show it.

    Parameters
    ----------
    demand : Demand
    zone : array of bool, shape (N,)
        Patches of the zone.
    attainable : array of bool, shape (N,)
        Patches that some safe camera can see at all; the others are reported and do not count.
    looks : sequence of Looked
    """
    required = zone & attainable
    if not zone.any():
        return ZoneVerdict("unattainable", float("nan"), "it has no counterpart here")
    if not required.any():
        return ZoneVerdict("unattainable", float("nan"), "no safe viewpoint shows any of it")
    beyond = 100 * float((zone & ~attainable).sum() / zone.sum())
    words = _words(demand, looks)
    passed = _steps(demand, len(zone), looks)
    share = 100 * float(passed[-1][required].mean())
    before = (np.ones(len(zone), bool), *passed)
    lost = [required & was & ~now for was, now in zip(before, passed, strict=False)]
    parts = [f"{100 * one.sum() / required.sum():.1f} % {why}" for why, one in zip(words, lost, strict=True)
             if one.any()]  # fmt: skip
    rest = f"{beyond:.1f} % of it no safe camera can see" if beyond else ""
    why = "; ".join(filter(None, (", ".join(parts), rest)))
    return ZoneVerdict("missed" if parts else "met", share, why)


def shown_as_required(demand: Demand, count: int, looks: Sequence[Looked]) -> Bools:
    """Which of a surface's patches (N,), of which there are `count`, looks showed within every limit."""
    return _steps(demand, count, looks)[-1]


def _steps(demand: Demand, count: int, looks: Sequence[Looked]) -> list[Bools]:
    """Patches (N,) seen; near enough; frontal as well; so by a young look; and in pictures enough."""
    seen, fine, frontal, young = (np.zeros(count, bool) for _ in range(4))
    pictures = np.zeros(count, np.int64)
    for look in looks:
        there = np.isfinite(look.distance_m)
        near, level = np.zeros(count, bool), np.zeros(count, bool)
        for distance, incidence in look.each:
            frontal_m = distance / np.maximum(np.cos(np.radians(incidence)), 1e-9)
            close = np.isfinite(distance) & _fine(demand, look.camera, frontal_m)
            near |= close
            level |= close & (demand.incidence_deg is None or incidence <= demand.incidence_deg)
        seen, fine, frontal = seen | there, fine | near, frontal | level
        if demand.max_age_days is None or look.age_days <= demand.max_age_days:
            young |= level
            pictures += there if look.pictures is None else np.where(there, np.maximum(look.pictures, 1), 0)
    return [seen, fine, frontal, young, young & (pictures >= demand.looks)]


def _fine(demand: Demand, camera: Camera, distance_m: Floats) -> Bools:
    """Patches (N,) of which a pixel covers little enough; none where the camera's pixels are not known.

    `distance_m` (N,) is over the cosine of the incidence: a pixel covers more of what is seen obliquely.
    """
    if demand.gsd_mm is None:
        return np.ones(len(distance_m), bool)
    if not camera.width_px:
        return np.zeros(len(distance_m), bool)
    return np.asarray(distance_m <= 1e-3 * demand.gsd_mm * focal_px(camera.width_px, camera.hfov_deg), bool)


def _words(demand: Demand, looks: Sequence[Looked]) -> tuple[str, ...]:
    """Why a patch fails each of `_steps`, of those that pass all before it."""
    coarse = f"was seen from too far for {demand.gsd_mm or 0:g} mm a pixel"
    if any(not look.camera.width_px for look in looks):
        coarse = "was seen by a camera of unknown resolution"
    return (
        "was not seen",
        coarse,
        f"was seen more obliquely than {demand.incidence_deg or 0:g} deg",
        f"was seen longer ago than {demand.max_age_days or 0:g} days",
        f"was seen in fewer than {demand.looks} pictures",
    )


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
    from the usual distance on the same ray.

    Parameters
    ----------
    part : Part
    known : Trajectory
        Poses there are already.
    graph : Roadmap
    limits : RetimeSettings
        For the pitch of the gimbal.
    usual_m : float
        From the surface, as the plan is.
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
