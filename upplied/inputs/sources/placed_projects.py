"""Cameras of Metashape and RealityCapture, which place a project on the Earth themselves."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
from defusedxml import ElementTree
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.inputs.files import read_regular
from upplied.inputs.sources.projects import MAX_BYTES, NO_SIZE, Size, on_earth, reconstructed
from upplied.inputs.sources.source import (
    Fields,
    Source,
    cameras,
    fixes,
    focal_of_35mm,
    gimbals,
    numbered,
    poses,
)
from upplied.records import Floats


def read(path: Path, fields: Fields) -> Source:
    """The cameras of a project."""
    data = read_regular(path, MAX_BYTES)
    if data.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"<"):
        return _metashape(path, ElementTree.fromstring(data, forbid_dtd=True))
    return _realitycapture(path, data.decode("utf-8-sig"))


def _metashape(path: Path, root: Any) -> Source:
    """Matrices from the camera to the chunk, and where it is placed from the chunk to the Earth's centre."""
    chunk = next(root.iter("chunk"), None)
    found = (
        [] if chunk is None else [each for each in chunk.iter("camera") if each.find("transform") is not None]
    )
    if chunk is None or len(found) < 2:
        raise InputError(
            str(path), f"holds {len(found)} aligned cameras", "at least two", "align the photos, export again"
        )
    matrices = np.array([_numbers(each.find("transform"), 16) for each in found]).reshape(-1, 4, 4)
    part = next(
        (each for each in (*chunk.iter("component"), chunk) if each.find("transform") is not None), None
    )
    place = None if part is None else part.find("transform")
    sizes = {each.get("id"): _sensor(each) for each in chunk.iter("sensor")}
    lenses = [sizes.get(each.get("sensor_id"), NO_SIZE) for each in found]
    turn = None if place is None else place.find("rotation")
    if place is None or turn is None:
        return reconstructed(path, matrices[:, :3, :3], matrices[:, :3, 3], sizes=lenses)
    scale = float(place.findtext("scale") or 1.0)
    whole = _numbers(turn, 9).reshape(3, 3)
    shift = _numbers(place.find("translation"), 3)
    ecef = scale * matrices[:, :3, 3] @ whole.T + shift
    lat, lon, alt = (float(value) for value in pymap3d.ecef2geodetic(*ecef.mean(axis=0)))
    if np.linalg.norm(shift) < 1e6:  # a project in metres of its own, not on the Earth
        return reconstructed(path, whole @ matrices[:, :3, :3], ecef, sizes=lenses, scaled=True)
    enu = np.column_stack(pymap3d.ecef2enu(*ecef.T, lat, lon, alt))
    axes = np.column_stack([pymap3d.ecef2enuv(*axis, lat, lon) for axis in np.eye(3)])
    source = reconstructed(path, axes @ whole @ matrices[:, :3, :3], enu, sizes=lenses, scaled=True)
    on_earth(source, enu, (lat, lon, alt))
    source.tables[-2].columns["alt_ellipsoid"] = source.tables[-2].columns.pop("alt")
    source.notes[-1] = "a Metashape chunk on the Earth: heights above the ellipsoid"
    source.tables.pop(0)  # a frame of nobody else's
    return source


def _sensor(sensor: Any) -> Size:
    size, focal = sensor.find("resolution"), sensor.findtext(".//f")
    if size is None or focal is None:
        return NO_SIZE
    return float(size.get("width", "nan")), float(size.get("height", "nan")), float(focal)


def _numbers(node: Any, count: int) -> Floats:
    values = np.array((node.text or "").split() if node is not None else [], float)
    if len(values) != count:
        raise ValueError(f"a matrix has {len(values)} numbers instead of {count}")
    return values


def _realitycapture(path: Path, text: str) -> Source:
    """``#name,x,y,alt,heading,pitch,roll,f``: degrees; x and y in degrees too where they are of the Earth."""
    rows = list(csv.DictReader(io.StringIO(text.lstrip("#"))))
    value = {
        name: np.array([float(row[name]) for row in rows])
        for name in ("x", "y", "alt", "heading", "pitch", "roll")
    }
    if len(rows) < 2:
        raise InputError(
            str(path), f"holds {len(rows)} cameras", "at least two", "align the photos, export again"
        )
    t_ns = numbered(len(rows))
    angles = value["heading"], value["pitch"] - 90, value["roll"]  # 0 looks down in RealityCapture
    focal = np.array([float(row.get("f") or "nan") for row in rows])
    lens = (
        [cameras("/cameras", t_ns, 36.0, 24.0, focal_of_35mm(36.0, 24.0, focal))]
        if np.isfinite(focal).all()
        else []
    )
    notes = ["the export says no times: one photo every 2 s, in its order"]
    if (np.abs(value["x"]) <= 180).all() and (np.abs(value["y"]) <= 90).all():
        notes.append("RealityCapture: x and y are taken for longitude and latitude, alt above the ellipsoid")
        place = fixes("/cameras", t_ns, value["y"], value["x"], alt_ellipsoid=value["alt"])
        return Source([place, gimbals("/cameras", t_ns, *angles), *lens], notes=notes, stills=True)
    yaw, pitch, roll = angles
    turns = Rotation.from_euler("ZYX", np.column_stack([90 - yaw, -pitch, roll]), degrees=True).as_quat()
    centres = np.column_stack([value["x"], value["y"], value["alt"]])
    defaults = {"body_frame": "camera"}
    return Source(
        [poses("/cameras", t_ns, centres, turns, "project"), *lens],
        notes=notes,
        defaults=defaults,
        stills=True,
    )
