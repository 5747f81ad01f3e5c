"""Marks become findings: each cast on the structure as it is known, with its place, size and error."""

import json
import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.catalog.verbs.roster import check_text
from upplied.checks import check_id
from upplied.config import digest
from upplied.errors import RefusedError, UppliedError
from upplied.findings.marks import Mark
from upplied.findings.photos import flight_of, registered, size_of_photo, with_size
from upplied.findings.place import Errors, located
from upplied.findings.rays import rays_of, size_px
from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.scene import Scene, scene_of, surface_error_m
from upplied.geometry.vectors import sphere
from upplied.records import Floats, Structure

_DIGITS = 12  # of a finding's id
_SAME_TIME_S = 1.0  # between the time of a mark and that of its photo
_SAME_SHAPE = 0.01  # of the proportions of a photo, by which those of a smaller copy may differ
_MOST_OUTLINE = 64
_WAYS = sphere(64)
_CLEARLY = 0.05  # share of rays, by which more escape from one side than from the other
_PHOTO = {"photo": "name", "photo_path": "path", "photo_sha256": "sha256"}  # columns of findings and photos
_MOST_M = 1e6  # of a stated coordinate
_OFF_SURFACE = 0.02  # of the diagonal, that a stated place may be off the surface


@dataclass(frozen=True)
class Added:
    """The result of adding marks."""

    ids: tuple[str, ...]  # of each mark that is a finding now, or was one already
    new: int
    refused: tuple[str, ...]  # in words


