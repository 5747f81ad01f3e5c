"""Photogrammetry: cameras of OpenSfM, OpenDroneMap, nerfstudio, Bundler, NVM, Metashape, RealityCapture."""

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
from defusedxml import ElementTree
from scipy.spatial.transform import Rotation

from upplied.inputs.files import read_regular
from upplied.inputs.flight.tracks import OPTICAL_R_CAMERA
from upplied.inputs.sources import source as fill
from upplied.inputs.sources.source import MAX_BYTES, SHAPE, Fields, Source, refusal
from upplied.records import Floats, Ints, Lens, Placement

_FLIPPED = np.diag([1.0, -1.0, -1.0])  # of cameras that look along -z, y up
# Width, height and focal length, pixels; None: a lens of another model.
Size = tuple[float, float, float, Lens | None]
NO_SIZE = (math.nan, math.nan, math.nan, Lens())
UNKNOWN_LENS = "distortion of the camera is not used: it is not Brown and Conrady's, or a plain fisheye's"
_OPENSFM = ("perspective", "simple_radial", "radial", "brown", "fisheye", "fisheye_opencv")
ERRORS = SHAPE


def read(path: Path, fields: Fields) -> Source:
    """The cameras of a project."""
    data = read_regular(path, MAX_BYTES)
    start = data.lstrip(b"\xef\xbb\xbf \r\n\t")[:40]
    if start[:1] in (b"[", b"{"):
        content = json.loads(data)
        return _nerfstudio(content) if isinstance(content, dict) else _opensfm(content)
    if start.startswith(b"# Bundle"):
        return _bundler(data.decode("ascii").split("\n"))
    if start.startswith(b"NVM_V3"):
        return _nvm(data.decode("utf-8", "replace").split("\n"))
    if start.startswith(b"<"):
        return _metashape(ElementTree.fromstring(data, forbid_dtd=True))
    return _realitycapture(data.decode("utf-8-sig"))


def reconstructed(
    matrices: Floats, centres: Floats, times: Ints | None = None, sizes: Sequence[Size] = (),
    scaled: bool = False, notes: Sequence[str] = (),
) -> Source:  # fmt: skip
    """The flight of cameras (N, 3, 3), to the project's frame, at (N, 3) in it."""
    matrices, centres = np.reshape(matrices, (-1, 3, 3)), np.reshape(centres, (-1, 3))
    if len(centres) < 2:
        raise refusal(f"holds {len(centres)} cameras with a pose", "at least two", "align the photos")
    if not np.isfinite(matrices).all() or (np.abs(np.linalg.det(matrices) - 1) > 1e-2).any():
        raise refusal("holds turns of cameras that are no rotations", "an unedited export", "export it again")
    quats = (Rotation.from_matrix(matrices) * OPTICAL_R_CAMERA).as_quat()
    notes, timed = list(notes), times is not None
    if times is None:
        times = fill.numbered(len(centres))
        notes.append("the project holds no times: one photo every 2 s, in its order")
    tables = [fill.poses("/cameras", times, centres, quats, "project")]
    known = np.array([size[:3] for size in sizes], float).reshape(-1, 3)
    if len(known) == len(centres) and np.isfinite(known).all():
        lenses = [lens for *_, lens in sizes if lens is not None]
        unknown, (width, height, focal) = len(lenses) < len(known), known.T
        tables.append(fill.cameras("/cameras", times, width, height, focal, () if unknown else lenses))
        notes += [UNKNOWN_LENS] * unknown
    defaults: dict[str, Any] = {"body_frame": "camera"} | ({} if scaled else {"unit_m": math.nan})
    return Source(tables, notes=notes, defaults=defaults, stills=True, timed=timed)


def _opensfm(content: list[Any]) -> Source:
    """A turn is an axis with its angle, world to camera; the world is east, north and up of a place."""
    if not (parts := [part for part in content if part.get("shots")]):
        raise refusal("holds no reconstructed photo", "a reconstruction with shots", "run the project again")
    part = max(parts, key=lambda each: len(each["shots"]))
    shots = [shot for _, shot in sorted(part["shots"].items())]
    stamps, times = np.array([float(shot.get("capture_time") or 0) for shot in shots]), None
    if (stamps > 1).all() and np.ptp(stamps) > 0:
        times = fill.spread(np.round(stamps * 1e9).astype(np.int64))
        order = np.argsort(times, kind="stable")
        shots, times = [shots[at] for at in order], times[order]
    turns = Rotation.from_rotvec([shot["rotation"] for shot in shots]).inv()
    centres = -turns.apply([shot["translation"] for shot in shots])
    sizes = [_lens(part.get("cameras", {}).get(shot.get("camera"), {})) for shot in shots]
    place = part.get("reference_lla")
    notes = [f"{len(parts) - 1} smaller parts of the reconstruction are left out"] if len(parts) > 1 else []
    source = reconstructed(turns.as_matrix(), centres, times, sizes, place is not None, notes)
    if place is not None:
        lla = float(place["latitude"]), float(place["longitude"]), float(place["altitude"])
        on_earth(source, centres, lla)
        source.place = Placement(*lla, 90.0, "amsl")
    return source


