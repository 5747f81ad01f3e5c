"""How much a path winds, whatever its waypoints: by which smoothing is judged."""

from __future__ import annotations

import itertools

import numpy as np

from upplied.records import Floats


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
    points = [positions[0]]
    for start, end in itertools.pairwise(positions):
        while np.linalg.norm(end - points[-1]) >= spacing:
            # Where the leg leaves the ball round the last point kept.
            leg, gap = end - start, start - points[-1]
            a, b, c = leg @ leg, leg @ gap, gap @ gap - spacing**2
            share = (-b + np.sqrt(max(b * b - a * c, 0.0))) / max(a, 1e-300)
            points.append(start + min(max(share, 0.0), 1.0) * leg)
            start = points[-1]
    return np.array(points)
