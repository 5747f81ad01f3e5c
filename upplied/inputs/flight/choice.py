"""The topic of a log that holds the poses, and one publisher of it: the only sensible one, or an error.

Bodies that share a topic are separated by the frames they name, by their channels, or by their positions.
"""

import re
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from upplied.errors import InputError
from upplied.geometry.polylines import leg_lengths
from upplied.geometry.poses import angle_between
from upplied.inputs.flight.clean import clean
from upplied.inputs.flight.tracks import Track, at_times
from upplied.inputs.schemas import geodetic, px4, ros, tf
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table, joined
from upplied.records import Floats

Samples = Callable[[Table, Sequence[Table], LogOptions], Track]
READERS: dict[str, Samples] = {name: it.samples for it in (ros, px4, geodetic) for name in it.SOURCES}

# What was asked of the aircraft, and what went into its estimate: neither is where it flew.
_COMMANDED = re.compile(r"setpoint|goal|target|cmd|command|desired|reference|plan|initialpose", re.IGNORECASE)
_INPUTS = re.compile(r"(?i)visual|vision|mocap_odometry|mocap/pose|fake_gps|raw|estimator_|groundtruth|/in$")
_MOST = 8  # sources that are compared
NOTHING = "holds no poses"
SAME_M, SAME_RAD = 0.05, np.radians(3.0)  # sources of one estimate differ by their stamps alone
_LOOK = 400  # samples together
_PLACES = 5  # of the flight, at which it is looked
_SMOOTH = 1.6  # two steps on lead nearly twice as far where one body flies
_SHORTER = 0.25  # two paths are one tangled up where they are this much shorter apart
_ONE_BODY = "several-publishers: one body"
_NAME_ONE = "name one by publisher: the name of its frame, or #7 for the channel 7"


def choose(tables: Sequence[Table], facts: LogOptions, what: str) -> tuple[Table | None, list[str]]:
    """The table of poses, several channels of one topic and schema joined; None: only transforms.

    Raises InputError, with all sources and their rates, if there is none, or several contradict each other.
    """
    sources = _by_topic([table for table in tables if table.schema in READERS])
    if facts.topic and not any(table.channel.topic == facts.topic for table in tables):
        raise InputError(what, f"has no poses on topic {facts.topic!r}", listed(_all(tables)), "name one")
    if facts.topic:
        sources = [table for table in sources if table.channel.topic == facts.topic]
    if facts.schema:
        sources = [table for table in sources if table.schema == facts.schema.replace("/msg/", "/")]
    if not (usable := [table for table in sources if len(table) > 1]) and sources:
        raise nothing(sources, what)
    if not facts.topic:
        usable = _narrowed(usable, facts)
    if 1 < len(usable) <= _MOST:
        usable = _agreeing(usable, tables, facts)
    if len(usable) > 1:
        finding = f"holds {len(usable)} sources of poses that differ: {listed(_all(tables))}"
        remedy = "choose one by topic, and by schema where a topic has several"
        raise InputError(what, finding, "one source", remedy)
    if not usable:
        return None, []
    same = (usable[0].channel.topic, usable[0].schema)
    table = one_publisher([it for it in tables if (it.channel.topic, it.schema) == same], facts, what)
    others = len(sources) > 1 and not facts.topic
    return table, [f"poses of {same[0]}, one of {len(sources)} sources"] if others else []


def listed(tables: Sequence[Table]) -> str:
    """Topics with schema, rate and number of messages."""
    words = "{0.channel.topic} ({0.schema}, {0.rate_hz:.1f} Hz, {0.messages} messages)"
    more = f" and {len(tables) - 2 * _MOST} more" if len(tables) > 2 * _MOST else ""
    return "; ".join(words.format(table) for table in tables[: 2 * _MOST]) + more


def nothing(tables: Sequence[Table], what: str) -> InputError:
    """The error for a log without poses; it says why those that are there cannot be read."""
    problems = [f"{it.channel.topic}: {it.problem}" for it in tables if it.problem]
    problems += [f"{it.channel.topic}: {number} of {it.messages} messages are {reason}"
                 for it in tables for reason, number in it.dropped.items()]  # fmt: skip
    reasons = f" ({'; '.join(problems[:10])})" if problems else ""
    return InputError(what, f"{NOTHING}{reasons}", "poses of the aircraft or of its camera")


def _all(tables: Sequence[Table]) -> list[Table]:
    return _by_topic([table for table in tables if table.schema in READERS or table.schema in tf.SCHEMAS])


