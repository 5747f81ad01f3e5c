"""Checks of the type and the range of a setting."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from upplied.errors import SettingsError


class Range(NamedTuple):
    """Lowest and highest value of a number."""

    low: float
    high: float


Count = Annotated[int, Range(1, 1000)]
Incidence = Annotated[float, Range(1, 90)]
Metres = Annotated[float, Range(0, 1000)]
Motion = Annotated[float, Range(0.01, 100)]  # m/s or m/s2
Pitch = Annotated[float, Range(-90, 90)]
Positive = Annotated[float, Range(0, math.inf)]
Ratio = Annotated[float, Range(1, 1e6)]
Share = Annotated[float, Range(0, 1)]
TurnRate = Annotated[float, Range(0.1, 1000)]
Weight = Annotated[float, Range(0, 1000)]


def range_of(stage: type, name: str) -> Range:
    """The range of a number of a stage; the whole line where none is declared."""
    hint = get_type_hints(stage, include_extras=True)[name]
    notes = (note for part in (hint, *get_args(hint)) for note in getattr(part, "__metadata__", ()))
    return next(notes, Range(-math.inf, math.inf))


def check_value(stage_name: str, stage: type, name: str, value: Any) -> None:
    """Refuse a value of a stage of another type than its field declares, or out of its range."""
    wanted = get_type_hints(stage)[name]
    what, choices = f"setting {stage_name}.{name}", get_args(wanted)
    if get_origin(wanted) is Literal:
        fits, rule = value in choices, f"one of {', '.join(map(repr, choices))}"
    elif wanted is str:
        fits, rule = isinstance(value, str) and len(value) <= 1000, "text of at most 1000 characters"
    elif wanted is bool:
        fits, rule = isinstance(value, bool), "true or false"
    elif wanted is int or int in choices:
        optional = type(None) in choices
        fits = (isinstance(value, int) and not isinstance(value, bool)) or (optional and value is None)
        rule = "a whole number, or none" if optional else "a whole number"
    elif wanted is float or float in choices:
        optional = type(None) in choices
        fits = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        fits, rule = fits or (optional and value is None), "a number, or none" if optional else "a number"
    else:
        fits = all(isinstance(pair, tuple | list) and len(pair) == 2 for pair in value)
        rule = "pairs of names"
    if not fits:
        raise SettingsError(what, f"got {value!r}", rule)
    low, high = range_of(stage, name)
    if isinstance(value, int | float) and not low <= value <= high:
        raise SettingsError(what, f"got {value!r}", f"{low:g} to {high:g}")
