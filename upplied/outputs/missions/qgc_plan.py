"""QGroundControl's plan file, for PX4 and ArduPilot."""

from __future__ import annotations

import json
import math
from typing import Any

from upplied.outputs.mission_options import MissionOptions
from upplied.outputs.missions.gate import written
from upplied.outputs.missions.mavlink import TAKEOFF, WAYPOINT, Item, items
from upplied.outputs.missions.records import Mission

_FIRMWARE = {"px4": 12, "ardupilot": 3}
_MULTICOPTER = 2
_ALTITUDE_MODE = {"relative": 1, "amsl": 2}


def qgc_plan_text(mission: Mission, options: MissionOptions) -> str:
    """The mission as JSON of simple items; unchanged parameters become null."""
    lat, lon, alt = (float(value) for value in mission.home)
    simple = [_simple_item(item, at + 1, mission) for at, item in enumerate(items(mission, options))]
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
            "plannedHomePosition": [lat, lon, alt],
            "items": simple,
        },
        "geoFence": {"version": 2, "circles": [], "polygons": polygons},
        "rallyPoints": {"version": 2, "points": mission.rally.tolist()},
    }
    return json.dumps(plan, indent=1, allow_nan=False) + "\n"


def _simple_item(item: Item, number: int, mission: Mission) -> dict[str, Any]:
    command: dict[str, Any] = {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame,
        "params": [None if math.isnan(value) else float(value) for value in item.params],
    }
    if item.command in (TAKEOFF, WAYPOINT):
        altitude = float(item.params[6])
        mode = _ALTITUDE_MODE[mission.altitude]
        command |= {"Altitude": altitude, "AltitudeMode": mode, "AMSLAltAboveTerrain": None}
    return command
