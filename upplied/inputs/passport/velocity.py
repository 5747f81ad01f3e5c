"""How the poses move: speeds, jumps, roll, and whether they follow velocity and gyroscope in the same log.

An estimator's velocity does not come from exported poses: those in other axes or units move otherwise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from upplied.geometry.polylines import interpolated
from upplied.geometry.poses import angle_between
from upplied.inputs.flight.tracks import Track
from upplied.records import Bools, Floats, Ints

_SPAN_S = 0.5  # over which poses are differenced: shorter is noise
_SLOWEST_MPS, _SLOWEST_RADPS = 0.3, 0.1  # below, a direction is noise
_TURNING_RADPS = 0.03  # about the vertical: above the bias of a gyroscope
_LEAST = 30  # moments that are compared
_LONGEST_S = 2.0  # between poses that are differenced


def _strided(track: Track, least: int) -> tuple[Ints, Floats]:
    """Poses about half a second apart, and the times of all, s; none where there are less than `least`."""
    if len(track) < least:
        return np.empty(0, np.int64), np.empty(0)
    seconds = (track.t_ns - track.t_ns[0]) * 1e-9
    stride = max(1, round(_SPAN_S / max(float(np.median(np.diff(seconds))), 1e-4)))
    return np.arange(0, len(track), stride), seconds


def _pace99(track: Track, gap_s: float) -> dict[str, Any]:
    """Speed, acceleration and turn over half a second that 99 % keep within, but for gaps and resets."""
    at, seconds = _strided(track, 4)
    if len(at) < 4:
        return {}
    breaks = np.diff(seconds) > gap_s
    if track.epoch is not None:
        breaks |= np.diff(track.epoch) != 0
    lasted, whole = np.diff(seconds[at]), np.diff(np.append(0, np.cumsum(breaks))[at]) == 0
    if not whole.any():
        return {}
    velocity = np.diff(track.positions[at], axis=0) / lasted[:, None]
    turned = np.degrees(angle_between(track.quat_xyzw[at][1:], track.quat_xyzw[at][:-1])) / lasted
    gained = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / ((lasted[1:] + lasted[:-1]) / 2)
    gained, speed = gained[whole[1:] & whole[:-1]], np.linalg.norm(velocity[whole], axis=1)
    parts = {"speed_p99_mps": speed, "acceleration_p99_mps2": gained, "turn_p99_degps": turned[whole]}
    return {name: float(np.percentile(values, 99)) for name, values in parts.items() if len(values)}


def turning_of(track: Track, gyroscopes: Sequence[tuple[Ints, Floats]]) -> float:
    """How the poses, as logged, turn about the vertical beside inertial units: the best correlation, -1 to 1.

    Mirrored poses turn the other way, whatever their headings. NaN where nothing turns. Of each gyroscope
    when (N,), ns, and how fast it turns (N,), rad/s, counter-clockwise from above.
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
    at, seconds = _strided(track, _LEAST)
    lasted = np.diff(seconds[at])
    whole = (lasted > 1e-3) & (lasted < _LONGEST_S)
    return at[:-1][whole], at[1:][whole], lasted[whole]


def _motion(track: Track, logged: tuple[Ints, Floats] | None) -> dict[str, Any]:
    """Compare the motion of poses, as logged, with the velocity in their log, of the body or of the world."""
    first, last, lasted = _steps(track)
    if logged is None or min(len(first), len(logged[0])) < _LEAST:
        return {}
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
    return {"motion_fit_pct": 100 * min(known) if known else float("nan"), "motion_ratio": ratio}


def _fit(moved: Floats, logged: Floats, least: float) -> float:
    """Mean cosine between vectors that are long enough in both; NaN where there are too few."""
    lengths = np.linalg.norm(moved, axis=1), np.linalg.norm(logged, axis=1)
    both = (lengths[0] > least) & (lengths[1] > least)
    if both.sum() < _LEAST:
        return float("nan")
    return float(np.mean((moved[both] * logged[both]).sum(axis=1) / (lengths[0] * lengths[1])[both]))


