"""Flights as their photos show a structure: path, camera, and which photo was taken when."""

import contextlib
import csv
import hashlib
import io
import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.catalog.schema.rows import camera_of
from upplied.catalog.verbs.roster import check_text
from upplied.config import digest
from upplied.errors import CatalogError, InputError, RefusedError, UppliedError
from upplied.findings.rays import focal_of
from upplied.geometry.poses import interpolate
from upplied.inputs.files import read_regular
from upplied.records import Camera, Floats, Record, Trajectory

SUFFIXES = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".dng"}
MOST_BYTES = 200 << 20  # of a photo
_MOST_PHOTOS = 100_000
_OUTSIDE_S = 1.0  # that a photo may be taken before or after its flight
_SAME_SHAPE = 0.05  # of the photo's proportions, that those of the camera may differ by


@dataclass(frozen=True, eq=False, repr=False)
class Flown(Record):
    """A flight, or a demonstration, round a structure."""

    flight_id: str
    target_id: str
    kind: str  # flown, simulated or demonstration
    path: Trajectory  # from 0
    camera: Camera
    began: pd.Timestamp | None  # the first pose, by the log's clock
    pose_error_m: float  # as its alignment states; NaN: nothing does
    stills: bool = False

    def moment(self, t_s: float) -> pd.Timestamp | None:
        """When that was, by the log's clock."""
        return None if self.began is None else self.began + pd.Timedelta(seconds=t_s)

    def at(self, t_s: Floats) -> Trajectory:
        """The poses at some times."""
        return interpolate(self.path, np.asarray(t_s, float))

    def zoomed(self, fov_deg: Floats | None) -> Camera:
        """The camera at the first of some fields of view (N, 2), deg, where it zooms."""
        return self.camera if fov_deg is None else self.camera.zoomed(fov_deg)[0]


def flights_round(catalog: Catalog, structure_id: str, kinds: Collection[str]) -> Iterator[Flown]:
    """Demonstrations, flown and simulated flights round a structure, those of some of these kinds."""
    if "demonstration" in kinds:
        for row in catalog.demonstrations(structure=structure_id).to_dict("records"):
            yield _demonstrated(catalog, str(row["demonstration_id"]))
    rows = catalog.flights(structure=structure_id).drop_duplicates("flight_id", keep="last")
    cameras: dict[str, Camera] = {}
    for row in rows.to_dict("records"):
        if row["kind"] in kinds:
            yield _of_row(catalog, row, cameras)


def flight_of(catalog: Catalog, start: str) -> Flown:
    """The one flight whose id begins so, or the demonstration of that id."""
    if start in set(catalog.demonstrations()["demonstration_id"]):
        return _demonstrated(catalog, start)
    rows = catalog.flights()
    matches = rows[rows["flight_id"].str.startswith(start)].drop_duplicates("flight_id", keep="last")
    if len(matches) != 1 or not start:
        what = "is not in the catalog" if matches.empty else f"may be {len(matches)}"
        rule = "a flight or a demonstration of the catalog"
        raise CatalogError(f"flight {start or '(none)'}", what, rule, "see: upplied flights list")
    return _of_row(catalog, matches.iloc[0].to_dict(), {})


def _demonstrated(catalog: Catalog, name: str) -> Flown:
    flown = catalog.demonstration(name)
    began = pd.Timestamp(int(flown.t_ns[0]), unit="ns", tz="UTC")
    about = flown.trajectory, flown.camera, began, float("nan"), flown.stills
    return Flown(name, flown.structure_id, "demonstration", *about)


def _of_row(catalog: Catalog, row: dict[Any, Any], cameras: dict[str, Camera]) -> Flown:
    name = str(row["demonstration_id"] or catalog.transfer(str(row["transfer_id"]))["demonstration_id"])
    if name not in cameras:
        cameras[name] = camera_of(catalog.newest("demonstrations", name))
    began = None if pd.isna(row["flown_at"]) else row["flown_at"]
    # A log beside its plan may be off by that much, whether its frame or the vehicle was (`proof.align`).
    error = [row[name] for name in ("place_error_m", "residual_p95_m") if not pd.isna(row[name])]
    path = catalog.flown(str(row["flight_sha256"]))
    stated = max(map(float, error), default=float("nan"))
    about = str(row["flight_id"]), str(row["target_id"]), str(row["kind"]), path, cameras[name], began, stated
    return Flown(*about)


def register_photos(
    catalog: Catalog, flight: Flown, folder: Path, times: Path | None = None, clock_s: float = 0.0,
    by: str = "",
) -> tuple[int, list[str]]:  # fmt: skip
    """Register the photos of a flight by name, hash and time; they stay where they are.

    `times` is a CSV with the columns ``name`` and ``t_ns`` (log's clock) or ``t_s`` (from the first pose).
    Without it the time of each photo is that in its head, with `clock_s` added (what the camera's clock was
    behind the log's), and where there is none, the photos of a demonstration of photos are its poses in the
    order of their names. Returned are how many were new, and which were refused, in words.
    """
    if not folder.is_dir():
        raise InputError(str(folder), "is no folder", "the folder of the photos", "check the path")
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)[: _MOST_PHOTOS + 1]
    if not 0 < len(files) <= _MOST_PHOTOS:
        raise InputError(str(folder), f"holds {len(files)} photos", f"1 to {_MOST_PHOTOS}")
    stated = {} if times is None else _stated(times, flight)
    rows, refused = [], []
    by_order = len(files) == len(flight.path)
    for number, path in enumerate(files):
        try:
            data = read_regular(path, MOST_BYTES)
            rows.append(_photo_row(flight, path, data, stated, clock_s, number if by_order else -1))
        except UppliedError as error:
            refused.append(str(error))
    return catalog.add_flight_photos(rows, by), refused


