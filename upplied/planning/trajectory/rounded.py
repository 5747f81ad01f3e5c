"""A path of stations made a smooth curve through them, as far as the rules allow.

A polyline has all its turning at its vertices: a vehicle that minds its acceleration would slow down
at each and speed up between. The curve through the same stations turns steadily.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from upplied.poses import interpolate
from upplied.records import Bools, Floats, Trajectory, Waypoints

_STEP_M = 0.5  # largest leg of the result
_MOST = 40  # pieces of a leg
_AWAY = 0.12  # of a leg: a curve that leaves it further is none that the stations meant


def rounded(path: Waypoints, broken: Callable[[Floats], Bools]) -> Waypoints:
    """The path with further waypoints on a cubic spline through its own.

    Parameters
    ----------
    path : Waypoints
        Closely spaced; its legs keep the rules.
    broken : callable
        Takes positions (K, 3), gives (K - 1,) bool: which legs break a rule.

    Returns
    -------
    Waypoints
        The given ones among them. A leg whose curve would break a rule stays straight.
    """
    leg = np.linalg.norm(np.diff(path.positions, axis=0), axis=1)
    if len(path) < 4 or (leg > 1e-6).sum() < 3:
        return path
    pieces = np.clip(np.ceil(leg / _STEP_M - 1e-9).astype(int), 1, _MOST)
    number = np.repeat(np.arange(len(leg)), pieces)
    share = (np.arange(len(number)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[number]
    along = np.concatenate([[0.0], np.cumsum(leg)])
    apart = np.concatenate([[True], leg > 1e-6])
    curve = CubicSpline(along[apart], path.positions[apart], bc_type="natural")
    straight = path.positions[:-1][number] + share[:, None] * np.diff(path.positions, axis=0)[number]
    curved = curve(along[:-1][number] + share * leg[number])
    curved[share == 0] = path.positions[number[share == 0]]
    away = np.linalg.norm(curved - straight, axis=1) > _AWAY * leg[number]
    bad = np.bincount(number[away], minlength=len(leg)) > 0
    while True:
        places = np.vstack([np.where(bad[number][:, None], straight, curved), path.positions[-1:]])
        worse = np.bincount(number[broken(places)], minlength=len(leg)) > 0
        if not (worse & ~bad).any():
            break
        bad |= worse
    origin = np.append(number + share, float(len(leg)))
    index = np.arange(float(len(path)))
    viewpoint = np.zeros(len(origin), bool)
    viewpoint[np.append(share == 0, True)] = path.is_viewpoint
    turned = interpolate(Trajectory(index, path.positions, path.quat_xyzw), origin).quat_xyzw
    return Waypoints(places, turned, np.interp(origin, index, path.t_s), viewpoint)
