"""Photos of a mission: where they are taken, and how soon after one another the camera takes them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from upplied.cameras import known_camera, least_interval, named_by_drone
from upplied.errors import RefusedError
from upplied.outputs.missions.options import MissionOptions
from upplied.outputs.missions.sorties import SLOWEST_MPS
from upplied.photographed import MARGIN, photographed
from upplied.polylines import cumulated, leg_lengths
from upplied.records import Bools, Camera, Cloud, Record, SurfaceStates, Trajectory
from upplied.scene import Scene

_SLOWER_S = 1.0  # from which it is said


@dataclass(frozen=True, eq=False, repr=False)
class Shots(Record):
    """A path as it is flown for its photos."""

    path: Trajectory
    fixed: Bools  # (N,) poses that stay as they are
    photo: Bools  # (N,)
    every_m: float  # between photos by distance; 0: at `photo` alone
    shown: float  # share of what the path shows that the photos show; NaN where that is not known
    across: float  # overlap with another pass; NaN where it was not asked
    notes: tuple[str, ...]


def interval_of(options: MissionOptions, camera: Camera | None) -> tuple[float, str]:
    """Least time between two photos of a mission, s, and where it is known from, in words.

    What is asked for counts first, then the camera that is named, that of the drone, and that of the
    demonstration.
    """
    if options.trigger_s is not None:
        return options.trigger_s, "as asked"
    name = options.camera or named_by_drone(options.drone)
    return least_interval(known_camera(name, options.file_format) if name else camera)


def shots_of(
    name: str,
    path: Trajectory,
    viewpoints: Bools | None,
    scene: Scene,
    seen: tuple[SurfaceStates | None, Camera | None],
    options: MissionOptions,
    own: bool = False,
) -> Shots:
    """Where a mission takes photos, and its path in the times that they need.

    Parameters
    ----------
    name : str
        Of the mission, for errors.
    path : Trajectory
        N poses.
    viewpoints : array of bool, shape (N,), or None
        Of a plan; a bare path is photographed by distance.
    scene : Scene
    seen : (SurfaceStates or None, Camera or None)
        What the plan shows, where that is known, and the demonstration's camera.
    options : MissionOptions
    own : bool
        Whether the viewpoints are the plan's own photos, which stay where the camera takes them in time.

    Raises
    ------
    RefusedError
        If photos by distance ask for a flight that is slower than any vehicle flies.
    """
    states, camera = seen
    none, nan = np.zeros(len(path), bool), float("nan")
    fixed = none if viewpoints is None else viewpoints
    if options.photos == "video":
        return Shots(path, fixed, none, 0.0, nan, nan, ("filmed from the first to the last place",))
    if options.photos == "none":
        return Shots(path, fixed, none, 0.0, nan, nan, ())
    interval, why = interval_of(options, camera)
    if own and viewpoints is not None and not options.overlap and options.photos == "viewpoints":
        between = np.diff(path.t_s[viewpoints])
        if not len(between) or between.min() >= interval * MARGIN - 1e-6:
            count = int(viewpoints.sum())
            note = f"{count} photos, those of the plan: the camera takes {interval:g} s for one, {why}"
            return Shots(path, viewpoints, viewpoints, 0.0, nan, nan, (note,))
    if options.photos == "distance" or viewpoints is None:
        return _by_distance(name, path, fixed, options.photo_distance_m, interval, why)
    surface = Cloud(np.empty((0, 3)))
    if states is not None:
        surface = Cloud(states.points, states.normals).at(states.state == 1)
    found = photographed(path, camera or Camera(), scene, surface, interval, options.overlaps)
    count = int(found.photo.sum())
    took = np.diff(found.path.t_s[found.photo])
    apart = f", at least {took.min():.1f} s apart" if count > 1 else ""
    said = [f"{count} photos{apart}: the camera takes {interval:g} s for one, {why}"]
    if np.isfinite(found.shown):
        said[0] += f"; they show {100 * found.shown:.1f} % of what the plan shows"
    if count > 1:
        said[0] += f"; overlap along {100 * np.median(found.along):.0f} %"
    if np.isfinite(found.across):
        said[0] += f", across {100 * found.across:.0f} %"
    if found.slower_s > _SLOWER_S:
        said.append(f"flown {found.slower_s:.0f} s longer than planned, so that the camera is ready in time")
    return Shots(found.path, found.photo, found.photo, 0.0, found.shown, found.across, tuple(said))


def _by_distance(
    name: str, path: Trajectory, fixed: Bools, every_m: float, interval: float, why: str
) -> Shots:
    """The path flown no faster than a photo every so many metres allows."""
    fastest = every_m / (interval * MARGIN)
    if fastest < SLOWEST_MPS:
        raise RefusedError(
            name,
            f"a photo every {every_m:g} m asks for {fastest:.2f} m/s: the camera takes {interval:g} s, {why}",
            f"{SLOWEST_MPS:g} m/s at least",
            "ask for fewer: --photo-distance-m, or say what the camera takes: --trigger-s",
        )
    planned = np.diff(path.t_s)
    took = np.maximum(planned, leg_lengths(path.positions) / fastest)
    slower = float((took - planned).sum())
    said = [f"a photo every {every_m:g} m, at least {interval * MARGIN:.1f} s apart: the camera takes "
            f"{interval:g} s for one, {why}"]  # fmt: skip
    if slower > _SLOWER_S:
        said.append(f"flown {slower:.0f} s longer than planned, so that the camera is ready in time")
    slowed = replace(path, t_s=path.t_s[0] + cumulated(took))
    return Shots(slowed, fixed, np.zeros(len(path), bool), every_m, float("nan"), float("nan"), tuple(said))
