"""Missions of MAVLink commands: QGroundControl's plans and waypoint files."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from upplied.errors import InputError

_WAYPOINT, _SPLINE, _SPEED, _YAW, _ROI, _MOUNT, _GIMBAL = 16, 82, 178, 115, (195, 201), 205, 1000
_FRAMES = {0: "alt", 3: "alt_takeoff", 5: "alt", 6: "alt_takeoff"}


@dataclass
class Route:
    """Waypoints, in the order in which they are flown; NaN where nothing is said."""

    datum: str = "alt_takeoff"
    rows: list[tuple[float, float, float, float, float, float]] = field(default_factory=list)
    speed: float = np.nan
    yaw: float = np.nan
    pitch: float = np.nan

    def add(
        self,
        lat: float,
        lon: float,
        alt: float,
        yaw: float = np.nan,
        pitch: float = np.nan,
        speed: float = np.nan,
    ) -> None:
        """A waypoint with the yaw from north and the pitch of the camera, deg."""
        said = [
            now if np.isnan(value) else value
            for value, now in ((yaw, self.yaw), (pitch, self.pitch), (speed, self.speed))
        ]
        self.rows.append((lat, lon, alt, *said))  # type: ignore[arg-type]


def _commands(items: list[tuple[int, int, list[float]]], route: Route) -> Route:
    """Waypoints of MAVLink commands: number, frame, seven parameters."""
    datums = {
        _FRAMES[frame] for command, frame, _ in items if command in (_WAYPOINT, _SPLINE) and frame in _FRAMES
    }
    route.datum = datums.pop() if len(datums) == 1 else route.datum
    for command, frame, params in items:
        if command == _SPEED and params[1] > 0:
            route.speed = params[1]
        elif command == _YAW:
            route.yaw = params[0]
        elif command in (_MOUNT, _GIMBAL):
            route.pitch = params[0]
        elif command in (_WAYPOINT, _SPLINE) and frame in _FRAMES and (params[4] or params[5]):
            route.add(params[4], params[5], params[6], params[3])
    if len(datums) > 1:
        raise ValueError("its waypoints have heights of several kinds")
    return route


def plan_route(data: bytes, path: Path) -> Route:
    plan = json.loads(data)
    versions = plan.get("version"), plan.get("mission", {}).get("version")
    if versions != (1, 2):
        raise InputError(
            str(path),
            f"is a plan of version {versions[0]}, mission {versions[1]}",
            "versions 1 and 2",
            "open it in QGroundControl and save it again",
        )
    items: list[tuple[int, int, list[float]]] = []
    computed = []
    for item in plan["mission"].get("items", []):
        inner = (
            [item]
            if item.get("type") == "SimpleItem"
            else item.get("TransectStyleComplexItem", {}).get("Items", [])
        )
        if not inner:
            computed.append(str(item.get("complexItemType", "?")))
        for each in inner:
            params = [float("nan") if value is None else float(value) for value in each["params"]]
            items.append((int(each["command"]), int(each["frame"]), params))
    route = _commands(items, Route())
    if computed and len(route.rows) < 2:
        raise InputError(
            str(path),
            f"states no waypoints of {', '.join(computed)}: QGroundControl computes them",
            "waypoints",
            "upload it, download it from the vehicle, and save that",
        )
    return route


def waypoints_route(data: bytes, path: Path) -> Route:
    items = []
    for line in data.decode("ascii").splitlines()[2:]:  # the first is home
        row = line.split()
        params = [float(value) for value in row[4:11]]
        if params:
            params[3] = params[3] or np.nan  # the format has no other word for none
            items.append((int(row[3]), int(row[2]), params))
    return _commands(items, Route())
