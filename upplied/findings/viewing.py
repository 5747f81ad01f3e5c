"""From where a place is looked at: as before, or as near to that as is safe and shows it finely enough."""

from dataclasses import dataclass

import numpy as np

from upplied.config import RetimeSettings
from upplied.findings.looks import Spot, plane_axes
from upplied.findings.rays import focal_of
from upplied.geometry.poses import from_yaw_pitch, look_at, yaw_pitch
from upplied.planning.airspace.roadmap import Roadmap, links
from upplied.planning.visibility.observations import TRULY
from upplied.proof.gap import Part
from upplied.proof.inspected import narrowed
from upplied.records import Bools, Camera, Cloud, Floats, Record, Trajectory

_TILTS_DEG = (4.0, 8.0, 14.0, 20.0, 28.0, 36.0, 45.0, 55.0, 65.0)  # from the wanted direction
_TURNS = 12
_DISTANCES = 7
_FINE = 0.97  # of the largest ground sample distance: a margin for wind and rounding
_MARGIN_DEG = 4.0  # of the picture, at each rim
_FARTHER = 0.1  # log of the distance, that weighs as much as a radian


@dataclass(frozen=True, eq=False, repr=False)
class Look(Record):
    """A look at the place of a finding."""

    finding_id: str
    spot: Spot  # on the structure that is flown to
    direction: Floats  # (3,) unit, from the place to the camera
    distance_m: float  # of the reference photo; NaN where there is none
    reference: str  # the photo, in words
    note: str = ""  # of the counterpart, in words


def best_look(
    goal: Look, camera: Camera, graph: Roadmap, limits: RetimeSettings, mm_px: float
) -> Trajectory | None:
    """The pose nearest to the wanted look that is safe and shows the place so; None where there is none."""
    place, normal = goal.spot.place, goal.spot.normal
    first, second = plane_axes(goal.direction)
    turn, tilt = 2 * np.pi * np.arange(_TURNS)[:, None] / _TURNS, np.radians(_TILTS_DEG)[:, None, None]
    beside = np.cos(turn) * first + np.sin(turn) * second
    aside = np.cos(tilt) * goal.direction + np.sin(tilt) * beside
    way = np.vstack([goal.direction, aside.reshape(-1, 3)])
    way = way[way @ normal > np.cos(np.radians(TRULY.max_incidence_deg))]
    facing = way @ normal
    # Straight at the place a pixel covers its angle over the cosine of the incidence.
    farthest = np.minimum(_FINE * 1e-3 * mm_px * focal_of(camera)[0] * facing, 0.999 * camera.max_range_m)
    nearest = max(camera.min_range_m, graph.airspace.clearance_m) * 1.001
    wish = np.where(np.isnan(goal.distance_m), farthest, np.clip(goal.distance_m, nearest, None))
    wish = np.minimum(wish, farthest)
    reach = (np.maximum(farthest, nearest) / nearest)[:, None] ** np.linspace(0, 1, _DISTANCES)
    away = np.concatenate([wish[:, None], nearest * reach], axis=1)
    angle = np.arccos(np.clip(way @ goal.direction, -1, 1))
    cost = angle[:, None] + _FARTHER * np.abs(np.log(away / np.maximum(wish, 1e-3)[:, None]))
    fits = (away >= nearest) & (away <= farthest[:, None] * (1 + 1e-9))
    positions = place + away[..., None] * way[:, None]
    if not fits.any():
        return None
    order = np.argsort(cost[fits], kind="stable")
    positions = positions[fits][order]
    yaw, pitch = yaw_pitch(look_at(positions, np.broadcast_to(place, positions.shape)))
    low, high = np.radians([limits.min_gimbal_pitch_deg, limits.max_gimbal_pitch_deg])  # as far as it turns
    turned = from_yaw_pitch(yaw, np.clip(pitch, low, high))
    poses = Trajectory(np.arange(len(positions), dtype=float), positions, turned)
    for some in np.array_split(np.arange(len(poses)), max(1, len(poses) // 60)):
        part = poses.take(some)
        good = graph.airspace.allowed(part.positions)
        good[good] = shows(part.take(good), goal.spot, camera, graph, mm_px)
        for at in np.flatnonzero(good):
            if len(links(graph, part.positions[at])):
                return part.take(np.array([at]))
    return None


def shows(poses: Trajectory, spot: Spot, camera: Camera, graph: Roadmap, mm_px: float) -> Bools:
    """Which poses (P,) show a spot well inside the picture, at that ground sample distance at most."""
    farthest_m = 1e-3 * mm_px * focal_of(camera)[0]
    part = Part(Cloud(spot.place[None], spot.normal[None]), camera, TRULY, farthest_m)
    return part.seen(poses, graph, narrowed(camera, _MARGIN_DEG))[:, 0]
