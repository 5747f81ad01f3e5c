"""Missions as flights planned at the stated speed: QGroundControl, MAVLink waypoints, KML, WPML, Litchi."""

import csv
import io
import json
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from upplied.inputs.files import plain_xml, read_regular
from upplied.inputs.sources.source import SHAPE, Fields, Source, fixes, gimbals, refusal
from upplied.records import Floats

MAX_BYTES = 64 << 20
MAX_UNPACKED = 256 << 20
_STEP_S = 0.2  # of the stations on a leg
_SLOW_MPS = 3.0  # where a mission states no speed
_WAYPOINT, _SPLINE, _SPEED, _YAW, _MOUNT, _GIMBAL = 16, 82, 178, 115, 205, 1000  # MAVLink commands
_FRAMES = {0: "alt", 3: "alt_takeoff", 5: "alt", 6: "alt_takeoff"}
_NAN = float("nan")
ERRORS = SHAPE


@dataclass
class _Route:
    """Waypoints, in the order in which they are flown; NaN where nothing is stated."""

    datum: str = "alt_takeoff"
    rows: list[tuple[float, ...]] = field(default_factory=list)
    yaw: float = _NAN
    pitch: float = _NAN
    speed: float = _NAN

    def add(self, *place: float, yaw: float = _NAN, pitch: float = _NAN, speed: float = _NAN) -> None:
        """A waypoint (lat, lon, altitude) with the yaw from north and the pitch of the camera, deg."""
        stated = ((yaw, self.yaw), (pitch, self.pitch), (speed, self.speed))
        self.rows.append((*place, *(now if np.isnan(value) else value for value, now in stated)))


def read(path: Path, fields: Fields) -> Source:
    """The planned flight of a mission."""
    data = read_regular(path, MAX_BYTES)
    head = data.lstrip(b"\xef\xbb\xbf \r\n\t")
    readers = {b"PK": _zipped, b"QGC WPL": _waypoints, b"{": _plan, b"<": _marks}
    route = next((reader for start, reader in readers.items() if head.startswith(start)), _litchi)(data)
    rows = np.array(route.rows, float).reshape(-1, 6)
    if len(rows) < 2 or not np.isfinite(rows[:, :3]).all():
        rule = "at least two with a place"
        raise refusal(f"states {len(rows)} waypoints", rule, "let the ground station write them out")
    notes = ["a planned mission: nobody flew it"]
    if not np.isfinite(rows[:, 4]).any():
        notes.append("it states no pitch of the camera: level")
    if not np.isfinite(rows[:, 3]).all():
        notes.append("it states no heading at some waypoints: the camera looks along the path")
    place, yaw, pitch, seconds = _flown(rows)
    t_ns = 1_000_000_000 + np.round(seconds * 1e9).astype(np.int64)
    places = fixes("/mission", t_ns, place[:, 0], place[:, 1], **{route.datum: place[:, 2]})
    return Source([places, gimbals("/mission", t_ns, yaw, pitch, 0 * yaw)], notes=notes, planned=True)