class Placing:
    """Marks placed on structures of a catalog; flights and structures are read once.

    The errors are those of the camera, and of the positions of flights that do not state theirs; `pose_m` is
    that of all positions, whatever flights state.
    """

    def __init__(self, catalog: Catalog, errors: Errors | None = None, pose_m: float | None = None) -> None:
        self.catalog, self.errors, self.pose_m = catalog, errors or Errors(), pose_m
        self._flight = cache(lambda name: flight_of(catalog, name))
        self._structure = cache(lambda name: catalog.structure(check_id(name, "structure")))

    def row(self, mark: Mark) -> dict[str, Any]:
        """A mark as a row of `findings`, without author and commit.

        It is refused if a text of it is not readable, its photo is of no known flight, or it misses the
        structure or looks at it too obliquely.
        """
        columns = {"class": mark.class_name, "severity": mark.severity, "note": mark.note, "state": "open"}
        columns |= {"file": mark.file, "file_sha256": mark.file_sha256}
        own = {name: getattr(mark, name) for name in ("photo", "structure", "flight")}
        for name, text in (own | columns).items():
            check_text(mark.what, name, text)
        return columns | (self._stated(mark) if mark.place is not None else self._seen(mark))

    def _stated(self, mark: Mark) -> dict[str, Any]:
        assert mark.place is not None
        structure = self._structure(mark.structure)
        stated = np.array(mark.place, float)[None]
        if not (np.abs(stated) < _MOST_M).all():
            rule = "three coordinates, m, frame of the structure"
            raise RefusedError(mark.what, f"is at {mark.place}", rule)
        (place,), (normal,) = on_surface(scene_of(structure), stated)
        off = float(np.linalg.norm(place - stated[0]))
        if off > _OFF_SURFACE * structure.diagonal_m:
            fault = f"is {off:.2f} m off the surface of {structure.structure_id}"
            rule = f"at most {_OFF_SURFACE * structure.diagonal_m:.2f} m"
            raise RefusedError(mark.what, fault, rule, "state the place in the frame of the structure")
        return self._about(mark, structure, place, normal, "place")

    def _seen(self, mark: Mark) -> dict[str, Any]:
        photo = self._photo(mark)
        flight = self._flight(photo["flight_id"] if photo else mark.flight)
        t_s = float(photo["t_s"]) if photo else float(mark.t_s or 0.0)
        if mark.t_s is not None and not abs(mark.t_s - t_s) <= _SAME_TIME_S:
            fault = f"is of {mark.t_s:g} s, its photo {mark.photo} of {t_s:g} s"
            raise RefusedError(mark.what, fault, "one time", "omit the time or the photo")
        if not 0 <= t_s <= float(flight.path.t_s[-1]):
            when = f"is of {t_s:g} s, the flight took {float(flight.path.t_s[-1]):.1f} s"
            raise RefusedError(mark.what, when, "a time of the flight", "count from its first pose")
        size = size_of_photo(photo, mark.size_px)
        pose = flight.at(np.array([t_s]))
        named = f"{mark.what}, photo {mark.photo or f'of {t_s:g} s'}"
        camera = with_size(flight.zoomed(pose.fov_deg), *size, named)
        limits = np.array(size_px(camera))
        corners = mark.corners * _enlarged(mark, limits)
        if not len(corners) or (corners < 0).any() or (corners > limits).any():
            rule = f"0 to {limits[0]} and 0 to {limits[1]} px"
            raise RefusedError(mark.what, "lies outside its photo", rule, "check the pixels and the photo")
        if not np.isfinite(rays_of(camera, corners)).all():
            rule = "a pixel in the field of view"
            remedy = "check the distortion in the camera's calibration"
            raise RefusedError(mark.what, "lies outside the valid area of the lens model", rule, remedy)
        structure = self._structure(flight.target_id)
        stated = flight.pose_error_m if self.pose_m is None else self.pose_m
        pose_m = self.errors.pose_m if math.isnan(stated) else stated
        mesh_m = self.errors.mesh_m or surface_error_m(structure)
        errors = replace(self.errors, pose_m=pose_m, mesh_m=mesh_m)
        seen = pose.positions[0], pose.quat_xyzw[0]
        spot = located(mark.what, scene_of(structure), camera, *seen, corners, errors)
        outline = spot.outline[chosen_evenly(len(spot.outline), _MOST_OUTLINE)]
        return self._about(mark, structure, spot.place, spot.normal, flight.flight_id) | {
            "place_error_m": spot.error_m,
            **{f"{name}_error_m": getattr(spot, f"{name}_error_m") for name in ("pose", "pixel", "mesh")},
            **{f"{name}_mm": 1e3 * getattr(spot, f"{name}_m") for name in ("length", "length_error")},
            "area_mm2": 1e6 * spot.area_m2,
            "area_error_mm2": 1e6 * spot.area_error_m2,
            "outline_json": _json(outline) if len(corners) > 1 else "",
            "flight_id": flight.flight_id,
            **{key: photo.get(name, "") for key, name in _PHOTO.items()},
            "photo_s": t_s,
            "photo_at": flight.moment(t_s),
            "pixels_json": json.dumps(corners[:1000].round(2).tolist()),
            **{name: getattr(camera, name) for name in ("width_px", "height_px", "hfov_deg", "vfov_deg")},
            "camera_json": _json(np.concatenate(seen), 7),
            "distance_m": spot.distance_m,
            "incidence_deg": spot.incidence_deg,
            "gsd_mm": spot.mm_px,
        }

    def _photo(self, mark: Mark) -> dict[str, Any]:
        """The registered photo of a mark; empty where flight and time are stated instead."""
        timed = bool(mark.flight) and mark.t_s is not None
        if not (mark.photo or timed):
            remedy = "name a photo, or state --flight ID --time SECONDS"
            raise RefusedError(mark.what, "has neither photo nor time", "a photo of a known flight", remedy)
        whole = self._flight(mark.flight).flight_id if mark.flight else ""
        try:
            return registered(self.catalog, mark.photo, whole) if mark.photo else {}
        except RefusedError:
            if timed:
                return {}
            raise

    def _about(self, mark: Mark, structure: Structure, place: Any, normal: Any, by: str) -> dict[str, Any]:
        photo = Path(mark.photo).name
        key: list[Any] = [structure.structure_id, by, photo, mark.t_s, mark.pixels, mark.class_name]
        key += [] if mark.place is None else [list(mark.place)]
        return {
            "finding_id": digest(key)[:_DIGITS],
            "target_id": structure.structure_id,
            "kind": structure.kind,
            **dict(zip(("x_m", "y_m", "z_m"), map(float, place), strict=True)),
            "normal_json": _json(normal, 6),
            "structure_sha256": structure.sha256,
        }


