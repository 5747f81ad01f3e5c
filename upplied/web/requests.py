"""What requests of our pages carry, checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.proof.edit import Viewpoint

MOST_M = 100_000.0  # from the structure's origin: farther out nothing is flown


def signed(request: Mapping[str, Any]) -> tuple[str, str]:
    """The name and the note that a request carries; one without a name is refused."""
    by, note = request.get("by", ""), request.get("note", "")
    if not isinstance(by, str) or not isinstance(note, str) or not by.strip():
        raise InputError("the decision", "has no name", "who decides", "write your name")
    return by.strip(), note


def text_of(request: Mapping[str, Any], name: str) -> str:
    """The text of this name."""
    value = request.get(name)
    if not isinstance(value, str):
        raise InputError(name, "is not a text")
    return value


def viewpoint_of(request: Mapping[str, Any]) -> Viewpoint:
    """The viewpoint that a request describes."""
    try:
        values = [float(request[key]) for key in ("x_m", "y_m", "z_m", "yaw_deg", "pitch_deg")]
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError("the viewpoint", "cannot be read", "x_m, y_m, z_m, yaw_deg and pitch_deg") from None
    x, y, z, yaw, pitch = values
    if not np.isfinite(values).all() or max(map(abs, (x, y, z))) > MOST_M:
        raise InputError("the viewpoint", "is out of range", f"finite, at most {MOST_M:g} m from the origin")
    return Viewpoint((x, y, z), yaw, pitch)
