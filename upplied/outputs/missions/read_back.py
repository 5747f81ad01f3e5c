"""The path that a mission file commands, read from its bytes, in the structure frame.

The gate judges this path instead of the plan. Places on the Earth are converted to metres by the placement
of the structure, heights above take-off by the home of the mission.
"""

import csv
import io
import json
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from defusedxml import ElementTree
from mcap_ros2.reader import read_ros2_messages

from upplied.errors import RefusedError
from upplied.geometry.polylines import cumulated, leg_lengths
from upplied.outputs.missions.flying import triangle
from upplied.outputs.missions.gate import Reading, planned
from upplied.outputs.missions.records import Mission, from_geodetic
from upplied.records import Floats

_WAYPOINT, _SPEED, _DISTANCE = 16, 178, 206
_PHOTOS = (203, 2000)
_LITCHI_STAYS, _LITCHI_PHOTO = "0", "1"
_WPML = "{http://www.dji.com/wpmz/1.0.2}"
_KML = "{http://www.opengis.net/kml/2.2}"
_PASSES = "toPointAndPassWithContinuityCurvature"


def read_mission(format: str, content: bytes, mission: Mission) -> Reading:
    """The path that a mission file states, from take-off to landing; of the mission only its place counts."""
    try:
        file = _READERS[format](content)
        places = np.array([stop.place for stop in file.stops], float).reshape(-1, 3)
        relative = mission.altitude == "relative" and format != "csv"
        level = np.full(len(places), mission.home[2]) if relative else places[:, 2]
        local = from_geodetic(np.column_stack([places[:, :2], level]), mission.placement)
        if relative:
            local[:, 2] = mission.home_local[2] + places[:, 2]
    except (ValueError, KeyError, IndexError, AttributeError, zipfile.BadZipFile) as error:
        raise RefusedError(mission.name, f"the {format} file cannot be read back: {error}") from error
    if len(local) == 0 or not np.isfinite(local).all():
        raise RefusedError(mission.name, f"the {format} file states no path", "finite waypoints")
    return _whole(local, file, mission.home_local)


def read_mcap(content: bytes) -> Reading:
    """The timed path of the plan in an MCAP file."""
    poses = [*read_ros2_messages(io.BytesIO(content), topics=["/plan/camera"])]
    places = (each.ros_msg.pose.position for each in poses)
    positions = np.array([[at.x, at.y, at.z] for at in places], float).reshape(-1, 3)
    return planned(positions, np.array([each.log_time_ns for each in poses], float) * 1e-9)


def _whole(local: Floats, file: "_File", home: Floats) -> Reading:
    """Vertical legs from home to the height of the first waypoint, and from that of the last to home."""
    up, down = (np.array([[home[0], home[1], at[2]]]) for at in (local[0], local[-1]))
    unknown, speeds = np.full(2, np.nan), np.array([stop.speed for stop in file.stops])
    starts, ends = [np.empty((0, 3))], [np.empty((0, 3))]
    for at, stop in enumerate(file.stops[1:-1], 1):
        if stop.passing > 0:
            before, after = local[at - 1] - local[at], local[at + 1] - local[at]
            units = before / np.linalg.norm(before), after / np.linalg.norm(after)
            start, end = triangle(local[at], *units, stop.passing)
            starts += [start, end[:-1]]
            ends += [end, end[1:]]
    # Minimum times of the photos, s from the first waypoint, by speeds and holds.
    took = np.nan_to_num(leg_lengths(local) / np.maximum(speeds[1:], 1e-3))
    reached = cumulated(took + [stop.hold for stop in file.stops[:-1]])
    return Reading(
        np.concatenate([home[None], up, local, down, home[None]]),
        np.concatenate([unknown, speeds, unknown]),
        fan_start=np.concatenate(starts),
        fan_end=np.concatenate(ends),
        photo_m=local[[at for at, _ in file.photos]],
        photo_s=np.array(file.photo_s or [reached[at] + stay for at, stay in file.photos]),
        every_s=min((a.every / b.speed for a, b in pairwise(file.stops) if a.every), default=np.inf),
    )


@dataclass
class _Stop:
    place: Sequence[float]  # latitude and longitude, deg, altitude as written, m
    speed: float = np.nan  # of the leg that ends here, m/s; NaN if not stated
    hold: float = 0.0  # s, that the vehicle stays
    passing: float = 0.0  # m
    every: float = 0.0  # m between photos on the leg behind it; 0: none by distance


@dataclass
class _File:
    stops: list[_Stop]
    photos: list[tuple[int, float]] = field(default_factory=list)  # waypoint, and s after it is reached
    photo_s: list[float] = field(default_factory=list)  # if the file states the times


def _items(rows: list[tuple[int, list[float]]]) -> _File:
    """Waypoints of MAVLink commands with their seven parameters."""
    file, speed, every = _File([]), np.nan, 0.0
    for command, params in rows:
        if command == _SPEED:
            speed = params[1]
        if command == _WAYPOINT:
            file.stops.append(_Stop(params[4:7], speed, params[0], every=every))
        if command == _DISTANCE:
            every = file.stops[-1].every = params[0]
        if command in _PHOTOS:
            file.photos.append((len(file.stops) - 1, file.stops[-1].hold))
    return file


