"""What is known of a flight besides its messages: side-car, metadata record and options.

A recorder cannot know which structure was flown or how the camera is mounted. That is told by a
metadata record named ``inspection`` in the log, or by a TOML file next to it (``flight.mcap`` ->
``flight.toml``, table ``[inspection]``). Facts: the side-car wins over the metadata, the metadata
over the options. What to read (topic, start, stop) is the caller's choice: there options win.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from upplied.cameras import FILE_FORMATS, known_cameras
from upplied.checks import check_id
from upplied.errors import InputError
from upplied.inputs.passport.settings import CONVENTIONS, PassportSettings
from upplied.records import Placement

MAX_TEXT = 2000  # characters
MAX_SIDECAR_BYTES = 2**20
BODY_FRAMES = ("camera", "optical", "body")
_CHOICES = ("topic", "schema", "publisher", "start_s", "stop_s")

Vector = tuple[float, ...]


@dataclass(frozen=True)
class LogOptions:
    """What may be said of a log; None or "" where nothing is said.

    The same names are the keys of the metadata record and of the side-car's ``[inspection]``,
    except for the last block, which belongs to the reader. All lengths in m, angles in degrees.
    """

    structure_id: str = ""
    demonstration_id: str = ""  # default: the file's name
    operator: str = ""
    site: str = ""
    kind: str = ""
    notes: str = ""
    about: str = ""  # what was inspected: landmarks, part_3, box X Y Z X Y Z (m, structure frame), by commas
    # Which messages, and which part of the flight (s from the first pose, or ns of the source clock).
    topic: str = ""
    schema: str = ""  # where one topic carries several
    publisher: str = ""  # where several publish on the topic: a frame's name, or #7 for the channel 7
    start_s: float | None = None
    stop_s: float | None = None
    start_ns: int | None = None
    end_ns: int | None = None
    # Pose of the structure frame in the log's fixed frame.
    frame_id: str = ""
    structure_position_m: Vector | None = None  # x y z
    structure_quat_xyzw: Vector | None = None  # structure to log frame
    points: tuple[tuple[str, Vector], ...] = ()  # landmarks in the log's frame, by which it is registered
    # Or, for geodetic logs, where the structure stands.
    structure_lat_deg: float | None = None
    structure_lon_deg: float | None = None
    structure_alt_m: float | None = None
    structure_heading_deg: float | None = None  # of +X, clockwise from north
    structure_datum: str = ""  # of the altitude: "ellipsoid" or "amsl"
    geoid_undulation_m: float | None = None  # ellipsoid minus mean sea level, where datums differ
    takeoff_alt_m: float | None = (
        None  # of the place of take-off, in the structure's datum: heights may count from it
    )
    unit_m: float | None = (
        None  # what one unit of the log's lengths is: a reconstruction has a scale of its own
    )
    # What the poses are of, and the camera.
    convention: str = ""  # in which the poses are written, where it is not what the schema says
    body_frame: str = ""  # "camera" (x forward), "optical" (z forward) or "body" (x forward, with a mount)
    body_T_camera_position_m: Vector | None = None
    body_T_camera_quat_xyzw: Vector | None = None
    camera_frame_id: str = ""  # name of the camera's optical frame in TF
    camera_min_range_m: float | None = None
    camera_max_range_m: float | None = None
    camera_hfov_deg: float | None = None
    camera_vfov_deg: float | None = None
    camera_model: str = ""  # a name in `cameras.toml`
    camera_file_format: str = ""  # of its photos: "jpeg" or "raw"
    camera_width_px: float | None = None
    camera_height_px: float | None = None
    camera_exposure_s: float | None = None  # of one picture
    camera_trigger_s: float | None = None  # least time between two photos
    camera_focus_m: float | None = None  # nearest distance that is in focus
    camera_focal_mm: float | None = None
    camera_f_number: float | None = None
    # Limits of the reader; options only.
    gap_s: float = 0.5  # a longer silence breaks the flight
    max_dropped: float = 0.05  # share of the samples
    min_duration_s: float = 5.0
    # Rules of the passport that are overruled, by name; whether what is odd is refused too; the bounds.
    allow: tuple[str, ...] = ()
    strict: bool = False
    passport: PassportSettings = field(default_factory=PassportSettings)


_READER_ONLY = ("gap_s", "max_dropped", "min_duration_s", "allow", "strict", "passport")
_VECTORS = {
    "structure_position_m": 3,
    "structure_quat_xyzw": 4,
    "body_T_camera_position_m": 3,
    "body_T_camera_quat_xyzw": 4,
}
_POINTS = 1000  # that anybody would name
_INTEGERS = ("start_ns", "end_ns")
_TEXTS = tuple(item.name for item in fields(LogOptions) if item.default == "")
_NAMES = tuple(item.name for item in fields(LogOptions) if item.name not in _READER_ONLY)
_FAR_M = 1e7
_BOUNDS: dict[str, tuple[float, float]] = {
    "structure_lat_deg": (-90, 90),
    "structure_lon_deg": (-180, 360),
    "camera_hfov_deg": (1, 360),
    "camera_vfov_deg": (1, 180),
    "camera_min_range_m": (0, 10_000),
    "camera_max_range_m": (0.01, 100_000),
    "camera_width_px": (16, 100_000),
    "camera_height_px": (16, 100_000),
    "camera_exposure_s": (1e-6, 1),
    "camera_trigger_s": (0.01, 3600),
    "camera_focus_m": (0, 1000),
    "camera_focal_mm": (0.1, 10_000),
    "camera_f_number": (0.5, 100),
    "structure_alt_m": (-1000, 20_000),
    "structure_heading_deg": (-360, 360),
    "geoid_undulation_m": (-200, 200),
    "takeoff_alt_m": (-1000, 20_000),
    "unit_m": (1e-6, 1e6),
    "start_s": (-1e7, 1e7),
    "stop_s": (-1e7, 1e7),
    "start_ns": (0, 2**63 - 1),
    "end_ns": (0, 2**63 - 1),
    "gap_s": (1e-3, 3600),
    "max_dropped": (0, 1),
    "min_duration_s": (0, 1e6),
}


def inspection(
    path: Path, metadata: list[tuple[str, dict[str, str]]], options: LogOptions
) -> tuple[LogOptions, list[str]]:
    """All facts about a flight, each from its strongest source.

    Parameters
    ----------
    path : Path
        Of the log; the side-car lies next to it.
    metadata : list of (name, mapping)
        The metadata records of the log.
    options : LogOptions

    Returns
    -------
    facts : LogOptions
        Checked; `demonstration_id` is filled in, `structure_id` may be missing.
    notes : list of str
        Options that were overruled.

    Raises
    ------
    InputError
        If a value has the wrong form, or the side-car holds an unknown key.
    """
    facts, notes = _checked(options, "options"), []
    for name, values in metadata:
        if name == "inspection":
            facts = _merged(facts, values, f"{path}: metadata inspection", strict=False)
    sidecar = path / "inspection.toml" if path.is_dir() else path.with_suffix(".toml")
    if sidecar.is_file():
        facts = _merged(facts, _read_toml(sidecar), str(sidecar), strict=True)
    for item in fields(LogOptions):
        said, used = getattr(options, item.name), getattr(facts, item.name)
        if item.name in _CHOICES and said not in ("", None):
            facts = replace(facts, **{item.name: said})
        elif said not in ("", None) and said != used:
            notes.append(f"{item.name} {said} was overruled by the log's own {used}")
    if not facts.demonstration_id:
        facts = replace(facts, demonstration_id=safe_id(path.stem))
    return facts, notes


def placed(facts: LogOptions, placement: Placement | None) -> LogOptions:
    """The facts with the structure's place on the Earth, where they do not tell it themselves."""
    if placement is None or facts.structure_lat_deg is not None:
        return facts
    return replace(
        facts,
        structure_lat_deg=placement.lat_deg,
        structure_lon_deg=placement.lon_deg,
        structure_alt_m=placement.alt_m,
        structure_heading_deg=placement.heading_deg,
        structure_datum=placement.datum,
    )


