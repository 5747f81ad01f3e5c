"""The photos that show a place: of which flights, when, how finely, obliquely and sharply, and where in them.

Rays on the structure decide what is occluded. Registered photos are checked one by one; a flight without any
is taken to record all the time, and its finest look is listed.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.config import InspectionSettings
from upplied.errors import SettingsError
from upplied.findings.adding import on_surface, outline_of
from upplied.findings.photos import Flown, flights_round, size_of_photo, with_size
from upplied.findings.rays import focal_of, footprint_m, frustum_of, pixels_of, size_px
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import scene_of
from upplied.planning.visibility.line_of_sight import visible
from upplied.planning.visibility.moments import motion_of, rates
from upplied.planning.visibility.observations import TRULY, stations
from upplied.records import Camera, Cloud, Floats, Record

FLOWN = ("demonstration", "flown")  # kinds of flights that a vehicle flew
_EXPOSURE_S = InspectionSettings().exposure_s
_AROUND_S = 0.1  # before and after a photo, over which its motion is taken
_LEAST_M = 0.25  # radius about a place without extent, that its box shows
_CIRCLE = np.linspace(0, 2 * np.pi, 16, endpoint=False)

COLUMNS = (
    "flight_id", "kind", "taken_at", "t_s", "photo", "path", "sha256", "distance_m", "incidence_deg", "mm_px",
    "blur_px", "left_px", "top_px", "right_px", "bottom_px", "in_picture_pct",
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Spot(Record):
    """A place on a structure, and how far about it is meant."""

    structure_id: str
    place: Floats  # (3,) m
    normal: Floats  # (3,) unit, outward
    corners: Floats  # (K, 3) m, of what is to be in the picture
    structure_sha256: str = ""  # as it was when the place was found; empty: as it is


@dataclass(frozen=True, eq=False, repr=False)
class Look(Record):
    """A photo that shows a spot, or a moment of a flight without photos."""

    row: dict[str, Any]  # by `COLUMNS`
    position: Floats  # (3,) m
    quat_xyzw: Floats  # (4,)
    camera: Camera


def spot_at(
    catalog: Catalog, structure_id: str, place_m: Sequence[float], radius_m: float = _LEAST_M
) -> Spot:
    """The spot of a structure's surface that is nearest to a place, m, frame of the structure."""
    structure = catalog.structure(structure_id)
    if len(place_m) != 3 or not np.isfinite(place_m).all():
        raise SettingsError("place", f"is {place_m}", "three coordinates, m, frame of the structure")
    (place,), (normal,) = on_surface(scene_of(structure), np.array([place_m], float))
    return Spot(structure_id, place, normal, _around(place, normal, radius_m))


def spot_of(row: dict[str, Any]) -> Spot:
    """The spot of a finding's row: what was marked, and about it as far as the place may be off."""
    place, normal = np.array([row["x_m"], row["y_m"], row["z_m"]]), np.array(json.loads(row["normal_json"]))
    error = row.get("place_error_m")
    radius = max(_LEAST_M, float(error) if error is not None and error == error else 0.0)
    corners = np.concatenate([outline_of(row), _around(place, normal, radius)])
    return Spot(str(row["target_id"]), place, normal, corners, str(row.get("structure_sha256") or ""))


def off_surface(catalog: Catalog, spots: Sequence[Spot], sha256: str) -> Floats:
    """How far (N,), m, places are off a structure that has changed since; 0 where it has not."""
    off = np.zeros(len(spots))
    changed = np.array([spot.structure_sha256 not in ("", sha256) for spot in spots], bool)
    if changed.any():
        places = np.array([spot.place for spot in spots])[changed]
        nearest = scene_of(catalog.structure(spots[0].structure_id)).closest(places)[0]
        off[changed] = np.linalg.norm(nearest - places, axis=1)
    return off


