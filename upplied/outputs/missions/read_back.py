"""What a mission file tells a vehicle, read from its bytes: the path in the structure frame again.

The gate judges this, not what was meant to be written. Places on the Earth become metres by the placement
of the structure, heights above take-off by the home of the mission.
"""

from __future__ import annotations

import csv
import io
import json
import zipfile
from collections.abc import Callable

import numpy as np
from defusedxml import ElementTree
from mcap_ros2.reader import read_ros2_messages

from upplied.errors import RefusedError
from upplied.outputs.missions.corners import triangle
from upplied.outputs.missions.geodesy import from_geodetic
from upplied.outputs.missions.reading import Reading, planned
from upplied.outputs.missions.records import Mission
from upplied.records import Floats

_TAKEOFF, _WAYPOINT, _SPEED = 22, 16, 178
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
        places, speeds, passing = _READERS[format](content)
        local = _local(places, mission, format)
    except (ValueError, KeyError, IndexError, AttributeError, zipfile.BadZipFile) as error:
        raise RefusedError(mission.name, f"the {format} file cannot be read back: {error}") from error
    if len(local) == 0 or not np.isfinite(local).all():
        raise RefusedError(mission.name, f"the {format} file states no path", "finite waypoints")
    return _whole(local, speeds, passing, mission.home_local)


def read_mcap(content: bytes) -> Reading:
    """The timed path of an MCAP file that holds a plan."""
    poses = [
        (each.log_time_ns, each.ros_msg.pose.position)
        for each in read_ros2_messages(io.BytesIO(content), topics=["/plan/camera"])
    ]
    positions = np.array([[at.x, at.y, at.z] for _, at in poses], float).reshape(-1, 3)
    t_s = np.array([stamp for stamp, _ in poses], float) * 1e-9
    return planned(positions, t_s)


def _whole(local: Floats, speeds: Floats, passing: Floats, home: Floats) -> Reading:
    """Straight up from home to the height of the first waypoint, and down from that of the last."""
    up, down = (np.array([[home[0], home[1], at[2]]]) for at in (local[0], local[-1]))
    unknown = np.full(2, np.nan)
    starts, ends = [np.empty((0, 3))], [np.empty((0, 3))]
    for at in np.flatnonzero(passing[1:-1] > 0) + 1:
        before, after = local[at - 1] - local[at], local[at + 1] - local[at]
        units = before / np.linalg.norm(before), after / np.linalg.norm(after)
        start, end = triangle(local[at], *units, float(passing[at]))
        starts += [start, end[:-1]]
        ends += [end, end[1:]]
    return Reading(
        np.concatenate([home[None], up, local, down, home[None]]),
        np.concatenate([unknown, speeds, unknown]),
        fan_start=np.concatenate(starts),
        fan_end=np.concatenate(ends),
    )


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


_Read = tuple[Floats, Floats, Floats]  # places (N, 3), speeds (N,), passing (N,)


def _items(rows: list[tuple[int, list[float]]]) -> _Read:
    """Waypoints of MAVLink commands with their seven parameters."""
    places, speeds, speed = [], [], np.nan
    for command, params in rows:
        if command == _SPEED:
            speed = params[1]
        if command == _WAYPOINT:
            places.append(params[4:7])
            speeds.append(speed)
    return np.array(places, float).reshape(-1, 3), np.array(speeds), np.zeros(len(places))


def _qgc(content: bytes) -> _Read:
    items = json.loads(content)["mission"]["items"]
    return _items([(int(i["command"]), [float(v or 0.0) for v in i["params"]]) for i in items])


def _mavlink(content: bytes) -> _Read:
    lines = content.decode("utf-8").splitlines()
    if lines[0] != "QGC WPL 110":
        raise ValueError("it does not begin with QGC WPL 110")
    fields = [line.split("\t") for line in lines[2:]]  # the first row is home
    return _items([(int(each[3]), [float(value) for value in each[4:11]]) for each in fields])


def _dji(content: bytes) -> _Read:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        root = ElementTree.fromstring(archive.read("wpmz/waylines.wpml"))
    places, speeds, passing = [], [np.nan], []
    for mark in root.iter(f"{_KML}Placemark"):
        lon, lat = (float(value) for value in mark.find(f".//{_KML}coordinates").text.split(","))
        places.append([lat, lon, float(mark.find(f"{_WPML}executeHeight").text)])
        speeds.append(float(mark.find(f"{_WPML}waypointSpeed").text))  # of the leg that begins here
        turn = mark.find(f"{_WPML}waypointTurnParam")
        passes = turn.find(f"{_WPML}waypointTurnMode").text == _PASSES
        passing.append(float(turn.find(f"{_WPML}waypointTurnDampingDist").text) if passes else 0.0)
    return np.array(places).reshape(-1, 3), np.array(speeds[:-1]), np.array(passing)


def _litchi(content: bytes) -> _Read:
    rows = list(csv.DictReader(io.StringIO(content.decode("utf-8"))))
    places = [[float(r["latitude"]), float(r["longitude"]), float(r["altitude(m)"])] for r in rows]
    speeds = [np.nan, *(float(r["speed(m/s)"]) for r in rows)]
    return np.array(places).reshape(-1, 3), np.array(speeds[:-1]), np.zeros(len(rows))


def _kml(content: bytes) -> _Read:
    root = ElementTree.fromstring(content)
    line = root.find(f".//{_KML}LineString/{_KML}coordinates").text.split()
    return _unsaid(np.array([[float(v) for v in place.split(",")] for place in line])[:, [1, 0, 2]])


def _geojson(content: bytes) -> _Read:
    line = json.loads(content)["features"][0]["geometry"]["coordinates"]
    return _unsaid(np.array(line, float)[:, [1, 0, 2]])


def _csv(content: bytes) -> _Read:
    rows = list(csv.DictReader(io.StringIO(content.decode("utf-8"))))
    places = [[float(r["lat_deg"]), float(r["lon_deg"]), float(r["alt_m"])] for r in rows]
    return (
        np.array(places).reshape(-1, 3),
        np.array([float(r["speed_mps"]) for r in rows]),
        np.zeros(len(rows)),
    )


def _unsaid(places: Floats) -> _Read:
    return places, np.full(len(places), np.nan), np.zeros(len(places))


_READERS: dict[str, Callable[[bytes], _Read]] = {
    "qgc-plan": _qgc,
    "mavlink": _mavlink,
    "dji-wpml": _dji,
    "litchi": _litchi,
    "kml": _kml,
    "geojson": _geojson,
    "csv": _csv,
}
