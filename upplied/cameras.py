"""Cameras that inspect, by name: their pixels, lenses and least times between photos (`cameras.toml`)."""

import math
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import replace
from importlib import resources
from typing import Any

from upplied.errors import SettingsError
from upplied.records import Camera

FILE_FORMATS = ("jpeg", "raw")
#: Least time between two photos where neither camera nor flight says it, s.
DEFAULT_TRIGGER_S = 2.0
_SAME_LENS = 0.05  # of a focal length
_FIGURES = {
    "sensor_mm": "sensor width", "dfov_deg": "field of view", "width_px": "width in pixels",
    "height_px": "height in pixels", "focal_mm": "focal length", "f_number": "aperture",
    "focus_m": "nearest focus", "trigger_s": "least time between photos",
}  # fmt: skip
_OF_FIELD = ("sensor_mm", "dfov_deg")  # they give the field of view and nothing else


def known_cameras() -> Mapping[str, Mapping[str, Any]]:
    """The entries of `cameras.toml` by their names."""
    return tomllib.loads(resources.files("upplied").joinpath("cameras.toml").read_text("utf-8"))


def known_camera(name: str, file_format: str = "jpeg") -> Camera:
    """A camera of the list, for photos of a format: the longest time stated counts where none is for it.

    Examples
    --------
    >>> camera = known_camera("dji-phantom-4-rtk")
    >>> round(camera.hfov_deg, 1), camera.width_px, camera.trigger_s
    (73.7, 5472, 2.5)
    """
    cameras = known_cameras()
    if name not in cameras:
        raise SettingsError(f"camera {name!r}", "is unknown", f"one of {', '.join(cameras)}")
    if file_format not in FILE_FORMATS:
        raise SettingsError(f"file format {file_format!r}", "is unknown", f"one of {', '.join(FILE_FORMATS)}")
    entry = cameras[name]
    width, height = entry["width_px"], entry["height_px"]
    if "sensor_mm" in entry:
        half = entry["sensor_mm"] / (2 * entry["focal_mm"])
    else:
        half = math.tan(math.radians(entry["dfov_deg"]) / 2) * width / math.hypot(width, height)
    triggers = entry.get("trigger_s", {})
    focus = entry.get("focus_m", 0.0)
    return Camera(
        hfov_deg=math.degrees(2 * math.atan(half)),
        vfov_deg=math.degrees(2 * math.atan(half * height / width)),
        min_range_m=max(Camera.min_range_m, focus),
        width_px=width,
        height_px=height,
        model=name,
        trigger_s=triggers.get(file_format, max(triggers.values(), default=0.0)),
        focus_m=focus,
        focal_mm=entry["focal_mm"],
        f_number=entry.get("f_number", 0.0),
    )


def named_by_exif(model: str, focal_mm: float) -> str:
    """The name of the camera that EXIF means by its model and focal length; empty where none is listed.

    Examples
    --------
    >>> named_by_exif("DJI ZenmuseP1", 50.0)
    'dji-zenmuse-p1-50'
    """
    words = model.split()
    for name, entry in known_cameras().items():
        lens = entry.get("lens_mm")
        fits = lens is None or abs(focal_mm / lens - 1) < _SAME_LENS
        if fits and any(model_name in words for model_name in entry.get("exif", ())):
            return name
    return ""


def named_by_drone(drone: str) -> str:
    """The name of the camera that a drone carries; empty where none is listed."""
    return next((name for name, entry in known_cameras().items() if drone in entry.get("drone", ())), "")


def completed(camera: Camera, known: Camera) -> Camera:
    """A camera with what is known of its model where nothing was measured or said of it."""
    names = ("width_px", "height_px", "model", "trigger_s", "focus_m", "focal_mm", "f_number")
    missing = {name: getattr(known, name) for name in names if not getattr(camera, name)}
    return replace(camera, **missing)


def least_interval(camera: Camera | None) -> tuple[float, str]:
    """Least time between two photos, s, and where it is known from, in words."""
    if camera is None or not camera.trigger_s:
        return DEFAULT_TRIGGER_S, "assumed: the interval of the camera is unknown"
    if camera.model:
        doubtful = known_cameras().get(camera.model, {}).get("unverified", ())
        doubt = ", not verified" if "trigger_s" in doubtful else ""
        return camera.trigger_s, f"of the camera {camera.model}{doubt}"
    return camera.trigger_s, "as the demonstration took them"


def unverified(name: str, stated: Collection[str] = ()) -> str:
    """The figures of a camera of the list that were read nowhere, in words; empty where there are none.

    `stated` are the fields of `Camera` that are known of the flight itself.

    Examples
    --------
    >>> unverified("dji-mavic-3e", ("hfov_deg", "focus_m", "trigger_s"))
    'focal length, aperture of dji-mavic-3e not verified'
    >>> unverified("sony-a7r-iv-35")
    ''
    """
    known = {*stated, *(_OF_FIELD if "hfov_deg" in stated else ())}
    figures = set(known_cameras()[name].get("unverified", ())) - known
    listed = [words for key, words in _FIGURES.items() if key in figures]
    return f"{', '.join(listed)} of {name} not verified" if listed else ""