def add_marks(
    catalog: Catalog, marks: list[Mark], by: str, errors: Errors | None = None, pose_m: float | None = None
) -> Added:
    """Place marks (see `Placing`) and add those that can be placed, in one commit of who found them.

    What is refused is listed with its reason; nothing of it is stored.
    """
    placing, rows, refused = Placing(catalog, errors, pose_m), [], []
    for mark in marks:
        try:
            rows.append(placing.row(mark))
        except UppliedError as error:
            refused.append(str(error))
    new = catalog.add_findings(rows, by)
    return Added(tuple(row["finding_id"] for row in rows), len(new), tuple(refused))


def on_surface(scene: Scene, places: Floats) -> tuple[Floats, Floats]:
    """The points of the surface that are nearest to places (N, 3), m, and its normals (N, 3), outward.

    Outward is the side from which more rays escape, as samples have it; of a sheet the side of the place.
    """
    points, _ = scene.closest(places)
    rows, size = np.arange(len(points)), float(np.linalg.norm(np.subtract(*scene.box)))
    step = max(1e-3 * size, 2 * scene.error_m)
    ways = sphere(26)
    origins = (points[:, None] + step * ways).reshape(-1, 3)
    reach, _, normals = scene.cast(origins, np.tile(-ways, (len(points), 1)))
    reach, normals = reach.reshape(len(points), -1), normals.reshape(len(points), -1, 3)
    # What is met where the place is, as frontally as can be.
    facing = np.abs(np.einsum("nwi,wi->nw", normals, ways))
    there = np.abs(reach - step) < 0.2 * step + scene.error_m
    normal = normals[rows, np.where(there, facing, -1.0).argmax(axis=1)]
    free = np.stack([escaping(scene, points, side * normal, size) for side in (1, -1)])
    beside = np.einsum("ni,ni->n", places - points, normal)
    side = np.where(np.abs(beside) > 1e-6 * size, np.sign(beside), 1.0)
    side = np.where(np.abs(free[0] - free[1]) > _CLEARLY, np.sign(free[0] - free[1]), side)
    return points, normal * side[:, None]


def escaping(scene: Scene, points: Floats, normals: Floats, size: float) -> Floats:
    """Share (N,) of the rays from before a surface that meet nothing."""
    ahead = normals @ _WAYS.T > 0.1
    owner, which = np.nonzero(ahead)
    starts = (points + 1e-5 * size * normals)[owner]
    met = scene.occluded(starts, starts + 2 * size * _WAYS[which], slack=0.0)
    return np.bincount(owner, ~met, len(points)) / np.maximum(ahead.sum(axis=1), 1)


def _enlarged(mark: Mark, size: Floats) -> Floats:
    """By what the pixels (2,) of a mark are multiplied, whose file has the photo in another size."""
    if not all(mark.size_px):
        return np.ones(2)
    ratio = size / np.array(mark.size_px)
    if abs(ratio[0] / ratio[1] - 1) > _SAME_SHAPE:
        stated, own = (f"{each[0]:.0f} x {each[1]:.0f} px" for each in (mark.size_px, size))
        fault = f"is of a picture of {stated}, the photo has {own}"
        raise RefusedError(mark.what, fault, "the same proportions", "mark it in the photo as it was taken")
    return np.asarray(ratio, float)


def outline_of(row: Any) -> Floats:
    """The outline (K, 3), m, of a finding's row; its place alone where it has none."""
    text = row["outline_json"]
    place = np.array([[row["x_m"], row["y_m"], row["z_m"]]], float)
    return np.array(json.loads(text), float).reshape(-1, 3) if text else place


def _json(values: Any, digits: int = 4) -> str:
    return json.dumps(np.round(np.asarray(values, float), digits).tolist())