def _qgc(content: bytes) -> _File:
    items = json.loads(content)["mission"]["items"]
    return _items([(int(i["command"]), [float(v or 0.0) for v in i["params"]]) for i in items])


def _mavlink(content: bytes) -> _File:
    lines = content.decode("utf-8").splitlines()
    if lines[0] != "QGC WPL 110":
        raise ValueError("it does not begin with QGC WPL 110")
    fields = [line.split("\t") for line in lines[2:]]  # the first row is home
    return _items([(int(each[3]), [float(value) for value in each[4:11]]) for each in fields])


def _behind(file: _File) -> _File:
    """The file with each speed at the end of its leg instead of the beginning."""
    for stop, speed in zip(file.stops, [np.nan, *(stop.speed for stop in file.stops)], strict=False):
        stop.speed = speed
    return file


def _dji(content: bytes) -> _File:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        root = ElementTree.fromstring(archive.read("wpmz/waylines.wpml"))
    file = _File([])
    for at, mark in enumerate(root.iter(f"{_KML}Placemark")):
        lon, lat = (float(value) for value in mark.find(f".//{_KML}coordinates").text.split(","))
        stop = _Stop((lat, lon, float(mark.find(f"{_WPML}executeHeight").text)))
        stop.speed = float(mark.find(f"{_WPML}waypointSpeed").text)
        turn = mark.find(f"{_WPML}waypointTurnParam")
        if turn.find(f"{_WPML}waypointTurnMode").text == _PASSES:
            stop.passing = float(turn.find(f"{_WPML}waypointTurnDampingDist").text)
        for group in mark.iter(f"{_WPML}actionGroup"):
            trigger = group.find(f"{_WPML}actionTrigger")
            if trigger.find(f"{_WPML}actionTriggerType").text == "multipleDistance":
                stop.every = float(trigger.find(f"{_WPML}actionTriggerParam").text)
                continue
            for action in group.iter(f"{_WPML}action"):
                name = action.find(f"{_WPML}actionActuatorFunc").text
                if name == "hover":
                    stop.hold += float(action.find(f".//{_WPML}hoverTime").text)
                if name == "takePhoto":
                    file.photos.append((at, stop.hold))
        file.stops.append(stop)
    return _behind(file)


def _litchi(content: bytes) -> _File:
    file = _File([])
    for at, row in enumerate(_rows(content)):
        place = [float(row[name]) for name in ("latitude", "longitude", "altitude(m)")]
        stop = _Stop(place, float(row["speed(m/s)"]), every=max(float(row["photo_distinterval"]), 0.0))
        for number in range(1, 16):
            action = row[f"actiontype{number}"]
            stop.hold += float(row[f"actionparam{number}"]) * 1e-3 * (action == _LITCHI_STAYS)
            if action == _LITCHI_PHOTO:
                file.photos.append((at, stop.hold))
        file.stops.append(stop)
    return _behind(file)


def _kml(content: bytes) -> _File:
    root = ElementTree.fromstring(content)
    line = root.find(f".//{_KML}LineString/{_KML}coordinates").text.split()
    file = _File([_turned(map(float, place.split(","))) for place in line])
    for mark in root.iter(f"{_KML}Placemark"):
        if (point := mark.find(f"{_KML}Point/{_KML}coordinates")) is not None:
            file.photos.append((line.index(point.text), 0.0))
            file.photo_s.append(float(mark.find(f".//{_KML}value").text))
    return file


def _geojson(content: bytes) -> _File:
    line, *points = json.loads(content)["features"]
    stops = [_turned(place) for place in line["geometry"]["coordinates"]]
    return _stated(stops, [point["properties"] for point in points])


def _csv(content: bytes) -> _File:
    rows = _rows(content)
    return _stated([_Stop([float(r[name]) for name in ("lat_deg", "lon_deg", "alt_m")]) for r in rows], rows)


def _rows(content: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(content.decode("utf-8"))))


def _turned(place: Iterable[float]) -> _Stop:
    lon, lat, alt = place
    return _Stop((lat, lon, alt))


def _stated(stops: list[_Stop], rows: Sequence[Mapping[str, Any]]) -> _File:
    """The waypoints with speeds, holds and photos from named columns."""
    for stop, row in zip(stops, rows, strict=True):
        stop.speed, stop.hold = float(row["speed_mps"]), float(row["hold_s"])
    return _File(stops, [(at, stops[at].hold) for at, row in enumerate(rows) if int(row["photo"])])


_READERS: dict[str, Callable[[bytes], _File]] = {
    "qgc-plan": _qgc,
    "mavlink": _mavlink,
    "dji-wpml": _dji,
    "litchi": _litchi,
    "kml": _kml,
    "geojson": _geojson,
    "csv": _csv,
}
