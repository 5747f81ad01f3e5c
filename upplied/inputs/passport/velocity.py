"""Whether the poses move and turn as the velocity in the same messages says.

An estimator that knows its velocity did not take it from the poses that an exporter wrote: a flight that
was mirrored, in another unit or in other axes moves otherwise than it says, though somebody could have
flown it so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.inputs.flight.tracks import Track
from upplied.polylines import interpolated
from upplied.records import Floats, Ints

_SPAN_S = 0.5  # over which poses are differenced: shorter is noise
_SLOWEST_MPS, _SLOWEST_RADPS = 0.3, 0.1  # below, a direction is noise
_TURNING_RADPS = 0.03  # about the vertical: above the bias of a gyroscope
_LEAST = 30  # moments that tell of one
_LONGEST_S = 2.0  # between poses that are differenced


@dataclass(frozen=True)
class Motion:
    """How the motion of the poses compares with what is said of it; NaN where nothing tells."""

    fit_pct: float = float("nan")  # mean cosine between the two, the worse of moving and turning
    ratio: float = float("nan")  # speed of the poses over the speed that is said


def turning_of(track: Track, felt: Sequence[tuple[str, Ints, Floats]]) -> float:
    """How the poses turn about the vertical beside what inertial units feel: the best correlation, -1 to 1.

    Mirrored poses turn the other way, whatever was done to their headings. NaN where nothing tells.

    Parameters
    ----------
    track : Track
        Clean, as logged, in a frame with z up.
    felt : sequence of (topic, array, shape (N,), array, shape (N,))
        When, ns, and how fast each turns, rad/s, counter-clockwise from above.
    """
    first, last, lasted = _steps(track)
    if len(first) < _LEAST:
        return float("nan")
    starts, ends = (Rotation.from_quat(track.quat_xyzw[index]) for index in (first, last))
    turned = (ends * starts.inv()).as_rotvec()[:, 2] / lasted
    middle = (track.t_ns[first] + track.t_ns[last]) // 2
    fits = []
    for _, t_ns, about in felt:
        inside = (middle >= t_ns[0]) & (middle <= t_ns[-1])
        said = np.interp((middle - t_ns[0]) * 1e-9, (t_ns - t_ns[0]) * 1e-9, about)
        told = inside & (np.maximum(np.abs(turned), np.abs(said)) > _TURNING_RADPS)
        size = float(np.linalg.norm(turned[told]) * np.linalg.norm(said[told]))
        fits.append(float(turned[told] @ said[told]) / size if told.sum() >= _LEAST and size > 0 else np.nan)
    known = [fit for fit in fits if np.isfinite(fit)]
    return max(known) if known else float("nan")


def _steps(track: Track) -> tuple[Ints, Ints, Floats]:
    """First and last pose, and seconds, of steps of about half a second that no gap interrupts."""
    if len(track) < _LEAST:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    seconds = (track.t_ns - track.t_ns[0]) * 1e-9
    stride = max(1, round(_SPAN_S / max(float(np.median(np.diff(seconds))), 1e-4)))
    at = np.arange(0, len(track), stride)
    lasted = np.diff(seconds[at])
    whole = (lasted > 1e-3) & (lasted < _LONGEST_S)
    return at[:-1][whole], at[1:][whole], lasted[whole]


def motion_of(track: Track, said: tuple[Ints, Floats] | None) -> Motion:
    """Compare the motion of logged poses with the velocity that the log says.

    Parameters
    ----------
    track : Track
        Clean, as logged, in its own frame.
    said : (array, shape (N,), array, shape (N, 6)) or None
        When, ns, and the velocity, m/s and rad/s, in the axes of the body (REP-105) or of the world.
    """
    if said is None or len(track) < _LEAST or len(said[0]) < _LEAST:
        return Motion()
    seconds = (track.t_ns - track.t_ns[0]) * 1e-9
    first, last, lasted = _steps(track)
    if len(first) < _LEAST:
        return Motion()
    order = np.argsort(said[0], kind="stable")
    times, middle = (said[0][order] - track.t_ns[0]) * 1e-9, (seconds[first] + seconds[last]) / 2
    told = interpolated(middle, times, said[1][order])
    linear, angular = told[:, :3], told[:, 3:]
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


def _fit(found: Floats, said: Floats, least: float) -> float:
    """Mean cosine between vectors that are long enough in both; NaN where there are too few."""
    lengths = np.linalg.norm(found, axis=1), np.linalg.norm(said, axis=1)
    both = (lengths[0] > least) & (lengths[1] > least)
    if both.sum() < _LEAST:
        return float("nan")
    return float(np.mean((found[both] * said[both]).sum(axis=1) / (lengths[0] * lengths[1])[both]))
