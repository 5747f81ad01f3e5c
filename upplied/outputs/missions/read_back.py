"""The path that a mission file commands, read from its bytes, in the structure frame.

The gate judges this, not what was meant to be written. Places on the Earth become metres by the placement
of the structure, heights above take-off by the home of the mission.
"""

from __future__ import annotations

import csv
import io
import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from defusedxml import ElementTree
from mcap_ros2.reader import read_ros2_messages

from upplied.errors import RefusedError
from upplied.geometry.polylines import cumulated, leg_lengths
from upplied.outputs.missions.corners import triangle
from upplied.outputs.missions.gate import Reading, planned
from upplied.outputs.missions.geodesy import from_geodetic
from upplied.outputs.missions.records import Mission
from upplied.records import Floats

_WAYPOINT, _SPEED, _DISTANCE = 16, 178, 206
_PHOTOS = (203, 2000)
_LITCHI_STAYS, _LITCHI_PHOTO = "0", "1"
_WPML = "{http://www.dji.com/wpmz/1.0.2}"
_KML = "{http://www.opengis.net/kml/2.2}"
_PASSES = "toPointAndPassWithContinuityCurvature"


def read_mission(format: str, content: bytes, mission: Mission) -> Reading:
    """The path that a mission file states, from take-off to landing.

    Parameters
    ----------
    format : str
    content : bytes
        As they are written.
    mission : Mission
        Its placement and home; nothing else of it is read.

    Raises
    ------
    RefusedError
        If the file does not state a path.
    """
    try:
        file = _READERS[format](content)
        local = _local(file.places, mission, format)
    except (ValueError, KeyError, IndexError, AttributeError, zipfile.BadZipFile) as error:
        raise RefusedError(mission.name, f"the {format} file cannot be read back: {error}") from error
    if len(local) == 0 or not np.isfinite(local).all():
        raise RefusedError(mission.name, f"the {format} file states no path", "finite waypoints")
    return _whole(local, file, mission.home_local)


def read_mcap(content: bytes) -> Reading:
    """The timed path of an MCAP file that holds a plan."""
    poses = [
        (each.log_time_ns, each.ros_msg.pose.position)
        for each in read_ros2_messages(io.BytesIO(content), topics=["/plan/camera"])
    ]
    positions = np.array([[at.x, at.y, at.z] for _, at in poses], float).reshape(-1, 3)
    t_s = np.array([stamp for stamp, _ in poses], float) * 1e-9
    return planned(positions, t_s)


def _whole(local: Floats, file: _File, home: Floats) -> Reading:
    """Straight up from home to the height of the first waypoint, and down from that of the last."""
    up, down = (np.array([[home[0], home[1], at[2]]]) for at in (local[0], local[-1]))
    unknown = np.full(2, np.nan)
    starts, ends = [np.empty((0, 3))], [np.empty((0, 3))]
    for at in np.flatnonzero(file.passing[1:-1] > 0) + 1:
        before, after = local[at - 1] - local[at], local[at + 1] - local[at]
        units = before / np.linalg.norm(before), after / np.linalg.norm(after)
        start, end = triangle(local[at], *units, float(file.passing[at]))
        starts += [start, end[:-1]]
        ends += [end, end[1:]]
    return Reading(
        np.concatenate([home[None], up, local, down, home[None]]),
        np.concatenate([unknown, file.speeds, unknown]),
        fan_start=np.concatenate(starts),
        fan_end=np.concatenate(ends),
        photo_m=local[[at for at, _ in file.photos]],
        photo_s=np.array(file.photo_s) if file.photo_s else _photo_times(local, file),
        every_s=min(
            (m / file.speeds[at + 1] for at, m in file.every.items() if at + 1 < len(local)), default=np.inf
        ),
    )


def _photo_times(local: Floats, file: _File) -> Floats:
    """When photos are taken (K,), s from the first waypoint: what speeds and holds give at the least."""
    took = leg_lengths(local) / np.maximum(file.speeds[1:], 1e-3)
    reached = cumulated(np.nan_to_num(took) + file.holds[:-1])
    return np.array([reached[at] + stay for at, stay in file.photos])


def _local(places: Floats, mission: Mission, format: str) -> Floats:
    """Latitude, longitude and altitude as the file states them, (N, 3), in the structure frame, m."""
    absolute = places.copy()
    relative = mission.altitude == "relative" and format != "csv"
    if relative:  # of the same height as home on the Earth; the true height follows
        absolute[:, 2] = mission.home[2]
    local = from_geodetic(absolute, mission.placement)
    if relative:
        local[:, 2] = mission.home_local[2] + places[:, 2]
    return local


@dataclass
class _File:
    """What a file states, waypoint by waypoint."""

    places: Floats  # (N, 3) latitude and longitude, deg, altitude as it is written, m
    speeds: Floats  # (N,) of the leg that ends at each; NaN where it is not stated
    passing: Floats  # (N,) m
    holds: Floats  # (N,) s, that the vehicle stays at each
    photos: list[tuple[int, float]] = field(default_factory=list)  # waypoint, and s after it is reached
    every: dict[int, float] = field(default_factory=dict)  # m between photos on the leg behind a waypoint
    photo_s: list[float] = field(default_factory=list)  # where the file states the times themselves


def _items(rows: list[tuple[int, list[float]]]) -> _File:
    """Waypoints of MAVLink commands with their seven parameters."""
    places: list[list[float]] = []
    speeds, holds, speed, every_m = [], [], np.nan, 0.0
    photos, every = [], dict[int, float]()
    for command, params in rows:
        if command == _SPEED:
            speed = params[1]
        if command == _WAYPOINT:
            places.append(params[4:7])
            speeds.append(speed)
            holds.append(params[0])
        if command == _DISTANCE:
            every_m = params[0]
            every.pop(len(places) - 1, None)
        if command in _PHOTOS:
            photos.append((len(places) - 1, holds[-1]))
        if every_m:
            every[len(places) - 1] = every_m
    return _File(_places(places), np.array(speeds), np.zeros(len(places)), np.array(holds), photos, every)


