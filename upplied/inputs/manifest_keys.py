"""The keys of a structure manifest: each with its parser, its rule and its meaning."""

from __future__ import annotations

import json
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
    """The values of one entry, checked.

    Parameters
    ----------
    row : mapping
        Key to value: typed from TOML, text from CSV.
    what : str
        Names the entry in errors.
    """
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
        raise InputError(
            what,
            "has no 'forward'",
            "the axis of the file that points to the nose, bow, rotor hub or along the structure",
            "declare it, or symmetric = true where no such direction exists",
        )
    if forward[-1] == up[-1]:
        raise InputError(what, f"forward {forward!r} and up {up!r} lie on one axis", "two different axes")
    return up, forward


def _text(value: Any, what: str) -> str:
    if isinstance(value, str) and len(value) <= 4096 and "\0" not in value:
        return value
    raise InputError(what, f"got {_shown(value)}", "text of at most 4096 characters")


def _number(low: float = -1e12, high: float = 1e12, above: float | None = None) -> Parser:
    rule = (
        f"a number from {low:g} to {high:g}" if above is None else f"a number above {above:g}, up to {high:g}"
    )

    def parse_number(value: Any, what: str) -> float:
        try:
            number = float(value) if isinstance(value, str | int | float) and value is not True else None
        except (ValueError, OverflowError):
            number = None
        if number is None or isinstance(value, bool) or not low <= number <= high:
            raise InputError(what, f"got {_shown(value)}", rule)
        if above is not None and number <= above:
            raise InputError(what, f"got {_shown(value)}", rule)
        return number

    return parse_number


def _choice(allowed: tuple[str, ...]) -> Parser:
    def parse_choice(value: Any, what: str) -> str:
        text = value.strip().lower().removeprefix("+") if isinstance(value, str) else None
        if text not in allowed:
            raise InputError(what, f"got {_shown(value)}", f"one of {', '.join(allowed)}")
        return text

    return parse_choice


def _units(value: Any, what: str) -> float | None:
    if isinstance(value, str) and value.strip() in UNITS:
        return UNITS[value.strip()]
    try:
        return _number(above=0.0, high=1e6)(value, what)
    except InputError:
        rule = f"one of {', '.join(UNITS)} (file: as the file itself declares), or metres per unit"
        raise InputError(what, f"got {_shown(value)}", rule) from None


def _flag(value: Any, what: str) -> bool:
    if isinstance(value, bool):
        return value
    if isinstance(value, str) and value.lower() in ("true", "false"):
        return value.lower() == "true"
    raise InputError(what, f"got {_shown(value)}", "true or false")


def _array(shape: tuple[int, ...], rule: str) -> Parser:
    """Nested lists of numbers, from TOML or as JSON in a CSV cell; 0 in the shape is any length."""

    def parse_array(value: Any, what: str) -> Any:
        try:
            array = np.array(_decoded(value), float)
        except (ValueError, TypeError, OverflowError):
            array = np.empty(0)
        fits = array.ndim == len(shape) and all(
            want in (0, have) for want, have in zip(shape, array.shape, strict=True)
        )
        if not fits or not np.isfinite(array).all():
            raise InputError(what, f"got {_shown(value)}", rule)
        return tuple(array.tolist()) if len(shape) == 1 else array

    return parse_array


def _boxes(value: Any, what: str) -> Any:
    boxes = _array((0, 2, 3), "boxes [[xmin, ymin, zmin], [xmax, ymax, zmax]], m")(value, what)
    if (boxes[:, 0] >= boxes[:, 1]).any():
        raise InputError(what, "a box's first corner is not below its second", "min before max on each axis")
    return boxes


def _polygon(value: Any, what: str) -> Any:
    polygon = _array((0, 2), "corners [x, y], m")(value, what)
    if len(polygon) < 3:
        raise InputError(what, f"has {len(polygon)} corners", "at least 3")
    return polygon


def _landmarks(value: Any, what: str) -> dict[str, tuple[float, float, float]]:
    try:
        table = _decoded(value)
    except ValueError:
        table = None
    if not isinstance(table, dict):
        raise InputError(what, f"got {_shown(value)}", "name = [x, y, z], m, structure frame")
    point = _array((3,), "[x, y, z], m, structure frame")
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


_LENGTH = _number(above=0.0, high=1e5)
_NOMINAL = "real size along {}, m: the mesh is checked against it within 7 %"

#: Every key of a manifest entry, in the order of the documentation.
KEYS: dict[str, Key] = {
    "id": Key(check_id, "names the structure: letters, digits, _ and -", required=True),
    "kind": Key(check_id, "what it is: airplane, wind_turbine, ship, bridge, ...", required=True),
    "path": Key(_text, "its file, relative to the manifest", required=True),
    "units": Key(_units, "m, cm, mm, in, ft, file (as it declares itself) or metres per unit", required=True),
    "up": Key(_choice(AXES), "the axis of the file that points up: x, y, z, -x, -y or -z", required=True),
    "forward": Key(_choice(AXES), "the axis of the file that points to the nose, bow or rotor hub"),
    "scale": Key(_number(above=0.0, high=1e6), "of the whole, besides the units"),
    "local_origin": Key(
        _array((3,), "[x, y, z] in the file's units"), "subtracted first: projected coordinates"
    ),
    "site": Key(_text, "where it stands"),
    "lat": Key(_number(-90, 90), "of the structure's origin, deg, WGS 84"),
    "lon": Key(_number(-180, 180), "of the structure's origin, deg, WGS 84"),
    "alt": Key(_number(-1000, 10000), "of the structure's origin, m"),
    "datum": Key(_choice(DATUMS), "of alt: ellipsoid (WGS 84) or amsl"),
    "heading": Key(_number(-360, 360), "of +X, deg clockwise from true north"),
    "nominal_length_m": Key(_LENGTH, _NOMINAL.format("+X")),
    "nominal_width_m": Key(_LENGTH, _NOMINAL.format("Y")),
    "nominal_height_m": Key(_LENGTH, _NOMINAL.format("Z")),
    "ground_z": Key(_number(-1e5, 1e5), "height of level ground, m, structure frame"),
    "keep_out": Key(_boxes, "boxes no path may enter, m, structure frame"),
    "geofence": Key(_polygon, "polygon no path may leave, m, structure frame"),
    "ceiling_z": Key(_number(-1e5, 1e5), "highest allowed z, m, structure frame"),
    "landmarks": Key(_landmarks, "named points, m, structure frame"),
    "symmetric": Key(_flag, "no heading can be told from the shape"),
    "surface": Key(_choice(SURFACES), "drawn or scanned; left out: a cloud is scanned, a mesh drawn"),
    "surface_error_m": Key(
        _number(0, 1e4), "how far its surface may lie from where the file has it, m; left out: measured"
    ),
    "drop_hidden": Key(_flag, "drop parts that cannot be seen from outside"),
    "drop_outliers": Key(_flag, "drop parts far off the rest: billboards, wakes"),
    "clip_ground": Key(_flag, "cut off what lies below ground_z"),
    "notes": Key(_text, "anything else"),
    "allow": Key(_rules, 'rules that are overruled for it, as in docs/checks.md: ["odd-size"]'),
}