def _photo_row(
    flight: Flown, path: Path, data: bytes, stated: dict[str, float], clock_s: float, number: int
) -> dict[str, Any]:
    from upplied.inputs.sources.photos import head_of

    check_text(f"photo {path.name!a}", "name", path.name)
    head = head_of(path)
    if path.name in stated:
        t_s = stated[path.name]
    elif stated:
        raise InputError(str(path), "is not in the file of times", "a line for each photo")
    elif math.isfinite(head["t_ms"]) and flight.began is not None:
        t_s = (pd.Timestamp(head["t_ms"], unit="ms", tz="UTC") - flight.began).total_seconds() + clock_s
    elif flight.stills and number >= 0:
        t_s = float(flight.path.t_s[number])
    else:
        rule, remedy = "EXIF with a time, or --times", "list name and t_ns in a CSV"
        raise InputError(str(path), "has no time", rule, remedy)
    end = float(flight.path.t_s[-1])
    if not -_OUTSIDE_S <= t_s <= end + _OUTSIDE_S:
        fault = f"was taken {t_s:.1f} s after the first pose, the flight took {end:.1f} s"
        remedy = "state the offset of its clock: --clock SECONDS"
        raise InputError(str(path), fault, "within the flight", remedy)
    sha256, t_s = hashlib.sha256(data).hexdigest(), min(max(t_s, 0.0), end)
    size = tuple(int(head[name]) if math.isfinite(head[name]) else 0 for name in ("width", "height"))
    if not all(size):
        from upplied.outputs.pictures import size_of

        with contextlib.suppress(InputError):  # of one that cannot be read here, as a raw one
            size = size_of(data, str(path))
    own = {"flight_id": flight.flight_id, "target_id": flight.target_id, "sha256": sha256, "t_s": t_s}
    own |= {"photo_id": digest([flight.flight_id, sha256, round(t_s, 3)])}
    own |= {"name": path.name, "path": str(path.resolve())}
    return own | dict(zip(("width_px", "height_px"), size, strict=True))


def _stated(path: Path, flight: Flown) -> dict[str, float]:
    rule = "a CSV with the columns name and t_ns (log's clock) or t_s (from the first pose)"
    try:
        text = read_regular(path, 64 << 20).decode("utf-8-sig")
        lines = list(csv.DictReader(io.StringIO(text)))[: _MOST_PHOTOS + 1]
        began = 0 if flight.began is None else flight.began.value
        times_s = {}
        for line in lines:
            since = (int(line["t_ns"]) - began) * 1e-9 if line.get("t_ns") else float(line["t_s"])
            times_s[line["name"]] = since
    except (UnicodeDecodeError, csv.Error, KeyError, TypeError, ValueError) as error:
        raise InputError(str(path), f"cannot be read: {error}", rule) from None
    if not times_s:
        raise InputError(str(path), "lists no photo", rule)
    return times_s


def registered(catalog: Catalog, photo: str, flight_id: str = "") -> dict[str, Any]:
    """The row of the one registered photo of a name, or of a path's name and bytes."""
    name = Path(photo).name
    rows = catalog.flight_photos()
    rows = rows[rows["name"] == name]
    if flight_id:
        rows = rows[rows["flight_id"] == flight_id]
    if len(rows) > 1 and Path(photo).is_file():
        rows = rows[rows["sha256"] == hashlib.sha256(read_regular(photo, MOST_BYTES)).hexdigest()]
    fault, remedy = "belongs to no known flight", "register it: upplied findings photos FLIGHT FOLDER"
    if len(rows) > 1:
        flights = rows["flight_id"].unique()
        names = ", ".join(name[:12] if len(name) == 64 else name for name in flights)
        fault, remedy = f"is of several flights: {names}", "name the flight: --flight ID"
        if len(flights) == 1:
            fault, remedy = f"names {len(rows)} photos of {flights[0]}", "name it with its folder"
    if len(rows) != 1:
        raise RefusedError(f"photo {name}", fault, "a photo of one flight, registered", remedy)
    return {str(key): value for key, value in rows.iloc[0].items()}


def size_of_photo(photo: dict[Any, Any], otherwise: tuple[int, int] = (0, 0)) -> tuple[int, int]:
    """Width and height, px, of a row of registered photos, if both are known."""
    size = [0 if pd.isna(photo.get(name)) else int(photo[name]) for name in ("width_px", "height_px")]
    return (size[0], size[1]) if all(size) else otherwise


def with_size(camera: Camera, width_px: int, height_px: int, what: str) -> Camera:
    """The camera with the pixels of a photo, of like proportions; its own where the photo's are not known."""
    width, height = width_px or camera.width_px, height_px or camera.height_px
    remedy = "state the camera in the side-car of the log"
    if not (width and height):
        raise RefusedError(what, "the pixels of its camera are not known", "width and height, px", remedy)
    sized = replace(camera, width_px=width, height_px=height)
    across, down = focal_of(sized)
    if abs(down / across - 1) > _SAME_SHAPE and (camera.hfov_deg <= 120 or camera.lens is not None):
        fov = f"the camera of the flight sees {camera.hfov_deg:.1f} x {camera.vfov_deg:.1f} deg"
        fault, rule = f"has {width} x {height} px, {fov}", "the same proportions"
        raise RefusedError(what, fault, rule, remedy)
    return sized