def _qgc(content: bytes) -> _File:
    items = json.loads(content)["mission"]["items"]
    return _items([(int(i["command"]), [float(v or 0.0) for v in i["params"]]) for i in items])


def _mavlink(content: bytes) -> _File:
    lines = content.decode("utf-8").splitlines()
    if lines[0] != "QGC WPL 110":
        raise ValueError("it does not begin with QGC WPL 110")
    fields = [line.split("\t") for line in lines[2:]]  # the first row is home
    return _items([(int(each[3]), [float(value) for value in each[4:11]]) for each in fields])


def _dji(content: bytes) -> _File:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        root = ElementTree.fromstring(archive.read("wpmz/waylines.wpml"))
    places, speeds, passing, holds = [], [np.nan], [], []
    photos, every = [], {}
    for at, mark in enumerate(root.iter(f"{_KML}Placemark")):
        lon, lat = (float(value) for value in mark.find(f".//{_KML}coordinates").text.split(","))
        places.append([lat, lon, float(mark.find(f"{_WPML}executeHeight").text)])
        speeds.append(float(mark.find(f"{_WPML}waypointSpeed").text))  # of the leg that begins here
        turn = mark.find(f"{_WPML}waypointTurnParam")
        passes = turn.find(f"{_WPML}waypointTurnMode").text == _PASSES
        passing.append(float(turn.find(f"{_WPML}waypointTurnDampingDist").text) if passes else 0.0)
        stay = 0.0
        for group in mark.iter(f"{_WPML}actionGroup"):
            trigger = group.find(f"{_WPML}actionTrigger")
            if trigger.find(f"{_WPML}actionTriggerType").text == "multipleDistance":
                every[at] = float(trigger.find(f"{_WPML}actionTriggerParam").text)
                continue
            for action in group.iter(f"{_WPML}action"):
                name = action.find(f"{_WPML}actionActuatorFunc").text
                if name == "hover":
                    stay += float(action.find(f".//{_WPML}hoverTime").text)
                if name == "takePhoto":
                    photos.append((at, stay))
        holds.append(stay)
    stated = np.array(speeds[:-1]), np.array(passing), np.array(holds)
    return _File(_places(places), *stated, photos, every)


def _litchi(content: bytes) -> _File:
    rows = list(csv.DictReader(io.StringIO(content.decode("utf-8"))))
    places = [[float(r["latitude"]), float(r["longitude"]), float(r["altitude(m)"])] for r in rows]
    speeds = [np.nan, *(float(r["speed(m/s)"]) for r in rows)]
    holds, photos, every = [], [], {}
    for at, row in enumerate(rows):
        stay = 0.0
        for number in range(1, 16):
            action = row[f"actiontype{number}"]
            stay += float(row[f"actionparam{number}"]) * 1e-3 * (action == _LITCHI_STAYS)
            if action == _LITCHI_PHOTO:
                photos.append((at, stay))
        holds.append(stay)
        if float(row["photo_distinterval"]) > 0:
            every[at] = float(row["photo_distinterval"])
    stated = np.array(speeds[:-1]), np.zeros(len(rows)), np.array(holds)
    return _File(_places(places), *stated, photos, every)


def _kml(content: bytes) -> _File:
    root = ElementTree.fromstring(content)
    line = root.find(f".//{_KML}LineString/{_KML}coordinates").text.split()
    parsed = _unstated(np.array([[float(v) for v in place.split(",")] for place in line])[:, [1, 0, 2]])
    for mark in root.iter(f"{_KML}Placemark"):
        if (point := mark.find(f"{_KML}Point/{_KML}coordinates")) is not None:
            parsed.photos.append((line.index(point.text), 0.0))
            parsed.photo_s.append(float(mark.find(f".//{_KML}value").text))
    return parsed


def _geojson(content: bytes) -> _File:
    line, *points = json.loads(content)["features"]
    parsed = _unstated(np.array(line["geometry"]["coordinates"], float)[:, [1, 0, 2]])
    return _stated(parsed, [point["properties"] for point in points])


def _csv(content: bytes) -> _File:
    rows = list(csv.DictReader(io.StringIO(content.decode("utf-8"))))
    places = [[float(r["lat_deg"]), float(r["lon_deg"]), float(r["alt_m"])] for r in rows]
    return _stated(_unstated(_places(places)), rows)


def _stated(content: _File, rows: Sequence[Mapping[str, Any]]) -> _File:
    """Speeds, holds and photos of waypoints, from rows that name them."""
    content.speeds = np.array([float(row["speed_mps"]) for row in rows])
    content.holds = np.array([float(row["hold_s"]) for row in rows])
    content.photos = [(at, float(row["hold_s"])) for at, row in enumerate(rows) if int(row["photo"])]
    return content


def _places(rows: list[list[float]]) -> Floats:
    return np.array(rows, float).reshape(-1, 3)


def _unstated(places: Floats) -> _File:
    number = len(places)
    return _File(places, np.full(number, np.nan), np.zeros(number), np.zeros(number))


_READERS: dict[str, Callable[[bytes], _File]] = {
    "qgc-plan": _qgc,
    "mavlink": _mavlink,
    "dji-wpml": _dji,
    "litchi": _litchi,
    "kml": _kml,
    "geojson": _geojson,
    "csv": _csv,
}
