"""Fewer waypoints within a stated tolerance, checked again for clearance and coverage."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from upplied.geometry.poses import interpolate
from upplied.geometry.scene import Scene
from upplied.outputs.missions.flying import Turning, as_flown
from upplied.outputs.missions.records import SAME_ZOOM
from upplied.overlap import Frames
from upplied.planning.airspace.rules import Airspace, path_clearance
from upplied.records import Bools, Camera, Floats, Ints, SurfaceStates, Trajectory

_LEAST_SEEN = 0.99  # share of the full path's view that the thinned path must retain
_LOOKS = 160  # poses along a path at which the view is compared


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
