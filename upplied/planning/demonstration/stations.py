"""The stations by which a flight is given: as dense as its shape asks for, however long it is."""

from __future__ import annotations

import itertools

import numpy as np

from upplied.planning.constants import JITTER, JITTER_M, SAME_TURN_DEG
from upplied.polylines import cumulated, interpolated, leg_lengths
from upplied.poses import facing, matrices
from upplied.records import Floats, Ints, Trajectory

_SHORTEST = 0.1  # of the usual spacing: stations are no denser
_TURNED_RAD = np.radians(6.0)  # of the camera's axis from station to station, about
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
    ends = [
        run[[0, -1]] + [0, 1] for run in np.split(still, np.flatnonzero(np.diff(still) > 1) + 1) if len(run)
    ]
    sharp = places[_peaks(curvature, np.radians(SAME_TURN_DEG) / (_SHORTEST * spacing))]
    tips = [np.searchsorted(along, sharp).clip(0, len(flight) - 1)]
    fixed = np.unique(np.concatenate([[0, len(flight) - 1], *ends, *tips]).astype(np.int64))
    chosen = [np.zeros(1)]
    for first, last in itertools.pairwise(fixed):
        pieces = max(int(np.ceil(progress[last] - progress[first] - 1e-9)), 1)
        chosen.append(np.interp(*_evenly(progress, int(first), int(last), pieces)))
    index = np.arange(float(len(flight)))
    stations = np.concatenate(chosen)

    def there(values: Floats) -> Floats:
        return interpolated(stations, index, values)

    return Trajectory(np.interp(stations, index, flight.t_s), there(at), looking(there(axes)))


def _evenly(progress: Floats, first: int, last: int, pieces: int) -> tuple[Floats, Floats, Floats]:
    """Even steps of progress between two poses, but for the first; progress, and number, of the poses."""
    part = progress[first : last + 1] + 1e-12 * np.arange(last - first + 1)
    return np.linspace(part[0], part[-1], pieces + 1)[1:], part, np.arange(first, last + 1.0)


def _curvature(at: Floats, along: Floats, apart: float) -> tuple[Floats, Floats]:
    """Places along a path, m, and its curvature there, 1/m, as chords of length `apart` tell it."""
    moving = np.concatenate([[True], np.diff(along) > 0])
    number = max(int(np.ceil(along[-1] / max(apart, 1e-9))), 2)
    places = np.linspace(0, along[-1], number + 1)
    path = interpolated(places, along[moving], at[moving])
    leg = np.diff(path, axis=0)
    length = np.maximum(np.linalg.norm(leg, axis=1), 1e-12)
    cross = np.linalg.norm(np.cross(leg[:-1], leg[1:]), axis=1)
    angle = np.arctan2(cross, (leg[:-1] * leg[1:]).sum(axis=1))
    bend = np.zeros(len(places))
    bend[1:-1] = angle / ((length[1:] + length[:-1]) / 2)
    return places, bend


def _peaks(values: Floats, least: float) -> Ints:
    """Where values (K,) are largest among their neighbours and more than `least`."""
    inner = (values[1:-1] >= values[:-2]) & (values[1:-1] > values[2:]) & (values[1:-1] > least)
    return np.flatnonzero(inner) + 1
