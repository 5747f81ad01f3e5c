"""A noisy demonstration made even: jitter, pauses and small detours leave no trace in what is carried.

A pilot's log has more poses where he hesitates, trembles by centimetres, and strays a little from his
line. The flight is described along its progress (metres flown and radians turned), not along its time;
each pose of the result is fitted robustly to those within a short reach of it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from upplied.poses import facing, matrices, optical_axis
from upplied.records import Floats, Ints, Record, Trajectory

_SETTLE_S = 0.4  # deviation of the first smoothing in time, before distances are trusted
_REACH = 0.025  # of the flight's extent: how far the fit of a pose reaches along its progress
_DETOUR = 0.05  # of the flight's extent: excursions up to this are not followed
_TURN = 0.1  # of the flight's extent: metres of progress that a turn by one radian counts
_MOST_SAMPLES = 6000
_TICK_S, _AVERAGE_S = 0.2, 0.4


@dataclass(frozen=True, eq=False, repr=False)
class Smoothed(Record):
    """An even flight, and where it goes on after a gap in the log."""

    flight: Trajectory  # evenly spaced in progress; no roll
    breaks: Ints  # first pose of each part but the first


def smoothed(flight: Trajectory, most: int = 1000, breaks: Ints | None = None) -> Smoothed:
    """The flight as the pilot meant it.

    Parameters
    ----------
    flight : Trajectory
        N poses as logged.
    most : int
        Poses of the result, at most.
    breaks : array of int, optional
        First pose after each gap in the log; nothing is smoothed across.

    Returns
    -------
    Smoothed
        Its times are those at which the demonstration was there.
    """
    cuts = [
        0,
        *sorted({int(b) for b in breaks if 0 < b < len(flight)} if breaks is not None else ()),
        len(flight),
    ]
    extent = 2 * float(np.linalg.norm(flight.positions - flight.positions.mean(axis=0), axis=1).max())
    if extent == 0 or len(flight) < 3:
        return Smoothed(flight, np.array(cuts[1:-1], np.int64))
    parts = [_thinned(_part(flight, a, b)) for a, b in itertools.pairwise(cuts)]
    parts = [_without_detours(_settled(part, _REACH * extent), _DETOUR * extent) for part in parts]
    progress = [_progress(part, extent) for part in parts]
    total = sum(float(along[-1]) for along in progress)
    spacing = max(total / max(most - 2 * len(parts), 2), 0.2 * _REACH * extent)
    even = [_even(part, along, spacing, _REACH * extent) for part, along in zip(parts, progress, strict=True)]
    joined = Trajectory(
        np.concatenate([part.t_s for part in even]),
        np.vstack([part.positions for part in even]),
        np.vstack([part.quat_xyzw for part in even]),
    )
    return Smoothed(joined, np.cumsum([len(part) for part in even])[:-1])


def pauses(flight: Trajectory, least_s: float = 3.0) -> list[tuple[float, float]]:
    """Begin and end, s, of each time in which the pilot stood still, start and landing apart.

    He stands where the steadied position moves at less than a quarter of his usual speed.

    Parameters
    ----------
    flight : Trajectory
    least_s : float
        Shorter ones are hesitations.
    """
    if len(flight) < 5 or flight.t_s[-1] < 2 * least_s:
        return []
    times, positions = steadied(flight)
    speed = np.linalg.norm(np.gradient(positions, times, axis=0), axis=1)
    usual = float(np.percentile(speed, 75))
    still = np.flatnonzero(speed < 0.25 * usual)
    if usual == 0 or len(still) == 0:
        return []
    runs = np.split(still, np.flatnonzero(np.diff(still) > 1) + 1)
    return [
        (float(times[run[0]]), float(times[run[-1]]))
        for run in runs
        if times[run[-1]] - times[run[0]] >= least_s and run[0] > 0 and run[-1] < len(times) - 1
    ]


def steadied(flight: Trajectory) -> tuple[Floats, Floats]:
    """Even times (K,), s, and positions (K, 3), m, averaged over about a second: for speeds."""
    begin, end = float(flight.t_s[0]), float(flight.t_s[-1])
    count = int(np.clip((end - begin) / _TICK_S, 2, _MOST_SAMPLES))
    times = np.linspace(begin, end, count + 1)
    even = np.column_stack([np.interp(times, flight.t_s, axis) for axis in flight.positions.T])
    return times, gaussian_filter1d(even, _AVERAGE_S / (times[1] - times[0]), axis=0, mode="nearest")


def turning_deg_per_m(positions: Floats, spacing_m: float) -> float:
    """How much a path winds: the sum of its turning angles over its length, deg/m.

    The path is first sampled every `spacing_m` along its chords, so that paths with different
    waypoints are compared at one scale. A circle of radius r winds 57.3 / r, a straight line 0.
    """
    path = _by_chords(np.asarray(positions, float), spacing_m)
    legs = np.diff(path, axis=0)
    length = np.linalg.norm(legs, axis=1)
    if len(legs) < 2:
        return 0.0
    cross = np.linalg.norm(np.cross(legs[:-1], legs[1:]), axis=1)
    angle = np.arctan2(cross, (legs[:-1] * legs[1:]).sum(axis=1))
    return float(np.degrees(angle.sum()) / length.sum())


def _by_chords(positions: Floats, spacing: float) -> Floats:
    """Points of a polyline, each the first that is `spacing` away from the one before."""
    kept = [positions[0]]
    for start, end in itertools.pairwise(positions):
        while np.linalg.norm(end - kept[-1]) >= spacing:
            # Where the leg leaves the ball round the last point kept.
            leg, gap = end - start, start - kept[-1]
            a, b, c = leg @ leg, leg @ gap, gap @ gap - spacing**2
            share = (-b + np.sqrt(max(b * b - a * c, 0.0))) / max(a, 1e-300)
            kept.append(start + min(max(share, 0.0), 1.0) * leg)
            start = kept[-1]
    return np.array(kept)


def _part(flight: Trajectory, start: int, stop: int) -> Trajectory:
    return Trajectory(flight.t_s[start:stop], flight.positions[start:stop], flight.quat_xyzw[start:stop])


def _thinned(flight: Trajectory) -> Trajectory:
    """At most some thousand samples, each the mean of its neighbours in the log."""
    if len(flight) <= _MOST_SAMPLES:
        return flight
    bounds = np.linspace(0, len(flight), _MOST_SAMPLES + 1).astype(int)
    count = np.diff(bounds)[:, None]
    axes = np.add.reduceat(_axes(flight), bounds[:-1], axis=0)
    return Trajectory(
        np.add.reduceat(flight.t_s, bounds[:-1]) / count[:, 0],
        np.add.reduceat(flight.positions, bounds[:-1], axis=0) / count,
        _looking(axes),
    )


def _settled(flight: Trajectory, reach: float) -> Trajectory:
    """Positions and axes smoothed over a moment, in which no more than half a reach is flown."""
    axes = _axes(flight)
    if len(flight) < 3:
        return Trajectory(flight.t_s, flight.positions, _looking(axes))
    times, positions = steadied(flight)
    usual = float(np.percentile(np.linalg.norm(np.diff(positions, axis=0), axis=1), 75)) / (
        times[1] - times[0]
    )
    moment = min(_SETTLE_S, 0.5 * reach / max(usual, 1e-9))
    window = moment / max(float(np.median(np.diff(flight.t_s))), 1e-9)
    return Trajectory(
        flight.t_s,
        gaussian_filter1d(flight.positions, window, axis=0, mode="nearest"),
        _looking(gaussian_filter1d(axes, window, axis=0, mode="nearest")),
    )


def _axes(flight: Trajectory) -> Floats:
    """Optical and left axis of each pose, (N, 6): what is averaged instead of angles."""
    axes = matrices(flight.quat_xyzw)
    return np.hstack([axes[:, :, 0], axes[:, :, 1]])


def _looking(axes: Floats) -> Floats:
    """Orientation without roll along each pair of axes (N, 6), of any length."""
    return facing(axes[:, :3], axes[:, 3:])


def _without_detours(flight: Trajectory, size: float) -> Trajectory:
    """The flight without short excursions after which it goes on as if nothing had happened.

    The end of a hairpin comes back as well, but leaves in the opposite direction: it stays.
    """
    at, near = flight.positions, 0.25 * size
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(at, axis=0), axis=1))])
    before = np.searchsorted(along, along - near, side="right") - 1
    after = np.minimum(np.searchsorted(along, along + near), len(along) - 1)
    coming, leaving = at - at[np.maximum(before, 0)], at[after] - at
    kept, index = [], 0
    while index < len(flight):
        kept.append(index)
        ahead = np.arange(index + 1, int(np.searchsorted(along, along[index] + 3 * size, side="right")))
        back = (np.linalg.norm(at[ahead] - at[index], axis=1) < near) & (along[ahead] > along[index] + size)
        same_way = leaving[ahead] @ coming[index] > 0.5 * near**2
        found = ahead[back & same_way]
        index = int(found[-1]) if len(found) else index + 1
    chosen = np.array(kept)
    return Trajectory(flight.t_s[chosen], flight.positions[chosen], flight.quat_xyzw[chosen])


def _progress(flight: Trajectory, extent: float) -> Floats:
    """Metres flown, and metres for radians turned, from the start to each pose."""
    moved = np.linalg.norm(np.diff(flight.positions, axis=0), axis=1)
    axis = optical_axis(flight.quat_xyzw)
    turned = np.linalg.norm(np.diff(axis, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(moved + _TURN * extent * turned)])


def _even(flight: Trajectory, along: Floats, spacing: float, reach: float) -> Trajectory:
    """Poses every `spacing` of progress, each a robust local line through those within `reach`."""
    stations = np.linspace(0, along[-1], max(int(np.ceil(along[-1] / spacing)), 1) + 1)
    values = np.column_stack([flight.positions, _axes(flight)])
    # A pilot who stands still gives many samples at one progress: each counts by what it progresses.
    share = np.gradient(along) if len(along) > 1 else np.ones(1)
    share = np.maximum(share, 1e-9 * max(along[-1], 1e-9))
    fitted = np.array([_local_line(s, along, values, share, reach) for s in stations])
    times = np.interp(stations, along + 1e-9 * np.arange(len(along)), flight.t_s)
    times = np.maximum.accumulate(times) + 1e-6 * np.arange(len(times))
    return Trajectory(times, fitted[:, :3], _looking(fitted[:, 3:]))


def _local_line(station: float, along: Floats, values: Floats, share: Floats, reach: float) -> Floats:
    """Value at one progress of the weighted line through the samples near it."""
    low, high = np.searchsorted(along, [station - reach, station + reach])
    low, high = max(low - 1, 0), min(high + 1, len(along))
    offset = along[low:high] - station
    width = max(reach, float(np.abs(offset).min()) * 1.01, 1e-12)
    weight = share[low:high] * np.clip(1 - np.abs(offset / width) ** 3, 0, None) ** 3
    robust = np.ones_like(weight)
    near = values[low:high]
    fit = near[np.argmin(np.abs(offset))]
    for _ in range(2):
        both = weight * robust
        mass = both.sum()
        if mass <= 0:
            break
        mean_o, mean_v = both @ offset / mass, both @ near / mass
        spread = both @ (offset - mean_o) ** 2
        slope = (both * (offset - mean_o)) @ (near - mean_v) / spread if spread > 0 else 0 * mean_v
        # Samples close together on one side give a steep line, which leads where none of them has been.
        ahead, around = -slope * mean_o, near - mean_v
        farthest, led = np.linalg.norm(around[:, :3], axis=1).max(), np.linalg.norm(ahead[:3])
        fit = mean_v + ahead * (farthest / led if led > farthest else 1.0)
        residual = np.linalg.norm((near - mean_v - np.outer(offset - mean_o, slope))[:, :3], axis=1)
        usual = 6 * float(np.median(residual)) + 1e-9
        robust = np.clip(1 - (residual / usual) ** 2, 0, None) ** 2
    return np.asarray(fit)
