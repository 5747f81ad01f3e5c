"""A folder of drone photos: positions, times and cameras of EXIF, attitudes of XMP. Heads alone are read.

A gimbal's yaw counts from north, on some models from the nose; heights from take-off, unless RTK fixed them.
"""

import logging
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import exifread
import numpy as np
from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from upplied.cameras import named_by_exif
from upplied.inputs.files import open_regular, table
from upplied.inputs.sources import source as fill
from upplied.inputs.sources.source import Fields, Source, refusal
from upplied.inputs.tables import Table
from upplied.records import Floats, Ints

ENDINGS = (".jpg", ".jpeg", ".dng", ".tif", ".tiff")
MAX_PHOTOS = 100_000
_RTK_FIXED, _RTK_M = 50, 0.05
_NADIR_DEG, _TURN_DEG, _STILL_DEG = 85.0, 60.0, 15.0
_HEAD = 1 << 18  # bytes in which the XMP begins and ends
_NAMES: dict[str, list[str]] = table("kinds.toml")["photo"]
_LENS = {"exposure_s": "ExposureTime", "f_number": "FNumber", "focal_mm": "FocalLength"}
_NED = re.compile(r"(Camera)OrientationNED", re.IGNORECASE)  # Skydio: yaw, pitch and roll within

logging.getLogger("exifread").setLevel(logging.CRITICAL)  # damaged tags are no news


def members(folder: Path) -> list[Path]:
    """The photos that lie in a folder, by name."""
    names = (path for path in folder.iterdir() if path.suffix.lower() in ENDINGS and path.is_file())
    return sorted(names)[: MAX_PHOTOS + 1]


def read(path: Path, fields: Fields) -> Source:
    """The looks of a folder of photos, or of one photo."""
    names = members(path) if path.is_dir() else [path]
    if len(names) > MAX_PHOTOS:
        raise refusal(f"holds more than {MAX_PHOTOS} photos", "one flight", "split the folder")
    with ThreadPoolExecutor(4) as threads:
        heads = list(threads.map(head_of, names))
    placed = [it for it in heads if np.isfinite(it["lat"] + it["lon"]) and (it["lat"] or it["lon"])]
    finding = f"{len(placed)} of {len(heads)} photos have a place"
    if len(placed) < 2:
        remedy = "copy the originals: programs that resize or edit photos drop their tags"
        raise refusal(finding, "at least two", remedy)
    if len(models := sorted({head.pop("camera") for head in placed})) > 1:
        finding = f"holds photos of {len(models)} cameras ({', '.join(models[:5])})"
        raise refusal(finding, "one flight", "put the photos of each flight into a folder of its own")
    at = {name: np.array([head[name] for head in placed], float) for name in placed[0]}
    if timed := bool(np.isfinite(at["t_ms"]).all()):
        notes = ["times of photos are taken to be UTC where they name no zone"]
        t_ns = fill.spread(np.round(at["t_ms"] * 1e6).astype(np.int64))
    else:
        notes = ["not all photos hold a time: by their names, one every 2 s"]
        t_ns = fill.numbered(len(placed))
    order = np.argsort(t_ns, kind="stable")
    at, t_ns = {name: column[order] for name, column in at.items()}, t_ns[order]
    facts, lost = _lens(at, models[0]), [finding] if len(placed) < len(heads) else []
    tables = [*_tables(at, t_ns, notes)]
    return Source(tables, [], lost, notes=notes, stills=True, defaults=facts, timed=timed)


def _lens(at: dict[str, Floats], model: str) -> dict[str, Any]:
    """What photos say of camera, lens and places, as facts; of exposures the longest, which blurs most."""
    counts: dict[str, Any] = {"exposure_s": np.max, "f_number": np.median, "focal_mm": np.median}
    known = {name: at[name][np.isfinite(at[name]) & (at[name] > 0)] for name in counts}
    facts: dict[str, Any] = {
        f"camera_{name}": float(counts[name](values)) for name, values in known.items() if len(values)
    }
    if name := named_by_exif(model, facts.get("camera_focal_mm", 0.0)):
        facts["camera_model"] = name
    return facts if (accuracy_m := _accuracy_m(at)) is None else facts | {"accuracy_m": accuracy_m}


def _accuracy_m(at: dict[str, Floats]) -> float | None:
    """One sigma of the worst place, m, where RTK fixed all; the usual where some photo does not state it."""
    if not ((at["rtk"] == _RTK_FIXED).all() and np.isfinite(at["absolute"]).all()):
        return None
    sigma = np.sqrt(at["sigma"] ** 2 + at["sigma_east"] ** 2 + at["sigma_north"] ** 2)
    return float(sigma.max()) if np.isfinite(sigma).all() else _RTK_M