def stated(facts: LogOptions, defaults: Mapping[str, Any]) -> LogOptions:
    """The facts with what a kind of file says of itself, where nobody says otherwise."""
    unsaid = {name: value for name, value in defaults.items() if getattr(facts, name) in ("", None)}
    return replace(facts, **unsaid)


def safe_id(text: str) -> str:
    """An id made of a file's name.

    Examples
    --------
    >>> safe_id("A320 left wing (2)")
    'A320-left-wing-2'
    """
    safe = re.sub(r"[^A-Za-z0-9_-]+", "-", text).strip("-_")[:64].rstrip("-_")
    return safe or "flight"


def _read_toml(path: Path) -> Mapping[str, Any]:
    if path.stat().st_size > MAX_SIDECAR_BYTES:
        raise InputError(str(path), "is too large for a side-car", f"at most {MAX_SIDECAR_BYTES} bytes")
    try:
        table = tomllib.loads(path.read_text("utf-8")).get("inspection")
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(str(path), f"is no TOML ({str(error)[:120]})", "a table [inspection]") from None
    if not isinstance(table, dict):
        raise InputError(str(path), "has no table [inspection]", f"keys {', '.join(_NAMES)}")
    return table


def _merged(facts: LogOptions, values: Mapping[str, Any], what: str, strict: bool) -> LogOptions:
    version = values.get("schema_version", "1")
    if str(version) != "1":
        raise InputError(what, f"has schema_version {str(version)[:20]!r}", "schema_version 1")
    changes = {}
    for name, value in values.items():
        if name in _NAMES:
            if value not in ("", None):
                changes[name] = _value(name, value, what)
        elif strict and name != "schema_version":
            raise InputError(what, f"has an unknown key {str(name)[:60]!r}", f"one of {', '.join(_NAMES)}")
    return _checked(replace(facts, **changes), what)


