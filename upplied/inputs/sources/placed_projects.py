"""Cameras of Metashape and RealityCapture, which place a project on the Earth themselves."""

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
from defusedxml import ElementTree
from scipy.spatial.transform import Rotation

from upplied.inputs.files import read_regular
from upplied.inputs.sources import source as fill
from upplied.inputs.sources.projects import NO_SIZE, Size, lens_by, on_earth, reconstructed
from upplied.inputs.sources.source import MAX_BYTES, SHAPE, Fields, Source, refusal
from upplied.records import Floats

_CALIBRATION = ("f", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2")
_ALIGN = ("at least two", "align the photos, export again")
ERRORS = SHAPE


def read(path: Path, fields: Fields) -> Source:
    """The cameras of a project."""
    data = read_regular(path, MAX_BYTES)
    if data.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"<"):
        return _metashape(ElementTree.fromstring(data, forbid_dtd=True))
    return _realitycapture(data.decode("utf-8-sig"))


def _metashape(root: Any) -> Source:
    """Matrices from the camera to the chunk, and where it is placed from the chunk to the Earth's centre."""
    chunk = next(root.iter("chunk"), None)
    listed = [] if chunk is None else chunk.iter("camera")
    shots = [each for each in listed if each.find("transform") is not None]
    if chunk is None or len(shots) < 2:
        raise refusal(f"holds {len(shots)} aligned cameras", *_ALIGN)
    matrices = np.array([_numbers(each.find("transform"), 16) for each in shots]).reshape(-1, 4, 4)
    turns, centres = matrices[:, :3, :3], matrices[:, :3, 3]
    sizes = {each.get("id"): _sensor(each) for each in chunk.iter("sensor")}
    lenses = [sizes.get(each.get("sensor_id"), NO_SIZE) for each in shots]
    places = (each.find("transform") for each in (*chunk.iter("component"), chunk))
    place = next((each for each in places if each is not None), None)
    if place is None or place.find("rotation") is None:
        return reconstructed(turns, centres, sizes=lenses)
    whole, shift = _numbers(place.find("rotation"), 9).reshape(3, 3), _numbers(place.find("translation"), 3)
    ecef = float(place.findtext("scale") or 1.0) * centres @ whole.T + shift
    if np.linalg.norm(shift) < 1e6:  # a project in metres of its own, not on the Earth
        return reconstructed(whole @ turns, ecef, sizes=lenses, scaled=True)
    lat, lon, alt = (float(value) for value in pymap3d.ecef2geodetic(*ecef.mean(axis=0)))
    enu = np.column_stack(pymap3d.ecef2enu(*ecef.T, lat, lon, alt))
    axes = np.column_stack([pymap3d.ecef2enuv(*axis, lat, lon) for axis in np.eye(3)])
    source = reconstructed(axes @ whole @ turns, enu, sizes=lenses, scaled=True)
    on_earth(source, enu, (lat, lon, alt), "alt_ellipsoid")
    source.tables.pop(0)  # in a frame that nothing else shares
    return source


def _sensor(sensor: Any) -> Size:
    size = sensor.find("resolution")
    known = next((each for each in sensor.iter("calibration") if each.find("f") is not None), None)
    if size is None or known is None:
        return NO_SIZE
    width, height = float(size.get("width", "nan")), float(size.get("height", "nan"))
    values = {each.tag: float(each.text or "nan") for each in known if each.tag in _CALIBRATION}
    values |= {"p1": values.get("p2", 0.0), "p2": values.get("p1", 0.0)}  # the other way round in OpenCV
    middle = 0.5 + values.get("cx", 0.0) / width, 0.5 + values.get("cy", 0.0) / height
    model = str(sensor.get("type") or "frame")
    return width, height, values["f"], lens_by(values, model if model in ("frame", "fisheye") else "", middle)


def _numbers(node: Any, count: int) -> Floats:
    values = np.array((node.text or "").split() if node is not None else [], float)
    if len(values) != count:
        raise ValueError(f"a matrix has {len(values)} numbers instead of {count}")
    return values


def _realitycapture(text: str) -> Source:
    """``#name,x,y,alt,heading,pitch,roll,f``: degrees; x and y in degrees too where they are of the Earth."""
    rows = list(csv.DictReader(io.StringIO(text.lstrip("#"))))
    if len(rows) < 2:
        raise refusal(f"holds {len(rows)} cameras", *_ALIGN)
    names = ("x", "y", "alt", "heading", "pitch", "roll")
    x, y, alt, yaw, pitch, roll = np.array([[float(row[name]) for name in names] for row in rows]).T
    pitch = pitch - 90  # 0 looks down in RealityCapture
    focal = np.array([float(row.get("f") or "nan") for row in rows])
    t_ns, tables = fill.numbered(len(rows)), []
    notes = ["the export holds no times: one photo every 2 s, in its order"]
    if np.isfinite(focal).all():
        tables = [fill.cameras("/cameras", t_ns, 36.0, 24.0, fill.focal_of_35mm(36.0, 24.0, focal))]
    if (np.abs(x) <= 180).all() and (np.abs(y) <= 90).all():
        notes.append("RealityCapture: x and y are taken for longitude and latitude, alt above the ellipsoid")
        place = fill.fixes("/cameras", t_ns, y, x, alt_ellipsoid=alt)
        tables = [place, fill.gimbals("/cameras", t_ns, yaw, pitch, roll), *tables]
        return Source(tables, notes=notes, stills=True, timed=False)
    turns = Rotation.from_euler("ZYX", np.column_stack([90 - yaw, -pitch, roll]), degrees=True).as_quat()
    poses = fill.poses("/cameras", t_ns, np.column_stack([x, y, alt]), turns, "project")
    facts = {"body_frame": "camera"}
    return Source([poses, *tables], notes=notes, defaults=facts, stills=True, timed=False)
