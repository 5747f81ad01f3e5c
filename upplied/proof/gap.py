"""The shortest safe flight that shows what a flight left out, from viewpoints of its own plan.

Viewpoints are chosen among the poses of the plan, those that look from as near, as frontally and as finely as
the plan itself did at each place, and put in the order of a short way (`tour`) by the safe legs that join
them. Zone surface that those poses do not show as required has poses of its own (`zone_gap`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.config import InspectionSettings, RetimeSettings
from upplied.errors import RefusedError
from upplied.geometry.poses import in_a_row
from upplied.planning.airspace.roadmap import Roadmap
from upplied.planning.visibility.looks import sampled_m
from upplied.planning.visibility.observations import stations
from upplied.proof.tour import STANDING_M, Toured, toured
from upplied.proof.zone_gap import Part, ZoneGap, poses_for
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Trajectory

_STATIONS = 500  # poses of the plan, at most, that viewpoints are chosen from
_FARTHER, _ASLANT_DEG = 1.1, 5.0  # than the plan's own look at a place, that still counts as planned
_COARSER = 1.05  # than its finest look: a flight strays, and 1.1 is inspected as planned
_LOOKS = 3  # of the plan at each place that are matched: the nearest, the most frontal, the finest
_CREEPING_MPS = 0.1
_STEADY = 0.8  # of the motion that is still sharp, that a picture is planned with: a vehicle is unsteady


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
    both = [(done, none & ~done) for done, none in zip(flown, cannot, strict=True)]
    shows[part], unattainable[part] = both[0]
    return GapFlight(**vars(tour), shows=shows, unattainable=unattainable, zones=tuple(both[1:]))


def _planned_looks(part: Part, plan: Trajectory, graph: Roadmap) -> tuple[Floats, Ints]:
    """What the plan's nearest, most frontal and finest look at each sample reach, (5, M), m, deg, m, deg, m.

    A sample that the plan does not see requires nothing. The poses of those looks are returned too, (3 M,).
    """
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
