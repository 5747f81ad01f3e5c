"""The keys of a structure manifest, and the parsers of declared values: what each accepts, and its error."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from upplied.checks import check_id
from upplied.errors import InputError
from upplied.inputs.files import table
from upplied.inputs.rules import RULES

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048, "file": None}
AXES = ("x", "y", "z", "-x", "-y", "-z")
DATUMS = ("ellipsoid", "amsl")

Parser = Callable[[Any, str], Any]


@dataclass(frozen=True)
class Key:
    """One key of a manifest."""

    parse: Parser
    meaning: str
    required: bool = False


def parse(row: Mapping[str, Any], what: str) -> dict[str, Any]:
    """The values of one entry, checked: typed by TOML, or text from CSV. `what` names it in errors."""
    if unknown := [str(key) for key in row if key not in KEYS]:
        raise InputError(what, f"unknown key {unknown[0][:60]!r}", f"known keys are {', '.join(KEYS)}")
    for name, key in KEYS.items():
        if key.required and name not in row:
            raise InputError(what, f"has no {name!r}", f"{name} is required: {key.meaning}")
    return {name: KEYS[name].parse(value, f"{what}, {name}") for name, value in row.items()}


def _parser(check: Callable[..., Any]) -> Callable[..., Parser]:
    """Makes parsers with bounds: what the check takes besides a value and its name in errors."""
    return lambda *bounds, **more: lambda value, what: check(value, what, *bounds, **more)


@_parser
def text(value: Any, what: str, most: int) -> str:
    """Text of so many characters."""
    if isinstance(value, str) and len(value) <= most and "\0" not in value:
        return value
    raise InputError(what, f"got {value!r:.80}", f"text of at most {most} characters")


@_parser
def number(
    value: Any, what: str, low: float = -1e12, high: float = 1e12, above: float = -np.inf, whole: bool = False
) -> float:
    """A number, typed or as text."""
    try:
        parsed = float("nan") if isinstance(value, bool) else (int if whole else float)(value)
    except (ValueError, TypeError, OverflowError):
        parsed = float("nan")
    if not low <= parsed <= high or parsed <= above:
        least = f"from {low:g}" if np.isinf(above) else f"above {above:g}, up"
        rule = f"a {'whole' if whole else 'finite'} number {least} to {high:g}"
        raise InputError(what, f"got {value!r:.80}", rule)
    return parsed


@_parser
def choice(value: Any, what: str, allowed: Sequence[str]) -> str:
    """One of these words."""
    word = value.strip().lower().removeprefix("+") if isinstance(value, str) else None
    if word is None or word not in allowed:
        raise InputError(what, f"got {value!r:.80}", f"one of {', '.join(allowed)}")
    return word


def _units(value: Any, what: str) -> float | None:
    if isinstance(value, str) and value.strip() in UNITS:
        return UNITS[value.strip()]
    try:
        return number(above=0.0, high=1e6)(value, what)
    except InputError:
        rule = f"one of {', '.join(UNITS)} (file: as the file itself declares), or metres per unit"
        raise InputError(what, f"got {value!r:.80}", rule) from None


def _flag(value: Any, what: str) -> bool:
    if (word := str(value).lower()) not in ("true", "false") or not isinstance(value, bool | str):
        raise InputError(what, f"got {value!r:.80}", "true or false")
    return word == "true"


@_parser
def array(value: Any, what: str, shape: Sequence[int], rule: str) -> Any:
    """Nested lists of numbers, typed, as JSON or by spaces; 0 in the shape is any length."""
    try:
        spaced = isinstance(value, str) and not value.lstrip().startswith("[")
        values = np.array(value.split() if spaced else _decoded(value), float)
    except (ValueError, TypeError, OverflowError):
        values = np.empty(0)
    sizes = [have if want == 0 else want for want, have in zip(shape, values.shape, strict=False)]
    if values.shape != tuple(sizes) or values.ndim != len(shape) or not np.isfinite(values).all():
        raise InputError(what, f"got {value!r:.80}", rule)
    return tuple(values.tolist()) if len(shape) == 1 else values


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
        places = _decoded(value)
    except ValueError:
        places = None
    if not isinstance(places, dict):
        raise InputError(what, f"got {value!r:.80}", "name = [x, y, z], m, structure frame")
    point = array((3,), "[x, y, z], m, structure frame")
    return {check_id(name, what): point(xyz, f"{what} {name}") for name, xyz in places.items()}


def _rules(value: Any, what: str) -> tuple[str, ...]:
    try:
        spaced = isinstance(value, str) and not value.lstrip().startswith("[")
        names = value.replace(",", " ").split() if spaced else _decoded(value)
    except ValueError:
        names = None
    if not isinstance(names, list) or not all(isinstance(name, str) and name in RULES for name in names):
        raise InputError(what, f"got {value!r:.80}", f"names of rules, of {', '.join(RULES)}")
    return tuple(sorted(set(names)))


def _decoded(value: Any) -> Any:
    try:
        return json.loads(value) if isinstance(value, str) else value
    except RecursionError:
        raise ValueError("nested too deeply") from None


_TYPES: dict[str, Callable[..., Parser]] = {"text": text, "number": number, "choice": choice, "array": array}
_PARSERS: dict[str, Parser] = {
    "id": check_id, "units": _units, "boxes": _boxes, "polygon": _polygon, "points": points, "flag": _flag,
    "rules": _rules,
}  # fmt: skip

#: Every key of a manifest entry, in the order of the documentation.
KEYS: dict[str, Key] = {}
for _name, _row in table("manifest.toml").items():
    _type, _meaning, _required = _row.pop("type"), _row.pop("meaning"), _row.pop("required", False)
    KEYS[_name] = Key(_TYPES[_type](**_row) if _row else _PARSERS[_type], _meaning, _required)
