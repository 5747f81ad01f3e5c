"""Where the pilot stood still, and how fast he flew in between."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from upplied.planning.constants import SMOOTH_S, STILL
from upplied.polylines import interpolated, leg_lengths
from upplied.records import Bools, Floats, Trajectory

_TICK_S = 0.1
_MOST_TICKS = 100_000
_SURE_S = 1.0  # at the very same place for so long is no rounding of the log


def pauses(flight: Trajectory, least_s: float = 3.0) -> list[tuple[float, float]]:
    """Begin and end, s, of each time in which the pilot stood still, start and landing apart.

    He stands where the steadied position moves at less than three tenths of his usual speed, or where poses
    one after another are at the very same place.

    Parameters
    ----------
    flight : Trajectory
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
    known = [
        (begin, end)
        for begin, end in _runs(legs == 0, flight.t_s)
        if end - begin >= max(_SURE_S, least_s / 2)
    ]
    slow = _runs((speed < STILL * usual)[:-1], times)
    found = [(begin, end) for begin, end in slow if not any(begin < b and a < end for a, b in known)]
    return [
        (begin, end)
        for begin, end in sorted(known + found)
        if end - begin >= least_s and begin > flight.t_s[0] and end < flight.t_s[-1]
    ]


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
