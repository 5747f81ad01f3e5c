"""The photos that show a place: of which flights, when, how finely, obliquely and sharply, and where in them.

Rays on the structure decide what is occluded. Registered photos are checked one by one; a flight without any
is taken to record all the time, and its finest look is listed. No pose is known exactly: a look that only
some of the possible poses have, as at the edge of a picture, is listed as doubtful, with the reason.
"""

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
from upplied.findings.place import Errors, drawn_poses
from upplied.findings.rays import focal_of, footprint_m, pixels_of, pixels_towards, size_px, widest_rad
from upplied.geometry.poses import interpolate, matrices
from upplied.geometry.scene import Scene, scene_of
from upplied.planning.visibility.observations import TRULY, rates, stations
from upplied.records import Bools, Camera, Floats, Ints, Record, Trajectory

FLOWN = ("demonstration", "flown")  # kinds of flights that a vehicle flew
_EXPOSURE_S = InspectionSettings().exposure_s
_AROUND_S = 0.1  # before and after a photo, over which its motion is taken
_LEAST_M = 0.25  # radius about a place without extent, that its box shows
_CIRCLE = np.linspace(0, 2 * np.pi, 16, endpoint=False)
_DRAWS = np.random.default_rng(0).normal(size=(64, 6))  # of a pose that may be off
_SURE, _PERHAPS = 0.95, 0.03  # share of the draws that show a place: certainly, and not at all below
_MARGIN_DEG, _FARTHER = 5.0, 1.2  # about the picture and its range, within which a place may be in it
_REASONS = ("edge of the picture", "incidence", "range", "occlusion")
_PHOTO = {"photo": "name", "path": "path", "sha256": "sha256"}  # columns of looks, and of photos

