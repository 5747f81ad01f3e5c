"""The keys of a structure manifest, and the parsers of declared values: what each accepts, and its error."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from upplied.checks import check_id
from upplied.errors import InputError
from upplied.inputs.structure_rules import RULES

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048, "file": None}
AXES = ("x", "y", "z", "-x", "-y", "-z")
DATUMS = ("ellipsoid", "amsl")
SURFACES = ("drawn", "scanned")

Parser = Callable[[Any, str], Any]


@dataclass(frozen=True)
class Key:
    """One key of a manifest."""

    parse: Parser
    meaning: str
    required: bool = False


def parse(row: Mapping[str, Any], what: str) -> dict[str, Any]:
    """The values of one entry, checked: typed by TOML, or text from CSV. `what` names it in errors."""
    unknown = [str(key) for key in row if key not in KEYS]
    if unknown:
        raise InputError(what, f"unknown key {unknown[0][:60]!r}", f"known keys are {', '.join(KEYS)}")
    missing = [name for name, key in KEYS.items() if key.required and name not in row]
    if missing:
        key = missing[0]
        raise InputError(what, f"has no {key!r}", f"{key} is required: {KEYS[key].meaning}")
    return {name: KEYS[name].parse(value, f"{what}, {name}") for name, value in row.items()}


def axes(given: Mapping[str, Any], what: str) -> tuple[str, str]:
    """Up and forward axis; a symmetric structure needs no forward axis."""
    up, forward = given["up"], given.get("forward")
    if forward is None and given.get("symmetric"):
        forward = next(axis for axis in AXES if axis[-1] != up[-1])
    if forward is None:
        found = "has no 'forward'"
        rule = "the axis of the file that points to the nose, bow, rotor hub or along the structure"
        raise InputError(what, found, rule, "declare it, or symmetric = true where no such direction exists")
    if forward[-1] == up[-1]:
        raise InputError(what, f"forward {forward!r} and up {up!r} lie on one axis", "two different axes")
    return up, forward


def text(most: int) -> Parser:
    """A parser of text of so many characters."""

    def parse_text(value: Any, what: str) -> str:
        if isinstance(value, str) and len(value) <= most and "\0" not in value:
            return value
        raise InputError(what, f"got {_shown(value)}", f"text of at most {most} characters")

    return parse_text


def number(low: float = -1e12, high: float = 1e12, above: float = -math.inf, whole: bool = False) -> Parser:
    """A parser of numbers, typed or as text."""
    least = f"from {low:g}" if math.isinf(above) else f"above {above:g}, up"
    rule = f"a {'whole' if whole else 'finite'} number {least} to {high:g}"

    def parse_number(value: Any, what: str) -> float:
        try:
            found = float("nan") if isinstance(value, bool) else (int if whole else float)(value)
        except (ValueError, TypeError, OverflowError):
            found = float("nan")
        if not low <= found <= high or found <= above:
            raise InputError(what, f"got {_shown(value)}", rule)
        return found

    return parse_number


def choice(allowed: tuple[str, ...]) -> Parser:
    """A parser of one of these words."""

    def parse_choice(value: Any, what: str) -> str:
        word = value.strip().lower().removeprefix("+") if isinstance(value, str) else None
        if word not in allowed:
            raise InputError(what, f"got {_shown(value)}", f"one of {', '.join(allowed)}")
        return word

    return parse_choice


def _units(value: Any, what: str) -> float | None:
    if isinstance(value, str) and value.strip() in UNITS:
        return UNITS[value.strip()]
    try:
        return number(above=0.0, high=1e6)(value, what)
    except InputError:
        rule = f"one of {', '.join(UNITS)} (file: as the file itself declares), or metres per unit"
        raise InputError(what, f"got {_shown(value)}", rule) from None


def _flag(value: Any, what: str) -> bool:
    if isinstance(value, bool):
        return value
    if isinstance(value, str) and value.lower() in ("true", "false"):
        return value.lower() == "true"
    raise InputError(what, f"got {_shown(value)}", "true or false")


def array(shape: tuple[int, ...], rule: str) -> Parser:
    """A parser of nested lists of numbers, typed, as JSON or by spaces; 0 in the shape is any length."""

    def parse_array(value: Any, what: str) -> Any:
        try:
            spaced = isinstance(value, str) and not value.lstrip().startswith("[")
            values = np.array(value.split() if spaced else _decoded(value), float)
        except (ValueError, TypeError, OverflowError):
            values = np.empty(0)
        fits = values.ndim == len(shape) and all(
            map(lambda want, have: want in (0, have), shape, values.shape)
        )
        if not fits or not np.isfinite(values).all():
            raise InputError(what, f"got {_shown(value)}", rule)
        return tuple(values.tolist()) if len(shape) == 1 else values

    return parse_array


def _boxes(value: Any, what: str) -> Any:
    boxes = array((0, 2, 3), "boxes [[xmin, ymin, zmin], [xmax, ymax, zmax]], m")(value, what)
    if (boxes[:, 0] >= boxes[:, 1]).any():
        raise InputError(what, "a box's first corner is not below its second", "min before max on each axis")
    return boxes


def _polygon(value: Any, what: str) -> Any:
    polygon = array((0, 2), "corners [x, y], m")(value, what)
    if len(polygon) < 3:
        raise InputError(what, f"has {len(polygon)} corners", "at least 3")
    return polygon


def points(value: Any, what: str) -> dict[str, tuple[float, float, float]]:
    """A table of names and three numbers each, m."""
    try:
        table = _decoded(value)
    except ValueError:
        table = None
    if not isinstance(table, dict):
        raise InputError(what, f"got {_shown(value)}", "name = [x, y, z], m, structure frame")
    point = array((3,), "[x, y, z], m, structure frame")
    return {check_id(name, what): point(xyz, f"{what} {name}") for name, xyz in table.items()}


def _rules(value: Any, what: str) -> tuple[str, ...]:
    listed = isinstance(value, str) and value.lstrip().startswith("[")
    try:
        names = _decoded(value) if listed or not isinstance(value, str) else value.replace(",", " ").split()
    except ValueError:
        names = None
    if not isinstance(names, list) or not all(isinstance(name, str) and name in RULES for name in names):
        raise InputError(what, f"got {_shown(value)}", f"names of rules, of {', '.join(RULES)}")
    return tuple(sorted(set(names)))


def _decoded(value: Any) -> Any:
    try:
        return json.loads(value) if isinstance(value, str) else value
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _shown(value: Any) -> str:
    return repr(value)[:80]


_LENGTH = number(above=0.0, high=1e5)
_NOMINAL = "real size along {}, m: the mesh is checked against it within 7 %"

#: Every key of a manifest entry, in the order of the documentation.
KEYS: dict[str, Key] = {
    "id": Key(check_id, "names the structure: letters, digits, _ and -", required=True),
    "kind": Key(check_id, "what it is: airplane, wind_turbine, ship, bridge, ...", required=True),
    "path": Key(text(4096), "its file, relative to the manifest", required=True),
    "units": Key(_units, "m, cm, mm, in, ft, file (as it declares itself) or metres per unit", required=True),
    "up": Key(choice(AXES), "the axis of the file that points up: x, y, z, -x, -y or -z", required=True),
    "forward": Key(choice(AXES), "the axis of the file that points to the nose, bow or rotor hub"),
    "scale": Key(number(above=0.0, high=1e6), "of the whole, besides the units"),
    "local_origin": Key(
        array((3,), "[x, y, z] in the file's units"), "subtracted first: projected coordinates"
    ),
    "site": Key(text(4096), "where it stands"),
    "lat": Key(number(-90, 90), "of the structure's origin, deg, WGS 84"),
    "lon": Key(number(-180, 180), "of the structure's origin, deg, WGS 84"),
    "alt": Key(number(-1000, 10000), "of the structure's origin, m"),
    "datum": Key(choice(DATUMS), "of alt: ellipsoid (WGS 84) or amsl"),
    "heading": Key(number(-360, 360), "of +X, deg clockwise from true north"),
    "nominal_length_m": Key(_LENGTH, _NOMINAL.format("+X")),
    "nominal_width_m": Key(_LENGTH, _NOMINAL.format("Y")),
    "nominal_height_m": Key(_LENGTH, _NOMINAL.format("Z")),
    "ground_z": Key(number(-1e5, 1e5), "height of level ground, m, structure frame"),
    "keep_out": Key(_boxes, "boxes no path may enter, m, structure frame"),
    "geofence": Key(_polygon, "polygon no path may leave, m, structure frame"),
    "ceiling_z": Key(number(-1e5, 1e5), "highest allowed z, m, structure frame"),
    "rally": Key(
        array((0, 3), "points [x, y, z], m"), "where it may land instead of home, m, structure frame"
    ),
    "landmarks": Key(points, "named points, m, structure frame"),
    "symmetric": Key(_flag, "no heading can be told from the shape"),
    "surface": Key(choice(SURFACES), "drawn or scanned; left out: a cloud is scanned, a mesh drawn"),
    "surface_error_m": Key(
        number(0, 1e4), "how far its surface may lie from where the file has it, m; left out: measured"
    ),
    "drop_hidden": Key(_flag, "drop parts that cannot be seen from outside"),
    "drop_outliers": Key(_flag, "drop parts far off the rest: billboards, wakes"),
    "clip_ground": Key(_flag, "cut off what lies below ground_z"),
    "notes": Key(text(4096), "anything else"),
    "allow": Key(_rules, 'rules that are overruled for it, as in docs/checks.md: ["odd-size"]'),
}
