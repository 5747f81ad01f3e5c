"""From an MCAP log to a demonstration: the camera's poses in the frame of the structure.

    log = open_recording(path)                   the container, salvaged where it is damaged
    facts = inspection(path, ...)                side-car, metadata, options
    tables = read_tables(log, ...)               the messages that matter, one pass
    track = choose(tables, facts)                one source of poses, or an error with the candidates
    clean, window, mount, structure frame        what is left is sorted, finite, counted

Every family of schemas has a file of its own beside this one.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from upplied.config import digest
from upplied.errors import InputError
from upplied.inputs.flight.clean import breaks, clean
from upplied.inputs.flight.mounts import camera_poses, in_structure_frame
from upplied.inputs.flight.tracks import Track
from upplied.inputs.mcap.recording import Channel, open_recording
from upplied.inputs.mcap.tables import Table, read_tables
from upplied.inputs.schemas import cameras, ros2, tf
from upplied.inputs.sidecar import LogOptions, inspection
from upplied.poses import normalised
from upplied.records import Camera, Demonstration

__all__ = ["LogOptions", "read_demonstration"]

_FAMILIES = {**ros2.FIELDS, **tf.FIELDS, **cameras.FIELDS}
_COMMANDED = re.compile(r"setpoint|goal|target|cmd|command|desired|reference|plan|initialpose", re.IGNORECASE)


def read_demonstration(path: str | Path, options: LogOptions | None = None) -> Demonstration:
    """The demonstration that a log holds.

    Parameters
    ----------
    path : path
        Of an MCAP log; a side-car of the same name with the ending ``.toml`` is read with it.
    options : LogOptions, optional

    Returns
    -------
    Demonstration
        Poses of the camera in the structure frame, m; `dropped`, `breaks`, `degraded` and `notes`
        say what was wrong with the log.

    Raises
    ------
    InputError
        If no correct record can be made of the file.
    """
    path = Path(path)
    options = options or LogOptions()
    recording = open_recording(path)
    tables = read_tables(recording, _fields)
    facts, notes = inspection(path, recording.metadata, options)
    if not facts.structure_id:
        raise InputError(
            str(path),
            "does not say which structure was flown",
            "a structure_id",
            f"write it into {path.with_suffix('.toml').name}, table [inspection], or give it as an option",
        )
    track, camera, more = _camera_track(tables, facts, str(path))
    topic = track.notes[0]
    track = in_structure_frame(track, facts)
    broken, counts = breaks(track, facts.gap_s)
    _check_length(track, facts, str(path))
    notes += [*more, *track.notes[1:], *(f"{n} {kind}" for kind, n in counts.items() if n), *recording.losses]
    return Demonstration(
        demonstration_id=facts.demonstration_id,
        structure_id=facts.structure_id,
        t_ns=track.t_ns,
        positions=track.positions,
        quat_xyzw=normalised(track.quat_xyzw),
        camera=camera,
        operator=facts.operator,
        site=facts.site,
        sha256=_sha256(path, facts),
        breaks=broken,
        degraded=bool(recording.losses),
        dropped=dict(sorted(track.dropped.items())),
        clock=track.clock,
        topic=topic,
        notes="; ".join([*([facts.notes] if facts.notes else []), *notes]),
    )


def _fields(channel: Channel) -> Iterable[str]:
    return _FAMILIES.get(schema_of(channel), ())


def schema_of(channel: Channel) -> str:
    """The schema's name in the short form, whatever the encoding says."""
    parts = channel.schema_name.split("/")
    name = f"{parts[0]}/{parts[-1]}" if len(parts) > 1 else channel.schema_name
    return name.replace("foxglove_msgs/", "foxglove.")


def _camera_track(tables: Sequence[Table], facts: LogOptions, what: str) -> tuple[Track, Camera, list[str]]:
    camera, frame, notes = cameras.camera_of(
        [t for t in tables if schema_of(t.channel) in cameras.FIELDS], facts, what
    )
    transforms = [(t, schema_of(t.channel)) for t in tables if schema_of(t.channel) in tf.FIELDS]
    tree = tf.tree_of(transforms, facts)
    table = _choose(tables, facts, what)
    if table is None:
        if not tree.moving:
            raise _nothing(tables, what)
        frame = tf.camera_frame(tree, facts, frame, what)
        track = tree.track(frame, facts.frame_id if tree.path(frame, facts.frame_id) else "", facts)
        topic = transforms[0][0].channel.topic
    else:
        track = ros2.samples(table, schema_of(table.channel))
        topic = table.channel.topic
    track = clean(track, facts, f"{what}, {topic}")
    track = replace(track, notes=(topic, *track.notes))
    return camera_poses(track, facts, tree, frame), camera, notes


def _choose(tables: Sequence[Table], facts: LogOptions, what: str) -> Table | None:
    """The one table of poses; None where only transforms are left."""
    found = [table for table in tables if schema_of(table.channel) in ros2.FIELDS]
    if facts.topic:
        found = [table for table in found if table.channel.topic == facts.topic]
        if not found and not any(table.channel.topic == facts.topic for table in tables):
            raise InputError(
                what, f"has no poses on topic {facts.topic!r}", _listed(tables), "name one of these"
            )
    else:
        found = [table for table in found if not _COMMANDED.search(table.channel.topic)]
    if facts.schema:
        found = [table for table in found if schema_of(table.channel) == facts.schema]
    usable = [table for table in found if len(table) > 1]
    if len(usable) > 1:
        raise InputError(
            what, f"holds {len(usable)} sources of poses: {_listed(usable)}", "one", "choose by topic"
        )
    if found and not usable:
        raise _nothing(found, what)
    return usable[0] if usable else None


def _listed(tables: Sequence[Table]) -> str:
    return "; ".join(
        f"{t.channel.topic} ({schema_of(t.channel)}, {t.rate_hz:.1f} Hz, {t.messages} messages)"
        for t in tables
    )


def _nothing(tables: Sequence[Table], what: str) -> InputError:
    problems = "; ".join(f"{t.channel.topic}: {t.problem}" for t in tables if t.problem)
    return InputError(
        what, f"holds no poses{f' ({problems})' if problems else ''}", "poses of the aircraft or its camera"
    )


def _check_length(track: Track, facts: LogOptions, what: str) -> None:
    seconds = (track.t_ns[-1] - track.t_ns[0]) * 1e-9 if len(track) else 0.0
    if len(track) < 2 or seconds < facts.min_duration_s:
        reasons = ", ".join(f"{n} {reason}" for reason, n in sorted(track.dropped.items()))
        raise InputError(
            what,
            f"holds {len(track)} poses over {seconds:.2f} s{f' ({reasons} dropped)' if reasons else ''}",
            f"at least 2 poses and {facts.min_duration_s} s",
            "lower min_duration_s if this is really the whole flight",
        )


def _sha256(path: Path, facts: LogOptions) -> str:
    with path.open("rb") as stream:
        log = hashlib.file_digest(stream, "sha256").hexdigest()
    return digest(
        {
            "log": log,
            "facts": {name: value for name, value in vars(facts).items() if name != "demonstration_id"},
        }
    )