def on_earth(source: Source, enu: Floats, place: tuple[float, float, float], height: str = "alt") -> None:
    """The same cameras by latitude and longitude, for a structure that is placed so."""
    table = source.tables[0]
    lat, lon, alt = pymap3d.enu2geodetic(*enu.T, *place)
    quats = Rotation.from_quat(table.stack(*(f"pose.orientation.{axis}" for axis in "xyzw")))
    yaw, pitch, roll = quats.as_euler("ZYX", degrees=True).T  # of x forward, y left, z up in east, north, up
    source.tables.append(fill.fixes("/cameras_on_earth", table.log_ns, lat, lon, **{height: alt}))
    source.tables.append(fill.attitudes("/cameras_on_earth", table.log_ns, 90 - yaw, -pitch, roll))
    datum = "ellipsoid" if height == "alt_ellipsoid" else "mean sea level"
    source.notes.append(f"heights of the project are taken to be above the {datum}")


def _lens(lens: Any) -> Size:
    width, height = float(lens.get("width", math.nan)), float(lens.get("height", math.nan))
    focal = lens.get("focal", lens.get("focal_x", math.nan))  # of the longer side
    side, model = max(width, height), str(lens.get("projection_type", "perspective"))
    middle = 0.5 + float(lens.get("c_x", 0)) * side / width, 0.5 + float(lens.get("c_y", 0)) * side / height
    return width, height, float(focal) * side, lens_by(lens, model if model in _OPENSFM else "", middle)


def lens_by(values: Any, model: str, middle: tuple[float, float]) -> Lens | None:
    """A lens whose coefficients have the names of OpenCV; None where the model has no name."""
    if not model:
        return None
    fisheye = "fisheye" in model.lower()
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    coefficients = tuple(float(values.get(name) or 0.0) for name in names)
    return Lens("fisheye" if fisheye else "brown", coefficients, middle)


def _nerfstudio(content: dict[str, Any]) -> Source:
    """Matrices from the camera to the world; the camera looks along -z, y up."""
    frames = sorted(content.get("frames", []), key=lambda frame: str(frame.get("file_path", "")))
    matrices = np.array([frame["transform_matrix"] for frame in frames], float).reshape(-1, 4, 4)
    if "applied_transform" in content:  # from the frame of the reconstruction to that of the file
        applied = np.vstack([np.array(content["applied_transform"], float)[:3], [0, 0, 0, 1]])
        matrices = np.linalg.inv(applied) @ matrices
    sizes = []
    for frame in (content | frame for frame in frames):
        width, height = float(frame.get("w", math.nan)), float(frame.get("h", math.nan))
        focal = frame.get("fl_x") or width / 2 / math.tan(float(frame.get("camera_angle_x", math.nan)) / 2)
        middle = float(frame.get("cx", width / 2)) / width, float(frame.get("cy", height / 2)) / height
        lens = lens_by(frame, str(frame.get("camera_model", "OPENCV")), middle)
        sizes.append((width, height, float(focal), lens))
    return reconstructed(matrices[:, :3, :3] @ _FLIPPED, matrices[:, :3, 3], sizes=sizes)


def _bundler(lines: list[str]) -> Source:
    """Turns and shifts from the world to the camera, which looks along -z; without a focal length no pose."""
    count = int(lines[1].split()[0])
    rows = [[float(value) for value in line.split()] for line in lines[2 : 2 + 5 * min(count, 1_000_000)]]
    shots = [rows[at : at + 5] for at in range(0, len(rows) - 4, 5) if rows[at][0] > 0]
    turns = np.array([each[1:4] for each in shots]).reshape(-1, 3, 3)
    shifts = np.array([each[4] for each in shots]).reshape(-1, 3)
    return reconstructed(np.swapaxes(turns, 1, 2) @ _FLIPPED, -np.einsum("nji,nj->ni", turns, shifts))


def _nvm(lines: list[str]) -> Source:
    """Name, focal length, quaternion ``w x y z`` from the world to the camera, and the camera's centre."""
    at = next((index for index, line in enumerate(lines[1:], 1) if line.strip()), 0)
    rows = sorted(line.replace("\t", " ").rsplit(" ", 10) for line in lines[at + 1 : at + 1 + int(lines[at])])
    values = np.array([[float(value) for value in row[1:9]] for row in rows])
    return reconstructed(Rotation.from_quat(values[:, [2, 3, 4, 1]]).inv().as_matrix(), values[:, 5:8])


_CALIBRATION = ("f", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2")
_ALIGN = ("at least two", "align the photos, export again")


def _metashape(root: Any) -> Source:
    """Matrices from the camera to the chunk, and where it is placed from the chunk to the Earth's centre."""
    listed = [] if (chunk := next(root.iter("chunk"), None)) is None else chunk.iter("camera")
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
    if len(rows := list(csv.DictReader(io.StringIO(text.lstrip("#"))))) < 2:
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
    tables = [fill.poses("/cameras", t_ns, np.column_stack([x, y, alt]), turns, "project"), *tables]
    return Source(tables, notes=notes, defaults={"body_frame": "camera"}, stills=True, timed=False)
