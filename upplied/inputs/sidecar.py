"""Facts about a flight besides its messages, of which the later win: options, metadata and side-car.

A metadata record is ``inspection``, a side-car a ``flight.toml`` with a table of that name.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import numpy as np

from upplied.cameras import FILE_FORMATS, known_cameras
from upplied.checks import check_id
from upplied.errors import InputError
from upplied.inputs.files import read_regular
from upplied.inputs.manifest_keys import DATUMS, Parser, array, choice, number, points, text
from upplied.inputs.rules import CONVENTIONS, PassportSettings
from upplied.records import Placement

MAX_TEXT = 2000  # characters
MAX_SIDECAR_BYTES = 2**20
BODY_FRAMES = ("camera", "optical", "body")
_CHOICES = ("topic", "schema", "publisher", "start_s", "stop_s")

Vector = tuple[float, ...]
Text = Annotated[str, text(MAX_TEXT)]
Place = Annotated[Vector | None, array((3,), "3 finite numbers")]
Turn = Annotated[Vector | None, array((4,), "a unit quaternion x y z w")]


@dataclass(frozen=True)
class LogOptions:
    """Facts about a log, by the keys of record and side-car; None or "" where nothing is declared."""

    structure_id: Annotated[str, check_id] = ""
    demonstration_id: Annotated[str, check_id] = ""  # default: the file's name
    operator: Text = ""
    site: Text = ""
    kind: Text = ""
    notes: Text = ""
    about: Text = ""  # what was inspected: landmarks, part_3, box X Y Z X Y Z (m, structure frame), by commas
    # Which messages, and which part of the flight (s from the first pose, or ns of the source clock).
    topic: Text = ""
    schema: Text = ""  # where one topic carries several
    publisher: Text = ""  # where several publish on the topic: a frame's name, or #7 for the channel 7
    start_s: Annotated[float | None, number(-1e7, 1e7)] = None
    stop_s: Annotated[float | None, number(-1e7, 1e7)] = None
    start_ns: Annotated[int | None, number(0, 2**63 - 1, whole=True)] = None
    end_ns: Annotated[int | None, number(0, 2**63 - 1, whole=True)] = None
    # Pose of the structure frame in the log's fixed frame.
    frame_id: Text = ""
    structure_position_m: Place = None  # x y z
    structure_quat_xyzw: Turn = None  # structure to log frame
    points: Annotated[tuple[tuple[str, Vector], ...], points] = ()  # landmarks in the log's frame, m
    # Or, for geodetic logs, where the structure stands.
    structure_lat_deg: Annotated[float | None, number(-90, 90)] = None
    structure_lon_deg: Annotated[float | None, number(-180, 360)] = None
    structure_alt_m: Annotated[float | None, number(-1000, 20_000)] = None
    structure_heading_deg: Annotated[float | None, number(-360, 360)] = None  # of +X, clockwise from north
    structure_datum: Annotated[str, choice(DATUMS)] = ""  # of the altitude
    geoid_undulation_m: Annotated[float | None, number(-200, 200)] = None  # ellipsoid minus mean sea level
    takeoff_alt_m: Annotated[float | None, number(-1000, 20_000)] = None  # in the structure's datum
    unit_m: Annotated[float | None, number(1e-6, 1e6)] = None  # metres per unit of a reconstruction's lengths
    # What the poses are of, and the camera.
    convention: Annotated[str, choice(tuple(CONVENTIONS))] = ""  # where it is not what the schema says
    body_frame: Annotated[str, choice(BODY_FRAMES)] = ""  # x forward, z forward, or x forward with a mount
    body_T_camera_position_m: Place = None
    body_T_camera_quat_xyzw: Turn = None
    body_T_antenna_position_m: Place = None  # of the satellite receiver, whose positions are logged
    accuracy_m: Annotated[float | None, number(0, 1000)] = None  # of the positions, one sigma, as of RTK
    camera_frame_id: Text = ""  # name of the camera's optical frame in TF
    camera_min_range_m: Annotated[float | None, number(0, 10_000)] = None
    camera_max_range_m: Annotated[float | None, number(0.01, 100_000)] = None
    camera_hfov_deg: Annotated[float | None, number(1, 360)] = None
    camera_vfov_deg: Annotated[float | None, number(1, 180)] = None
    camera_model: Annotated[str, choice(tuple(known_cameras()))] = ""  # a name in `cameras.toml`
    camera_file_format: Annotated[str, choice(FILE_FORMATS)] = ""  # of its photos
    camera_width_px: Annotated[float | None, number(16, 100_000)] = None
    camera_height_px: Annotated[float | None, number(16, 100_000)] = None
    camera_exposure_s: Annotated[float | None, number(1e-6, 1)] = None  # of one picture
    camera_trigger_s: Annotated[float | None, number(0.01, 3600)] = None  # least time between two photos
    camera_focus_m: Annotated[float | None, number(0, 1000)] = None  # nearest distance that is in focus
    camera_focal_mm: Annotated[float | None, number(0.1, 10_000)] = None
    camera_f_number: Annotated[float | None, number(0.5, 100)] = None
    camera_distortion: Annotated[Vector | None, array((0,), "numbers k1 k2 p1 p2 k3 k4 k5 k6")] = None
    camera_distortion_model: Annotated[str, choice(("brown", "fisheye"))] = ""
    camera_middle_px: Annotated[Vector | None, array((2,), "x and y, px")] = None  # where the axis meets it
    # Limits of the reader; options only.
    gap_s: Annotated[float, number(1e-3, 3600)] = 0.5  # a longer silence breaks the flight
    max_dropped: Annotated[float, number(0, 1)] = 0.05  # share of the samples
    min_duration_s: Annotated[float, number(0, 1e6)] = 5.0
    # Rules of the passport that are overruled, by name; whether what is odd is refused too; the bounds.
    allow: tuple[str, ...] = ()
    strict: bool = False
    passport: PassportSettings = field(default_factory=PassportSettings)


_KEYS: dict[str, Parser] = {
    name: hint.__metadata__[0]
    for name, hint in get_type_hints(LogOptions, include_extras=True).items()
    if hasattr(hint, "__metadata__")
}
_NAMES = tuple(name for name in _KEYS if name not in ("gap_s", "max_dropped", "min_duration_s"))
_FAR_M = 1e7


def inspection(
    path: Path, metadata: list[tuple[str, dict[str, str]]], options: LogOptions
) -> tuple[LogOptions, list[str]]:
    """All facts about a flight, each from its strongest source, and in words the options that were overruled.

    `metadata` are named records of the log. `demonstration_id` is filled in, `structure_id` may be missing.
    Raises InputError if a value has the wrong form, or the side-car holds an unknown key.
    """
    choices = {name: getattr(options, name) for name in _KEYS} | {"points": dict(options.points)}
    choices = {name: _parsed(name, value, "options") for name, value in choices.items() if _is_set(value)}
    facts, notes = replace(options, **choices), []
    for name, values in metadata:
        if name == "inspection":
            facts = _merged(facts, values, f"{path}: metadata inspection", strict=False)
    if (sidecar := sidecar_of(path)).is_file():
        text = read_regular(sidecar, MAX_SIDECAR_BYTES, remedy="keep facts alone in it")
        try:
            table = tomllib.loads(text.decode("utf-8")).get("inspection")
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
            finding = f"is no TOML ({str(error)[:120]})"
            raise InputError(str(sidecar), finding, "a table [inspection]") from None
        if not isinstance(table, dict):
            raise InputError(str(sidecar), "has no table [inspection]", f"keys {', '.join(_NAMES)}")
        facts = _merged(facts, table, str(sidecar), strict=True)
    for item in fields(LogOptions):
        option, used = getattr(options, item.name), getattr(facts, item.name)
        if item.name in _CHOICES and option not in ("", None):
            facts = replace(facts, **{item.name: option})
        elif option not in ("", None) and option != used:
            notes.append(f"{item.name} {option} was overruled by the log's own {used}")
    if not facts.demonstration_id:
        facts = replace(facts, demonstration_id=safe_id(path.stem))
    return facts, notes


def sidecar_of(path: Path) -> Path:
    """The file of facts beside a log, or in a folder of photos, whether it exists or not."""
    return path / "inspection.toml" if path.is_dir() else path.with_suffix(".toml")


def placed(facts: LogOptions, placement: Placement | None) -> LogOptions:
    """The facts with the structure's place on the Earth, where they do not have it themselves."""
    if placement is None or facts.structure_lat_deg is not None:
        return facts
    return replace(facts, **{f"structure_{name}": value for name, value in asdict(placement).items()})


