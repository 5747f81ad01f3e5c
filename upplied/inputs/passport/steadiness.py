"""Whether the poses of a flight follow on each other as those of one camera: jumps, spikes, roll, clocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from upplied.inputs.flight.tracks import Track
from upplied.records import Bools, Floats

_AROUND = 7  # steps whose median tells how it moved there
_OFF_M = 0.7  # beside that: no gust moves a vehicle so between two poses
_TIMES = 8.0  # the usual
_LASTS = 3  # poses later, still there: it jumped; back: a spike
_STEEP = 0.94  # of an axis that points up or down, whose roll is that of its yaw
_LEAST = 20  # poses, and s, that tell


@dataclass(frozen=True)
class Steadiness:
    """Figures of a flight; NaN where nothing tells."""

    jumps: int = 0
    jump_m: float = 0.0  # the largest
    spikes: int = 0
    roll_deg: float = float("nan")  # of the camera, median size
    clock_ratio: float = float("nan")  # of the time by the source's clock and by the recorder's
    clock_ahead_s: float = float("nan")  # of the source's clock before the recorder's, median
    step_s: float = 0.0  # usual


def steadiness(logged: Track, flown: Track, gap_s: float) -> Steadiness:
    """The figures of a flight as it was logged, and of its camera.

    Parameters
    ----------
    logged : Track
        Clean, in the log's frame; what was dropped of it counts.
    flown : Track
        The camera's poses, structure frame.
    gap_s : float
        Steps of longer silences tell nothing.
    """
    off_m, lasting = _off(flown, gap_s)
    ratio = ahead_s = float("nan")
    spans = [float(np.ptp(clock)) * 1e-9 for clock in (logged.t_ns, logged.log_ns) if len(clock)]
    if min(spans, default=0.0) > _LEAST and not logged.clock_steps:
        ratio, ahead_s = spans[0] / spans[1], float(np.median(logged.t_ns - logged.log_ns)) * 1e-9
    dropped = logged.dropped.get("far off its neighbours", 0)
    return Steadiness(
        jumps=int(lasting.sum()),
        jump_m=float(off_m[lasting].max(initial=0.0)),
        spikes=int(((off_m > 0) & ~lasting).sum() + 1) // 2 + dropped,
        roll_deg=_roll_deg(flown.quat_xyzw),
        clock_ratio=ratio,
        clock_ahead_s=ahead_s,
        step_s=float(np.median(np.diff(flown.t_ns))) * 1e-9 if len(flown) > 1 else 0.0,
    )


def _off(track: Track, gap_s: float) -> tuple[Floats, Bools]:
    """How far each step (N - 1,) leads off the motion around it, m, where it does; and whether for good."""
    if len(track) < _LEAST:
        return np.zeros(0), np.zeros(0, bool)
    lasted = np.diff(track.t_ns) * 1e-9
    steps = np.diff(track.positions, axis=0)
    velocity = median_filter(steps / np.maximum(lasted, 1e-9)[:, None], size=(_AROUND, 1), mode="nearest")
    beside = steps - velocity * lasted[:, None]
    off_m = np.linalg.norm(beside, axis=1)
    same = lasted <= gap_s
    if track.epoch is not None:
        same &= np.diff(track.epoch) == 0
    off_m[~same | (off_m < max(_OFF_M, _TIMES * float(np.median(off_m))))] = 0.0
    whole = np.cumsum(beside, axis=0)
    later, before = (np.clip(np.arange(len(off_m)) + by, 0, len(off_m) - 1) for by in (_LASTS, -1 - _LASTS))
    moved = np.linalg.norm(whole[later] - whole[before], axis=1)
    return off_m, (off_m > 0) & (moved > 0.6 * off_m)


def _roll_deg(quats: Floats) -> float:
    turns = Rotation.from_quat(quats).as_matrix()
    level = np.abs(turns[:, 2, 0]) < _STEEP
    if level.sum() < _LEAST:
        return float("nan")
    return float(np.degrees(np.median(np.abs(np.arctan2(turns[level, 2, 1], turns[level, 2, 2])))))
