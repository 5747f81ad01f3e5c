"""From a log to a demonstration, and what it is known by: the hash of its bytes and of the facts about it."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from upplied.config import digest
from upplied.errors import InputError
from upplied.geometry.poses import normalised
from upplied.geometry.scene import scene_of
from upplied.inputs.flight import inspection as inspections
from upplied.inputs.flight.choice import NOTHING, READERS, check_one, choose, nothing
from upplied.inputs.flight.clean import breaks, check_dropped, clean, paced, reasons, silence_s, steady, timed
from upplied.inputs.flight.mounts import camera_poses, in_frame, in_structure_frame, registered
from upplied.inputs.flight.tracks import FIELDS, Track
from upplied.inputs.mcap.recording import open_recording
from upplied.inputs.passport.fits import converted
from upplied.inputs.passport.measured import SEEN, Reading
from upplied.inputs.passport.rules import RULES, passport_of
from upplied.inputs.rules import SHAPING, PassportSettings, Verdict, broken
from upplied.inputs.schemas import cameras, geodetic, px4, ros, tf
from upplied.inputs.sidecar import LogOptions, inspection, placed, sidecar_of, stated
from upplied.inputs.sources import door
from upplied.inputs.sources.source import Source
from upplied.records import Demonstration, Placement, Structure

Places = Mapping[str, Placement]
Structures = Callable[[str], Structure] | None
Check = tuple[str, Callable[[LogOptions], object]]  # a rule of the reader, and what raises where it is broken
_OF_FACTS = ("demonstration_id", "structure_id", "operator", "site", "about")
_OF_TRACK = ("t_ns", "positions", "fov_deg", "clock")


def read_demonstration(
    path: str | Path,
    options: LogOptions | None = None,
    placements: Mapping[str, Placement] | None = None,
    structures: Callable[[str], Structure] | None = None,
    flight: bool = False,
) -> Demonstration:
    """The demonstration that a log holds.

    Parameters
    ----------
    path : path
        Of a log of any kind in `upplied.inputs.sources.door`, or a folder of photos; a side-car of the same
        name with the ending ``.toml`` is read with it.
    options : LogOptions, optional
    placements : mapping of structure id to Placement, optional
        Where structures stand, for logs of satellite positions without it.
    structures : callable, optional
        Gives the structure of an id, or raises. With it the flight is measured against its structure and
        judged (`upplied.inputs.passport`); without, it is only read.
    flight : bool
        It is the proof of a plan: its pauses and silences stay as long as they were, since photos carry the
        log's clock; those of a demonstration are shortened. Exports of plans and simulated logs are refused.

    Returns
    -------
    Demonstration
        Poses of the camera in the structure frame, m; `dropped`, `breaks`, `degraded` and `notes`
        hold what was wrong with the log.

    Raises
    ------
    InputError
        If no correct record can be made of the file.
    """
    path = Path(path)
    try:
        kind = door.kind_of(path)
        with ThreadPoolExecutor(1) as beside:  # hashing a large log takes longer than reading its poses
            sha256 = beside.submit(_sha256, path, kind)
            source = door.read(path, FIELDS)
            try:
                settings = options or LogOptions(), placements or {}
                demonstration, facts = _demonstration(path, source, *settings, structures, flight)
            except InputError as error:
                raise _in_context(error, path, source) from None
            return replace(demonstration, sha256=_digest(sha256.result(), facts))
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror})", "a readable file") from None


def _demonstration(
    path: Path, source: Source, options: LogOptions, placements: Places, structures: Structures, flight: bool
) -> tuple[Demonstration, LogOptions]:
    """The procedure: the facts, then poses from end to end; and the facts as they are hashed."""
    what, tables = str(path), source.tables
    if flight:
        _check_flown(source.metadata, what)
    # Facts beside the messages: side-car, metadata, options; then the defaults of the kind of file.
    declared, notes = inspection(path, source.metadata, options)
    if not declared.structure_id:
        remedy = f"write it into {sidecar_of(path)}, table [inspection], or give --structure"
        raise InputError(what, "does not name the structure that was flown", "a structure_id", remedy)
    structure = None if structures is None else structures(declared.structure_id)
    declared = placed(declared, placements.get(declared.structure_id))
    facts = stated(declared, source.defaults)
    camera, camera_frame, more, zoom = cameras.camera_of(tables, facts, what)
    tree = tf.tree_of(tables, facts)
    # One source of poses: a topic, or the transforms.
    table, chosen = choose(tables, facts, what)
    if table is not None:
        track, topic = READERS[table.schema](table, tables, facts), table.channel.topic
    elif tree.moving:
        track, topic = tf.transformed(tree, facts, camera_frame, what), tree.topic
    else:
        raise nothing(tables, what)
    where = f"{what}, {topic}"
    # The inspection alone; samples that are no pose are dropped and counted.
    track, cut, bounded = inspections.inspected(steady(timed(track)), tables, facts, what)
    track = clean(track, facts, where)
    check_one(track, facts, where)
    facts, placing = registered(facts, track, structure, where)
    if facts.unit_m is not None and track.parent != geodetic.STRUCTURE:
        if not facts.unit_m > 0:  # a reconstruction has no unit of its own
            remedy = "write unit_m of the project's mesh into the side-car"
            rule = "unit_m: metres per unit of it"
            raise InputError(where, "is a reconstruction without unit", rule, remedy)
        track = replace(track, positions=track.positions * facts.unit_m)
    track = converted(track, facts.convention)
    through = partial(cameras.through, camera, zoom, track, what=what)
    camera, fov_deg = through(facts)
    track = replace(track, fov_deg=fov_deg)
    pointing = px4.gimbal(tables, facts)

    # From the body to the camera, from the log's frame to the structure's.
    def to_camera(logged: Track) -> Track:
        seen = camera_poses(logged, facts, tree, camera_frame, pointing)
        seen = in_structure_frame(in_frame(seen, facts, tree, where), facts)
        return converted(seen, facts.convention, of_camera=True)

    whole, flown = track, to_camera(track)
    parts = None
    if structure is not None and source.timed and not bounded and len(flown) > 1:
        parts = inspections.phases(flown, scene_of(structure), SEEN * camera.max_range_m)
    if parts is not None:
        inside = parts.inspected((flown.t_ns - flown.t_ns[0]) * 1e-9)
        track, flown = track.take(np.isin(track.t_ns, flown.t_ns[inside])), flown.take(inside)
        cut = [f"the inspection within the log: {parts}"]
    check_dropped(flown, facts, where)
    _check_length(flown, facts, what)
    gap_s = silence_s(flown, facts.gap_s)
    shortened, pace = paced(flown, gap_s, facts.passport, parts.between_s if parts else 0.0)
    if flight:
        shortened = flown
    first_after, how = breaks(shortened, gap_s)
    pacing = [] if flight else pace.words
    notes += [*source.notes, *filter(None, [placing]), *more, *chosen, *cut, *shortened.notes, *how, *pacing]
    if source.stills and not camera.trigger_s and len(shortened) > 1:
        camera = replace(camera, trigger_s=float(np.diff(shortened.t_ns).min() * 1e-9))
    passport: Mapping[str, Any] = {}
    if structure is not None:
        of_reader: list[Check] = [
            ("zoom-untimed", through),
            ("several-publishers", lambda options: choose(tables, options, what)),
            ("several-publishers", lambda options: check_one(track, options, what)),
            ("frame-unconnected", lambda options: in_frame(track, options, tree, what)),
        ]
        reading = Reading(
            source, whole, track, flown, shortened, pace, camera, to_camera, gap_s, tuple(notes),
            _overruled(facts, of_reader), None if facts.convention else ros.velocity(tables, topic),
            ros.turning(tables), cameras.lens_ratio(zoom, facts),
        )  # fmt: skip
        passport = passport_of(reading, structure, facts, what)
    demonstration = Demonstration(
        **{name: getattr(facts, name) for name in _OF_FACTS},
        **{name: getattr(shortened, name) for name in _OF_TRACK},
        quat_xyzw=normalised(shortened.quat_xyzw),
        camera=camera,
        breaks=first_after,
        degraded=bool(source.losses),
        dropped=dict(sorted(shortened.dropped.items())),
        topic=topic,
        notes="; ".join([*filter(None, [facts.notes]), *notes, *source.losses]),
        passport=passport,
        wind=ros.wind_of(tables, shortened, facts.structure_heading_deg),
        stills=source.stills,
        accuracy_m=facts.accuracy_m if flight else None,
    )
    return demonstration, declared


def _overruled(facts: LogOptions, checks: Sequence[Check]) -> tuple[Verdict, ...]:
    verdicts: dict[str, Verdict] = {}
    for rule, check in checks:
        try:
            if rule in facts.allow:
                check(replace(facts, allow=()))
        except InputError as error:
            verdicts.setdefault(rule, replace(broken(RULES[rule], error.finding), overruled=True))
    return tuple(verdicts.values())


def _in_context(error: InputError, path: Path, source: Source) -> InputError:
    what = error.what if str(path) in error.what else f"{path}, {error.what}"
    finding = "; ".join([error.finding, *source.losses])
    if error.finding.startswith(NOTHING):
        topics = source.listed or ", ".join(f"{it.channel.topic} ({it.schema})" for it in source.tables[:12])
        finding += f"; its topics: {topics or 'none'}"
    return InputError(what, finding, error.rule, error.remedy)


def _check_flown(metadata: Sequence[tuple[str, Mapping[str, str]]], what: str) -> None:
    for name, values in metadata:
        plan = name == "plan" and "structure_id" in values
        if plan or (name == "inspection" and values.get("simulated", "").lower() == "true"):
            finding = "is an export of a plan" if plan else "is the log of a simulated flight"
            raise InputError(what, f"{finding}: its metadata say so", "the log of a vehicle that flew")


def _check_length(track: Track, facts: LogOptions, what: str) -> None:
    seconds = float(track.t_ns[-1] - track.t_ns[0]) * 1e-9 if len(track) else 0.0
    if len(track) < 2 or seconds < facts.min_duration_s:
        finding = f"holds {len(track)} poses over {seconds:.2f} s"
        finding += f" ({reasons(track)} dropped)" if track.dropped else ""
        rule, remedy = f"at least 2 poses and {facts.min_duration_s} s", "lower min_duration_s if this is all"
        raise InputError(what, finding, rule, remedy)


# Facts that change nothing of a flight, and those that came later and leave the hash of older logs alone.
_UNHASHED = ("demonstration_id", "allow", "strict", "passport")
_LATER = (
    "publisher", "convention", "unit_m", "takeoff_alt_m", "points", "body_T_antenna_position_m",
    "camera_model", "camera_file_format", "camera_width_px", "camera_height_px", "camera_exposure_s",
    "camera_trigger_s", "camera_focus_m", "camera_focal_mm", "camera_f_number", "camera_distortion",
    "camera_distortion_model", "camera_middle_px", "accuracy_m",
)  # fmt: skip
_PHOTO_HEAD = 1 << 17  # bytes by which a photo is known: reading all of them would take longer than the rest


def fingerprint(
    path: str | Path, options: LogOptions | None = None, placements: Mapping[str, Placement] | None = None
) -> tuple[str, str]:
    """The id and the hash that `read_demonstration` would give; no message is read.

    The hash differs where facts stand among the messages of a damaged log: such a log is read to be known.
    Raises InputError or OSError if the file cannot be read or is no log.
    """
    path = Path(path)
    kind = door.kind_of(path)
    metadata = open_recording(path).metadata if kind == "mcap" else []
    facts, _ = inspection(path, metadata, options or LogOptions())
    facts = placed(facts, (placements or {}).get(facts.structure_id))
    return facts.demonstration_id, _digest(_sha256(path, kind), facts)


def _digest(log: str, facts: LogOptions) -> str:
    """The hash of a flight: of the hash of its bytes and of all facts about it."""
    hashed = {name: fact for name, fact in vars(facts).items() if fact or name not in _LATER}
    hashed = {name: fact for name, fact in hashed.items() if name not in _UNHASHED}
    shaped = {name: getattr(facts.passport, name) for name in SHAPING}
    if shaped != {name: getattr(PassportSettings(), name) for name in SHAPING}:
        hashed["shaped"] = shaped
    return digest({"log": log, "said": hashed})


def _sha256(path: Path, kind: str) -> str:
    """The hash of the bytes of a file; where several hold a flight, of all of them, photos by their heads."""
    names, whole = door.parts_of(path, kind), hashlib.sha256()
    for name in names:
        with name.open("rb") as stream:
            if names == [path]:
                return hashlib.file_digest(stream, "sha256").hexdigest()
            whole.update(f"{name.name}\0{name.stat().st_size}\0".encode())
            photo = kind == "photos"
            whole.update(
                stream.read(_PHOTO_HEAD) if photo else hashlib.file_digest(stream, "sha256").digest()
            )
    return whole.hexdigest()
