"""The head of a photo: tags of EXIF, and attitudes in each maker's XMP."""

import logging
import re
from pathlib import Path
from typing import Any

import exifread
import numpy as np
from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from upplied.errors import InputError
from upplied.inputs.files import open_regular, table
from upplied.inputs.sources.source import dated, focal_of_35mm

_HEAD = 1 << 18  # bytes in which the XMP begins and ends
_NAMES: dict[str, list[str]] = table("kinds.toml")["photo"]
_LENS = {"exposure_s": "ExposureTime", "f_number": "FNumber", "focal_mm": "FocalLength"}
_NED = re.compile(r"(Camera)OrientationNED", re.IGNORECASE)  # Skydio: yaw, pitch and roll within

logging.getLogger("exifread").setLevel(logging.CRITICAL)  # damaged tags are no news


def head_of(path: Path) -> dict[str, Any]:
    """Values in the head of one photo; NaN where it has none."""
    names = (*_NAMES, "exif_alt", "t_ms", "width", "height", *_LENS)
    values: dict[str, Any] = dict.fromkeys(names, float("nan"))
    try:
        with open_regular(path) as stream:
            xmp = _xmp(stream.read(_HEAD))
            stream.seek(0)
            tags = exifread.process_file(stream, details=False, extract_thumbnail=False)
    except (InputError, OSError):
        raise
    except Exception:  # tags that are damaged say nothing
        tags, xmp = {}, {}
    for name, written in _NAMES.items():
        values[name] = next((xmp[local] for local in written if local in xmp), values[name])
    for name, axis in (("lat", "Latitude"), ("lon", "Longitude")):
        values[name] = values[name] if np.isfinite(values[name]) else _degrees(tags, f"GPS GPS{axis}")
    values["camera"] = " ".join(str(tags.get(f"Image {name}", "?")).strip() for name in ("Make", "Model"))
    below = -1.0 if str(tags.get("GPS GPSAltitudeRef", "0")) == "1" else 1.0
    values["exif_alt"] = below * _ratio(tags.get("GPS GPSAltitude"))
    values["absolute"] = values["absolute"] if np.isfinite(values["absolute"]) else values["exif_alt"]
    values["width"] = _ratio(tags.get("EXIF ExifImageWidth", tags.get("Image ImageWidth")))
    values["height"] = _ratio(tags.get("EXIF ExifImageLength", tags.get("Image ImageLength")))
    focal_mm = _ratio(tags.get("EXIF FocalLengthIn35mmFilm"))
    if np.isnan(values["focal_px"]) and focal_mm > 0:
        values["focal_px"] = float(focal_of_35mm(values["width"], values["height"], focal_mm))
    values |= {name: _ratio(tags.get(f"EXIF {tag}")) for name, tag in _LENS.items()}
    text = str(tags.get("EXIF DateTimeOriginal", tags.get("Image DateTime", "")))
    part = str(tags.get("EXIF SubSecTimeOriginal", "")).strip()
    part_s = float(f"0.{part}") if part.isdigit() else 0.0
    zone = re.fullmatch(r"([+-])(\d\d):(\d\d)", str(tags.get("EXIF OffsetTimeOriginal", "")).strip())
    ahead_s = float(f"{zone[1]}1") * (int(zone[2]) * 60 + int(zone[3])) * 60 if zone else 0.0
    values["t_ms"] = dated(text.replace(":", "-", 2)) + (part_s - ahead_s) * 1e3
    if np.isfinite(values["utc_us"]):
        values["t_ms"] = values["utc_us"] / 1e3
    return values


def _xmp(head: bytes) -> dict[str, float]:
    """Numbers of the XMP by local name, whether attributes or elements."""
    start, stop = head.find(b"<x:xmpmeta"), head.find(b"</x:xmpmeta>")
    if not 0 <= start < stop:
        return {}
    try:
        root = ElementTree.fromstring(head[start : stop + 12], forbid_dtd=True)
    except (ElementTree.ParseError, DefusedXmlException, ValueError):
        return {}
    numbers: dict[str, float] = {}
    for node in root.iter():
        inside = _NED.search(node.tag)
        for name, text in [(node.tag, node.text or ""), *node.attrib.items()]:
            local = name.rsplit("}", 1)[-1]
            if (inside or _NED.search(name)) and (axis := re.search(r"(Yaw|Pitch|Roll)$", local)):
                local = f"Gimbal{axis[1]}Degree"
            try:
                numbers.setdefault(local, float(text))
            except ValueError:
                continue
    return numbers


def _degrees(tags: Any, name: str) -> float:
    try:
        parts = [float(part) for part in tags[name].values[:3]]
    except (KeyError, AttributeError, TypeError, ValueError, ZeroDivisionError):
        return float("nan")
    value = sum(part / 60**at for at, part in enumerate(parts))
    return -value if str(tags.get(f"{name}Ref", "")) in ("S", "W") else value


def _ratio(tag: Any) -> float:
    try:
        return float(tag.values[0])
    except (AttributeError, IndexError, TypeError, ValueError, ZeroDivisionError):
        return float("nan")
