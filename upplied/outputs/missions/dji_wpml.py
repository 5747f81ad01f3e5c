"""DJI's waypoint file (WPML 1.0.2 in a KMZ), for DJI Pilot 2 and FlightHub 2.

Written after the element tables of DJI's Cloud API documentation, both files always, heights above
take-off. No DJI software has read or flown it here: check it on the controller before a flight.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from xml.sax.saxutils import escape

import numpy as np

from upplied.errors import RefusedError, SettingsError
from upplied.outputs.mission_options import MissionOptions
from upplied.outputs.missions.flying import Flying
from upplied.outputs.missions.gate import written
from upplied.outputs.missions.records import SHORTEST_HOLD_S, Mission
from upplied.polylines import leg_lengths

MAX_WAYPOINTS = 200  # what importers are known to take; the format itself counts to 65535
#: It passes waypoints where it may; at a stop it brakes, turns the gimbal, takes the photo, and starts again.
FLYING = Flying(
    MAX_WAYPOINTS,
    stop_s=3.0,
    turning="evenly",
    passes=True,
    zooms=True,
    zoom_note=", written as focal lengths as on film 36 mm wide: see that the camera takes them",
)
_FILM_MM = 36.0
#: Model -> drone type, sub type, and the payload that is built in (None: say which one hangs below).
DRONES: dict[str, tuple[int, int, int | None]] = {
    "m300": (60, 0, None),
    "m350": (89, 0, None),
    "m30": (67, 0, 52),
    "m30t": (67, 1, 53),
    "m3e": (77, 0, 66),
    "m3t": (77, 1, 67),
    "m3m": (77, 2, 68),
    "m3d": (91, 0, 80),
    "m3td": (91, 1, 81),
    "m4e": (99, 0, 88),
    "m4t": (99, 1, 89),
    "m4d": (100, 0, 98),
    "m4td": (100, 1, 99),
    "m400": (103, 0, None),
}
_SAFE_HEIGHT_M = (2.0, 1500.0)
_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:wpml="http://www.dji.com/wpmz/1.0.2">
<Document>
"""
_TAIL = "</Document>\n</kml>\n"
# Straight legs, the ones that were checked; passing rounds the corner within a distance that was checked too.
_STOPS, _PASSES = "toPointAndStopWithDiscontinuityCurvature", "toPointAndPassWithContinuityCurvature"


