"""The time of a flight: long gaps become transits, and long hovering is shortened.

Otherwise every plan would wait as long as the recorder was silent, or the vehicle stood still.
"""

from dataclasses import dataclass, replace

import numpy as np

from upplied.geometry.polylines import leg_lengths
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
    seconds = (track.t_ns - track.t_ns[0]) // 10**9
    ticks = np.unique(np.concatenate([[0], np.flatnonzero(np.diff(seconds)) + 1, [len(track) - 1]]))
    broken = np.concatenate([[0], np.cumsum(gap)])
    places, quats, alike = track.positions, track.quat_xyzw, np.cos(_STILL_RAD / 2)
    first = last = 0
    while first < len(ticks) - 1:
        start, last = ticks[first], first
        for later in ticks[first + 1 :]:
            off, turned = places[later] - places[start], abs(quats[later] @ quats[start]) < alike
            if turned or off @ off >= _STILL_M**2 or broken[later] > broken[start]:
                break
            last += 1
        lasted = float(track.t_ns[ticks[last]] - track.t_ns[start]) * 1e-9
        if lasted > cap_s:
            total += lasted
            passed = (track.t_ns[start : ticks[last] + 1] - track.t_ns[start]) * 1e-9
            keep[start : ticks[last] + 1] &= (passed <= cap_s / 2) | (passed >= lasted - cap_s / 2)
        first = max(last, first + 1)
    return keep, total