def _value(name: str, value: Any, what: str) -> Any:
    try:
        if isinstance(value, bool):
            raise TypeError
        if name == "points":
            return tuple((str(key), tuple(float(part) for part in place)) for key, place in value.items())
        if name in _VECTORS:
            return tuple(float(part) for part in (value.split() if isinstance(value, str) else value))
        if name in _INTEGERS:
            return int(value)
        if name in _TEXTS:
            if not isinstance(value, str) or len(value) > MAX_TEXT:
                raise TypeError
            return value
        return float(value)
    except (TypeError, ValueError, OverflowError, AttributeError):
        form = (
            "a table of names and three numbers each"
            if name == "points"
            else f"{_VECTORS[name]} numbers"
            if name in _VECTORS
            else f"text of at most {MAX_TEXT} characters"
            if name in _TEXTS
            else "a number"
        )
        raise InputError(f"{what}, {name}", f"got {str(value)[:80]!r}", form) from None


def _checked(facts: LogOptions, what: str) -> LogOptions:
    for name, size in _VECTORS.items():
        _check_vector(name, getattr(facts, name), size, what)
    for name, point in facts.points[:_POINTS]:
        _check_vector(f"points, {name[:60]}", point, 3, what)
    for name in ("structure_id", "demonstration_id"):
        if getattr(facts, name):
            check_id(getattr(facts, name), f"{what}, {name}")
    for item in fields(facts):
        value = getattr(facts, item.name)
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{what}, {item.name}", f"got {value}", "a finite number")
        low, high = _BOUNDS.get(item.name, (-math.inf, math.inf))
        if isinstance(value, float | int) and not low <= value <= high:
            raise InputError(f"{what}, {item.name}", f"got {value}", f"{low} to {high}")
    if facts.convention and facts.convention not in CONVENTIONS:
        raise InputError(
            f"{what}, convention", f"got {facts.convention[:40]!r}", f"one of {', '.join(CONVENTIONS)}"
        )
    if facts.camera_model and facts.camera_model not in (names := known_cameras()):
        found = f"got {facts.camera_model[:60]!r}"
        raise InputError(f"{what}, camera_model", found, f"one of {', '.join(names)}")
    if facts.camera_file_format not in ("", *FILE_FORMATS):
        found = f"got {facts.camera_file_format[:40]!r}"
        raise InputError(f"{what}, camera_file_format", found, f"one of {', '.join(FILE_FORMATS)}")
    if facts.body_frame not in ("", *BODY_FRAMES):
        raise InputError(
            f"{what}, body_frame", f"got {facts.body_frame[:40]!r}", f"one of {', '.join(BODY_FRAMES)}"
        )
    if facts.structure_datum not in ("", "ellipsoid", "amsl"):
        raise InputError(
            f"{what}, structure_datum", f"got {facts.structure_datum[:40]!r}", "ellipsoid or amsl"
        )
    return facts


def _check_vector(name: str, vector: Vector | None, size: int, what: str) -> None:
    if vector is None:
        return
    if len(vector) != size or not all(abs(part) <= _FAR_M for part in vector):  # NaN is not
        raise InputError(f"{what}, {name}", f"got {str(vector)[:80]}", f"{size} finite numbers")
    if size == 4 and abs(math.hypot(*vector) - 1) > 1e-2:
        raise InputError(
            f"{what}, {name}", f"has length {math.hypot(*vector):.3f}", "a unit quaternion x y z w"
        )
