"""MAVLink missions: their items, and two files of them.

Mission Planner and MAVProxy read text (QGC WPL 110), QGroundControl a plan in JSON.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from upplied.outputs.mission_options import MissionOptions
from upplied.outputs.missions.gate import written
from upplied.outputs.missions.records import SHORTEST_HOLD_S, Mission

WAYPOINT, RETURN, TAKEOFF, YAW, ZOOM = 16, 20, 22, 115, 531
SPEED, DIGICAM, MOUNT, PHOTO_DISTANCE = 178, 203, 205, 206
GIMBAL, PHOTO, FILM, FILMED = 1000, 2000, 2500, 2501
INCLUSION, EXCLUSION, RALLY = 5001, 5002, 5100  # MAV_CMD_NAV_FENCE_POLYGON_VERTEX_..., ..._RALLY_POINT
_MISSION_FRAME, _RELATIVE_FRAME, _GLOBAL_FRAME = 2, 3, 0
_GIMBAL_LEVEL_WITH_VEHICLE = 4 + 8 + 32  # roll and pitch held to the horizon, yaw to the vehicle
_MOUNT_BY_ANGLES = 2
_FIRMWARE, _MULTICOPTER = {"px4": 12, "ardupilot": 3}, 2  # of QGroundControl's plans
_ALTITUDE_MODE = {"relative": 1, "amsl": 2}
_ZOOM_BY_FIELD_OF_VIEW = 4.0
_NAN = float("nan")
_SHORT_S = 0.3  # shorter holds are omitted, unless photos are taken
_SLOWER = 0.03  # relative reduction of speed below which the speed is not commanded again


@dataclass(frozen=True)
class Item:
    """One mission item; for commands with a place the last three parameters are lat, lon, altitude."""

    command: int
    frame: int
    params: Sequence[float]  # seven


def mavlink_text(mission: Mission, options: MissionOptions) -> str:
    """The mission as QGC WPL 110: tab separated, home first. NaN, which the format lacks, is written as 0."""
    home = Item(WAYPOINT, _GLOBAL_FRAME, (0.0, 0.0, 0.0, 0.0, *mission.home))
    return _wpl_text([home, *items(mission, options)], current=1)


def fence_text(mission: Mission) -> str:
    """The fence, likewise, for Mission Planner and MAVProxy: a row for each corner; empty without one."""
    rows = []
    for fence in mission.fences:
        command, count = INCLUSION if fence.inside else EXCLUSION, len(fence.corners)
        places = [(count, 0, 0, 0, *corner, 0) for corner in fence.corners.tolist()]
        rows += [Item(command, _RELATIVE_FRAME, place) for place in places]
    return _wpl_text(rows)


def rally_text(mission: Mission) -> str:
    """The rally points, likewise: a row for each, with its height above home; empty without any."""
    return _wpl_text([Item(RALLY, _RELATIVE_FRAME, (0, 0, 0, 0, *each)) for each in mission.rally.tolist()])


def _wpl_text(rows: Sequence[Item], current: int = 0) -> str:
    """A file of QGC WPL 110 with these items; `current` is the flag of the first."""
    lines = ["QGC WPL 110"]
    for seq, item in enumerate(rows):
        numbers = [f"{0.0 if math.isnan(value) else value:.8f}" for value in item.params]
        flag = current if seq == 0 else 0
        lines.append("\t".join([*map(str, (seq, flag, item.frame, item.command)), *numbers, "1"]))
    return "\n".join(lines) + "\n" if rows else ""


def items(mission: Mission, options: MissionOptions) -> list[Item]:
    """Take-off, gimbal, speed, waypoints, photos and return.

    The vehicle's yaw carries the camera's heading, the gimbal its pitch. PX4 reads the heading from the
    waypoint, ArduPilot's copters from a command of its own before it.
    """
    frame = _RELATIVE_FRAME if mission.altitude == "relative" else _GLOBAL_FRAME
    alt = mission.written_alt_m
    out = [Item(TAKEOFF, frame, (0.0, 0.0, 0.0, _NAN, *mission.home[:2], alt[0]))]
    speed = pitch = _NAN
    zooms, photos, inspecting = mission.zooms_at, 0, False
    for at in range(len(mission)):
        if not 0 <= mission.speed_mps[at] - speed <= _SLOWER * mission.speed_mps[at]:  # never faster
            speed = mission.speed_mps[at]
            out.append(_command(SPEED, 1.0, speed, -1.0))
        if not abs(mission.pitch_deg[at] - pitch) < 0.5:
            pitch = mission.pitch_deg[at]
            if options.gimbal == "mount":
                out.append(_command(MOUNT, pitch, 0.0, 0.0, 0.0, 0.0, 0.0, _MOUNT_BY_ANGLES))
            else:
                out.append(_command(GIMBAL, pitch, 0.0, _NAN, _NAN, _GIMBAL_LEVEL_WITH_VEHICLE))
        if at in zooms:
            out.append(_command(ZOOM, _ZOOM_BY_FIELD_OF_VIEW, zooms[at]))
        if options.firmware == "ardupilot":
            out.append(_command(YAW, mission.heading_deg[at]))
        short = SHORTEST_HOLD_S if mission.photo.any() else _SHORT_S
        hold = math.ceil(mission.hold_s[at]) if mission.hold_s[at] > short else 0.0
        place = (mission.heading_deg[at], *mission.geodetic[at, :2], alt[at])
        out.append(Item(WAYPOINT, frame, (hold, 0.0, 0.0, *place)))
        if mission.photo_distance_m and mission.inspects_behind(at) != inspecting:
            inspecting = not inspecting
            every_m = mission.photo_distance_m * inspecting
            out.append(_command(PHOTO_DISTANCE, every_m, 0.0, float(inspecting)))
        if mission.films and at in (mission.starts_at, mission.stops_at):
            out.append(_command(FILM if at == mission.starts_at else FILMED))
        photos += int(mission.photo[at])
        if mission.photo[at] and options.firmware == "ardupilot":
            out.append(_command(DIGICAM, 0.0, 0.0, 0.0, 0.0, 1.0))
        elif mission.photo[at]:
            out.append(_command(PHOTO, 0.0, 0.0, 1.0, float(photos)))
    return [*out, _command(RETURN)]


def _command(command: int, *params: float) -> Item:
    return Item(command, _MISSION_FRAME, (*params, *(0.0,) * (7 - len(params))))


def qgc_plan_text(mission: Mission, options: MissionOptions) -> str:
    """The mission as JSON of simple items; unchanged parameters become null."""
    simple = [_simple_item(item, at, mission) for at, item in enumerate(items(mission, options), 1)]
    polygons = [
        {"version": 1, "inclusion": fence.inside, "polygon": fence.corners.tolist()}
        for fence in mission.fences
    ]
    plan = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "; ".join(["upplied", *written(mission.notes)]),
        "mission": {
            "version": 2,
            "firmwareType": _FIRMWARE[options.firmware],
            "vehicleType": _MULTICOPTER,
            "cruiseSpeed": options.transit_mps,
            "hoverSpeed": options.transit_mps,
            "globalPlanAltitudeMode": _ALTITUDE_MODE[mission.altitude],
            "plannedHomePosition": mission.home.tolist(),
            "items": simple,
        },
        "geoFence": {"version": 2, "circles": [], "polygons": polygons},
        "rallyPoints": {"version": 2, "points": mission.rally.tolist()},
    }
    return json.dumps(plan, indent=1, allow_nan=False) + "\n"


def _simple_item(item: Item, number: int, mission: Mission) -> dict[str, Any]:
    command: dict[str, Any] = {"type": "SimpleItem", "autoContinue": True, "command": item.command}
    params = [None if math.isnan(value) else float(value) for value in item.params]
    command |= {"doJumpId": number, "frame": item.frame, "params": params}
    if item.command in (TAKEOFF, WAYPOINT):
        command |= {"Altitude": float(item.params[6]), "AltitudeMode": _ALTITUDE_MODE[mission.altitude]}
        command["AMSLAltAboveTerrain"] = None
    return command
