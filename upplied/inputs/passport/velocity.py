"""How the poses move: speeds, and whether they follow the velocity and the gyroscope in the same log.

An estimator that knows its velocity did not take it from the poses that an exporter wrote: a flight that
was mirrored, in another unit or in other axes moves otherwise, though somebody could have flown it so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.inputs.flight.tracks import Track
from upplied.polylines import interpolated
from upplied.poses import angle_between
from upplied.records import Floats, Ints

_SPAN_S = 0.5  # over which poses are differenced: shorter is noise
_SLOWEST_MPS, _SLOWEST_RADPS = 0.3, 0.1  # below, a direction is noise
_TURNING_RADPS = 0.03  # about the vertical: above the bias of a gyroscope
_LEAST = 30  # moments that are compared
_LONGEST_S = 2.0  # between poses that are differenced


@dataclass(frozen=True)
class Motion:
    """How the motion of the poses compares with the velocity in the log; NaN where that has none."""

    motion_fit_pct: float = float("nan")  # mean cosine between the two, the worse of moving and turning
    motion_ratio: float = float("nan")  # speed of the poses over the speed in the log


@dataclass(frozen=True)
class Pace99:
    """What 99 % of a flight keep within."""

    speed_p99_mps: float = 0.0
    acceleration_p99_mps2: float = 0.0
    turn_p99_degps: float = 0.0


def _strided(track: Track) -> tuple[Ints, Floats]:
    """Poses about half a second apart, and the times of all, s."""
    seconds = (track.t_ns - track.t_ns[0]) * 1e-9
    stride = max(1, round(_SPAN_S / max(float(np.median(np.diff(seconds))), 1e-4)))
    return np.arange(0, len(track), stride), seconds


def pace99_of(track: Track, gap_s: float) -> Pace99:
    """Speeds and turns over half a second, but for gaps and resets."""
    at, seconds = _strided(track) if len(track) >= 4 else (np.empty(0, np.int64), np.empty(0))
    if len(at) < 4:
        return Pace99()
    breaks = np.diff(seconds) > gap_s
    if track.epoch is not None:
        breaks |= np.diff(track.epoch) != 0
    lasted, whole = np.diff(seconds[at]), np.diff(np.append(0, np.cumsum(breaks))[at]) == 0
    if not whole.any():
        return Pace99()
    velocity = np.diff(track.positions[at], axis=0) / lasted[:, None]
    turned = np.degrees(angle_between(track.quat_xyzw[at][1:], track.quat_xyzw[at][:-1])) / lasted
    gained = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / ((lasted[1:] + lasted[:-1]) / 2)
    gained = np.append(gained[whole[1:] & whole[:-1]], [] if (whole[1:] & whole[:-1]).any() else 0.0)
    speed = np.linalg.norm(velocity[whole], axis=1)
    return Pace99(*(float(np.percentile(values, 99)) for values in (speed, gained, turned[whole])))


def turning_of(track: Track, gyroscopes: Sequence[tuple[Ints, Floats]]) -> float:
    """How the poses turn about the vertical beside inertial units: the best correlation, -1 to 1.

    Mirrored poses turn the other way, whatever was done to their headings. NaN where nothing turns.

    Parameters
    ----------
    track : Track
        Clean, as logged, in a frame with z up.
    gyroscopes : sequence of (array, shape (N,), array, shape (N,))
        When, ns, and how fast each turns, rad/s, counter-clockwise from above.
    """
    first, last, lasted = _steps(track)
    if len(first) < _LEAST:
        return float("nan")
    starts, ends = (Rotation.from_quat(track.quat_xyzw[index]) for index in (first, last))
    turned = (ends * starts.inv()).as_rotvec()[:, 2] / lasted
    middle = (track.t_ns[first] + track.t_ns[last]) // 2
    fits = []
    for t_ns, about in gyroscopes:
        felt = np.interp((middle - t_ns[0]) * 1e-9, (t_ns - t_ns[0]) * 1e-9, about)
        turns = np.maximum(np.abs(turned), np.abs(felt)) > _TURNING_RADPS
        turns &= (middle >= t_ns[0]) & (middle <= t_ns[-1])
        size = float(np.linalg.norm(turned[turns]) * np.linalg.norm(felt[turns]))
        if turns.sum() >= _LEAST and size > 0:
            fits.append(float(turned[turns] @ felt[turns]) / size)
    return max(fits, default=float("nan"))


def _steps(track: Track) -> tuple[Ints, Ints, Floats]:
    """First and last pose, and seconds, of steps of about half a second that no gap interrupts."""
    if len(track) < _LEAST:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    at, seconds = _strided(track)
    lasted = np.diff(seconds[at])
    whole = (lasted > 1e-3) & (lasted < _LONGEST_S)
    return at[:-1][whole], at[1:][whole], lasted[whole]


def motion_of(track: Track, logged: tuple[Ints, Floats] | None) -> Motion:
    """Compare the motion of poses with the velocity in their log.

    Parameters
    ----------
    track : Track
        Clean, as logged, in its own frame.
    logged : (array, shape (N,), array, shape (N, 6)) or None
        When, ns, and the velocity, m/s and rad/s, in the axes of the body (REP-105) or of the world.
    """
    first, last, lasted = _steps(track)
    if logged is None or min(len(first), len(logged[0])) < _LEAST:
        return Motion()
    order = np.argsort(logged[0], kind="stable")
    middle = (track.t_ns[first] + track.t_ns[last] - 2 * track.t_ns[0]) * 0.5e-9
    velocity = interpolated(middle, (logged[0][order] - track.t_ns[0]) * 1e-9, logged[1][order])
    linear, angular = velocity[:, :3], velocity[:, 3:]
    starts, ends = (Rotation.from_quat(track.quat_xyzw[index]) for index in (first, last))
    moved = (track.positions[last] - track.positions[first]) / lasted[:, None]
    turned = (starts.inv() * ends).as_rotvec() / lasted[:, None]  # in the body's axes
    fits = [
        max(_fit(starts.inv().apply(moved), linear, _SLOWEST_MPS), _fit(moved, linear, _SLOWEST_MPS)),
        max(_fit(turned, angular, _SLOWEST_RADPS), _fit(starts.apply(turned), angular, _SLOWEST_RADPS)),
    ]
    known = [fit for fit in fits if np.isfinite(fit)]
    speeds, wanted = np.linalg.norm(moved, axis=1), np.linalg.norm(linear, axis=1)
    both = (speeds > _SLOWEST_MPS / 10) & (wanted > _SLOWEST_MPS)
    ratio = float(np.median(speeds[both] / wanted[both])) if both.sum() >= _LEAST else float("nan")
    return Motion(100 * min(known) if known else float("nan"), ratio)


def _fit(moved: Floats, logged: Floats, least: float) -> float:
    """Mean cosine between vectors that are long enough in both; NaN where there are too few."""
    lengths = np.linalg.norm(moved, axis=1), np.linalg.norm(logged, axis=1)
    both = (lengths[0] > least) & (lengths[1] > least)
    if both.sum() < _LEAST:
        return float("nan")
    return float(np.mean((moved[both] * logged[both]).sum(axis=1) / (lengths[0] * lengths[1])[both]))