def looks_at_spot(catalog: Catalog, spot: Spot, kinds: Collection[str] = FLOWN) -> list[Look]:
    """Every look at a spot, flight by flight in the order of flying, the finest of each flight first.

    Parameters
    ----------
    catalog : Catalog
    spot : Spot
    kinds : collection of str
        Of flights: ``demonstration``, ``flown`` and ``simulated``.
    """
    photos = catalog.flight_photos(structure=spot.structure_id)
    scene = scene_of(catalog.structure(spot.structure_id))
    cloud = Cloud(spot.place[None], spot.normal[None])
    groups: list[list[Look]] = []
    for flight in flights_round(catalog, spot.structure_id, kinds):
        own = photos[photos["flight_id"] == flight.flight_id]
        poses = flight.at(own["t_s"].to_numpy()) if len(own) else stations(flight.path)
        where = poses.positions, poses.quat_xyzw, cloud, frustum_of(flight.camera)
        seen = np.flatnonzero(visible(*where, TRULY, scene, fov_deg=poses.fov_deg).seen[:, 0])
        rows = own.to_dict("records")
        every = (_look(flight, spot, float(poses.t_s[at]), rows[at] if rows else {}) for at in seen)
        looks = [look for look in every if look is not None]
        looks.sort(key=lambda look: look.row["mm_px"])
        groups.append(looks if rows else looks[:1])
    groups.sort(key=lambda looks: str(looks[0].row["taken_at"]) if looks else "")
    return [look for looks in groups for look in looks]


def looks_frame(looks: Sequence[Look]) -> pd.DataFrame:
    """Looks as a table, one a row."""
    return pd.DataFrame([look.row for look in looks], columns=list(COLUMNS))


def _look(flight: Flown, spot: Spot, t_s: float, photo: dict[Any, Any]) -> Look | None:
    """How a photo that looks towards a spot shows it; None where its lens does not."""
    pose, camera = flight.at(np.array([t_s])), flight.seen_by(t_s)
    if any(size := size_of_photo(photo)):
        camera = with_size(camera, *size, f"photo {photo['name']}")
    position, quat = pose.positions[0], pose.quat_xyzw[0]
    ray = spot.place - position
    distance = float(np.linalg.norm(ray))
    pixels = pixels_of(camera, position, quat, np.vstack([spot.place, spot.corners]))
    limits = np.array(size_px(camera), float)
    inside = np.all((pixels >= 0) & (pixels <= limits), axis=1)
    if camera.lens is not None and not inside[0]:
        return None
    low, high = (np.clip(reach(pixels, axis=0), 0, limits) for reach in (np.nanmin, np.nanmax))
    row = {
        "flight_id": flight.flight_id,
        "kind": flight.kind,
        "taken_at": flight.moment(t_s),
        "t_s": t_s,
        "photo": str(photo.get("name", "")),
        "path": str(photo.get("path", "")),
        "sha256": str(photo.get("sha256", "")),
        "distance_m": distance,
        "incidence_deg": float(np.degrees(np.arccos(np.clip(-(ray @ spot.normal) / distance, -1, 1)))),
        "mm_px": 1e3 * footprint_m(camera, position, spot.place, spot.normal),
        "blur_px": _blur_px(flight, camera, ray, distance, t_s),
        **dict(zip(("left_px", "top_px", "right_px", "bottom_px"), (*low, *high), strict=True)),
        "in_picture_pct": 100 * float(inside[1:].mean()),
    }
    return Look(row, position, quat, camera)


def _blur_px(flight: Flown, camera: Camera, ray: Floats, distance: float, t_s: float) -> float:
    """By how many pixels the place moved during the exposure; NaN where photos alone tell the path."""
    if flight.stills:
        return float("nan")
    velocity, turn = rates(interpolate(flight.path, t_s + np.array([-_AROUND_S, 0.0, _AROUND_S])))
    speed = motion_of(ray, distance, velocity[1], turn[1])
    return speed * (camera.exposure_s or _EXPOSURE_S) * focal_of(camera)[0]


def _around(place: Floats, normal: Floats, radius_m: float) -> Floats:
    first, second = plane_axes(normal)
    return place + radius_m * (np.cos(_CIRCLE)[:, None] * first + np.sin(_CIRCLE)[:, None] * second)


def plane_axes(normal: Floats) -> tuple[Floats, Floats]:
    """Right and up (..., 3) of who looks along normals (..., 3) at a surface; up is near the vertical."""
    level = np.abs(normal[..., 2:]) > 0.95
    up = np.where(level, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    up = up - (up * normal).sum(axis=-1, keepdims=True) * normal
    up = up / np.linalg.norm(up, axis=-1, keepdims=True)
    return np.cross(up, normal), up