def _tables(at: dict[str, Floats], t_ns: Ints, notes: list[str]) -> Iterator[Table]:
    mostly = {name: np.isfinite(column).mean() >= 0.5 for name, column in at.items()}
    if (accuracy_m := _accuracy_m(at)) is not None:
        notes.append(f"fixed by RTK to {accuracy_m:.2f} m")
        yield fill.fixes("/photos", t_ns, at["lat"], at["lon"], alt_ellipsoid=at["absolute"])
    elif mostly["relative"]:
        yield fill.fixes("/photos", t_ns, at["lat"], at["lon"], alt_takeoff=at["relative"])
    elif mostly["exif_alt"]:
        notes.append("altitudes of EXIF are taken to be above mean sea level")
        yield fill.fixes("/photos", t_ns, at["lat"], at["lon"], alt=at["exif_alt"])
    else:
        raise refusal("photos hold no height", "a height above take-off or sea level", "use the originals")
    if mostly["pitch"]:
        yield fill.gimbals("/photos", t_ns, _yaw(at, notes), at["pitch"], np.nan_to_num(at["roll"]))
    elif mostly["flight"]:
        notes.append("no gimbal in the photos: the camera is taken to look ahead, level")
        yield fill.attitudes("/photos", t_ns, at["flight"], 0 * at["flight"], 0 * at["flight"])
    if np.isfinite(at["focal_px"]).any() and np.isfinite(at["width"]).any():
        yield fill.cameras("/photos", t_ns, at["width"], at["height"], at["focal_px"])


def _yaw(at: dict[str, Floats], notes: list[str]) -> Floats:
    """Yaw from north: where it stays near 0 while the aircraft turns, it counts from the nose."""
    yaw, flight = at["gimbal"], at["flight"]
    known = np.isfinite(yaw) & np.isfinite(flight)
    steep = np.abs(at["pitch"]) > _NADIR_DEG
    some = known & ~steep if (known & ~steep).sum() >= 5 else known  # of a nadir yaw half a turn may be off
    turns = np.unwrap(np.radians(flight[some])) if some.any() else np.zeros(1)
    relative = np.abs((yaw[some] + 180) % 360 - 180)
    if some.sum() >= 3 and np.degrees(np.ptp(turns)) > _TURN_DEG and np.percentile(relative, 90) < _STILL_DEG:
        notes.append("the gimbal's yaw counts from the aircraft's nose here: the aircraft's is added")
        return np.where(known, yaw + flight, np.nan)
    if known.any() and steep[known].mean() > 0.5:
        notes.append("most photos look straight down: which way is up in them is known to half a turn")
    return np.where(np.isfinite(yaw), yaw, flight)


def head_of(path: Path) -> dict[str, Any]:
    """Values in the head of one photo; NaN where it has none."""
    try:
        with open_regular(path) as stream:
            xmp = _xmp(stream.read(_HEAD))
            stream.seek(0)
            tags = exifread.process_file(stream, details=False, extract_thumbnail=False)
    except OSError:
        raise
    except Exception:  # tags that are damaged say nothing
        tags, xmp = {}, {}
    values: dict[str, Any] = {}
    for name, written in _NAMES.items():
        values[name] = next((xmp[local] for local in written if local in xmp), float("nan"))
    for name, axis, minus in (("lat", "GPS GPSLatitude", "S"), ("lon", "GPS GPSLongitude", "W")):
        if not np.isfinite(values[name]):
            degrees = sum(part / 60**at for at, part in enumerate(_numbers(tags.get(axis), 3)))
            values[name] = -degrees if str(tags.get(f"{axis}Ref")) == minus else degrees
    values["camera"] = " ".join(str(tags.get(f"Image {name}", "?")).strip() for name in ("Make", "Model"))
    below = -1.0 if str(tags.get("GPS GPSAltitudeRef", "0")) == "1" else 1.0
    values["exif_alt"] = below * _numbers(tags.get("GPS GPSAltitude"))[0]
    values["absolute"] = values["absolute"] if np.isfinite(values["absolute"]) else values["exif_alt"]
    values["width"] = _numbers(tags.get("EXIF ExifImageWidth", tags.get("Image ImageWidth")))[0]
    values["height"] = _numbers(tags.get("EXIF ExifImageLength", tags.get("Image ImageLength")))[0]
    focal_mm = _numbers(tags.get("EXIF FocalLengthIn35mmFilm"))[0]
    if np.isnan(values["focal_px"]) and focal_mm > 0:
        values["focal_px"] = float(fill.focal_of_35mm(values["width"], values["height"], focal_mm))
    values |= {name: _numbers(tags.get(f"EXIF {tag}"))[0] for name, tag in _LENS.items()}
    text = str(tags.get("EXIF DateTimeOriginal", tags.get("Image DateTime", "")))
    part = str(tags.get("EXIF SubSecTimeOriginal", "")).strip()
    part_s = float(f"0.{part}") if part.isdigit() else 0.0
    zone = re.fullmatch(r"([+-])(\d\d):(\d\d)", str(tags.get("EXIF OffsetTimeOriginal", "")).strip())
    ahead_s = float(f"{zone[1]}1") * (int(zone[2]) * 60 + int(zone[3])) * 60 if zone else 0.0
    t_ms = fill.dated(text.replace(":", "-", 2)) + (part_s - ahead_s) * 1e3
    return values | {"t_ms": values["utc_us"] / 1e3 if np.isfinite(values["utc_us"]) else t_ms}


def _xmp(head: bytes) -> dict[str, float]:
    """Numbers of the XMP by local name, whether attributes or elements."""
    if not 0 <= (start := head.find(b"<x:xmpmeta")) < (stop := head.find(b"</x:xmpmeta>")):
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


def _numbers(tag: Any, most: int = 1) -> list[float]:
    try:
        return [float(value) for value in tag.values[:most]] or [float("nan")]
    except (AttributeError, TypeError, ValueError, ZeroDivisionError):
        return [float("nan")]