def _by_topic(tables: Sequence[Table]) -> list[Table]:
    groups: dict[tuple[str, str], list[Table]] = {}
    for table in tables:
        groups.setdefault((table.channel.topic, table.schema), []).append(table)
    return [joined(group) for group in groups.values()]


def _narrowed(tables: list[Table], facts: LogOptions) -> list[Table]:
    """Without commands and sensor inputs, and by what is known of the structure's place."""
    tables = [table for table in tables if not _COMMANDED.search(table.channel.topic)]
    tables = [table for table in tables if not _INPUTS.search(table.channel.topic)] or tables
    on_earth = [table for table in tables if table.schema in geodetic.SOURCES]
    local = [table for table in tables if table.schema not in geodetic.SOURCES]
    if on_earth and local:
        placed = facts.structure_lat_deg is not None and facts.structure_position_m is None
        tables = on_earth if placed else local
    if facts.body_frame in ("camera", "optical"):
        tables = [table for table in tables if "camera" in table.channel.topic.lower()] or tables
    return tables


def _agreeing(usable: list[Table], tables: Sequence[Table], facts: LogOptions) -> list[Table]:
    """The densest source alone where all others hold the same poses, else all of them."""
    usable = sorted(usable, key=len, reverse=True)
    try:
        first, *others = (
            clean(READERS[table.schema](table, tables, facts), facts, table.channel.topic) for table in usable
        )
    except InputError:
        return usable
    for other in others:
        positions, quats = at_times(first, other.t_ns, facts.gap_s)
        if (known := np.isfinite(positions).all(axis=1)).mean() < 0.5:
            return usable
        apart = np.linalg.norm(positions[known] - other.positions[known], axis=1)
        turned = angle_between(quats[known], other.quat_xyzw[known])
        if not (np.median(apart) < SAME_M and np.median(turned) < SAME_RAD):
            return usable
    return usable[:1]


def one_publisher(tables: Sequence[Table], facts: LogOptions, what: str) -> Table:
    """The channels of one topic and schema as one table, or the named one; InputError if they differ."""
    if facts.publisher.startswith("#"):
        named = [table for table in tables if f"#{table.channel.channel_id}" == facts.publisher]
        return joined(named or list(tables))
    full = [table for table in tables if len(table) > 1]
    spans = sorted((int(table.log_ns.min()), int(table.log_ns.max())) for table in full)
    both = [min(end, other) - start for (_, end), (start, other) in pairwise(spans)]
    if any(overlap > 1e9 for overlap in both) and "several-publishers" not in facts.allow:
        listed = ", ".join(f"#{table.channel.channel_id} ({len(table)} messages)" for table in full)
        finding = f"{len(full)} publishers at the same time: channels {listed}"
        raise InputError(f"{what}, {full[0].channel.topic}", finding, _ONE_BODY, _NAME_ONE)
    return joined(list(tables))


def check_one(track: Track, facts: LogOptions, what: str) -> None:
    """InputError if the samples are of two bodies in turn: two paths through them are far shorter."""
    if "several-publishers" in facts.allow or len(track) < 40:
        return
    starts = np.linspace(0, max(len(track) - _LOOK, 0), _PLACES).astype(int)
    tangled = [_tangled(track.positions[start : start + _LOOK]) for start in np.unique(starts)]
    if np.mean(tangled) >= 0.4:
        finding = "holds the poses of several bodies in turn: the path jumps to and fro between them"
        raise InputError(what, finding, _ONE_BODY, f"{_NAME_ONE}; else record them on topics of their own")


def _tangled(path: Floats) -> bool:
    steps = leg_lengths(path)
    whole = float(steps.sum())
    if whole < 1e-6 or np.linalg.norm(path[2:] - path[:-2], axis=1).sum() > _SMOOTH * whole:
        return False
    if not len(far := np.flatnonzero(np.linalg.norm(path - path[0], axis=1) > np.percentile(steps, 60) / 2)):
        return False
    ends, length, count = path[[0, far[0]]], np.zeros(2), np.zeros(2)
    for place in path:
        apart = np.linalg.norm(place - ends, axis=1)
        nearer = int(apart[1] < apart[0])
        length[nearer] += apart[nearer]
        count[nearer] += 1
        ends[nearer] = place
    return bool(min(count) > 0.1 * len(path) and sum(length) < _SHORTER * whole)
