"""A noisy demonstration made even: jitter leaves no trace, what was flown on purpose stays.

The shake of hand and sensors shows in the log as noise from pose to pose. Each pose is averaged over as
long a time as changes nothing but that noise (Lepski's rule: of several widths the largest whose mean
agrees with those of all smaller ones). So a straight stretch is averaged over seconds, and the tip of an
approach, the end of a row or a corner over hardly any. Nothing else is taken out: an excursion that is no
noise was flown, and cannot be distinguished from one that was meant.

A hover is one place with a beginning and an end. In between, the flight is given by stations as dense as its
shape asks for: straight lines between them leave it by no more than a few centimetres, whatever its length.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import convolve1d, gaussian_filter1d, minimum_filter1d

from upplied.geometry.polylines import interpolated, leg_lengths
from upplied.geometry.poses import fov_at, in_a_row
from upplied.planning.constants import JITTER_M, SMOOTH_S
from upplied.planning.demonstration.stations import axes_of, jitter_m, looking, pauses, stations_of
from upplied.records import Floats, Ints, Record, Trajectory

_GRID_S = 0.05  # shortest step of the even times that a log is brought to
_WIDTHS_S = (0.1, 0.2, 0.4, 0.8, 1.6)  # standard deviations of the averages
_WILD_MPS2 = 30.0  # no camera vehicle accelerates like that
# From the median norm of the second difference in 3D to its standard deviation per axis.
_NOISE = 1 / (np.sqrt(6) * 1.538)
_AGREE = 2.576  # standard deviations within which 99 % of normal noise lies: beyond, it is none
_HOVER_S = 2.0  # standing still for so long is a place of its own


@dataclass(frozen=True, eq=False, repr=False)
class Smoothed(Record):
    """A flight without jitter, and where it continues after a gap in the log."""

    flight: Trajectory  # no roll; two poses at one place where it hovers
    breaks: Ints  # first pose of each part but the first


def smoothed(flight: Trajectory, spacing_m: float = np.inf, breaks: Ints | None = None) -> Smoothed:
    """The flight as the pilot meant it; its times are those at which the demonstration was there.

    Parameters
    ----------
    flight : Trajectory
        N poses as logged.
    spacing_m : float
        Between stations, at most, where the flight is straight. They are denser where it bends or the
        camera turns, and on a short flight.
    breaks : array of int, optional
        First pose after each gap in the log; nothing is smoothed across.
    """
    inner = () if breaks is None else {int(b) for b in breaks if 0 < b < len(flight)}
    cuts = [0, *sorted(inner), len(flight)]
    extent = 2 * float(np.linalg.norm(flight.positions - flight.positions.mean(axis=0), axis=1).max())
    if extent == 0 or len(flight) < 3:
        return Smoothed(flight, np.array(cuts[1:-1], np.int64))
    steady = [_steady(flight.take(slice(a, b)), extent) for a, b in itertools.pairwise(cuts)]
    length = sum(float(leg_lengths(part.positions).sum()) for part in steady)
    reduced = [stations_of(part, spacing_m, extent, length) for part in steady]
    joined = in_a_row(reduced)
    joined = replace(joined, fov_deg=fov_at(flight, joined.t_s))
    return Smoothed(joined, np.cumsum([len(part) for part in reduced])[:-1])


def _steady(flight: Trajectory, extent: float) -> Trajectory:
    """One part without jitter, at even times; its hovers are places."""
    if len(flight) < 5 or flight.t_s[-1] <= flight.t_s[0]:
        return Trajectory(flight.t_s, flight.positions, looking(axes_of(flight)))
    times, values = _at_even_times(flight)
    tick = float(times[1] - times[0])
    positions = _averaged(_without_spikes(values[:, :3], tick), tick, jitter_m(extent))
    axes = np.hstack([_averaged(values[:, side], tick) for side in (slice(3, 6), slice(6, 9))])
    for begin, end in pauses(flight, _HOVER_S):
        _stand(times, positions, max(int(np.searchsorted(times, begin, "right")) - 1, 0), end)
    return Trajectory(times, positions, looking(axes))


def _stand(times: Floats, positions: Floats, first: int, end: float) -> None:
    """Make a pause one place, in which all of it is spent; the way into it and out of it stays as flown."""
    last = min(int(np.searchsorted(times, end)), len(times) - 1)
    points = positions[first : last + 1]
    place = points.mean(axis=0)
    for _ in range(20):  # to where the sum of distances is least, nearly: few far ones do not move it
        weight = 1 / np.maximum(np.linalg.norm(points - place, axis=1), 1e-3)
        place = weight @ points / weight.sum()
    there = np.linalg.norm(points - place, axis=1) <= 3 * JITTER_M
    change = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int))).reshape(-1, 2)
    if len(change) == 0:
        return
    begin, stop = first + change[np.diff(change, axis=1).argmax()]
    if 2 * (stop - begin) < last - first:
        return  # it drifts: that is flown as it was
    positions[begin:stop] = place
    times[first : begin + 1] = times[first] + 1e-3 * np.arange(begin + 1 - first)
    times[stop - 1 : last + 1] = times[last] - 1e-3 * np.arange(last + 1 - stop, -1, -1)


def _at_even_times(flight: Trajectory) -> tuple[Floats, Floats]:
    """Even times (K,), and positions and axes (K, 9) there: means of the samples round each, or between."""
    begin, end = float(flight.t_s[0]), float(flight.t_s[-1])
    tick = max(_GRID_S, float(np.median(np.diff(flight.t_s))))
    times = np.linspace(begin, end, max(int(np.ceil((end - begin) / tick - 1e-6)), 2) + 1)
    values = np.column_stack([flight.positions, axes_of(flight)])
    even = interpolated(times, flight.t_s, values)
    cell = np.searchsorted((times[1:] + times[:-1]) / 2, flight.t_s)
    count = np.bincount(cell, minlength=len(times))
    several = count > 1
    several[[0, -1]] = False  # the ends are where the log begins and ends
    if several.any():
        # The mean of samples is the value at the mean of their times: it is brought to the even time.
        mean = np.column_stack([np.bincount(cell, column, len(times)) for column in values.T])
        mean_s = np.bincount(cell, flight.t_s, len(times))[several] / count[several]
        there = interpolated(mean_s, times, even)
        even[several] += mean[several] / count[several, None] - there
    return times, even


def _without_spikes(values: Floats, tick: float) -> Floats:
    """Single samples (K, 3) that no vehicle could have been at, put between their neighbours."""
    # One sample out of place by s makes second differences of s, -2 s and s, whose sum is nothing; the tip of
    # a sharp turn does not.
    bend = np.zeros_like(values)  # none at the ends, which are never wild
    bend[1:-1] = np.diff(values, 2, axis=0)
    total = bend + np.roll(bend, 1, axis=0) + np.roll(bend, -1, axis=0)
    size = np.linalg.norm(bend, axis=1)
    wild = size / 2 > max(2 * _AGREE * noise_of(values), _WILD_MPS2 * tick**2)
    spike = np.flatnonzero(wild & (np.linalg.norm(total, axis=1) < 0.3 * size))
    calm = np.array(values)
    calm[spike] = (values[spike - 1] + values[spike + 1]) / 2
    return calm


def noise_of(values: Floats) -> float:
    """Standard deviation, per axis, of what differs from sample to sample (K, 3) without any pattern."""
    if len(values) < 3:
        return 0.0
    return _NOISE * float(np.median(np.linalg.norm(np.diff(values, 2, axis=0), axis=1)))


def _averaged(values: Floats, tick: float, jitter: float = 0.0) -> Floats:
    """Each sample (K, 3) averaged over as long a time as changes nothing but the noise."""
    # `jitter` is what may change besides.
    noise = noise_of(values)
    # Both ends lie on the lines through the samples beside them, where no more than noise is off these: what
    # is continued by reflection beyond an end shares the noise of that end.
    values = np.array(values)
    index = np.arange(min(round(SMOOTH_S / tick) + 1, len(values)))
    for end in (values, values[::-1]) if len(index) >= 4 else ():  # views: what is set is set in `values`
        _, begin = np.polyfit(index, end[index], 1)
        if np.linalg.norm(begin - end[0]) <= _AGREE * np.sqrt(3) * noise:
            end[0] = begin
    averages, spread = [values], [noise]
    for width in _WIDTHS_S:
        sigma = width / tick
        if sigma < 0.5 or 3 * sigma > len(values):
            continue
        # Weights that keep parabolas: the Gaussian less half its second derivative. The ends are continued by
        # point reflection and so stay where they are.
        many = min(int(4 * sigma) + 1, len(values) - 1)
        before, after = 2 * values[0] - values[many:0:-1], 2 * values[-1] - values[-2 : -many - 2 : -1]
        step = np.arange(-many, many + 1) / sigma
        weight = (3 - step**2) * np.exp(-(step**2) / 2)
        longer = np.vstack([before, values, after])
        averages.append(convolve1d(longer, weight / weight.sum(), axis=0)[many:-many])
        spread.append(noise * np.sqrt(min(0.476 / sigma, 1.0)))
    level, agrees = np.zeros(len(values), np.int64), np.ones(len(values), bool)
    for wide in range(1, len(averages)):
        for narrow in range(wide):
            apart = np.linalg.norm(averages[wide] - averages[narrow], axis=1)
            agrees &= apart <= _AGREE * np.sqrt(3) * (spread[wide] + spread[narrow]) + jitter
        level[agrees] = wide
    level = minimum_filter1d(level, 2 * round(SMOOTH_S / tick) + 1, mode="nearest")
    shares = np.stack([level == index for index in range(len(averages))]).astype(float)
    shares = gaussian_filter1d(shares, SMOOTH_S / 3 / tick, axis=1, mode="nearest")
    return np.asarray(np.einsum("kn,knj->nj", shares, np.stack(averages)))