_AROUND = 7  # steps whose median tells how it moved there
_OFF_M = 0.7  # beside that: no gust moves a vehicle so between two poses
_TIMES = 8.0  # the usual
_LASTS = 3  # poses later, still there: it jumped; back: a spike
_STEEP = 0.94  # of an axis that points up or down, whose roll is that of its yaw
_TELLING = 20  # poses, and s, that tell


@dataclass(frozen=True)
class Steadiness:
    """How a flight moves; NaN where nothing tells."""

    motion_fit_pct: float = float("nan")  # mean cosine with the log's velocity, the worse of two
    motion_ratio: float = float("nan")  # speed of the poses over the speed in the log
    speed_p99_mps: float = 0.0  # what 99 % of the flight keep within
    acceleration_p99_mps2: float = 0.0
    turn_p99_degps: float = 0.0
    jumps: int = 0
    jump_m: float = 0.0  # the largest
    spikes: int = 0
    roll_deg: float = float("nan")  # of the camera, median size
    clock_ratio: float = float("nan")  # of the time by the source's clock and by the recorder's
    clock_ahead_s: float = float("nan")  # of the source's clock before the recorder's, median
    step_s: float = 0.0  # usual


def steadiness(
    logged: Track, flown: Track, gap_s: float, velocity: tuple[Ints, Floats] | None = None, timed: bool = True
) -> Steadiness:
    """The figures of a flight as it was logged, clean, and of its camera, but for silences of `gap_s`.

    Of the velocity in the log when (N,), ns, and (N, 6), m/s and rad/s, in axes of the body (REP-105) or of
    the world. Poses that are not timed have no pace.
    """
    off_m, lasting = _off(flown, gap_s)
    ratio = ahead_s = float("nan")
    spans = [float(np.ptp(clock)) * 1e-9 for clock in (logged.t_ns, logged.log_ns) if len(clock)]
    if min(spans, default=0.0) > _TELLING and not logged.clock_steps:
        ratio, ahead_s = spans[0] / spans[1], float(np.median(logged.t_ns - logged.log_ns)) * 1e-9
    dropped = logged.dropped.get("far off its neighbours", 0)
    turns = Rotation.from_quat(flown.quat_xyzw).as_matrix()
    turns = turns[np.abs(turns[:, 2, 0]) < _STEEP]
    rolls = np.degrees(np.abs(np.arctan2(turns[:, 2, 1], turns[:, 2, 2])))
    return Steadiness(
        **_motion(logged, velocity),
        **(_pace99(flown, gap_s) if timed else {}),
        jumps=int(lasting.sum()), jump_m=float(off_m[lasting].max(initial=0.0)),
        spikes=int(((off_m > 0) & ~lasting).sum() + 1) // 2 + dropped,
        roll_deg=float(np.median(rolls)) if len(rolls) >= _TELLING else float("nan"),
        clock_ratio=ratio, clock_ahead_s=ahead_s,
        step_s=float(np.median(np.diff(flown.t_ns))) * 1e-9 if len(flown) > 1 else 0.0,
    )  # fmt: skip


def _off(track: Track, gap_s: float) -> tuple[Floats, Bools]:
    """How far each step (N - 1,) leads off the motion around it, m, where it does; and whether for good."""
    if len(track) < _TELLING:
        return np.zeros(0), np.zeros(0, bool)
    lasted = np.diff(track.t_ns) * 1e-9
    steps = np.diff(track.positions, axis=0)
    velocity = median_filter(steps / np.maximum(lasted, 1e-9)[:, None], size=(_AROUND, 1), mode="nearest")
    beside = steps - velocity * lasted[:, None]
    off_m = np.linalg.norm(beside, axis=1)
    same = lasted < min(gap_s, _LONGEST_S)  # farther apart, nobody knows how it moved
    if track.epoch is not None:
        same &= np.diff(track.epoch) == 0
    off_m[~same | (off_m < max(_OFF_M, _TIMES * float(np.median(off_m))))] = 0.0
    whole = np.cumsum(beside, axis=0)
    later, before = (np.clip(np.arange(len(off_m)) + by, 0, len(off_m) - 1) for by in (_LASTS, -1 - _LASTS))
    moved = np.linalg.norm(whole[later] - whole[before], axis=1)
    return off_m, (off_m > 0) & (moved > 0.6 * off_m)
