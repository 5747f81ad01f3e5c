"""The behaviour of the software of each format, for which a mission must allow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from upplied.geometry.poses import from_yaw_pitch, interpolate, yaw_pitch
from upplied.outputs.labels import table
from upplied.records import Floats, Trajectory

#: The camera turns evenly along each leg, at its start, or to heading and pitch on arrival.
Turning = Literal["evenly", "ahead", "on arrival"]
#: Properties of each format.
_TABLE: dict[str, dict[str, Any]] = table("missions/formats.toml")
#: Format -> usual ending of its files.
FORMATS: dict[str, str] = {name: each["ending"] for name, each in _TABLE.items()}
#: Format -> software in which to check the mission before a flight.
OPENED_IN: dict[str, str] = {name: each["opened_in"] for name, each in _TABLE.items()}


@dataclass(frozen=True)
class Flying:
    """The behaviour of the software of a format."""

    max_waypoints: int | None = None  # of one file; None: no limit
    stop_s: float = 0.0  # time of each stop at a waypoint of the inspection
    passes: bool = False  # waypoints without another reason to stop are passed, see `corners`
    turning: Turning = "evenly"
    altitudes: tuple[str, ...] = ("relative", "amsl", "ellipsoid")  # references that the format knows
    altitude_rule: str = ""  # the same in words, if some are missing
    zooms: bool = False  # whether the file can command the camera to zoom
    zooms_not_by: str = ""  # firmware without that command
    zoom_note: str = ""  # the command, in words
    note: str = ""  # settings that the pilot must make, because the file cannot contain them

    @classmethod
    def of(cls, format: str, firmware: str = "") -> Flying:
        """The entry of a format in the table of formats."""
        stated = dict(_TABLE[_TABLE[format].get("like", format)])
        notes = stated.pop("notes", {})
        rest = {name: value for name, value in stated.items() if name not in ("ending", "opened_in")}
        return cls(**rest, note=notes.get(firmware, notes.get("any", "")))


def as_flown(path: Trajectory, t_s: Floats, turning: Turning) -> Trajectory:
    """Poses (N,) at times on a mission's path, the camera turned as the vehicle turns it.

    No format states when a camera zooms on a leg: the narrower field of view of its ends counts.
    """
    evenly = interpolate(path, t_s)
    if path.fov_deg is not None and len(path) > 1:
        leg = (np.searchsorted(path.t_s, t_s, side="right") - 1).clip(0, len(path) - 2)
        evenly = replace(evenly, fov_deg=np.minimum(path.fov_deg[leg], path.fov_deg[leg + 1]))
    if turning == "evenly" or len(path) < 2:
        return evenly
    if turning == "ahead":
        coming = np.searchsorted(path.t_s, t_s, side="left").clip(0, len(path) - 1)
        return replace(evenly, quat_xyzw=path.quat_xyzw[coming])
    reached = (np.searchsorted(path.t_s, t_s, side="right") - 1).clip(0, len(path) - 1)
    (yaw, _), (_, pitch) = yaw_pitch(evenly.quat_xyzw), yaw_pitch(path.quat_xyzw[reached])
    return replace(evenly, quat_xyzw=from_yaw_pitch(yaw, pitch))
