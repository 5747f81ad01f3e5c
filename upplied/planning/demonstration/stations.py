"""The stations by which a flight is given: as dense as its shape asks for, its pauses, and its viewpoints."""

import itertools

import numpy as np
from scipy.ndimage import gaussian_filter1d

from upplied.config import ViewpointSettings
from upplied.geometry.polylines import cumulated, interpolated, leg_lengths
from upplied.geometry.poses import facing, matrices, mean_rotation
from upplied.planning.constants import JITTER, JITTER_M, SMOOTH_S, STILL
from upplied.records import Bools, Floats, Ints, Trajectory, Viewpoints, Visibility

_TICK_S = 0.1
_MOST_TICKS = 100_000
_SURE_S = 1.0  # at the very same place for so long is no rounding of the log


def pauses(flight: Trajectory, least_s: float = 3.0) -> list[tuple[float, float]]:
    """Begin and end, s, of each time in which the pilot stood still, start and landing apart.

    He stands where the steadied position moves at less than a quarter of his usual speed, or where poses
    one after another are at the very same place.

    Parameters
    ----------
    least_s : float
        Shorter ones are hesitations.
    """
    if len(flight) < 4 or flight.t_s[-1] - flight.t_s[0] < 2 * least_s:
        return []
    times, positions = steadied(flight)
    speed = np.linalg.norm(np.gradient(positions, times, axis=0), axis=1)
    usual = float(np.percentile(speed, 75))
    if usual == 0:
        return []
    legs = leg_lengths(flight.positions)
    sure_s = max(_SURE_S, least_s / 2)
    known = [(begin, end) for begin, end in _runs(legs == 0, flight.t_s) if end - begin >= sure_s]
    slow = _runs((speed < STILL * usual)[:-1], times)
    hovers = [(begin, end) for begin, end in slow if not any(begin < b and a < end for a, b in known)]
    some, (first, last) = sorted(known + hovers), flight.t_s[[0, -1]]
    return [(begin, end) for begin, end in some if end - begin >= least_s and begin > first and end < last]


