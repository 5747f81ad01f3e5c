"""Photos of a mission: their waypoints, and the trigger interval of the camera."""

from dataclasses import dataclass, replace

import numpy as np

from upplied.cameras import known_camera, least_interval, named_by_drone
from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length, cumulated, leg_lengths
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import Scene
from upplied.outputs.mission_options import MissionOptions
from upplied.outputs.missions.flying import SLOWEST_MPS
from upplied.outputs.missions.gate import Limits
from upplied.photographed import MARGIN, photographed, share_shown
from upplied.records import Bools, Camera, Cloud, Plan, Record, Trajectory

_SLOWER_S = 1.0  # shorter delays are not noted


@dataclass(frozen=True, eq=False, repr=False)
class Shots(Record):
    """A path with its photos."""

    path: Trajectory
    fixed: Bools  # (N,) poses that thinning must not remove
    photo: Bools  # (N,)
    every_m: float  # between photos by distance; 0: at `photo` alone
    shown: float  # share of the planned surface that the photos show; NaN if unknown
    across: float  # overlap with another pass; NaN where none is required
    notes: tuple[str, ...]


def interval_of(options: MissionOptions, camera: Camera | None) -> tuple[float, str]:
    """Minimum time between two photos of a mission, s, and its source, in words.

    The option counts first, then the named camera, the camera of the drone, and that of the demonstration.
    """
    if options.trigger_s is not None:
        return options.trigger_s, "as set"
    name = options.camera or named_by_drone(options.drone)
    return least_interval(known_camera(name, options.file_format) if name else camera)


def shots_of(name: str, plan: Plan, scene: Scene, camera: Camera, options: MissionOptions) -> Shots:
    """Where a mission of this name takes photos, and its path in the times that they need.

    A plan's own photos stay where the camera has time for them; a plan without viewpoints is photographed by
    distance. What asks for a flight that is slower than any vehicle flies is refused.
    """
    path, viewpoints, states = plan.trajectory, plan.is_viewpoint, plan.surface
    assert path is not None
    none, nan = np.zeros(len(path), bool), float("nan")
    fixed = none if viewpoints is None else viewpoints
    if options.photos in ("video", "none"):
        films = ("the camera records a video of the inspection",) if options.photos == "video" else ()
        return Shots(path, fixed, none, 0.0, nan, nan, films)
    interval, why = interval_of(options, camera)
    ready = f"the camera needs {interval:g} s for a photo ({why})"
    surface = Cloud(np.empty((0, 3)))
    if states is not None:
        surface = Cloud(states.points, states.normals).at(states.state == 1)
    own = bool(plan.photos or plan.photos_sha256)
    if own and viewpoints is not None and not options.overlap and options.photos == "viewpoints":
        between = np.diff(path.t_s[viewpoints])
        if not len(between) or between.min() >= interval * MARGIN - 1e-6:
            shown = share_shown(path, viewpoints, camera, scene, surface)
            note = f"{int(viewpoints.sum())} photos of the plan{_share(shown)}: {ready}"
            return Shots(path, viewpoints, viewpoints, 0.0, shown, nan, (note,))
    if options.photos == "distance" or viewpoints is None:
        every_m = options.photo_distance_m
        slowed, notes = _by_distance(name, path, every_m, interval, ready)
        along = arc_length(path.positions)
        photo_s = np.interp(np.arange(0.0, along[-1], every_m), along, path.t_s)
        times = np.union1d(path.t_s, photo_s)
        shown = share_shown(interpolate(path, times), np.isin(times, photo_s), camera, scene, surface)
        return Shots(slowed, fixed, none, every_m, shown, nan, (notes[0] + _share(shown), *notes[1:]))
    hardest = Limits().max_acceleration_mps2
    result = photographed(path, camera, scene, surface, interval, hardest, options.overlaps, complete=True)
    count = int(result.photo.sum())
    took = np.diff(result.path.t_s[result.photo])
    apart = f", at least {took.min():.1f} s apart" if count > 1 else ""
    note = f"{count} photos{apart}{_share(result.shown)}: {ready}"
    if count > 1:
        note += f"; overlap along the path {100 * np.median(result.along):.0f} %"
    if np.isfinite(result.across):
        note += f", across it {100 * result.across:.0f} %"
    notes = (note, *_longer(result.slower_s))
    return Shots(result.path, result.photo, result.photo, 0.0, result.shown, result.across, notes)


def _share(shown: float) -> str:
    """The share of the planned surface that the photos show, in words; nothing if unknown."""
    return f", which show {100 * shown:.1f} % of the planned surface" if np.isfinite(shown) else ""


def _longer(slower_s: float) -> tuple[str, ...]:
    if slower_s <= _SLOWER_S:
        return ()
    why = "because the camera needs time between photos"
    return (f"the flight takes {slower_s:.0f} s longer than planned, {why}",)


def _by_distance(
    name: str, path: Trajectory, every_m: float, interval: float, ready: str
) -> tuple[Trajectory, tuple[str, ...]]:
    """The path flown no faster than a photo every so many metres allows, and notes."""
    fastest = every_m / (interval * MARGIN)
    if fastest < SLOWEST_MPS:
        fault = f"a photo every {every_m:g} m needs {fastest:.2f} m/s or less: {ready}"
        remedy = "take fewer photos: --photo-distance-m, or set the interval of the camera: --trigger-s"
        raise RefusedError(name, fault, f"{SLOWEST_MPS:g} m/s at least", remedy)
    planned = np.diff(path.t_s)
    took = np.maximum(planned, leg_lengths(path.positions) / fastest)
    note = f"a photo every {every_m:g} m, at least {interval * MARGIN:.1f} s apart: {ready}"
    slowed = replace(path, t_s=path.t_s[0] + cumulated(took))
    return slowed, (note, *_longer(float((took - planned).sum())))
