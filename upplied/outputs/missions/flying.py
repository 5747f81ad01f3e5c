"""The behaviour of the software of each format, and how few waypoints show as much when flown by it.

A vehicle that passes a waypoint at speed leaves its leg some metres before it and joins the next equally far
behind it. The curve lies in the triangle of these points, so the whole triangle must obey the rules.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from upplied.geometry.polylines import leg_lengths
from upplied.geometry.poses import from_yaw_pitch, interpolate, yaw_pitch
from upplied.geometry.scene import Scene
from upplied.outputs.labels import table
from upplied.outputs.missions.records import SAME_ZOOM
from upplied.overlap import Frames
from upplied.planning.airspace.rules import Airspace, path_clearance
from upplied.records import Bools, Camera, Floats, Ints, SurfaceStates, Trajectory

SLOWEST_MPS = 0.2  # of a leg of the inspection
_HOVER_S, _SAME_PLACE_M = 0.05, 0.05  # shorter differences in time are no hovering, and in place no leg
_SHARE = 0.4  # of the shorter leg: two neighbours together stay below the whole
_MOST_M = 5.0
_LEAST_M = 0.2  # below it is a stop
_GAP_M = 0.1  # between the lines that stand for the triangle
#: The camera turns evenly along each leg, at its start, or to heading and pitch on arrival.
Turning = Literal["evenly", "ahead", "on arrival"]
#: Properties of each format.
_TABLE: dict[str, dict[str, Any]] = table("missions/formats.toml")
#: Format -> usual ending of its files.
FORMATS: dict[str, str] = {name: each["ending"] for name, each in _TABLE.items()}
#: Format -> software in which to check the mission before a flight.
OPENED_IN: dict[str, str] = {name: each["opened_in"] for name, each in _TABLE.items()}
_LEAST_SEEN = 0.99  # share of the full path's view that the thinned path must retain
_LOOKS = 160  # poses along a path at which the view is compared


@dataclass(frozen=True)
class Flying:
    """The behaviour of the software of a format."""

    max_waypoints: int | None = None  # of one file; None: no limit
    stop_s: float = 0.0  # time of each stop at a waypoint of the inspection
    passes: bool = False  # waypoints without another reason to stop are passed, see `passing_m`
    turning: Turning = "evenly"
    altitudes: tuple[str, ...] = ("relative", "amsl", "ellipsoid")  # references that the format knows
    altitude_rule: str = ""  # the same in words, if some are missing
    zooms: bool = False  # whether the file can command the camera to zoom
    zooms_not_by: str = ""  # firmware without that command
    zoom_note: str = ""  # the command, in words
    note: str = ""  # settings that the pilot must make, because the file cannot contain them

    @classmethod
    def of(cls, format: str, firmware: str = "") -> "Flying":
        """The entry of a format in the table of formats."""
        stated = dict(_TABLE[_TABLE[format].get("like", format)])
        notes = stated.pop("notes", {})
        rest = {name: value for name, value in stated.items() if name not in ("ending", "opened_in")}
        return cls(**rest, note=notes.get(firmware, notes.get("any", "")))


def as_flown(path: Trajectory, t_s: Floats, turning: Turning) -> Trajectory:
    """Poses (N,) at times on a mission's path, the camera turned as the vehicle turns it.

    No format states when a camera zooms on a leg: the narrower field of view of its ends counts.
    """
    evenly = interpolate(path, t_s)
    if path.fov_deg is not None and len(path) > 1:
        leg = (np.searchsorted(path.t_s, t_s, side="right") - 1).clip(0, len(path) - 2)
        evenly = replace(evenly, fov_deg=np.minimum(path.fov_deg[leg], path.fov_deg[leg + 1]))
    if turning == "evenly" or len(path) < 2:
        return evenly
    if turning == "ahead":
        coming = np.searchsorted(path.t_s, t_s, side="left").clip(0, len(path) - 1)
        return replace(evenly, quat_xyzw=path.quat_xyzw[coming])
    reached = (np.searchsorted(path.t_s, t_s, side="right") - 1).clip(0, len(path) - 1)
    (yaw, _), (_, pitch) = yaw_pitch(evenly.quat_xyzw), yaw_pitch(path.quat_xyzw[reached])
    return replace(evenly, quat_xyzw=from_yaw_pitch(yaw, pitch))


def passing_m(path: Trajectory, airspace: Airspace, stray_m: float) -> Floats:
    """Distance before and behind each waypoint within which the vehicle may turn, (N,), m; 0: it stops.

    The curve obeys the rules of `airspace`, and stays within `stray_m` of the waypoint.
    """
    positions, lengths = path.positions, leg_lengths(path.positions)
    pace = np.clip(lengths / np.diff(path.t_s), SLOWEST_MPS, None)
    still = (np.diff(path.t_s) - lengths / pace > _HOVER_S) | (lengths < _SAME_PLACE_M)
    stops = np.append(still, False) | np.append(False, still)
    distance = np.zeros(len(positions))
    for at in range(1, len(positions) - 1):
        if stops[at]:
            continue
        before, after = positions[at - 1] - positions[at], positions[at + 1] - positions[at]
        legs = [float(np.linalg.norm(leg)) for leg in (before, after)]
        before, after = before / legs[0], after / legs[1]
        most = min(_SHARE * min(legs), _MOST_M)
        sagitta = float(np.linalg.norm(before + after)) / 2  # of the chord, over the distance
        if sagitta > 1e-9:
            most = min(most, stray_m / sagitta)
        while most >= _LEAST_M and not _free(positions[at], before, after, most, airspace):
            most /= 2
        distance[at] = most if most >= _LEAST_M else 0.0
    return distance


def triangle(corner: Floats, before: Floats, after: Floats, distance_m: float) -> tuple[Floats, Floats]:
    """Lines (L, 3) to (L, 3) from a corner that cover the triangle around its curve."""
    chord = distance_m * float(np.linalg.norm(after - before))
    share = np.linspace(0, 1, max(3, int(np.ceil(chord / _GAP_M)) + 1))[:, None]
    ends = corner + distance_m * ((1 - share) * before + share * after)
    return np.repeat(corner[None], len(ends), axis=0), ends


def _free(corner: Floats, before: Floats, after: Floats, distance_m: float, airspace: Airspace) -> bool:
    start, end = triangle(corner, before, after, distance_m)
    return not (airspace.broken_legs(start, end).any() or airspace.broken_legs(end[:-1], end[1:]).any())


def thinned(
    path: Trajectory,
    fixed: Bools,
    tolerances: tuple[float, float],
    airspace: Airspace,
    seen: tuple[SurfaceStates | None, Camera],
    turning: Turning = "evenly",
    zooms: bool = True,
) -> tuple[Ints, str, float]:
    """The waypoints that remain, the checks in words, and the retained share of the planned view.

    Those that are `fixed` (N,) stay. The tolerances of the path, m, and of the camera, deg, are halved until
    the thinned path breaks no rule and retains 99 % of the planned view of the surface, if that is known.
    Where the camera does not zoom like the path, its own field of view counts.
    """
    scene = airspace.scene
    planned = path_clearance(scene, path.positions).distance_m
    metres, degrees = tolerances
    flown = path if zooms else replace(path, fov_deg=None)
    for _ in range(6):
        left = np.flatnonzero(_essential(path, fixed, metres, degrees))
        coarse = flown.take(left)
        share = still_seen(path, coarse, scene, *seen, turning)
        if not airspace.broken(coarse.positions).any() and (np.isnan(share) or share >= _LEAST_SEEN):
            clear = path_clearance(scene, coarse.positions).distance_m
            view = "" if np.isnan(share) else f", {100 * share:.1f} % of the planned view is retained"
            remaining = f"{len(left)} of {len(path)} waypoints remain within {metres:g} m and {degrees:g} deg"
            return left, f"{remaining}: clearance {clear:.2f} m (planned {planned:.2f} m){view}", share
        metres, degrees = metres / 2, degrees / 2
    share = still_seen(path, flown, scene, *seen, turning)
    note = f"all {len(path)} waypoints remain, because fewer would reduce clearance or coverage"
    return np.arange(len(path)), note, share


def still_seen(
    full: Trajectory,
    coarse: Trajectory,
    scene: Scene,
    states: SurfaceStates | None,
    camera: Camera,
    turning: Turning = "evenly",
) -> float:
    """Share of the surface points seen along the full path that the coarse path sees; NaN where not known."""
    if states is None or len(full) < 2 or not (states.state == 1).any():
        return float("nan")
    points = states.points[states.state == 1]
    times = np.linspace(full.t_s[0], full.t_s[-1], _LOOKS)
    before = _in_view(interpolate(full, times), points, scene, camera)
    after = _in_view(as_flown(coarse, times, turning), points, scene, camera)
    return float((before & after).sum() / before.sum()) if before.any() else float("nan")


def _in_view(path: Trajectory, points: Floats, scene: Scene, camera: Camera) -> Bools:
    """Which points (N,) are in the frustum and range of any pose, with nothing between."""
    frames, shown = Frames(path, camera, scene), np.zeros(len(points), bool)
    for at in range(len(path)):
        shown[~shown] = frames.shows(at, points[~shown])
    return shown


def _essential(path: Trajectory, fixed: Bools, metres: float, degrees: float) -> Bools:
    """Douglas and Peucker's rule between fixed waypoints, for position and orientation together."""
    keep = fixed.copy()
    keep[[0, -1]] = True
    pairs = list(pairwise(np.flatnonzero(keep).tolist()))
    while pairs:
        first, last = pairs.pop()
        if last - first < 2:
            continue
        error = _strays(path, first, last, metres, degrees)
        worst = int(error.argmax())
        if error[worst] > 1:
            middle = first + 1 + worst
            keep[middle] = True
            pairs += [(first, middle), (middle, last)]
    return keep


def _strays(path: Trajectory, first: int, last: int, metres: float, degrees: float) -> Floats:
    """Distance, turn or zoom off an even leg of the waypoints between two others, in tolerances."""
    between = path.positions[first + 1 : last]
    leg = path.positions[last] - path.positions[first]
    along = (between - path.positions[first]) @ leg / max(float(leg @ leg), 1e-12)
    share = np.clip(along, 0, 1)
    off = np.linalg.norm(between - path.positions[first] - share[:, None] * leg, axis=1)
    ends = Rotation.from_quat(path.quat_xyzw[[first, last]])
    turned = Slerp([0.0, 1.0], ends)(share)
    angle = np.degrees((turned.inv() * Rotation.from_quat(path.quat_xyzw[first + 1 : last])).magnitude())
    error = np.maximum(off / max(metres, 1e-9), angle / max(degrees, 1e-9))
    if path.fov_deg is None:
        return error
    zoom, at = path.fov_deg[:, 0], path.t_s
    even = np.interp(at[first + 1 : last], at[[first, last]], zoom[[first, last]])
    return np.maximum(error, np.abs(zoom[first + 1 : last] / even - 1) / SAME_ZOOM)
