"""Steps of a log's clock: what was recorded after one comes after, whatever its stamps say.

A clock is set while a flight is recorded: the stamps jump back or ahead and run on from there. Sorted
by stamps, the two halves of the flight would be shuffled into each other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from upplied.inputs.flight.tracks import Track
from upplied.records import Ints

STEPPED = "the clock stepped"  # how a note of it begins
_TOLERANCE_NS = 100_000_000  # messages overtake each other by less
_LATE = 50  # messages within which those that were overtaken are back in order
_AROUND = 50  # messages before and after a step of the stamps alone, by which it is known
_LONGEST_NS = 60 * 10**9  # the recorder's clock counts where it says less


def steady(track: Track) -> Track:
    """The track, in the order in which it was recorded, with a clock that never steps.

    Parameters
    ----------
    track : Track
        In the order of the log. Messages that were merely late stay as they are, to be sorted.

    Returns
    -------
    Track
        After a step the stamps go on from the last before it, by what the recorder's clock says or
        else by the usual period; its `epoch` changes there.
    """
    if len(track) < 3:
        return track
    steps = np.union1d(_backwards(track.t_ns), _ahead(track.t_ns, track.log_ns))
    if not len(steps):
        return track
    usual = int(np.median(np.abs(np.diff(track.t_ns))))
    t_ns, epoch = track.t_ns.copy(), np.zeros(len(track), np.int64)
    for at in steps:
        lasted = int(track.log_ns[at + 1] - track.log_ns[at])
        lasted = lasted if 0 < lasted < _LONGEST_NS else usual
        t_ns[at + 1 :] += int(t_ns[at]) + lasted - int(t_ns[at + 1])
        epoch[at + 1 :] += 1
    seconds = ", ".join(f"{(track.t_ns[at + 1] - track.t_ns[at]) * 1e-9:+.1f} s" for at in steps[:5])
    before = np.zeros(len(track), np.int64) if track.epoch is None else track.epoch
    return replace(
        track,
        t_ns=t_ns,
        epoch=before + (epoch << 20),
        clock_steps=track.clock_steps + len(steps),
        notes=(*track.notes, f"{STEPPED} {len(steps)} times ({seconds}): split there"),
    )


def _backwards(t_ns: Ints) -> Ints:
    """Last sample before each step back from which the stamps run on: late messages jump ahead again."""
    step = np.diff(t_ns)
    found: list[int] = []
    for at in np.flatnonzero(step < -_TOLERANCE_NS):
        soon = step[at + 1 : at + 1 + _LATE]
        if not (soon > -step[at] / 2).any() and at + 1 - (found[-1] if found else -2) > 1:
            found.append(int(at))
    return np.array(found, np.int64)


def _ahead(t_ns: Ints, log_ns: Ints) -> Ints:
    """Last sample before each step of the stamps that the recorder's clock did not see."""
    if len(t_ns) < 2 * _AROUND or not np.ptp(log_ns):
        return np.empty(0, np.int64)
    off = t_ns - log_ns
    found = []
    for at in np.flatnonzero((np.abs(np.diff(off)) > 10 * _TOLERANCE_NS) & (np.diff(t_ns) > 0)):
        before, after = off[max(at + 1 - _AROUND, 0) : at + 1], off[at + 1 : at + 1 + _AROUND]
        jump = float(np.median(after) - np.median(before))
        spread = max(np.ptp(np.percentile(part, [10, 90])) for part in (before, after))
        if min(len(before), len(after)) >= 10 and jump > 10 * _TOLERANCE_NS and spread < 0.1 * jump:
            found.append(at)
    return np.array(found, np.int64)
