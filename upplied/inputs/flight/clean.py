"""From the track of a log to one that can be trusted: what is dropped, where it breaks, and its time.

Long gaps become transits, and long hovering is shortened: otherwise every plan would wait as long.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from upplied.errors import InputError
from upplied.geometry.polylines import leg_lengths
from upplied.geometry.poses import normalised
from upplied.inputs.flight.tracks import AT_THE_ENDS, Track, are_unit, source_times
from upplied.inputs.rules import PassportSettings
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Bools, Floats, Ints

MAX_SPAN_NS = 24 * 3600 * 10**9
MAX_POSITION_M = 1e7
MAX_SPEED_MPS = 15.0  # a faster step that does not fit its surroundings is a jump, no flight
MIN_JUMP_M = 0.2
_USUAL = 3.0  # steps: a message that was lost, and one that came late
UNSET = "attitude not set"
_UNSET = 3, 0.5  # at least so many poses, at most such a share: a gimbal may tell all of it
REPEATED = "repeated"  # the same sample again: nothing is lost by dropping it


def timed(track: Track) -> Track:
    """The samples with a believable stamp; the others are counted."""
    if not len(track := track.keep(track.t_ns > 0, "no time stamp")):
        return track
    middle = np.partition(track.t_ns, len(track) // 2)[len(track) // 2]
    return track.keep(np.abs(track.t_ns - middle) <= MAX_SPAN_NS // 2, "stamp of another day")


def clean(track: Track, limits: LogOptions, what: str) -> Track:
    """Drop what is no pose, sort, and drop repeated stamps; InputError if too much was dropped, or all."""
    track = steady(timed(track))
    finite = np.isfinite(np.column_stack([track.positions, track.quat_xyzw])).all(axis=1)
    track = track.keep(np.asarray(finite), "not a number")
    on_earth = np.abs(track.positions).max(axis=1, initial=0) < MAX_POSITION_M
    track = track.keep(on_earth, "position off the Earth")
    track = track.keep(are_unit(track.quat_xyzw), "quaternion not of unit length")
    # An attitude that was never set is no turn at all, though others of the flight turn.
    unset = (track.quat_xyzw[:, :3] == 0).all(axis=1) & (np.abs(track.quat_xyzw[:, 3]) == 1)
    if _UNSET[0] <= unset.sum() <= _UNSET[1] * len(track):
        track = track.keep(~unset, UNSET)
    track = track.take(np.argsort(track.t_ns, kind="stable"))
    again = np.diff(track.t_ns, prepend=-1) == 0
    values = np.column_stack([track.positions, track.quat_xyzw])
    same = again & np.append(False, (np.diff(values, axis=0) == 0).all(axis=1))[: len(track)]
    track = track.keep(~same, REPEATED).keep(~again[~same], "stamp used twice")
    jumps = np.pad(_jumps(track), 1)[: len(track) + 1]  # single samples off the flight before and after them
    track = track.keep(~(jumps[:-1] & jumps[1:]), "far off its neighbours")
    check_dropped(track, limits, what)
    return replace(track, quat_xyzw=normalised(track.quat_xyzw))


def attitude_track(
    table: Table, quat_xyzw: Floats, limits: LogOptions, good: Bools, epoch: Ints | None = None
) -> Track:
    """A clean track of the good attitudes (N, 4) alone of a table; however many are dropped is allowed."""
    times, clock = source_times(table)
    track = Track(times, np.zeros((len(table), 3)), quat_xyzw, table.log_ns, clock=clock, epoch=epoch)
    return clean(track.take(good), replace(limits, max_dropped=1.0), table.channel.topic)


def check_dropped(track: Track, limits: LogOptions, what: str) -> None:
    """InputError, with the reasons and their numbers, of a track of which too much was dropped, or all."""
    harmless = (REPEATED, UNSET, *(name for name in track.dropped if name.endswith(AT_THE_ENDS)))
    lost = sum(number for reason, number in track.dropped.items() if reason not in harmless)
    if not len(track):
        raise InputError(what, f"holds no usable pose ({reasons(track) or 'no message'})", "at least 2 poses")
    if lost > limits.max_dropped * (lost + len(track)):
        finding = f"{lost} of {lost + len(track)} samples are unusable ({reasons(track)})"
        remedy = "record the flight again, or raise max_dropped if the rest is good"
        raise InputError(what, finding, f"at most {limits.max_dropped:.0%}", remedy)


def reasons(track: Track) -> str:
    """What was dropped, in words."""
    return ", ".join(f"{number} {reason}" for reason, number in sorted(track.dropped.items()))


def silence_s(track: Track, least_s: float) -> float:
    """From how long on nothing was recorded, s: three of the usual steps, where these are long."""
    usual_s = float(np.median(np.diff(track.t_ns))) * 1e-9 if len(track) > 1 else 0.0
    return max(least_s, _USUAL * usual_s)


def breaks(track: Track, gap_s: float) -> tuple[Ints, list[str]]:
    """First sample after each gap, jump or reset of the estimator, and in words how many there are."""
    gaps = np.diff(track.t_ns) * 1e-9 > gap_s
    resets = np.zeros(len(gaps), bool) if track.epoch is None else np.diff(track.epoch) != 0
    jumps = _jumps(track) & ~gaps & ~resets
    reset = max(resets.sum() - track.clock_steps, 0)
    counts = {"gap": gaps.sum(), "jump": jumps.sum(), "estimator reset": reset}
    words = [f"{number} {kind}{'s' if number > 1 else ''}" for kind, number in counts.items() if number]
    return np.flatnonzero(gaps | jumps | resets) + 1, words


def _jumps(track: Track) -> Bools:
    """Which steps (N - 1,) are no flight: too fast, and much faster than the steps around."""
    if len(track) < 2:
        return np.zeros(0, bool)
    step_m = leg_lengths(track.positions)
    speed = step_m / np.maximum(np.diff(track.t_ns) * 1e-9, 1e-9)
    usual = median_filter(speed, size=11, mode="nearest")  # a fast flight is fast for a while
    return (step_m > MIN_JUMP_M) & (speed > MAX_SPEED_MPS) & (speed > 3 * usual)


STEPPED = "the clock stepped"  # how a note of it begins
_TOLERANCE_NS = 100_000_000  # messages overtake each other by less
_LATE = 50  # messages within which those that were overtaken are back in order
_AROUND = 50  # messages before and after a step of the stamps alone, by which it is known
_LONGEST_NS = 60 * 10**9  # the recorder's clock counts where it says less


def steady(track: Track) -> Track:
    """The track, in the order in which it was recorded, with a clock that never steps.

    The clock of a log is set while it is recorded: sorted by stamps, the two halves of the flight would be
    shuffled into each other. After a step the stamps go on from the last before it, by what the recorder's
    clock says or else by the usual period; `epoch` changes there. Messages that were merely late stay as they
    are, to be sorted.
    """
    if len(track) < 3:
        return track
    if not len(steps := np.union1d(_backwards(track.t_ns), _ahead(track.t_ns, track.log_ns))):
        return track
    usual = int(np.median(np.abs(np.diff(track.t_ns))))
    t_ns, epoch = track.t_ns.copy(), np.zeros(len(track), np.int64)
    for at in steps:
        lasted = int(track.log_ns[at + 1] - track.log_ns[at])
        lasted = lasted if 0 < lasted < _LONGEST_NS else usual
        t_ns[at + 1 :] += int(t_ns[at]) + lasted - int(t_ns[at + 1])
        epoch[at + 1 :] += 1
    seconds = ", ".join(f"{(track.t_ns[at + 1] - track.t_ns[at]) * 1e-9:+.1f} s" for at in steps[:5])
    notes = (*track.notes, f"{STEPPED} {len(steps)} times ({seconds}): split there")
    epoch = (epoch << 20) + (0 if track.epoch is None else track.epoch)
    return replace(track, t_ns=t_ns, epoch=epoch, clock_steps=track.clock_steps + len(steps), notes=notes)


def _backwards(t_ns: Ints) -> Ints:
    """Last sample before each step back from which the stamps run on: late messages jump ahead again."""
    step, steps = np.diff(t_ns), list[int]()
    for at in np.flatnonzero(step < -_TOLERANCE_NS):
        soon = step[at + 1 : at + 1 + _LATE]
        if not (soon > -step[at] / 2).any() and at + 1 - (steps[-1] if steps else -2) > 1:
            steps.append(int(at))
    return np.array(steps, np.int64)


def _ahead(t_ns: Ints, log_ns: Ints) -> Ints:
    """Last sample before each step of the stamps that the recorder's clock did not see."""
    if len(t_ns) < 2 * _AROUND or not np.ptp(log_ns):
        return np.empty(0, np.int64)
    off, steps = t_ns - log_ns, []
    for at in np.flatnonzero((np.abs(np.diff(off)) > 10 * _TOLERANCE_NS) & (np.diff(t_ns) > 0)):
        before, after = off[max(at + 1 - _AROUND, 0) : at + 1], off[at + 1 : at + 1 + _AROUND]
        jump = float(np.median(after) - np.median(before))
        spread = max(np.ptp(np.percentile(part, [10, 90])) for part in (before, after))
        if min(len(before), len(after)) >= 10 and jump > 10 * _TOLERANCE_NS and spread < 0.1 * jump:
            steps.append(at)
    return np.array(steps, np.int64)


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
        words = []
        if self.long_gaps:
            gaps = f"{self.long_gaps} gaps of up to {self.longest_gap_s:.0f} s"
            words.append(f"{gaps}: pieces joined by transits, {self.cut_gap_s:.0f} s less")
        if self.cut_hover_s:
            words.append(f"hovering of {self.hover_s:.0f} s in all: {self.cut_hover_s:.0f} s of it cut")
        return words