COLUMNS = (
    "flight_id", "kind", "taken_at", "t_s", "photo", "path", "sha256", "distance_m", "incidence_deg", "mm_px",
    "blur_px", "left_px", "top_px", "right_px", "bottom_px", "in_picture_pct", "probability", "doubt",
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Spot(Record):
    """A place on a structure, and how far about it is meant."""

    structure_id: str
    place: Floats  # (3,) m
    normal: Floats  # (3,) unit, outward
    corners: Floats  # (K, 3) m, of what is to be in the picture
    structure_sha256: str = ""  # as it was when the place was found; empty: as it is
    error_m: float = 0.0  # of the place, in 95 % of cases
    photo: tuple[str, float] = ("", 0.0)  # that it was marked in: flight, and seconds from its first pose


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
    known = (0.0 if pd.isna(row.get(name)) else row[name] for name in ("place_error_m", "photo_s"))
    error, t_s = map(float, known)
    corners = np.concatenate([outline_of(row), _around(place, normal, max(_LEAST_M, error))])
    about = str(row.get("structure_sha256") or ""), error, (str(row.get("flight_id") or ""), t_s)
    return Spot(str(row["target_id"]), place, normal, corners, *about)


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
    """Every look at a spot, flight by flight in the order of flying; certain ones first, the finest first.

    Kinds of flights are ``demonstration``, ``flown`` and ``simulated``.
    """
    photos = catalog.flight_photos(structure=spot.structure_id)
    scene = scene_of(catalog.structure(spot.structure_id))
    groups: list[list[Look]] = []
    for flight in flights_round(catalog, spot.structure_id, kinds):
        own = photos[photos["flight_id"] == flight.flight_id]
        poses = flight.at(own["t_s"].to_numpy()) if len(own) else stations(flight.path)
        rows, looks = own.to_dict("records"), list[Look]()
        towards = _towards(flight, poses, spot)
        if not rows:  # of many moments those alone that nothing hides
            towards = towards[~_hidden(scene, poses.positions[towards], spot)]
        for at in towards:
            photo = rows[at] if rows else {}
            look = _look(flight, spot, scene, poses.take(np.array([at])), photo)
            looks += [] if look is None else [look]
            if looks and not rows and not looks[-1].row["doubt"]:
                break
        looks.sort(key=lambda look: (look.row["doubt"] != "", look.row["mm_px"]))
        groups.append(looks if rows else looks[:1])
    groups.sort(key=lambda looks: str(looks[0].row["taken_at"]) if looks else "")
    return [look for looks in groups for look in looks]


def _towards(flight: Flown, poses: Trajectory, spot: Spot) -> Ints:
    """The poses whose pictures, or what is beside them, a spot may be in; the finest first."""
    ray = spot.place - poses.positions
    away = np.linalg.norm(ray, axis=1)
    facing = -(ray @ spot.normal) / away
    ahead = np.einsum("ni,ni->n", ray, matrices(poses.quat_xyzw)[:, :, 0]) / away
    camera = flight.zoomed(None if poses.fov_deg is None else poses.fov_deg.max(axis=0, keepdims=True))
    margin = np.radians(_MARGIN_DEG)
    may = np.arccos(np.clip(ahead, -1, 1)) < widest_rad(camera) + margin
    may &= facing > np.cos(np.radians(TRULY.max_incidence_deg) + margin)
    may &= away < _FARTHER * camera.max_range_m
    order = np.argsort(away / np.maximum(facing, 1e-6), kind="stable")
    return np.asarray(order[may[order]], np.int64)


def _chance(
    camera: Camera, at: Floats, turn: Floats, spot: Spot, scene: Scene, errors: Errors
) -> tuple[float, str]:
    """The probability that a photo shows a spot, by poses drawn about its own; and why it may not."""
    positions, turns = drawn_poses(at, turn, errors, _DRAWS)
    ray = spot.place - positions
    away = np.linalg.norm(ray, axis=1)
    pixels = pixels_towards(camera, np.einsum("nij,ni->nj", turns, ray))
    inside = np.all((pixels >= 0) & (pixels <= size_px(camera)), axis=1)
    frontal = -(ray @ spot.normal) >= away * np.cos(np.radians(TRULY.max_incidence_deg))
    near = (away >= camera.min_range_m) & (away <= camera.max_range_m)
    shown = inside & frontal & near
    free = ~shown
    if shown.mean() >= _PERHAPS:
        free[shown] = ~_hidden(scene, positions[shown], spot)
    fails = [float((~one).mean()) for one in (inside, frontal, near, free)]
    return float((shown & free).mean()), _REASONS[int(np.argmax(fails))]


def _hidden(scene: Scene, positions: Floats, spot: Spot) -> Bools:
    """Whether something hides a spot from positions (N, 3), m; what a scan has about it may lie before it."""
    return scene.occluded(positions, np.tile(spot.place + scene.error_m * spot.normal, (len(positions), 1)))


def looks_frame(looks: Sequence[Look]) -> pd.DataFrame:
    """Looks as a table, one a row."""
    return pd.DataFrame([look.row for look in looks], columns=list(COLUMNS))


def _look(flight: Flown, spot: Spot, scene: Scene, pose: Trajectory, photo: dict[Any, Any]) -> Look | None:
    """How a photo from one pose that looks towards a spot shows it; None where it does not."""
    t_s = float(pose.t_s[0])
    camera = flight.zoomed(pose.fov_deg)
    if any(size := size_of_photo(photo)):
        camera = with_size(camera, *size, f"photo {photo['name']}")
    position, quat = pose.positions[0], pose.quat_xyzw[0]
    pose_m = Errors.pose_m if np.isnan(flight.pose_error_m) else flight.pose_error_m
    errors = Errors(float(np.hypot(pose_m, spot.error_m)))
    if spot.photo == (flight.flight_id, t_s):  # the mark itself is in it
        errors = Errors(0.0, 0.0)
    chance, reason = _chance(camera, position, matrices(quat), spot, scene, errors)
    pixels = pixels_of(camera, position, quat, np.vstack([spot.place, spot.corners]))
    if chance < _PERHAPS or not np.isfinite(pixels[1:]).any():
        return None
    ray = spot.place - position
    distance = float(np.linalg.norm(ray))
    limits = np.array(size_px(camera), float)
    inside = np.all((pixels >= 0) & (pixels <= limits), axis=1)
    low, high = (np.clip(reach(pixels, axis=0), 0, limits) for reach in (np.nanmin, np.nanmax))
    row = {
        "flight_id": flight.flight_id,
        "kind": flight.kind,
        "taken_at": flight.moment(t_s),
        "t_s": t_s,
        **{key: str(photo.get(name, "")) for key, name in _PHOTO.items()},
        "distance_m": distance,
        "incidence_deg": float(np.degrees(np.arccos(np.clip(-(ray @ spot.normal) / distance, -1, 1)))),
        "mm_px": 1e3 * footprint_m(camera, position, spot.place, spot.normal),
        "blur_px": _blur_px(flight, camera, ray, distance, t_s),
        **dict(zip(("left_px", "top_px", "right_px", "bottom_px"), (*low, *high), strict=True)),
        "in_picture_pct": 100 * float(inside[1:].mean()),
        "probability": chance,
        "doubt": "" if chance >= _SURE else reason,
    }
    return Look(row, position, quat, camera)


def _blur_px(flight: Flown, camera: Camera, ray: Floats, distance: float, t_s: float) -> float:
    """By how many pixels the place moved during the exposure; NaN where photos alone tell the path."""
    if flight.stills:
        return float("nan")
    velocity, turn = rates(interpolate(flight.path, t_s + np.array([-_AROUND_S, 0.0, _AROUND_S])))
    along = ray / distance  # as `moments.motion_of` has it; here no compiled code is loaded
    across = (velocity[1] - (velocity[1] @ along) * along) / distance
    speed = float(np.linalg.norm(np.cross(turn[1], along) + across))
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
