"""The constant turn of a logged camera against its plan, estimated together with its lag.

A camera that follows its plan is late by its lag times its rate. Round a tower, where it turns one way all
the time, that looks like a rotated mount.
"""

from __future__ import annotations

import numpy as np

from upplied.geometry.poses import interpolate, yaw_pitch
from upplied.records import Floats, Ints, Trajectory

LEAST_TURN_DEG = 0.1  # one sigma of a turn, at least: a gimbal is no better
_BLOCK_S = 20.0  # stretches whose errors hang together, and count as one
_LAG_S = 0.3  # one sigma of what a gimbal or a heading may lag by, beyond what the position does
_HALF_S = 0.25  # to both sides, over which the planned rate is taken
_HUBER_DEG = 1.0  # residuals beyond count less
_ROUNDS = 8


def camera_offset(plan: Trajectory, flown: Trajectory) -> tuple[tuple[float, float], tuple[float, float]]:
    """A constant turn of the camera, rad, that is to be added to what was flown, and one sigma of it.

    Parameters
    ----------
    plan : Trajectory
    flown : Trajectory
        N poses, with the moments of the plan that they correspond to as their times.

    Returns
    -------
    tuple
        Of the heading, and of the pitch; the error is infinite where the flight is too short to tell.
    """
    low, high = plan.t_s[0], plan.t_s[-1]
    moments = [np.clip(flown.t_s + off, low, high) for off in (-_HALF_S, 0.0, _HALF_S)]
    before, now, after = (yaw_pitch(interpolate(plan, at).quat_xyzw) for at in moments)
    span = np.maximum(moments[2] - moments[0], 1e-9)
    block = (flown.t_s // _BLOCK_S).astype(int)
    is_so = yaw_pitch(flown.quat_xyzw)
    rates = [_turned(last - first) / span for first, last in zip(before, after, strict=True)]
    offs = [_turned(wanted - mine) for wanted, mine in zip(now, is_so, strict=True)]
    yaw, pitch = (_constant(off, rate, block) for off, rate in zip(offs, rates, strict=True))
    return yaw, pitch


def _turned(angle_rad: Floats) -> Floats:
    return np.asarray(np.angle(np.exp(1j * angle_rad)))


def _constant(off_rad: Floats, rate_radps: Floats, block: Ints) -> tuple[float, float]:
    """The constant part of ``off = turn + lag * rate``, and one sigma of it, each stretch counting once."""
    names, of = np.unique(block, return_inverse=True)
    if len(names) < 3:
        return 0.0, float("inf")
    shape = np.column_stack([np.ones(len(off_rad)), rate_radps])
    share = 1.0 / np.bincount(of)[of]
    values = np.array([np.median(off_rad), 0.0])
    spread, least = np.radians(_HUBER_DEG), float(np.radians(LEAST_TURN_DEG))
    prior = np.diag([0.0, _LAG_S**-2])
    for _ in range(_ROUNDS):
        left = off_rad - shape @ values
        weight = share * np.minimum(1.0, np.radians(_HUBER_DEG) / np.maximum(np.abs(left), 1e-12))
        normal = (shape * weight[:, None]).T @ shape / spread**2 + prior
        values = np.linalg.solve(normal, (shape * weight[:, None]).T @ off_rad / spread**2)
        left = off_rad - shape @ values
        middles = np.array([np.median(left[of == name]) for name in range(len(names))])
        spread = max(1.4826 * float(np.median(np.abs(middles - np.median(middles)))), least)
    normal = (shape * weight[:, None]).T @ shape / spread**2 + prior
    return float(values[0]), max(float(np.sqrt(np.linalg.inv(normal)[0, 0])), least)