def paced(track: Track, gap_s: float, bounds: PassportSettings, between_s: float = 0.0) -> tuple[Track, Pace]:
    """A camera's track with shorter gaps and hovers, and what was found, but for `between_s` of it."""
    step_ns, step_m = np.diff(track.t_ns), leg_lengths(track.positions)
    gap = step_ns > gap_s * 1e9
    long = step_ns > max(gap_s, bounds.long_gap_s) * 1e9
    moving = step_m[~gap] / np.maximum(step_ns[~gap] * 1e-9, 1e-9)
    moving = moving[moving > 0.1]
    speed = max(float(np.median(moving)) if len(moving) else 0.0, _LEAST_MPS)
    transit_ns = (np.maximum(step_m / speed, gap_s) + 1e-3) * 1e9  # still a gap, so that it stays a break
    shorter = np.where(long, np.minimum(transit_ns, step_ns), step_ns).astype(np.int64)
    keep, hover_s = _hovers(track, gap, bounds.hover_cap_s)
    frozen = (step_m == 0) & (np.diff(track.quat_xyzw, axis=0) == 0).all(axis=1) & ~gap
    cut = np.where(keep[1:], 0, shorter)  # the time that goes with the samples that are cut
    pace = Pace(
        span_s=float(track.t_ns[-1] - track.t_ns[0]) * 1e-9 - between_s if len(track) else 0.0,
        recorded_s=float(step_ns[~gap].sum()) * 1e-9,
        gaps=int(gap.sum()), long_gaps=int(long.sum()),
        longest_gap_s=float(step_ns[gap].max(initial=0)) * 1e-9,
        skipped_m=float(step_m[gap].sum()), cut_gap_s=float((step_ns - shorter).sum()) * 1e-9,
        hover_s=hover_s, cut_hover_s=float(cut.sum()) * 1e-9,
        frozen_s=float(step_ns[frozen].sum()) * 1e-9,
    )  # fmt: skip
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
