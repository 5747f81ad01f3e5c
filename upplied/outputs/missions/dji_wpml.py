"""DJI's waypoint file (WPML 1.0.2 in a KMZ), for DJI Pilot 2 and FlightHub 2.

Written after the element tables of DJI's Cloud API documentation, both files always, heights above
take-off. No DJI software has read or flown it here: check it on the controller before a flight.
"""

import io
import zipfile
from collections.abc import Mapping
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from upplied.errors import SettingsError
from upplied.geometry.polylines import leg_lengths
from upplied.outputs.labels import table
from upplied.outputs.mission_options import MissionOptions
from upplied.outputs.missions.gate import written
from upplied.outputs.missions.records import SHORTEST_HOLD_S, Mission

_FILM_MM = 36.0
_SAFE_HEIGHT_M = (2.0, 1500.0)
#: Elements that are the same in every mission, in the order of the schema; empty ones are filled here.
_ELEMENTS: dict[str, Any] = table("missions/dji.toml")
#: Model -> drone type, sub type, and the payload that is built in, if one is.
DRONES: dict[str, list[int]] = _ELEMENTS["drones"]
_STOPS, _PASSES = "toPointAndStopWithDiscontinuityCurvature", "toPointAndPassWithContinuityCurvature"


def dji_kmz(mission: Mission, options: MissionOptions) -> bytes:
    """The mission as KMZ bytes with `wpmz/template.kml` and `wpmz/waylines.wpml`."""
    settings, buffer = _mission_config(mission, options), io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, text in (("template.kml", _template(mission)), ("waylines.wpml", _waylines(mission))):
            entry = zipfile.ZipInfo(f"wpmz/{name}", (1980, 1, 1, 0, 0, 0))
            archive.writestr(entry, _ELEMENTS["document"].format(settings + text), zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def _mission_config(mission: Mission, options: MissionOptions) -> str:
    if options.drone not in DRONES:
        fault = f"is {options.drone!r}" if options.drone else "is missing"
        rule = f"one of {', '.join(DRONES)}"
        raise SettingsError("mission option drone", fault, rule, "set the model: --drone")
    kind, sub_kind, *built_in = DRONES[options.drone]
    payload = next(iter(built_in), None) if options.payload is None else options.payload
    if payload is None:
        rule = "DJI's payload number, for instance 42 (H20), 43 (H20T), 61 (H20N), 82 (H30), 83 (H30T)"
        raise SettingsError("mission option payload", f"the {options.drone} has no built-in camera", rule)
    climb, back = np.clip([mission.height_m[0], mission.return_height_m], *_SAFE_HEIGHT_M)
    config = _ELEMENTS["config"] | {
        "takeOffSecurityHeight": f"{climb:.1f}",
        "globalTransitionalSpeed": f"{options.transit_mps:.2f}",
        "globalRTHHeight": f"{back:.1f}",
        "droneInfo": {"droneEnumValue": kind, "droneSubEnumValue": sub_kind},
        "payloadInfo": {"payloadEnumValue": payload, "payloadSubEnumValue": 0, "payloadPositionIndex": 0},
    }
    return _xml({"missionConfig": config})


def _template(mission: Mission) -> str:
    height = f"{mission.height_m.max():.2f}"
    cruise = f"{np.median(mission.speed_mps):.2f}"  # m/s, which each waypoint overrides
    head = _ELEMENTS["template"] | {"autoFlightSpeed": cruise, "globalHeight": height}
    payload = {"payloadPositionIndex": 0, "imageFormat": "wide" if mission.fov_deg is None else "zoom"}
    comments = "".join(f"<!-- {note.replace('--', '- -')} -->\n" for note in written(mission.notes))
    marks = _placemarks(mission, template=True)
    return f"{comments}<Folder>\n{_xml(head)}{marks}{_xml({'payloadParam': payload})}</Folder>\n"


def _waylines(mission: Mission) -> str:
    head = _ELEMENTS["waylines"] | {
        "distance": f"{leg_lengths(mission.local).sum():.1f}",
        "duration": f"{mission.duration_s:.1f}",
        "autoFlightSpeed": f"{np.median(mission.speed_mps):.2f}",
    }
    return f"<Folder>\n{_xml(head)}{_placemarks(mission, template=False)}</Folder>\n"


def _placemarks(mission: Mission, template: bool) -> str:
    marks = enumerate(mission.stops)
    return "".join(_placemark(mission, number, stop, mission.zooms_at, template) for number, stop in marks)


def _placemark(mission: Mission, number: int, stop: range, zooms: dict[int, float], template: bool) -> str:
    at = stop[0]
    lat, lon, alt = mission.geodetic[at]
    height = f"{mission.height_m[at]:.3f}"
    after = mission.speed_mps[min(stop[-1] + 1, len(mission) - 1)]
    mark: dict[str, object] = {"index": number}
    if template:
        known = mission.placement.datum == "ellipsoid"
        mark |= {"ellipsoidHeight": f"{alt:.3f}" if known else height, "height": height}
        mark |= {f"useGlobal{name}": 0 for name in ("Height", "Speed", "HeadingParam", "TurnParam")}
        mark["gimbalPitchAngle"] = f"{mission.pitch_deg[at]:.1f}"
    else:
        mark["executeHeight"] = height
    passing = mission.passing_m[at] if len(stop) == 1 else 0.0
    mode = _PASSES if passing > 0 else _STOPS
    angle = {"waypointHeadingAngle": _signed(mission.heading_deg[at])}
    mark |= {
        "waypointSpeed": f"{after:.2f}",
        "waypointHeadingParam": _ELEMENTS["heading"] | angle,
        "waypointTurnParam": {"waypointTurnMode": mode, "waypointTurnDampingDist": f"{passing:.2f}"},
        "useStraightLine": 1,
        "actionGroup": _actions(mission, number, stop, zooms),
    }
    place = f"<Point><coordinates>{lon:.9f},{lat:.9f}</coordinates></Point>\n"
    return f"<Placemark>\n{place}{_xml(mark)}</Placemark>\n"


def _actions(mission: Mission, number: int, stop: range, zooms: dict[int, float]) -> list[dict[str, object]]:
    """Turns and photos at the waypoint; even turns of the gimbal and photos by distance on the next leg."""
    actions: list[tuple[str, dict[str, object]]] = []
    for at in stop:
        if at > stop[0]:
            right = (mission.heading_deg[at] - mission.heading_deg[at - 1]) % 360 < 180
            way = {"aircraftPathMode": "clockwise" if right else "counterClockwise"}
            actions.append(("rotateYaw", {"aircraftHeading": _signed(mission.heading_deg[at]), **way}))
        if at > stop[0] or number == 0:
            pitch = {"gimbalPitchRotateAngle": f"{mission.pitch_deg[at]:.1f}"}
            actions.append(("gimbalRotate", _ELEMENTS["gimbal"] | pitch))
        if at in zooms:
            focal_mm = _FILM_MM / 2 / np.tan(np.radians(min(zooms[at], 179.0)) / 2)
            zoom = {"focalLength": f"{focal_mm:.1f}", "isUseFocalFactor": 0, "payloadPositionIndex": 0}
            actions.append(("zoom", zoom))
        if mission.hold_s[at] > SHORTEST_HOLD_S:
            actions.append(("hover", {"hoverTime": f"{np.ceil(10 * mission.hold_s[at]) / 10:.1f}"}))
        if mission.photo[at]:
            actions.append(("takePhoto", _photo(at)))
        if mission.films and at == mission.starts_at:
            actions.append(("startRecord", _photo(at)))
        if mission.films and at == mission.stops_at:
            actions.append(("stopRecord", {"payloadPositionIndex": 0}))
    groups = []
    if actions:
        groups.append(_group(number, 0, {"actionTriggerType": "reachPoint"}, actions))
    if stop[-1] + 1 < len(mission):
        even = {"gimbalPitchRotateAngle": f"{mission.pitch_deg[stop[-1] + 1]:.1f}", "payloadPositionIndex": 0}
        between = {"actionTriggerType": "betweenAdjacentPoints"}
        groups.append(_group(number, 1, between, [("gimbalEvenlyRotate", even)]))
    if mission.photo_distance_m and mission.inspects_behind(stop[-1]):
        every = {"actionTriggerType": "multipleDistance", "actionTriggerParam": mission.photo_distance_m}
        groups.append(_group(number, 2, every, [("takePhoto", _photo(stop[-1]))]))
    return groups


def _photo(at: int) -> dict[str, object]:
    return {"fileSuffix": f"point{at}", "payloadPositionIndex": 0, "useGlobalPayloadLensIndex": 1}


def _signed(heading_deg: float) -> str:
    """A compass heading as DJI counts: -180 to 180."""
    return f"{(heading_deg + 180) % 360 - 180:.1f}"


def _group(number: int, kind: int, trigger: dict, actions: list[tuple[str, dict]]) -> dict[str, object]:
    """What is done at a waypoint (kind 0), or on the leg behind it."""
    group: dict[str, object] = {"actionGroupId": 3 * number + kind, "actionGroupStartIndex": number}
    group |= {"actionGroupEndIndex": number + (kind > 0), "actionGroupMode": "sequence"}
    listed = [
        {"actionId": at, "actionActuatorFunc": name, "actionActuatorFuncParam": parameters}
        for at, (name, parameters) in enumerate(actions)
    ]
    return group | {"actionTrigger": trigger, "action": listed}


def _xml(values: Mapping[str, object]) -> str:
    """Elements by their names; a mapping is the content of one, a list stands for several."""
    texts = []
    for name, value in values.items():
        for each in value if isinstance(value, list) else [value]:
            text = f"\n{_xml(each)}" if isinstance(each, Mapping) else escape(str(each))
            texts.append(f"<wpml:{name}>{text}</wpml:{name}>\n")
    return "".join(texts)
