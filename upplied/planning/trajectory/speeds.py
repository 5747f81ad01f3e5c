"""The largest speeds along a path of straight legs that nowhere exceed a limit.

What is decided is one speed for each leg. Speeds, rates and climbs bound each leg by itself; accelerations,
of the vehicle and of its heading, bound neighbours together. A pass from the start to the end lets no leg be
faster than the one before it allows, a pass back lets none be faster than the one after it allows (as in
time-optimal path parameterisation: Bobrow 1985; Pham and Pham 2018). For a pair of legs the condition is made
so that a speed between two allowed ones is allowed, hence the pass back breaks nothing that the first mended:
every limit holds when both are done, without any repair.
"""

import numpy as np
from numba import njit

from upplied.records import Bools, Floats

_HALVINGS = 40
_Rule = tuple[Floats, Floats, float, float]  # legs and turns as of `corner_cap`, acceleration and angular


def corner_cap(legs: Floats, turns: Floats, rest: Bools, acceleration: float, angular: float) -> Floats:
    """Speed of each leg (K,), m/s, at which it may be followed by another of the same speed, or by rest.

    Parameters
    ----------
    legs : array, shape (K, 3), m
    turns : array, shape (K,), rad
        Of the heading, on each leg.
    rest : array of bool, shape (K + 1,)
        Where the vehicle stands, before, between and after the legs.
    acceleration, angular : float, m/s^2 and rad/s^2
        Limits.
    """
    length = np.maximum(np.linalg.norm(legs, axis=1), 1e-12)
    ahead, bend = legs / length[:, None], np.abs(turns) / length
    from_rest = np.minimum(
        np.sqrt(acceleration * length / 2), np.sqrt(angular * length / (2 * np.maximum(bend, 1e-12)))
    )
    cap = np.where(rest[:-1] | rest[1:], from_rest, np.inf)
    both = (length[:-1] + length[1:]) / 2
    across = np.linalg.norm(np.diff(ahead, axis=0), axis=1)
    winding = np.abs(np.diff(turns / length))
    at = np.minimum(
        np.sqrt(acceleration * both / np.maximum(across, 1e-12)),
        np.sqrt(angular * both / np.maximum(winding, 1e-12)),
    )
    at = np.where(rest[1:-1], np.inf, at)
    cap[:-1] = np.minimum(cap[:-1], at)
    cap[1:] = np.minimum(cap[1:], at)
    return cap


@njit(cache=True)
def passes(
    cap: Floats, legs: Floats, turns: Floats, rest: Bools, acceleration: float, angular: float
) -> Floats:
    """Speeds (K,), m/s, at most the caps, that change from leg to leg no faster than the limits allow.

    Parameters are those of `corner_cap`; `cap` is at most what that gives.
    """
    speed, rule = cap.copy(), (legs, turns, acceleration, angular)
    last = len(speed) - 1
    for index in range(last):
        if not rest[index + 1] and speed[index + 1] > speed[index]:
            speed[index + 1] = _reached(speed[index], speed[index + 1], index, index + 1, rule)
    for index in range(last, 0, -1):
        if not rest[index] and speed[index - 1] > speed[index]:
            speed[index - 1] = _reached(speed[index], speed[index - 1], index, index - 1, rule)
    return speed


@njit(cache=True)
def _reached(slow: float, fast: float, here: int, beside: int, rule: _Rule) -> float:
    """The largest speed from `slow` to `fast` that a leg beside one of speed `slow` may have."""
    if _fits(slow, fast, here, beside, rule):
        return fast
    low, high = slow, fast
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if _fits(slow, middle, here, beside, rule):
            low = middle
        else:
            high = middle
    return low


@njit(cache=True)
def _fits(slow: float, fast: float, here: int, beside: int, rule: _Rule) -> bool:
    """Whether a leg of speed `slow` and its neighbour of speed `fast` may follow each other."""
    # The change of velocity has to be within the limit for the time between the middles of both legs, as
    # their own speeds give it and as a steady acceleration from one to the other gives it. The left sides
    # grow with `fast`, the right sides shrink: if one speed fits, so does every one between it and `slow`.
    legs, turns, acceleration, angular = rule
    length_here = np.sqrt(legs[here, 0] ** 2 + legs[here, 1] ** 2 + legs[here, 2] ** 2)
    length = np.sqrt(legs[beside, 0] ** 2 + legs[beside, 1] ** 2 + legs[beside, 2] ** 2)
    time = min((length_here / slow + length / fast) / 2, (length_here + length) / (slow + fast))
    across = 0.0
    for axis in range(3):
        across += (legs[beside, axis] / length - legs[here, axis] / length_here) ** 2
    change = np.sqrt((fast - slow) ** 2 + across * slow * fast)
    bend_here, bend = turns[here] / length_here, turns[beside] / length
    winding = abs(bend) * (fast - slow) + abs(bend - bend_here) * slow
    return change <= acceleration * time and winding <= angular * time
