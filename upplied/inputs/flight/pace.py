"""The time of a flight: long silences become transits, and long hovering is cut to what it is worth.

What the camera looked at stays. What nobody flew, or flew for hours on one spot, would otherwise stand
in every plan as seconds to fly.
"""

from dataclasses import dataclass, replace

import numpy as np

from upplied.geometry.polylines import leg_lengths
from upplied.geometry.poses import angle_between
from upplied.inputs.flight.tracks import Track
from upplied.inputs.passport.settings import PassportSettings
from upplied.records import Bools

_STILL_M, _STILL_RAD = 0.5, np.radians(5.0)  # from the beginning of a hover: wind moves a vehicle so far
_LEAST_MPS = 0.5  # of a transit


@dataclass(frozen=True)
class Pace:
    """A flight's time, s and m."""

    span_s: float = 0.0  # from the first pose to the last, as recorded
    recorded_s: float = 0.0  # of it, without the gaps
    gaps: int = 0  # longer than the reader's bound
    long_gaps: int = 0  # that were flown as a transit
    longest_gap_s: float = 0.0
    skipped_m: float = 0.0  # from one end of the gaps to the other
    cut_gap_s: float = 0.0
    hover_s: float = 0.0  # standing still, longer than the cap
    cut_hover_s: float = 0.0
    frozen_s: float = 0.0  # without any change of the pose at all

    @property
    def words(self) -> list[str]:
        """What was done, for the notes."""
        words = []
        if self.long_gaps:
            gaps = f"{self.long_gaps} gaps of up to {self.longest_gap_s:.0f} s"
            words.append(f"{gaps}: pieces joined by transits, {self.cut_gap_s:.0f} s less")
        if self.cut_hover_s:
            words.append(f"hovering of {self.hover_s:.0f} s in all: {self.cut_hover_s:.0f} s of it cut")
        return words


def paced(
    track: Track, gap_s: float, settings: PassportSettings, between_s: float = 0.0
) -> tuple[Track, Pace]:
    """The clean track of a camera with its gaps and hovers shortened, and what was found.

    Of its gaps `between_s`, s, were recorded, and lie between two inspections.
    """
    step_ns = np.diff(track.t_ns)
    step_m = leg_lengths(track.positions)
    gap = step_ns > gap_s * 1e9
    long = step_ns > max(gap_s, settings.long_gap_s) * 1e9
    moving = step_m[~gap] / np.maximum(step_ns[~gap] * 1e-9, 1e-9)
    moving = moving[moving > 0.1]
    speed = max(float(np.median(moving)) if len(moving) else 0.0, _LEAST_MPS)
    transit_ns = (np.maximum(step_m / speed, gap_s) + 1e-3) * 1e9  # still a gap, so that it stays a break
    shorter = np.where(long, np.minimum(transit_ns, step_ns), step_ns).astype(np.int64)
    keep, hover_s = _hovers(track, gap, settings.hover_cap_s)
    frozen = (step_m == 0) & (np.diff(track.quat_xyzw, axis=0) == 0).all(axis=1) & ~gap
    cut = np.where(keep[1:], 0, shorter)  # the time that goes with the samples that are cut
    pace = Pace(
        span_s=float(track.t_ns[-1] - track.t_ns[0]) * 1e-9 - between_s if len(track) else 0.0,
        recorded_s=float(step_ns[~gap].sum()) * 1e-9,
        gaps=int(gap.sum()),
        long_gaps=int(long.sum()),
        longest_gap_s=float(step_ns[gap].max(initial=0)) * 1e-9,
        skipped_m=float(step_m[gap].sum()),
        cut_gap_s=float((step_ns - shorter).sum()) * 1e-9,
        hover_s=hover_s,
        cut_hover_s=float(cut.sum()) * 1e-9,
        frozen_s=float(step_ns[frozen].sum()) * 1e-9,
    )
    if not pace.words:
        return track, pace
    t_ns = track.t_ns[0] + np.concatenate([[0], np.cumsum(shorter - cut)])
    after = np.unique(np.cumsum(keep)[np.flatnonzero(long) + 1] - 1)  # among the samples that are kept
    return replace(replace(track, t_ns=t_ns).take(keep), long_gaps=after), pace


def _hovers(track: Track, gap: Bools, cap_s: float) -> tuple[Bools, float]:
    """Which samples to keep, and how long the flight stood still for longer than the cap, s."""
    keep, total = np.ones(len(track), bool), 0.0
    if len(track) < 2 or (track.t_ns[-1] - track.t_ns[0]) * 1e-9 <= cap_s:
        return keep, total
    seconds = (track.t_ns - track.t_ns[0]) // 10**9
    ticks = np.unique(np.concatenate([[0], np.flatnonzero(np.diff(seconds)) + 1, [len(track) - 1]]))
    broken = np.concatenate([[0], np.cumsum(gap)])
    at = 0
    while at < len(ticks) - 1:
        start, length, look = ticks[at], 64, 64
        while length == look:  # ever farther, while it stands still
            look *= 4
            later = ticks[at + 1 : at + 1 + look]
            still = np.linalg.norm(track.positions[later] - track.positions[start], axis=1) < _STILL_M
            still &= broken[later] == broken[start]
            if still[0]:
                same = np.broadcast_to(track.quat_xyzw[start], (len(later), 4))
                still &= angle_between(track.quat_xyzw[later], same) < _STILL_RAD
            length = len(still) if still.all() else int(np.argmin(still))
        stop = ticks[at + length]
        lasted = float(track.t_ns[stop] - track.t_ns[start]) * 1e-9
        if lasted > cap_s:
            total += lasted
            passed = (track.t_ns[start : stop + 1] - track.t_ns[start]) * 1e-9
            keep[start : stop + 1] &= (passed <= cap_s / 2) | (passed >= lasted - cap_s / 2)
        at += max(length, 1)
    return keep, total
