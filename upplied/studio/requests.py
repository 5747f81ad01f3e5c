"""What requests of the studio's page carry, checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.proof.edit import Viewpoint


def signed(said: Mapping[str, Any]) -> tuple[str, str]:
    """The name and the note that a request carries; one without a name is refused."""
    by, note = said.get("by", ""), said.get("note", "")
    if not isinstance(by, str) or not isinstance(note, str) or not by.strip():
        raise InputError("the decision", "says not who decided", "a name", "write your name")
    return by.strip(), note


def text_of(said: Mapping[str, Any], name: str) -> str:
    """The text of this name."""
    value = said.get(name)
    if not isinstance(value, str):
        raise InputError(name, "is no text")
    return value


def viewpoint_of(said: Mapping[str, Any]) -> Viewpoint:
    """The viewpoint that a request describes."""
    try:
        x, y, z, yaw, pitch = (float(said[key]) for key in ("x_m", "y_m", "z_m", "yaw_deg", "pitch_deg"))
    except (KeyError, TypeError, ValueError):
        raise InputError("the viewpoint", "cannot be read", "x_m, y_m, z_m, yaw_deg and pitch_deg") from None
    if not np.isfinite([x, y, z, yaw, pitch]).all():
        raise InputError("the viewpoint", "holds what is no number")
    return Viewpoint((x, y, z), yaw, pitch)