def dji_kmz(mission: Mission, options: MissionOptions) -> bytes:
    """The mission as KMZ bytes with `wpmz/template.kml` and `wpmz/waylines.wpml`."""
    if mission.altitude != "relative":
        fault = f"{mission.altitude} altitudes were requested"
        raise RefusedError(mission.name, fault, "DJI files are written with heights above take-off")
    settings = _mission_config(mission, options)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in (("template.kml", _template(mission)), ("waylines.wpml", _waylines(mission))):
            entry = zipfile.ZipInfo(f"wpmz/{name}", (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, _HEAD + settings + text + _TAIL)
    return buffer.getvalue()


def _mission_config(mission: Mission, options: MissionOptions) -> str:
    known = ", ".join(DRONES)
    if options.drone not in DRONES:
        fault = f"got {options.drone!r}"
        raise SettingsError(
            "mission option drone", fault, f"one of {known}", "say which model flies: --drone"
        )
    kind, sub_kind, built_in = DRONES[options.drone]
    payload = built_in if options.payload is None else options.payload
    if payload is None:
        rule = "DJI's payload number, for instance 42 (H20), 43 (H20T), 61 (H20N), 82 (H30), 83 (H30T)"
        raise SettingsError("mission option payload", f"the {options.drone} has none built in", rule)
    climb = float(np.clip(mission.height_m[0], *_SAFE_HEIGHT_M))
    back = float(np.clip(mission.return_height_m, *_SAFE_HEIGHT_M))
    drone = _tags({"droneEnumValue": kind, "droneSubEnumValue": sub_kind})
    gimbal = _tags({"payloadEnumValue": payload, "payloadSubEnumValue": 0, "payloadPositionIndex": 0})
    return _group(
        "missionConfig",
        _tags(
            {
                "flyToWaylineMode": "safely",
                "finishAction": "goHome",
                "exitOnRCLost": "executeLostAction",
                "executeRCLostAction": "goBack",
                "takeOffSecurityHeight": f"{climb:.1f}",
                "globalTransitionalSpeed": f"{options.transit_mps:.2f}",
                "globalRTHHeight": f"{back:.1f}",
            }
        )
        + _group("droneInfo", drone)
        + _group("payloadInfo", gimbal),
    )


def _template(mission: Mission) -> str:
    top = float(mission.height_m.max())
    frame = {"coordinateMode": "WGS84", "heightMode": "relativeToStartPoint", "positioningType": "GPS"}
    heading = {"waypointHeadingMode": "smoothTransition", "waypointHeadingAngle": 0}
    heading["waypointHeadingPathMode"] = "followBadArc"
    head = _tags({"templateType": "waypoint", "templateId": 0})
    head += _group("waylineCoordinateSysParam", _tags(frame))
    head += _tags({"autoFlightSpeed": f"{_cruise(mission):.2f}", "gimbalPitchMode": "usePointSetting"})
    head += _tags({"globalHeight": f"{top:.2f}"})
    head += _group("globalWaypointHeadingParam", _tags(heading))
    head += _tags({"globalWaypointTurnMode": _STOPS, "globalUseStraightLine": 1})
    payload = _group(
        "payloadParam",
        _tags({"payloadPositionIndex": 0, "imageFormat": "wide" if mission.fov_deg is None else "zoom"}),
    )
    marks = _placemarks(mission, template=True)
    comments = "".join(f"<!-- {note.replace('--', '- -')} -->\n" for note in written(mission.notes))
    return f"{comments}<Folder>\n{head}{marks}{payload}</Folder>\n"


def _waylines(mission: Mission) -> str:
    head = _tags(
        {
            "templateId": 0,
            "executeHeightMode": "relativeToStartPoint",
            "waylineId": 0,
            "distance": f"{leg_lengths(mission.local).sum():.1f}",
            "duration": f"{mission.duration_s:.1f}",
            "autoFlightSpeed": f"{_cruise(mission):.2f}",
        }
    )
    marks = _placemarks(mission, template=False)
    return f"<Folder>\n{head}{marks}</Folder>\n"


def _placemarks(mission: Mission, template: bool) -> str:
    zooms = mission.zooms_at
    return "".join(
        _placemark(mission, number, stop, zooms, template) for number, stop in enumerate(mission.stops)
    )


def _placemark(mission: Mission, number: int, stop: range, zooms: dict[int, float], template: bool) -> str:
    at = stop[0]
    lat, lon, alt = mission.geodetic[at]
    height = f"{mission.height_m[at]:.3f}"
    after = mission.speed_mps[min(stop[-1] + 1, len(mission) - 1)]
    heading = {
        "waypointHeadingMode": "smoothTransition",
        "waypointHeadingAngle": _signed(mission.heading_deg[at]),
        "waypointHeadingPathMode": "followBadArc",
    }
    place = f"<Point><coordinates>{lon:.9f},{lat:.9f}</coordinates></Point>\n"
    body = place + _tags({"index": number})
    if template:
        known = mission.placement.datum == "ellipsoid"
        body += _tags({"ellipsoidHeight": f"{alt:.3f}" if known else height, "height": height})
        body += _tags({f"useGlobal{name}": 0 for name in ("Height", "Speed", "HeadingParam", "TurnParam")})
        body += _tags({"gimbalPitchAngle": f"{mission.pitch_deg[at]:.1f}"})
    else:
        body += _tags({"executeHeight": height})
    body += _tags({"waypointSpeed": f"{after:.2f}"}) + _group("waypointHeadingParam", _tags(heading))
    passing = mission.passing_m[at] if len(stop) == 1 else 0.0
    mode = _PASSES if passing > 0 else _STOPS
    turn = _tags({"waypointTurnMode": mode, "waypointTurnDampingDist": f"{passing:.2f}"})
    body += _group("waypointTurnParam", turn) + _tags({"useStraightLine": 1})
    return f"<Placemark>\n{body}{_actions(mission, number, stop, zooms)}</Placemark>\n"


def _actions(mission: Mission, number: int, stop: range, zooms: dict[int, float]) -> str:
    """Photos at the waypoint, and turns on the spot; on the leg behind it the gimbal turns evenly to what the
    next one wants, and photos by distance are taken.
    """
    actions: list[tuple[str, dict[str, object]]] = []
    for at in stop:
        if at > stop[0]:
            right = (mission.heading_deg[at] - mission.heading_deg[at - 1]) % 360 < 180
            turn: dict[str, object] = {"aircraftHeading": _signed(mission.heading_deg[at])}
            turn["aircraftPathMode"] = "clockwise" if right else "counterClockwise"
            actions.append(("rotateYaw", turn))
        if at > stop[0] or number == 0:
            actions.append(("gimbalRotate", _gimbal(mission.pitch_deg[at])))
        if at in zooms:
            actions.append(("zoom", _zoom(zooms[at])))
        if mission.hold_s[at] > SHORTEST_HOLD_S:
            actions.append(("hover", {"hoverTime": f"{np.ceil(10 * mission.hold_s[at]) / 10:.1f}"}))
        if mission.photo[at]:
            actions.append(("takePhoto", _photo(at)))
        if mission.films and at == mission.starts_at:
            actions.append(("startRecord", _photo(at)))
        if mission.films and at == mission.stops_at:
            actions.append(("stopRecord", {"payloadPositionIndex": 0}))
    groups = ""
    if actions:
        groups += _action_group(3 * number, number, number, {"actionTriggerType": "reachPoint"}, actions)
    if stop[-1] + 1 < len(mission):
        pitch = {
            "gimbalPitchRotateAngle": f"{mission.pitch_deg[stop[-1] + 1]:.1f}",
            "payloadPositionIndex": 0,
        }
        between = {"actionTriggerType": "betweenAdjacentPoints"}
        groups += _action_group(3 * number + 1, number, number + 1, between, [("gimbalEvenlyRotate", pitch)])
    if mission.photo_distance_m and mission.inspects_behind(stop[-1]):
        every = {"actionTriggerType": "multipleDistance", "actionTriggerParam": mission.photo_distance_m}
        groups += _action_group(3 * number + 2, number, number + 1, every, [("takePhoto", _photo(stop[-1]))])
    return groups


def _zoom(hfov_deg: float) -> dict[str, object]:
    focal_mm = _FILM_MM / 2 / np.tan(np.radians(min(hfov_deg, 179.0)) / 2)
    return {"focalLength": f"{focal_mm:.1f}", "isUseFocalFactor": 0, "payloadPositionIndex": 0}


def _gimbal(pitch_deg: float) -> dict[str, object]:
    return {
        "gimbalHeadingYawBase": "north",
        "gimbalRotateMode": "absoluteAngle",
        "gimbalPitchRotateEnable": 1,
        "gimbalPitchRotateAngle": f"{pitch_deg:.1f}",
        "gimbalRollRotateEnable": 0,
        "gimbalRollRotateAngle": 0,
        "gimbalYawRotateEnable": 0,
        "gimbalYawRotateAngle": 0,
        "gimbalRotateTimeEnable": 0,
        "gimbalRotateTime": 0,
        "payloadPositionIndex": 0,
    }


def _photo(at: int) -> dict[str, object]:
    return {"fileSuffix": f"point{at}", "payloadPositionIndex": 0, "useGlobalPayloadLensIndex": 1}


def _signed(heading_deg: float) -> str:
    """A compass heading as DJI counts: -180 to 180."""
    return f"{(heading_deg + 180) % 360 - 180:.1f}"


def _action_group(number: int, first: int, last: int, trigger: dict, actions: list[tuple[str, dict]]) -> str:
    head = {"actionGroupId": number, "actionGroupStartIndex": first, "actionGroupEndIndex": last}
    body = _tags({**head, "actionGroupMode": "sequence"}) + _group("actionTrigger", _tags(trigger))
    for at, (name, params) in enumerate(actions):
        what = _tags({"actionId": at, "actionActuatorFunc": name})
        body += _group("action", what + _group("actionActuatorFuncParam", _tags(params)))
    return _group("actionGroup", body)


def _cruise(mission: Mission) -> float:
    """One speed for the whole route, which each waypoint overrides."""
    return float(np.median(mission.speed_mps))


def _tags(values: Mapping[str, object]) -> str:
    return "".join(f"<wpml:{name}>{escape(str(value))}</wpml:{name}>\n" for name, value in values.items())


def _group(name: str, inner: str) -> str:
    return f"<wpml:{name}>\n{inner}</wpml:{name}>\n"
