"""Moments of a flight that is slowed: so that some lie far enough apart, or that it brakes no harder."""

import itertools

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from upplied.geometry.polylines import accelerations, cumulated
from upplied.records import Floats

_EASINGS = 50  # times, at most, that legs are flown more slowly
_WAITS = 200  # times, at most, that the time between chosen moments is stretched
_MOST_STEPS = 100_000  # of the time that is stretched
_OVER = 1e-3  # more than they must wait, so that it ends
_EASED = 0.01  # more than they must be, so that it ends
_CLOCK_S = 0.1  # steps of the time that is stretched
_BRAKING_S = 0.2, 1.0  # how long braking takes, least and most


def spaced(times: Floats, chosen_s: Floats, least_s: float, brake_s: float) -> Floats:
    """When the poses of a flight are reached (N,), s, that is slower where chosen moments were too near.

    It brakes before and after: what that takes more counts for the next of them. The first stays as it was.

    Parameters
    ----------
    times, chosen_s : array, shape (N,) and (K,)
        Of the poses, and moments among these, s, increasing.
    least_s : float
        Between two of the chosen ones.
    brake_s : float
        How long braking takes; taken for 0.2 to 1 s.
    """
    if (np.diff(chosen_s) >= least_s).all():
        return times
    gaps = np.maximum(np.diff(chosen_s), least_s)
    steps = 2 + int((times[-1] - times[0]) / min(_CLOCK_S, np.diff(chosen_s).min(initial=_CLOCK_S) / 2))
    clock = np.linspace(times[0], times[-1], min(steps, _MOST_STEPS))
    between = np.searchsorted(chosen_s, (clock[1:] + clock[:-1]) / 2)
    brake = 2 * round(float(np.clip(brake_s, *_BRAKING_S)) / (clock[1] - clock[0])) + 1
    slower = np.ones(len(clock) - 1)
    for _ in range(_WAITS):
        late = cumulated(uniform_filter1d(slower, brake, mode="nearest") * np.diff(clock))
        short = gaps / np.maximum(np.diff(np.interp(chosen_s, clock, late)), 1e-9)
        if not (short > 1 + 1e-9).any():
            break
        slower *= np.concatenate([[1.0], np.where(short > 1, short + _OVER, 1.0), [1.0]])[between]
    else:
        late = late * short.max()
    return times[0] + np.interp(times, clock, late)


def no_harder(times: Floats, positions: Floats, most_mps2: float) -> Floats:
    """Moments of a flight (N,), s, later where between positions (N, 3), m, it accelerates too much."""
    for _ in range(_EASINGS):
        excess = np.sqrt(accelerations(times, positions) / most_mps2)
        if not (excess > 1 + 1e-9).any():
            break
        slower = np.maximum(np.concatenate([[1.0], excess]), np.concatenate([excess, [1.0]]))
        slower = np.where(slower > 1, slower + _EASED, 1.0)  # so many times on each leg
        clock = np.linspace(times[0], times[-1], int((times[-1] - times[0]) / _CLOCK_S) + 2)
        leg = np.clip(np.searchsorted(times, clock, side="right") - 1, 0, len(slower) - 1)
        # The slowest leg of each step of the clock: legs are shorter where photos are close to other poses.
        rate = np.array([slower[first : last + 1].max() for first, last in itertools.pairwise(leg)])
        brake = 2 * round(_BRAKING_S[1] / _CLOCK_S) + 1
        # The mean of the slowest round about is nowhere faster than what it is the mean of.
        rate = uniform_filter1d(maximum_filter1d(rate, brake, mode="nearest"), brake, mode="nearest")
        times = times[0] + np.interp(times, clock, cumulated(rate * np.diff(clock)))
    return times
