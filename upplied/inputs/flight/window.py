"""The part of a log that is the inspection.

In this order: start and stop from options, side-car or metadata; the log's own `foxglove.Event`
of the phase ``inspection`` (or the only event that lasts); else what `upplied.inputs.flight.whole` finds
beside the structure.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.errors import InputError
from upplied.inputs.flight.tracks import Track, stamps
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Bools

_EVENT = "foxglove.Event"
_NAMES = ("metadata", "event_type.name")
FIELDS = {
    _EVENT: (
        "start_time.sec", "start_time.nanosec", "end_time.sec", "end_time.nanosec",
        "timestamp.sec", "timestamp.nanosec", "duration.sec", "duration.nanosec",
        *_NAMES,
    ),
}  # fmt: skip

Span = tuple[int, int]


def inspected(
    track: Track, tables: Sequence[Table], facts: LogOptions, what: str
) -> tuple[Track, list[str], bool]:
    """The samples of the inspection, in words how they were cut out, and whether start or stop were given.

    Raises
    ------
    InputError
        If nothing was flown in the time that is given.
    """
    first = int(track.t_ns.min()) if len(track) else 0
    given = (facts.start_s, facts.stop_s, facts.start_ns, facts.end_ns)
    if any(value is not None for value in given):
        start = facts.start_ns if facts.start_s is None else first + int(facts.start_s * 1e9)
        stop = facts.end_ns if facts.stop_s is None else first + int(facts.stop_s * 1e9)
        spans = [(-(2**63) if start is None else start, 2**63 - 1 if stop is None else stop)]
        words = "start and stop as given"
    elif spans := _events(tables):
        words = f"{len(spans)} events in the log"
    else:
        return track, [], False
    inside = _inside(track, spans)
    if not inside.any():
        seconds = f"0 to {(int(track.t_ns.max()) - first) * 1e-9:.1f} s" if len(track) else "none"
        rule = f"times within {seconds}"
        raise InputError(what, f"has no pose within {words}", rule, "correct start and stop")
    if inside.all():
        return track, [], True
    return track.take(inside), [f"cut to {words}: {int(inside.sum())} of {len(track)} samples"], True


def _inside(track: Track, spans: list[Span]) -> Bools:
    """By the clock of the poses, or by the recorder's where the times are of its domain."""
    for clock in (track.t_ns, track.log_ns):
        inside = np.zeros(len(track), bool)
        for start, stop in spans:
            inside |= (clock >= start) & (clock <= stop)
        if inside.any():
            return inside
    return inside


def _events(tables: Sequence[Table]) -> list[Span]:
    spans, labelled = [], []
    for table in tables:
        if table.schema != _EVENT:
            continue
        start = stamps(table, "start_time")
        start = stamps(table, "timestamp") if start is None else start
        stop, lasts = stamps(table, "end_time"), stamps(table, "duration")
        if start is not None and stop is None and lasts is not None:
            stop = start + lasts
        if start is None or stop is None:
            continue
        named = ["inspection" in f"{a} {b}".lower() for a, b in zip(*map(table.texts, _NAMES), strict=True)]
        for index in np.flatnonzero(stop > start):
            spans.append((int(start[index]), int(stop[index])))
            if named[index]:
                labelled.append(spans[-1])
    return labelled or (spans if len(spans) == 1 else [])
