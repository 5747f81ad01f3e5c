"""Where photos are taken on a path: as few as overlap and coverage need, none sooner than the camera takes.

A path is divided where the overlap with the photo before falls to the required one; where the camera is not
ready by then, the path is flown more slowly if overlap or coverage depend on it.
"""

from dataclasses import dataclass, replace

import numpy as np

from upplied.geometry.polylines import accelerations, leg_lengths
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import Scene
from upplied.geometry.slowing import no_harder, spaced
from upplied.overlap import Frames
from upplied.records import Bools, Camera, Cloud, Floats, Record, Trajectory

MARGIN = 1.03  # of the least interval: files round speeds
_USUAL = 0.6  # overlap along, where none is required and the camera is ready in time
_ENOUGH = 0.995  # of what the path shows, that its photos are to show
_CANDIDATES = 1200  # places of a path, at most
_OFTEN = 0.25  # of the least interval, between places of a path
_LONG_S = 2.0  # an interval, between whose photos a path shows more than at a few places
_POINTS = 1500  # of the surface, that are to stay in view
_AS_FINE = 1.25  # times the finest that the path shows a sample, by distance and incidence
_EDGE_ON = 0.1  # cosine of the incidence, below which it counts as that
_HALVINGS = 7  # of the time between two places, for a required overlap
_SAME_S = 1e-6
Span = tuple[float, float]  # two times, s


@dataclass(frozen=True, eq=False, repr=False)
class Photographed(Record):
    """A path with its photo points, in times that give the camera its own."""

    path: Trajectory
    photo: Bools  # (N,) of its poses
    shown: float  # share of what the path shows that the photos show; NaN where that is not known
    along: Floats  # (K - 1,) overlap of each photo with the one before, 0 to 1
    across: float  # median overlap with another pass; NaN where none was required
    slower_s: float  # by which it takes longer than planned
    planned_s: Floats  # (N,) when each pose was planned for


