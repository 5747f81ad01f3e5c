"""Marks in photos, as people and detectors write them: COCO JSON, CSV and GeoJSON."""

import csv
import hashlib
import io
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.inputs.files import read_regular
from upplied.records import Floats

_MOST_BYTES = 256 << 20
_MOST_MARKS = 200_000
_MOST_CORNERS = 10_000
_RULE = "COCO JSON, GeoJSON with photo names and pixels, or a CSV with the columns photo, x_px and y_px"
# Fields of `Mark`, and what files call them.
_WORDS = {"class_name": "class"} | {it: it for it in ("photo", "structure", "flight", "severity", "note")}
Pixels = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Mark:
    """A mark in a photo, or a place that is stated."""

    what: str  # what messages call it
    photo: str = ""  # name or path; empty: by flight and time
    pixels: Pixels = ()  # a point, or corners in order
    place: tuple[float, float, float] | None = None  # m, frame of the structure
    structure: str = ""
    flight: str = ""
    t_s: float | None = None  # from the first pose
    class_name: str = ""
    severity: str = ""
    note: str = ""
    size_px: tuple[int, int] = (0, 0)  # of the photo, as the file says
    file: str = ""
    file_sha256: str = ""

    @property
    def corners(self) -> Floats:
        """(K, 2) px."""
        return np.array(self.pixels, float).reshape(-1, 2)


def box_corners(x: float, y: float, width: float, height: float) -> tuple[tuple[float, float], ...]:
    """The corners of a box, px, from its upper left corner."""
    if min(width, height) < 0:
        raise ValueError(f"a box of {width:g} x {height:g} px")
    return (x, y), (x + width, y), (x + width, y + height), (x, y + height)


def read_marks(path: Path) -> list[Mark]:
    """The marks of a file of a known form and size; faults of a single mark are told when it is placed."""
    data, marks = read_regular(path, _MOST_BYTES), list[Mark]()
    about = {"file": str(path), "file_sha256": hashlib.sha256(data).hexdigest()}
    try:
        text = data.decode("utf-8-sig")
        if path.suffix.lower() in (".json", ".geojson"):
            content = json.loads(text)
            geo = isinstance(content, dict) and "features" in content
            read = _geojson(path, content, about) if geo else _coco(path, content, about)
        else:
            read = _csv(path, text, about)
        marks.extend(read)  # one by one: of what could not be read it is known how far it could be
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError, OverflowError,
            csv.Error) as error:  # fmt: skip
        after = f" after {len(marks)} marks" if marks else ""
        fault = f"cannot be read{after}: {type(error).__name__}: {error}"[:300]
        raise InputError(str(path), fault, _RULE) from None
    if not 0 < len(marks) <= _MOST_MARKS:
        raise InputError(str(path), f"holds {len(marks)} marks", f"1 to {_MOST_MARKS}")
    return marks


def _coco(path: Path, content: Mapping[str, Any], about: Mapping[str, str]) -> Iterator[Mark]:
    images = {image["id"]: image for image in content["images"]}
    names = {each["id"]: str(each["name"]) for each in content.get("categories", [])}
    for one in content["annotations"]:
        image, parts = images[one["image_id"]], one.get("segmentation")
        flat = max(parts, key=len) if isinstance(parts, list) and parts else None
        pixels = corners_of(flat) if flat is not None else _finite(box_corners(*map(float, one["bbox"])))
        size = int(image.get("width") or 0), int(image.get("height") or 0)
        stated = {"photo": image["file_name"], "class": names.get(one.get("category_id"), "")}
        stated |= {name: one.get(name) for name in ("severity", "note")}
        what = f"{path.name}, annotation {one.get('id', '?')!a:.40}"
        yield _mark(what, stated, about, pixels, size_px=size)


def _geojson(path: Path, content: Mapping[str, Any], about: Mapping[str, str]) -> Iterator[Mark]:
    for number, feature in enumerate(content["features"], 1):
        stated, shape = dict(feature.get("properties") or {}), feature["geometry"]
        places = shape["coordinates"]
        if shape["type"] == "Polygon":
            places = places[0][:-1] if places[0][0] == places[0][-1] else places[0]
        elif shape["type"] == "Point":
            places = [places]
        elif shape["type"] not in ("LineString", "MultiPoint"):
            raise ValueError(f"geometry {shape['type']!a:.40}")
        names = (stated.get(name) for name in ("photo", "file_name", "image"))
        stated["photo"] = next(filter(None, names), "")
        pixels = corners_of([value for place in places for value in place[:2]])
        yield _mark(f"{path.name}, feature {number}", stated, about, pixels)


def _csv(path: Path, text: str, about: Mapping[str, str]) -> Iterator[Mark]:
    lines = csv.DictReader(io.StringIO(text))
    known = set(lines.fieldnames or ())
    ways = ({"x_px", "y_px"}, {"outline_px"}, {"structure", "x_m", "y_m", "z_m"})
    if not any(way <= known for way in ways):
        raise ValueError(f"columns {', '.join(sorted(map(str, known)))!a:.200}")
    for number, line in enumerate(lines, 2):
        place: tuple[float, float, float] | None = None
        pixels: Pixels = ()
        if line.get("x_m"):
            place = float(line["x_m"]), float(line["y_m"]), float(line["z_m"])
        elif line.get("outline_px"):
            pixels = corners_of(line["outline_px"].split())
        else:
            x, y = float(line["x_px"]), float(line["y_px"])
            wide = line.get("width_px") and line.get("height_px")
            box = box_corners(x, y, float(line["width_px"]), float(line["height_px"])) if wide else ((x, y),)
            pixels = _finite(box)
        yield _mark(f"{path.name}, line {number}", line, about, pixels, place=place)


def _mark(what: str, stated: Mapping[str, Any], about: Mapping[str, str], pixels: Pixels, **own: Any) -> Mark:
    texts = ("" if stated.get(name) is None else str(stated[name]).strip() for name in _WORDS.values())
    words: dict[str, Any] = dict(zip(_WORDS, texts, strict=True))
    t_s = float(stated["t_s"]) if stated.get("t_s") not in (None, "") else None
    return Mark(what, pixels=pixels, t_s=t_s, **(words | dict(about) | own))


def corners_of(flat: Any) -> Pixels:
    values = [float(value) for value in flat]
    if not 2 <= len(values) <= 2 * _MOST_CORNERS or len(values) % 2:
        rule = f"state x and y of each corner, of {_MOST_CORNERS} at most"
        raise ValueError(f"an outline has {len(values)} numbers; {rule}")
    return _finite(tuple(zip(values[::2], values[1::2], strict=True)))


def _finite(pixels: Pixels) -> Pixels:
    if not all(math.isfinite(value) for pair in pixels for value in pair):
        raise ValueError("a pixel that is not a number")
    return pixels