def _runs(marked: Bools, times: Floats) -> list[tuple[float, float]]:
    """Begin and end of each run of marked steps (K,) between times (K + 1,)."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(int)))
    return [(float(times[a]), float(times[b])) for a, b in change.reshape(-1, 2)]


def steadied(flight: Trajectory) -> tuple[Floats, Floats]:
    """Even times (K,), s, and positions (K, 3), m, averaged over about a second: for speeds."""
    begin, end = float(flight.t_s[0]), float(flight.t_s[-1])
    count = int(np.clip((end - begin) / _TICK_S, 2, _MOST_TICKS))
    times = np.linspace(begin, end, count + 1)
    even = interpolated(times, flight.t_s, flight.positions)
    return times, gaussian_filter1d(even, SMOOTH_S / (times[1] - times[0]), axis=0, mode="nearest")


_SHORTEST = 0.1  # of the usual spacing: stations are no denser
_TURNED_RAD = np.radians(6.0)  # of the camera's axis from station to station, about
_CORNER_RAD = np.radians(25.0)  # over the shortest spacing: a sharper bend has a station at its very tip
_FEWEST = 160  # stations of a flight; those of a longer one are `spacing_m` apart


def jitter_m(extent_m: float) -> float:
    """What no flight of some extent means, whether it is noise or not, m."""
    return min(JITTER_M, JITTER * extent_m)


def axes_of(flight: Trajectory) -> Floats:
    """Optical and left axis of each pose, (N, 6): what is averaged instead of angles."""
    axes = matrices(flight.quat_xyzw)
    return np.hstack([axes[:, :, 0], axes[:, :, 1]])


def looking(axes: Floats) -> Floats:
    """Orientation without roll along each pair of axes (N, 6), of any length."""
    return facing(axes[:, :3], axes[:, 3:])


def stations_of(flight: Trajectory, spacing_m: float, extent_m: float, length_m: float) -> Trajectory:
    """The poses by which a steady flight is given: its ends, its hovers, and what its shape asks for.

    A line of length s over an arc of curvature k leaves it by k s^2 / 8.

    Parameters
    ----------
    flight : Trajectory
        Closely spaced; equal positions one after another where it hovers.
    spacing_m : float
        Of stations where it is straight, at most.
    extent_m, length_m : float
        Of the whole flight, of which this may be a part.
    """
    if len(flight) < 3:
        return flight
    spacing = min(spacing_m, max(length_m, 1e-9) / _FEWEST)
    chord = jitter_m(extent_m)  # lines between stations leave the flight by less
    at, axes = flight.positions, axes_of(flight)
    step = leg_lengths(at)
    along = cumulated(step)
    turned = np.linalg.norm(np.diff(axes[:, :3], axis=0), axis=1)
    places, curvature = _curvature(at, along, _SHORTEST * spacing)
    near = np.maximum(curvature, np.maximum(np.roll(curvature, 1), np.roll(curvature, -1)))
    bend = np.interp((along[1:] + along[:-1]) / 2, places, near)
    density = np.clip(np.sqrt(bend / (8 * chord)), 1 / spacing, 1 / (_SHORTEST * spacing))
    progress = cumulated(np.hypot(density * step, turned / _TURNED_RAD))
    still = np.flatnonzero(np.concatenate([step < 1e-9, [False]]))
    hovers = np.split(still, np.flatnonzero(np.diff(still) > 1) + 1)
    ends = [run[[0, -1]] + [0, 1] for run in hovers if len(run)]
    before, inner, after = curvature[:-2], curvature[1:-1], curvature[2:]
    sharp = (inner >= before) & (inner > after) & (inner > _CORNER_RAD / (_SHORTEST * spacing))
    tips = [np.searchsorted(along, places[1:-1][sharp]).clip(0, len(flight) - 1)]
    fixed = np.unique(np.concatenate([[0, len(flight) - 1], *ends, *tips]).astype(np.int64))
    index, chosen = np.arange(float(len(flight))), [np.zeros(1)]
    for first, last in itertools.pairwise(fixed.tolist()):  # by even steps of progress
        pieces = max(int(np.ceil(progress[last] - progress[first] - 1e-9)), 1)
        part = progress[first : last + 1] + 1e-12 * np.arange(last - first + 1)
        even = np.linspace(part[0], part[-1], pieces + 1)[1:]
        chosen.append(np.interp(even, part, index[first : last + 1]))
    stations = np.concatenate(chosen)
    there, facing_ = (interpolated(stations, index, values) for values in (at, axes))
    return Trajectory(np.interp(stations, index, flight.t_s), there, looking(facing_))


def _curvature(at: Floats, along: Floats, apart: float) -> tuple[Floats, Floats]:
    """Places along a path, m, and its curvature there, 1/m, as chords of length `apart` tell it."""
    moving = np.concatenate([[True], np.diff(along) > 0])
    number = max(int(np.ceil(along[-1] / max(apart, 1e-9) - 1e-6)), 2)  # often whole, but for the last bit
    places = np.linspace(0, along[-1], number + 1)
    path = interpolated(places, along[moving], at[moving])
    leg = np.diff(path, axis=0)
    length = np.maximum(np.linalg.norm(leg, axis=1), 1e-12)
    cross = np.linalg.norm(np.cross(leg[:-1], leg[1:]), axis=1)
    angle = np.arctan2(cross, (leg[:-1] * leg[1:]).sum(axis=1))
    bend = np.zeros(len(places))
    bend[1:-1] = angle / ((length[1:] + length[:-1]) / 2)
    return places, bend


def find_viewpoints(
    flight: Trajectory, visibility: Visibility, settings: ViewpointSettings, breaks: Ints | None = None
) -> Viewpoints:
    """One viewpoint for each stretch of the flight that looks at one region (or for each pose, if set so).

    The position is the centroid of the segment's positions, the orientation the mean of its
    rotations, the visible set the union over the segment.

    Parameters
    ----------
    flight : Trajectory
        N poses.
    visibility : Visibility
        What each pose sees, (N, points).
    breaks : array of int, optional
        Poses that start a new part after a gap in the log; they always start a segment.
    """
    if settings.method == "poses":
        bounds = np.arange(len(flight) + 1)
    else:
        bounds = segment(visibility, settings.shared, breaks)
    spans = list(itertools.pairwise(bounds))
    return Viewpoints(
        positions=np.array([flight.positions[a:b].mean(axis=0) for a, b in spans]),
        quat_xyzw=np.array([mean_rotation(flight.quat_xyzw[a:b]) for a, b in spans]),
        seen=np.array([visibility.seen[a:b].any(axis=0) for a, b in spans]),
        start=bounds[:-1],
        stop=bounds[1:],
        t_s=np.array([flight.t_s[a:b].mean() for a, b in spans]),
    )


def segment(visibility: Visibility, shared: float, breaks: Ints | None = None) -> Ints:
    """Where segments start, followed by the number of poses: (K + 1,).

    The paper's Algorithm 1 writes ``n(start & q) & n(V) < lambda``, which cannot be meant. Ours: a
    segment ends at the first pose q with ``|v_start & v_q| / |v_start| < lambda``. A segment whose
    first pose sees nothing ends at the first pose that sees something.

    Examples
    --------
    >>> seen = np.array([[1, 1, 0], [1, 1, 0], [0, 1, 1], [0, 0, 1]], bool)
    >>> segment(Visibility(seen), 0.6)
    array([0, 2, 3, 4])
    """
    seen = visibility.seen
    forced = set() if breaks is None else {int(index) for index in breaks}
    starts = [0]
    view, size = seen[0], int(seen[0].sum())
    for index in range(1, len(seen)):
        common = int(np.count_nonzero(view & seen[index]))
        moved_on = common < shared * size if size else bool(seen[index].any())
        if moved_on or index in forced:
            starts.append(index)
            view, size = seen[index], int(seen[index].sum())
    return np.array([*starts, len(seen)], np.int64)
