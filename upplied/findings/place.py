"""The place of a mark in a photo on the surface, and its error, which holds in 95 % of cases.

Camera position, attitude, pixel and surface are drawn at random many times, and the rays of all draws are
cast on the structure: edges and oblique surfaces count with the error that they truly cause.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.errors import RefusedError
from upplied.findings.rays import footprint_m, rays_of
from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.poses import matrices
from upplied.geometry.scene import Scene
from upplied.planning.visibility.observations import TRULY
from upplied.records import Bools, Camera, Floats, Record

_DRAWS, _OUTLINES = 1024, 64
_DRAWN_PCT = 96  # of the draws; 95 of them held 94 % of the marks of bench/findings.py
_MOST_CORNERS = 64  # of an outline, that are cast
_WITHIN_3D = 2.7955  # sigmas: 95 % of a normal error in three axes lie within
_WITHIN_1D = 1.96
_HIT = 0.5  # share of an outline, at least, that is on the structure
_GRAZING_DEG = TRULY.max_incidence_deg


@dataclass(frozen=True)
class Errors:
    """Errors of the ray along which a mark was seen, and of the surface."""

    pose_m: float = 0.5  # of the position in 95 % of cases, where nothing states it
    attitude_deg: float = 0.4  # of the camera, one sigma about each axis: as of usual gimbals
    pixel_px: float = 1.0  # of the mark, one sigma across and down
    mesh_m: float = 0.0  # of the surface along its normal, in 95 % of cases


@dataclass(frozen=True, eq=False, repr=False)
class Located(Record):
    """A mark on the surface; errors and lengths in m, areas in m2, NaN of a single point."""

    place: Floats  # (3,) m
    normal: Floats  # (3,) unit, towards the camera
    outline: Floats  # (K, 3) m
    distance_m: float
    incidence_deg: float
    mm_px: float
    error_m: float
    pose_error_m: float
    pixel_error_m: float
    mesh_error_m: float
    length_m: float
    length_error_m: float
    area_m2: float
    area_error_m2: float


@dataclass(frozen=True)
class _View:
    scene: Scene
    camera: Camera
    position: Floats  # (3,) m
    turn: Floats  # (3, 3) camera to structure


def located(
    what: str, scene: Scene, camera: Camera, position: Floats, quat_xyzw: Floats, pixels: Floats,
    errors: Errors,
) -> Located:  # fmt: skip
    """Cast a mark of a photo on a structure; refused if it misses it, or looks at it too obliquely.

    Messages call it `what`. The scene is of the structure as it was scanned or drawn, and the camera has the
    pixels of the photo, with its position (3,), m, and orientation (4,) in the structure's frame. The pixels
    (K, 2) are a point, or the corners of an outline in order.
    """
    corners = _densified(pixels)
    middle = np.asarray(_centroid(corners))
    turn = matrices(quat_xyzw)
    aims = np.concatenate([middle[None], corners]) if len(corners) > 1 else middle[None]
    reach, _, normals = scene.cast(np.tile(position, (len(aims), 1)), rays_of(camera, aims) @ turn.T)
    hit = np.isfinite(reach)
    if not hit[0] and hit[1:].any():  # the middle of a ring: the nearest of its corners
        near = 1 + int(np.where(hit[1:], np.linalg.norm(corners - middle, axis=1), np.inf).argmin())
        middle, reach[0], normals[0], hit[0] = aims[near], reach[near], normals[near], True
    aims = np.concatenate([middle[None], aims[1:]])
    rays = rays_of(camera, aims) @ turn.T
    hit &= _together(reach, rays)
    if not hit[0] or hit.mean() < _HIT:
        off = f"with {100 * (~hit).mean():.0f} % of it"
        fault = f"is beside the structure, or on another surface than its middle, {off}"
        rule, remedy = f"{100 * _HIT:.0f} % at most", "check photo, time and pixel, or state --at X Y Z"
        raise RefusedError(what, fault, rule, remedy)
    ray = rays_of(camera, middle) @ turn.T
    place, normal = position + reach[0] * ray, -np.sign(normals[0] @ ray) * normals[0]
    incidence = float(np.degrees(np.arccos(np.clip(-normal @ ray, 0, 1))))
    if incidence > _GRAZING_DEG:
        fault = f"looks at the surface at {incidence:.0f} degrees from its normal"
        remedy = "mark it in a photo that looks more frontally"
        raise RefusedError(what, fault, f"at most {_GRAZING_DEG:g} degrees", remedy)
    pose, pixel = Errors(errors.pose_m, errors.attitude_deg, 0.0, 0.0), Errors(0.0, 0.0, errors.pixel_px, 0.0)
    parts = errors, pose, pixel, Errors(0.0, 0.0, 0.0, errors.mesh_m)
    from scipy.stats import norm, qmc  # a quarter of a second, which no page waits for

    noise = norm.ppf(qmc.Sobol(9, rng=0).random(_DRAWS))
    view = _View(scene, camera, position, turn)
    whole_m, pose_m, pixel_m, mesh_m = (_error_m(view, middle, place, part, noise) for part in parts)
    outline = position + (reach[1:, None] * rays[1:])[hit[1:]] if len(corners) > 1 else place[None]
    size = _sized(view, aims[hit], outline, errors, noise)
    looked = float(reach[0]), incidence, 1e3 * footprint_m(camera, position, place, normal)
    return Located(place, normal, outline, *looked, whole_m, pose_m, pixel_m, mesh_m, *size)


def _drawn(view: _View, pixels: Floats, errors: Errors, noise: Floats) -> tuple[Floats, Floats]:
    """Origins (D, K, 3) and rays (D, K, 3) of draws of pixels (D, K, 2) by normal noise (D, 9)."""
    origins, turns = drawn_poses(view.position, view.turn, errors, noise)
    rays = np.einsum("dik,dnk->dni", turns, rays_of(view.camera, pixels))
    return np.ascontiguousarray(np.broadcast_to(origins[:, None], rays.shape)), rays


def drawn_poses(position: Floats, turn: Floats, errors: Errors, noise: Floats) -> tuple[Floats, Floats]:
    """Positions (D, 3), m, and axes (D, 3, 3) that a pose may truly have, by normal noise (D, 6 or more)."""
    wobble = Rotation.from_rotvec(np.radians(errors.attitude_deg) * noise[:, 3:6]).as_matrix()
    return position + errors.pose_m / _WITHIN_3D * noise[:, :3], turn @ wobble


def _error_m(view: _View, pixel: Floats, place: Floats, errors: Errors, noise: Floats) -> float:
    """How far from the place, m, 95 % of the draws lie."""
    if errors == Errors(0.0, 0.0, 0.0, 0.0):
        return 0.0
    pixels = pixel + errors.pixel_px * noise[:, None, 6:8]
    origins, rays = (each[:, 0] for each in _drawn(view, pixels, errors, noise))
    reach, _, normals = view.scene.cast(origins, rays)
    hit = np.isfinite(reach)
    if not hit.any():
        return 0.0
    steep = np.maximum(np.abs(np.einsum("ij,ij->i", normals, rays)), np.cos(np.radians(_GRAZING_DEG)))
    deeper = errors.mesh_m / _WITHIN_1D * noise[:, 8] / steep
    places = origins[hit] + (reach + deeper)[hit, None] * rays[hit]
    return float(np.percentile(np.linalg.norm(places - place, axis=1), _DRAWN_PCT))


def _together(reach: Floats, rays: Floats) -> Bools:
    """Which rays (..., K, 3) end on what the first does: a grazing surface leads no farther from there."""
    first, way = reach[..., :1], rays[..., :1, :]
    with np.errstate(invalid="ignore"):
        apart = np.linalg.norm(reach[..., None] * rays - first[..., None] * way, axis=-1)
        angle = np.arccos(np.clip((rays * way).sum(axis=-1), -1, 1))
        return np.asarray(apart <= first * (1e-6 + angle / np.cos(np.radians(_GRAZING_DEG))), bool)


def _sized(
    view: _View, aims: Floats, outline: Floats, errors: Errors, noise: Floats
) -> tuple[float, float, float, float]:
    """Length and area of an outline on the surface, each with its error; aims are its middle and corners."""
    if len(outline) < 2:
        return (float("nan"),) * 4
    noise = noise[:_OUTLINES]
    read = np.random.default_rng(0).normal(0, errors.pixel_px, (_OUTLINES, *aims.shape))
    origins, rays = _drawn(view, aims + read, errors, noise)
    reach = view.scene.cast(origins.reshape(-1, 3), rays.reshape(-1, 3))[0].reshape(rays.shape[:2])
    whole = _together(reach, rays).all(axis=1)
    drawn = (origins + reach[..., None] * rays)[whole, 1:]
    length, area = _length(outline), _area(outline)
    if not len(drawn):
        return length, length, area, area
    # A surface that is nearer or farther shows a mark smaller or larger, by as much as its distance.
    nearer = 1 + errors.mesh_m / _WITHIN_1D * noise[whole, 8] / max(float(reach[whole].min()), 1e-6)
    longer = np.abs(nearer * [_length(each) for each in drawn] - length)
    larger = np.abs(nearer**2 * [_area(each) for each in drawn] - area)
    return length, float(np.percentile(longer, 95)), area, float(np.percentile(larger, 95))


def _length(outline: Floats) -> float:
    """The largest extent of points (K, 3)."""
    return float(np.linalg.norm(outline[:, None] - outline[None], axis=2).max())


def _area(outline: Floats) -> float:
    """Area of a polygon (K, 3), by its vector area; 0 of a line."""
    if len(outline) < 3:
        return 0.0
    spokes = outline - outline.mean(axis=0)
    return float(np.linalg.norm(np.cross(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0)) / 2)


def _densified(pixels: Floats) -> Floats:
    """The corners of an outline with places between them, as many as are cast."""
    if not 3 <= len(pixels) < _MOST_CORNERS:
        return np.asarray(pixels, float)[chosen_evenly(len(pixels), _MOST_CORNERS)]
    between = max(1, min(4, _MOST_CORNERS // len(pixels)))
    share = np.arange(between)[None, :, None] / between
    ends = np.roll(pixels, -1, axis=0)
    return np.asarray((pixels[:, None] * (1 - share) + ends[:, None] * share).reshape(-1, 2), float)


def _centroid(corners: Floats) -> Floats:
    """The middle of a polygon's area; of a line or a point the mean of its corners."""
    x, y = corners.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = cross.sum()
    if len(corners) < 3 or abs(area) < 1e-9:
        return np.asarray(corners.mean(axis=0))
    both = corners + np.roll(corners, -1, axis=0)
    return np.asarray((both * cross[:, None]).sum(axis=0) / (3 * area))