def photographed(
    path: Trajectory, camera: Camera, scene: Scene, surface: Cloud, interval_s: float, most_mps2: float,
    overlap: tuple[float, float] | None = None, complete: bool = False,
) -> Photographed:  # fmt: skip
    """The photo points of a path of N poses at the times they are planned for.

    What the path shows of the samples of the surface its photos are to show, not much more coarsely.

    Parameters
    ----------
    interval_s, most_mps2 : float
        Least time between two photos; acceleration allowed at the bends beside one, or the path's own.
    overlap : (along, across), optional
        Required overlap, 0 to 1. Along is held by slowing the flight where need be; across is what the
        passes of the path give, and is measured.
    complete : bool
        Whether the photos are to show every sample, instead of 99.5 % of some of them; photos that show
        nothing of their own are left out where the flight would wait for them.
    """
    length = float(path.t_s[-1] - path.t_s[0])
    apart_s = _OFTEN * (min(interval_s, _LONG_S) if complete else interval_s)
    count = int(np.clip(np.ceil(length / apart_s), 1, _CANDIDATES)) + 1
    frames = Frames(interpolate(path, np.linspace(path.t_s[0], path.t_s[-1], count)), camera, scene)
    useful = [at for at in range(count) if len(frames.hits(at))]
    if not useful:
        return Photographed(path, np.zeros(len(path), bool), np.nan, np.empty(0), np.nan, 0.0, path.t_s)
    times = frames.poses.t_s
    chosen = _along(frames, useful, path, interval_s)
    if not complete:
        surface = surface.at(np.arange(0, len(surface), max(1, len(surface) // _POINTS)))
    reach = np.array([_reach(frames, at, surface) for at in useful])
    finest = reach.min(axis=0)
    goal = np.where(np.isfinite(finest), _AS_FINE * finest, -np.inf)  # what no place shows, none need
    enough = 1.0 if complete else _ENOUGH

    def shown_by(photo_s: list[float]) -> Bools:
        taken = Frames(interpolate(path, np.array(photo_s)), camera, scene)
        return np.array([_reach(taken, at, surface) <= goal for at in range(len(photo_s))])

    chosen, shown = _covering(chosen, shown_by(chosen), times[useful], reach <= goal, interval_s, enough)
    if overlap is not None:  # few are fixed: the others are spread evenly between them
        needed = _without_spare(chosen, shown_by(chosen), np.inf)
        fixed = np.unique([chosen[0], *needed, chosen[-1]])
        chosen = _filled(frames, useful, path, fixed, overlap[0])
    elif complete:
        chosen = _without_spare(chosen, shown_by(chosen), interval_s)
    photo_s = np.array(chosen)
    timed, flags, planned_s = _with_photos(path, photo_s, interval_s * MARGIN, most_mps2)
    taken = Frames(timed.take(flags), camera, scene)
    along = np.array([taken.overlap(at - 1, at) for at in range(1, len(photo_s))])
    across = float("nan") if overlap is None else float(np.nanmedian(taken.across()))
    slower = float(timed.t_s[-1] - timed.t_s[0]) - float(times[-1] - times[0])
    return Photographed(timed, flags, shown, along, across, slower, planned_s)


def _along(frames: Frames, useful: list[int], path: Trajectory, interval_s: float) -> list[float]:
    """Times of photos, each the last that overlaps enough with the one before, once the camera is ready."""
    times, chosen = frames.poses.t_s[useful], [float(frames.poses.t_s[useful[0]])]
    while times[-1] > chosen[-1] + _SAME_S:
        last = _last(frames, useful, path, _USUAL, (chosen[-1], float(times[-1])))
        if last == times[-1]:  # the rest overlaps enough
            return [*chosen, last] if last - chosen[-1] >= interval_s else chosen
        later = int(np.searchsorted(times, max(last, chosen[-1] + interval_s)))
        if later == len(times):
            break
        chosen.append(float(times[later]))
    return chosen


def _last(frames: Frames, useful: list[int], path: Trajectory, least: float, ends: Span) -> float:
    """The last place between two times whose picture, like all before it, overlaps enough with the first."""
    times, before, last = frames.poses.t_s[useful], _at(frames, path, ends[0]), ends[0]
    for at in range(int(np.searchsorted(times, ends[0] + _SAME_S)), len(times)):
        if times[at] > ends[1] or _shared(before, frames, useful[at]) < least:
            break
        last = float(times[at])
    return last


def _filled(
    frames: Frames, useful: list[int], path: Trajectory, photo_s: Floats, required: float
) -> list[float]:
    """The times of photos, and more between them, so that each overlaps enough with the one before."""
    chosen, times = photo_s[:1].tolist(), np.append(frames.poses.t_s[useful], np.inf)
    for end in photo_s[1:].tolist():
        steps = chosen[-1:]
        while True:
            last = _last(frames, useful, path, required, (steps[-1], end))
            later = min(end, float(times[np.searchsorted(times, last + _SAME_S)]))
            before = _at(frames, path, steps[-1])
            if _shared(before, _at(frames, path, later), 0) >= required:
                break
            steps.append(_exactly(before, frames, path, required, (last, later)))
        chosen += _evenly(frames, path, steps, end, required)
    return chosen


def _evenly(frames: Frames, path: Trajectory, steps: list[float], end: float, required: float) -> list[float]:
    """The times after the first of some photos, spread so that the last is not much nearer to the end."""
    if len(steps) > 1:
        begin = steps[0]
        share = min(1.0, (end - begin) / (2 * steps[-1] - steps[-2] - begin))
        even = [begin + share * (step - begin) for step in steps]
        taken = Frames(interpolate(path, np.array([*even, end])), frames.camera, frames.scene)
        if not any(taken.overlap(at - 1, at) < required for at in range(1, len(taken.poses))):
            steps = even
    return [*steps[1:], end]


def _at(frames: Frames, path: Trajectory, time_s: float) -> Frames:
    return Frames(interpolate(path, np.array([time_s])), frames.camera, frames.scene)


def _shared(before: Frames, frames: Frames, at: int) -> float:
    hits = frames.hits(at)
    return float(before.shows(0, hits).mean()) if len(hits) else 1.0


def _exactly(before: Frames, frames: Frames, path: Trajectory, least: float, ends: Span) -> float:
    """The time between two at which the overlap with the photo before falls to the required one."""
    low, high = ends
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        enough = _shared(before, _at(frames, path, middle), 0) >= least
        low, high = (middle, high) if enough else (low, middle)
    return low if low > ends[0] else high


def share_shown(path: Trajectory, photo: Bools, camera: Camera, scene: Scene, surface: Cloud) -> float:
    """Share, 0 to 1, of the samples that photos at some poses show as finely as the whole path; NaN for none.

    A photo (N,) does where it shows a sample no coarser than 1.25 times the finest look of the path.
    """
    frames = Frames(path, camera, scene)
    reach = np.array([_reach(frames, at, surface) for at in range(len(path))])
    finest, goal = reach[photo].min(axis=0, initial=np.inf), _AS_FINE * reach.min(axis=0)
    known = np.isfinite(goal)
    return float((finest <= goal)[known].mean()) if known.any() else float("nan")


def _covering(
    photo_s: list[float], shown: Bools, times: Floats, shows: Bools, interval_s: float, enough: float
) -> tuple[list[float], float]:
    """The photos, and more where they leave out (K, M) what places (P,) show (P, M); the share they show."""
    known, chosen = shows.any(axis=0), list(photo_s)
    if not (whole := int(known.sum())):
        return chosen, float("nan")
    left = known & ~shown.any(axis=0)
    while left.sum() > (1 - enough) * whole:
        gain = (shows & left).sum(axis=1)
        ready = np.abs(times[:, None] - np.array(chosen)).min(axis=1) >= interval_s
        # Where the camera is ready anyway a photo costs nothing; elsewhere the flight waits for it.
        best = int(np.argmax(np.where(ready, gain, gain / 2)))
        chosen.append(float(times[best]))
        left &= ~shows[best]
    return sorted(chosen), 1 - float(left.sum()) / whole


def _without_spare(photo_s: list[float], shown: Bools, interval_s: float) -> list[float]:
    """The photos without those less than an interval from another that show (K, M) nothing of their own."""
    times, needed, count = np.array(photo_s), np.ones(len(photo_s), bool), shown.sum(axis=0)
    for at in np.argsort(shown.sum(axis=1), kind="stable"):
        needed[at] = False
        waits = np.abs(times[needed] - times[at]).min(initial=np.inf) < interval_s
        if waits and (count[shown[at]] > 1).all():
            count = count - shown[at]
        else:
            needed[at] = True
    return times[needed].tolist()


def _reach(frames: Frames, at: int, surface: Cloud) -> Floats:
    """Distance (M,) over the cosine of the incidence from which a picture shows each sample; inf: not."""
    ray = frames.poses.positions[at] - surface.points
    distance = np.linalg.norm(ray, axis=1)
    if surface.normals is not None:
        facing = (ray * surface.normals).sum(axis=1) / np.maximum(distance, 1e-9)
        distance = distance / np.maximum(facing, _EDGE_ON)
    usual = np.tan(np.radians(min(frames.camera.hfov_deg, 179.0)) / 2)
    distance = distance * (frames.slopes[at, 0] / usual)  # where it zooms: distances are of one camera
    return np.where(frames.shows(at, surface.points), distance, np.inf)


def _with_photos(
    path: Trajectory, photo_s: Floats, least_s: float, most_mps2: float
) -> tuple[Trajectory, Bools, Floats]:
    """The path with a pose at each photo, more slowly where photos were nearer in time; which, and when."""
    every = np.union1d(path.t_s, photo_s)
    apart = np.abs(every[:, None] - photo_s).min(axis=1)
    every = every[np.isin(every, photo_s) | (apart > 1e-4)]
    posed = interpolate(path, every)
    allowed = float(accelerations(path.t_s, path.positions).max(initial=most_mps2))
    fastest = float((leg_lengths(path.positions) / np.diff(path.t_s)).max(initial=0.0))
    late = spaced(every, photo_s, least_s, fastest / allowed)
    late = no_harder(late, posed.positions, allowed)
    return replace(posed, t_s=late), np.isin(every, photo_s), every