def stated(facts: LogOptions, defaults: Mapping[str, Any]) -> LogOptions:
    """The facts with the defaults of a kind of file, where nothing else is declared."""
    return replace(facts, **{key: it for key, it in defaults.items() if not _is_set(getattr(facts, key))})


def safe_id(text: str) -> str:
    """An id made of a file's name: ``A320-left-wing-2`` of ``A320 left wing (2)``."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", text).strip("-_")[:64].rstrip("-_") or "flight"


def _merged(facts: LogOptions, values: Mapping[str, Any], what: str, strict: bool) -> LogOptions:
    if (version := str(values.get("schema_version", "1"))) != "1":
        raise InputError(what, f"has schema_version {version[:20]!r}", "schema_version 1")
    unknown = [str(name) for name in values if name not in (*_NAMES, "schema_version")]
    if unknown and strict:
        raise InputError(what, f"has an unknown key {unknown[0][:60]!r}", f"one of {', '.join(_NAMES)}")
    return replace(facts, **{it: _parsed(it, values[it], what) for it in _NAMES if _is_set(values.get(it))})


def _is_set(value: Any) -> bool:
    return not isinstance(value, str | tuple | dict | None) or bool(value)


def _parsed(name: str, value: Any, what: str) -> Any:
    what = f"{what}, {name}"
    value = _KEYS[name](value, what)
    if name == "points":
        value = tuple(value.items())
    numbers = np.array([point for _, point in value] if name == "points" else value)
    if numbers.dtype.kind in "if" and isinstance(value, tuple) and (np.abs(numbers) > _FAR_M).any():
        raise InputError(what, f"got {str(value)[:80]}", f"numbers up to {_FAR_M:g}")
    if name.endswith("quat_xyzw") and abs(math.hypot(*value) - 1) > 1e-2:
        raise InputError(what, f"has length {math.hypot(*value):.3f}", "a unit quaternion x y z w")
    return value
