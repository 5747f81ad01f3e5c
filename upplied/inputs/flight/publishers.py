"""Several bodies on one topic: separated by the frames they name, by their channels, or by their places."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from upplied.errors import InputError
from upplied.inputs.flight.tracks import Track
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table, joined
from upplied.polylines import leg_lengths
from upplied.records import Floats

_LOOK = 400  # samples together
_PLACES = 5  # of the flight, at which it is looked
_SMOOTH = 1.6  # two steps on lead nearly twice as far where one body flies
_SHORTER = 0.25  # two paths are one tangled up where they are this much shorter apart
_RULE = "several-publishers: one body"
REMEDY = "name one by publisher: the name of its frame, or #7 for the channel 7"


def chosen(tables: Sequence[Table], facts: LogOptions, what: str) -> Table:
    """The channels of one topic and schema as one table, or the channel that is named.

    Raises
    ------
    InputError
        If several channels hold different places at the same time.
    """
    if facts.publisher.startswith("#"):
        named = [table for table in tables if f"#{table.channel.channel_id}" == facts.publisher]
        return joined(named or list(tables))
    full = [table for table in tables if len(table) > 1]
    spans = sorted((int(table.log_ns.min()), int(table.log_ns.max())) for table in full)
    both = [min(end, other) - start for (_, end), (start, other) in pairwise(spans)]
    if any(overlap > 1e9 for overlap in both) and "several-publishers" not in facts.allow:
        listed = ", ".join(f"#{table.channel.channel_id} ({len(table)} messages)" for table in full)
        found = f"{len(full)} publishers at the same time: channels {listed}"
        raise InputError(f"{what}, {full[0].channel.topic}", found, _RULE, REMEDY)
    return joined(list(tables))


def check_one(track: Track, facts: LogOptions, what: str) -> None:
    """Refuse a track whose samples are of two bodies in turn.

    Raises
    ------
    InputError
        If two paths through the samples are far shorter than one.
    """
    if "several-publishers" in facts.allow or len(track) < 40:
        return
    starts = np.linspace(0, max(len(track) - _LOOK, 0), _PLACES).astype(int)
    tangled = [_tangled(track.positions[start : start + _LOOK]) for start in np.unique(starts)]
    if np.mean(tangled) >= 0.4:
        found = "holds the poses of several bodies in turn: the path jumps to and fro between them"
        raise InputError(what, found, _RULE, f"{REMEDY}; else record them on topics of their own")


def _tangled(path: Floats) -> bool:
    steps = leg_lengths(path)
    whole = float(steps.sum())
    if whole < 1e-6 or np.linalg.norm(path[2:] - path[:-2], axis=1).sum() > _SMOOTH * whole:
        return False
    far = np.flatnonzero(np.linalg.norm(path - path[0], axis=1) > np.percentile(steps, 60) / 2)
    if not len(far):
        return False
    ends, length, count = [path[0], path[far[0]]], [0.0, 0.0], [0, 0]
    for place in path:
        apart = [float(np.linalg.norm(place - end)) for end in ends]
        nearer = int(apart[1] < apart[0])
        length[nearer] += apart[nearer]
        count[nearer] += 1
        ends[nearer] = place
    return min(count) > 0.1 * len(path) and sum(length) < _SHORTER * whole
