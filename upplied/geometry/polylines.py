"""Lengths along polylines, values between their vertices, and a few of many chosen evenly."""

import numpy as np

from upplied.records import Floats, Ints


def leg_lengths(points: Floats) -> Floats:
    """Length (N - 1,) of each leg of a polyline (N, D), in its unit."""
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=1), float)


def accelerations(t_s: Floats, positions: Floats) -> Floats:
    """Acceleration (N - 2,), m/s2, from the middle of each leg to that of the next."""
    step = np.diff(t_s)
    velocity = np.diff(positions, axis=0) / step[:, None]
    return np.linalg.norm(np.diff(velocity, axis=0), axis=1) / ((step[1:] + step[:-1]) / 2)


def cumulated(steps: Floats) -> Floats:
    """What steps (N,) add up to before each of them and at their end, (N + 1,)."""
    return np.concatenate([[0.0], np.cumsum(steps)])


def arc_length(points: Floats) -> Floats:
    """How far along a polyline (N, D) each of its vertices lies, (N,), in its unit; the first at 0."""
    return cumulated(leg_lengths(points))


def interpolated(at: np.ndarray, where: np.ndarray, values: Floats) -> Floats:
    """Values (K, D) at places (K,), linear between values (N, D) at increasing places (N,)."""
    return np.column_stack([np.interp(at, where, column) for column in values.T])


def pieces_of_legs(pieces: Ints) -> tuple[Ints, Floats]:
    """The leg, and the share of it, at which each piece of legs divided into so many (L,) begins."""
    leg = np.repeat(np.arange(len(pieces)), pieces)
    return leg, (np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[leg]


def chosen_evenly(count: int, most: int) -> Ints:
    """Indices of at most so many of a number of things, spread evenly over them, both ends among them."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(np.int64))
