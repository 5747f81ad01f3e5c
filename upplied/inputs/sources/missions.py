"""Missions of ground stations as planned flights: QGroundControl, MAVLink waypoints, KML, DJI WPML, Litchi.

A planned flight is marked so from its passport on: it says what somebody wanted, not what was flown.
Between waypoints the camera is taken to turn steadily; the time is that of the stated speed.
"""

from __future__ import annotations

import csv
import io
import zipfile
from pathlib import Path

import numpy as np
from defusedxml import ElementTree

from upplied.errors import InputError
from upplied.inputs.files import read_regular
from upplied.inputs.sources.mission_items import Route, plan_route, waypoints_route
from upplied.inputs.sources.source import Fields, Source, fixes, gimbals
from upplied.records import Floats

MAX_BYTES = 64 << 20
MAX_UNPACKED = 256 << 20
_STEP_S = 0.2  # of the stations on a leg
_SLOW_MPS = 3.0  # where a mission says no speed


def read(path: Path, fields: Fields) -> Source:
    """The planned flight of a mission."""
    data = read_regular(path, MAX_BYTES)
    head = data.lstrip(b"\xef\xbb\xbf \r\n\t")
    readers = {b"PK": _zipped, b"QGC WPL": waypoints_route, b"{": plan_route, b"<": _marks}
    found = [reader for start, reader in readers.items() if head.startswith(start)]
    route = found[0](data, path) if found else _litchi(data, path)
    rows = np.array(route.rows, float).reshape(-1, 6)
    if len(rows) < 2 or not np.isfinite(rows[:, :3]).all():
        raise InputError(
            str(path),
            f"states {len(rows)} waypoints",
            "at least two with a place",
            "let the ground station write them out",
        )
    pitched = np.isfinite(rows[:, 4])
    notes = ["a planned mission: nobody flew it"]
    if not pitched.any():
        notes.append("it says no pitch of the camera: level")
    if not np.isfinite(rows[:, 3]).all():
        notes.append("it says no heading at some waypoints: the camera looks along the path")
    place, yaw, pitch, seconds = _flown(rows)
    t_ns = 1_000_000_000 + np.round(seconds * 1e9).astype(np.int64)
    tables = [fixes("/mission", t_ns, place[:, 0], place[:, 1], **{route.datum: place[:, 2]}),
              gimbals("/mission", t_ns, yaw, pitch, 0 * yaw)]  # fmt: skip
    return Source(tables, notes=notes, planned=True)


def _flown(rows: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Stations on the legs: places (N, 3), yaw and pitch, deg, and time, s."""
    scale = np.array([111_320.0, 111_320.0 * np.cos(np.radians(rows[0, 0])), 1.0])
    legs = np.diff(rows[:, :3] * scale, axis=0)
    length = np.linalg.norm(legs, axis=1)
    ahead = np.degrees(np.arctan2(legs[:, 1], legs[:, 0]))
    yaw = np.where(np.isnan(rows[:, 3]), np.append(ahead, ahead[-1:]), rows[:, 3])
    yaw = np.degrees(np.unwrap(np.radians(yaw)))
    pitch = np.nan_to_num(rows[:, 4])
    speed = np.where(rows[1:, 5] > 0, rows[1:, 5], _SLOW_MPS)
    at = np.concatenate([[0], np.cumsum(np.maximum(length / speed, 0.5))])
    seconds = np.unique(np.concatenate([at, np.arange(0, min(at[-1], 86_400), _STEP_S)]))
    place = np.column_stack([np.interp(seconds, at, rows[:, axis]) for axis in range(3)])
    return place, np.interp(seconds, at, yaw), np.interp(seconds, at, pitch), seconds


def _litchi(data: bytes, path: Path) -> Route:
    route = Route()
    for row in csv.DictReader(io.StringIO(data.decode("utf-8-sig"))):
        pitch = float(row["gimbalpitchangle"]) if row.get("gimbalmode", "2").strip() == "2" else np.nan
        route.add(
            float(row["latitude"]),
            float(row["longitude"]),
            float(row["altitude(m)"]),
            float(row["heading(deg)"]),
            pitch,
            float(row.get("speed(m/s)") or "nan"),
        )
    return route


def _zipped(data: bytes, path: Path) -> Route:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        names = sorted(
            archive.namelist(),
            key=lambda name: (not name.endswith("waylines.wpml"), not name.endswith(".kml")),
        )
        if not names or archive.getinfo(names[0]).file_size > MAX_UNPACKED:
            raise InputError(
                str(path),
                "unpacks to more than a mission",
                f"at most {MAX_UNPACKED >> 20} MB",
                "check where it is from",
            )
        with archive.open(names[0]) as stream:
            return _marks(stream.read(MAX_UNPACKED), path)


def _marks(data: bytes, path: Path) -> Route:
    """Placemarks of WPML, else the line of a KML."""
    root = ElementTree.fromstring(data, forbid_dtd=True)
    route = Route()
    for node in root.iter():  # names of the schema change with its version
        node.tag = str(node.tag).rsplit("}", 1)[-1]
    if root.find(".//executeHeight") is None:
        lines = [node.findtext("coordinates") for node in root.iter("LineString")]
        if not lines:
            raise InputError(
                str(path),
                "states no path: it is a template, or holds other shapes",
                "waypoints or one LineString",
                "take waylines.wpml, or the .kmz",
            )
        route.datum = (
            "alt_takeoff" if "relativeToGround" in {n.text for n in root.iter("altitudeMode")} else "alt"
        )
        for place in str(lines[0]).split():
            lon, lat, alt = (float(value) for value in [*place.split(","), "0"][:3])
            route.add(lat, lon, alt)
        return route
    route.datum = (
        "alt_ellipsoid" if "WGS84" in {n.text for n in root.iter("executeHeightMode")} else "alt_takeoff"
    )
    for mark in root.iter("Placemark"):
        lon, lat = (float(value) for value in str(mark.findtext("Point/coordinates")).split(",")[:2])
        turned = str(mark.findtext(".//waypointHeadingMode")).strip() in ("smoothTransition", "fixed")
        yaw = float(mark.findtext(".//waypointHeadingAngle") or "nan") if turned else np.nan
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
        route.add(lat, lon, float(str(mark.findtext("executeHeight"))), yaw, here, speed)
        route.pitch = ahead
    return route
