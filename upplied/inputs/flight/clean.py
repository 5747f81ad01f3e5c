"""From the track of a log to one that can be trusted: what is dropped, and where it breaks."""

from __future__ import annotations

from collections import Counter

import numpy as np

from upplied.errors import InputError
from upplied.inputs.flight.tracks import Track
from upplied.inputs.sidecar import LogOptions
from upplied.poses import normalised
from upplied.records import Bools, Ints

MAX_NORM_ERROR = 1e-2  # of a quaternion; a rounded or single-precision one is far within
MAX_SPAN_NS = 24 * 3600 * 10**9
MAX_SPEED_MPS = 15.0  # a faster step that does not fit its surroundings is a jump, no flight
MIN_JUMP_M = 0.2
REPEATED = "repeated"  # the same sample again: nothing is lost by dropping it


def clean(track: Track, limits: LogOptions, what: str) -> Track:
    """Drop what is no pose, sort, and drop repeated stamps; every dropped sample is counted.

    Raises
    ------
    InputError
        If more than the allowed share was dropped, or nothing is left.
    """
    track = _stamped(track)
    norms = np.linalg.norm(track.quat_xyzw, axis=1)
    finite = np.isfinite(track.positions).all(axis=1) & np.isfinite(norms)
    track = _kept(track, finite, "not a number")
    norms = norms[finite]
    track = _kept(track, np.abs(norms - 1) <= MAX_NORM_ERROR, "quaternion not of unit length")
    track = track.take(np.argsort(track.t_ns, kind="stable"))
    track = _unrepeated(track)
    check_dropped(track, limits, what)
    if len(track):
        track.quat_xyzw[:] = normalised(track.quat_xyzw)
    return track


def check_dropped(track: Track, limits: LogOptions, what: str) -> None:
    """Refuse a track of which too much was dropped, or all.

    Raises
    ------
    InputError
        With the reasons and their numbers.
    """
    lost = sum(number for reason, number in track.dropped.items() if reason != REPEATED)
    reasons = ", ".join(f"{number} {reason}" for reason, number in sorted(track.dropped.items()))
    if not len(track):
        raise InputError(what, f"holds no usable pose ({reasons or 'no message'})", "at least 2 poses")
    if lost > limits.max_dropped * (lost + len(track)):
        raise InputError(
            what,
            f"{lost} of {lost + len(track)} samples are unusable ({reasons})",
            f"at most {limits.max_dropped:.0%}",
            "record the flight again, or raise max_dropped if what is left is good",
        )


def breaks(track: Track, gap_s: float) -> tuple[Ints, dict[str, int]]:
    """First sample after each gap, jump or reset of the estimator, and how many there are of each."""
    step_s = np.diff(track.t_ns) * 1e-9
    gaps = step_s > gap_s
    jumps = _jumps(np.linalg.norm(np.diff(track.positions, axis=0), axis=1), step_s)
    resets = np.zeros(len(step_s), bool) if track.epoch is None else np.diff(track.epoch) != 0
    found = {
        "gaps": int(gaps.sum()),
        "jumps": int((jumps & ~gaps & ~resets).sum()),
        "resets": int(resets.sum()),
    }
    return np.flatnonzero(gaps | jumps | resets) + 1, found


def _stamped(track: Track) -> Track:
    track = _kept(track, track.t_ns > 0, "no time stamp")
    if not len(track):
        return track
    middle = np.partition(track.t_ns, len(track) // 2)[len(track) // 2]
    return _kept(track, np.abs(track.t_ns - middle) <= MAX_SPAN_NS // 2, "stamp of another day")


def _kept(track: Track, good: Bools, reason: str) -> Track:
    if good.all():
        return track
    track.dropped[reason] += int((~good).sum())
    return track.take(good)


def _unrepeated(track: Track) -> Track:
    if len(track) < 2:
        return track
    same_time = np.concatenate([[False], np.diff(track.t_ns) == 0])
    moved = np.any(np.diff(np.column_stack([track.positions, track.quat_xyzw]), axis=0) != 0, axis=1)
    same = same_time & ~np.concatenate([[True], moved])
    counts = Counter({REPEATED: int(same.sum()), "stamp used twice": int((same_time & ~same).sum())})
    track.dropped.update({reason: number for reason, number in counts.items() if number})
    return track.take(~same_time)


def _jumps(step_m: np.ndarray, step_s: np.ndarray) -> Bools:
    speed = step_m / np.maximum(step_s, 1e-9)
    suspects = np.flatnonzero((speed > MAX_SPEED_MPS) & (step_m > MIN_JUMP_M))
    jumps = np.zeros(len(speed), bool)
    for index in suspects:  # a fast flight is fast for a while: compare with the steps around
        around = speed[max(0, index - 5) : index + 6]
        jumps[index] = speed[index] > 3 * np.median(around)
    return jumps