def _flown(rows: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Stations on the legs: places (N, 3), yaw and pitch, deg, and time, s."""
    scale = np.array([111_320.0, 111_320.0 * np.cos(np.radians(rows[0, 0])), 1.0])
    legs = np.diff(rows[:, :3] * scale, axis=0)
    ahead = np.degrees(np.arctan2(legs[:, 1], legs[:, 0]))
    yaw = np.where(np.isnan(rows[:, 3]), np.append(ahead, ahead[-1:]), rows[:, 3])
    yaw = np.degrees(np.unwrap(np.radians(yaw)))
    speed = np.where(rows[1:, 5] > 0, rows[1:, 5], _SLOW_MPS)
    at = np.concatenate([[0], np.cumsum(np.maximum(np.linalg.norm(legs, axis=1) / speed, 0.5))])
    seconds = np.unique(np.concatenate([at, np.arange(0, min(at[-1], 86_400), _STEP_S)]))
    place = np.column_stack([np.interp(seconds, at, rows[:, axis]) for axis in range(3)])
    return place, np.interp(seconds, at, yaw), np.interp(seconds, at, np.nan_to_num(rows[:, 4])), seconds


def _commands(items: list[tuple[int, int, list[float]]]) -> _Route:
    route, flown = _Route(), (_WAYPOINT, _SPLINE)
    datums = {_FRAMES[frame] for command, frame, _ in items if command in flown and frame in _FRAMES}
    if len(datums) > 1:
        raise refusal("has waypoints with heights of several kinds", "one datum", "save it in one frame")
    route.datum = next(iter(datums), route.datum)
    for command, frame, params in items:
        if command == _SPEED and params[1] > 0:
            route.speed = params[1]
        elif command == _YAW:
            route.yaw = params[0]
        elif command in (_MOUNT, _GIMBAL):
            route.pitch = params[0]
        elif command in flown and frame in _FRAMES and (params[4] or params[5]):
            route.add(*params[4:7], yaw=params[3])
    return route


def _plan(data: bytes) -> _Route:
    plan = json.loads(data)
    if (versions := (plan.get("version"), plan.get("mission", {}).get("version"))) != (1, 2):
        finding = f"is a plan of version {versions[0]}, mission {versions[1]}"
        raise refusal(finding, "versions 1 and 2", "open it in QGroundControl and save it again")
    items, computed = list[tuple[int, int, list[float]]](), list[str]()
    for item in plan["mission"].get("items", []):
        simple = item.get("type") == "SimpleItem"
        inner = [item] if simple else item.get("TransectStyleComplexItem", {}).get("Items", [])
        if not inner:
            computed.append(str(item.get("complexItemType", "?")))
        for each in inner:
            params = [_NAN if value is None else float(value) for value in each["params"]]
            items.append((int(each["command"]), int(each["frame"]), params))
    route = _commands(items)
    if computed and len(route.rows) < 2:
        finding = f"states no waypoints of {', '.join(computed)}: QGroundControl computes them"
        raise refusal(finding, "waypoints", "upload it, download it from the vehicle, and save that")
    return route


def _waypoints(data: bytes) -> _Route:
    items = []
    for line in data.decode("ascii").splitlines()[2:]:  # the first is home
        row = line.split()
        if params := [float(value) for value in row[4:11]]:
            params[3] = params[3] or _NAN  # the format has no other word for none
            items.append((int(row[3]), int(row[2]), params))
    return _commands(items)


def _litchi(data: bytes) -> _Route:
    route = _Route()
    for row in csv.DictReader(io.StringIO(data.decode("utf-8-sig"))):
        place = (float(row[name]) for name in ("latitude", "longitude", "altitude(m)"))
        pitch = float(row["gimbalpitchangle"]) if row.get("gimbalmode", "2").strip() == "2" else _NAN
        speed = float(row.get("speed(m/s)") or "nan")
        route.add(*place, yaw=float(row["heading(deg)"]), pitch=pitch, speed=speed)
    return route


def _zipped(data: bytes) -> _Route:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        names = [name for name in archive.namelist() if name.endswith(("waylines.wpml", ".kml"))]
        names.sort(key=lambda name: name.endswith(".kml"))
        if not names or archive.getinfo(names[0]).file_size > MAX_UNPACKED:
            rule = f"a mission of at most {MAX_UNPACKED >> 20} MB"
            raise refusal("unpacks to no mission, or to more than one", rule, "check where it is from")
        with archive.open(names[0]) as stream:
            return _marks(stream.read(MAX_UNPACKED))


def _marks(data: bytes) -> _Route:
    root, route = plain_xml(data), _Route()  # names of the schema change with its version
    if root.find(".//executeHeight") is None:
        if not (lines := [node.findtext("coordinates") for node in root.iter("LineString")]):
            finding = "states no path: it is a template, or holds other shapes"
            raise refusal(finding, "waypoints or one LineString", "take waylines.wpml, or the .kmz")
        relative = "relativeToGround" in {node.text for node in root.iter("altitudeMode")}
        route.datum = "alt_takeoff" if relative else "alt"
        for place in str(lines[0]).split():
            lon, lat, alt = (float(value) for value in [*place.split(","), "0"][:3])
            route.add(lat, lon, alt)
        return route
    ellipsoid = "WGS84" in {node.text for node in root.iter("executeHeightMode")}
    route.datum = "alt_ellipsoid" if ellipsoid else "alt_takeoff"
    for mark in root.iter("Placemark"):
        lon, lat = (float(value) for value in str(mark.findtext("Point/coordinates")).split(",")[:2])
        turned = str(mark.findtext(".//waypointHeadingMode")).strip() in ("smoothTransition", "fixed")
        yaw = float(mark.findtext(".//waypointHeadingAngle") or "nan") if turned else _NAN
        here, ahead = route.pitch, route.pitch
        for action in mark.iter("action"):
            pitch = action.findtext(".//gimbalPitchRotateAngle")
            if pitch is not None and action.findtext("actionActuatorFunc") == "gimbalEvenlyRotate":
                ahead = float(pitch)  # reached at the next waypoint
            elif pitch is not None:
                here = ahead = float(pitch)
            if (heading := action.findtext(".//aircraftHeading")) is not None:
                yaw = float(heading)
        speed = float(mark.findtext("waypointSpeed") or "nan")
        height = float(str(mark.findtext("executeHeight")))
        route.add(lat, lon, height, yaw=yaw, pitch=here, speed=speed)
        route.pitch = ahead
    return route
