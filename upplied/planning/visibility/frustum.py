"""Which points lie in the frustum, range and incidence of which camera: compiled, in bunches.

Points are sorted so that neighbours which face the same way stand together. A bunch of them has a
bounding sphere and a cone of normals, and is left out as a whole where none of it can be seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.config import VisibilitySettings, focal_px
from upplied.errors import SettingsError
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record

_BUNCH = 24  # points
_FEW_POSES = 40  # for fewer, sorting costs more than it saves


@dataclass(frozen=True, eq=False, repr=False)
class Bunches(Record):
    """Points in bunches, local to the scene."""

    points: Floats  # (3, N) m, sorted
    normals: Floats  # (3, N), sorted; zero where the incidence does not count
    order: Ints  # (N,) index in the cloud
    start: Ints  # (B + 1,) first point of each bunch
    bounds: Floats  # (9, B) centre and radius of the sphere, m; axis of the cone, and cosine and sine
    # of the angle beyond which all of the bunch faces away (half a turn: never)


def limits_of(
    camera: Camera, settings: VisibilitySettings, cloud: Cloud, fov_deg: Floats | None = None
) -> Floats:
    """Sines and cosines of the half angles, ranges, and the least cosine of the incidence: (8,), or a
    row for each pose (P, 8) where the camera zooms.

    Raises
    ------
    SettingsError
        If the camera's angles or ranges make no sense.
    """
    if not (0 < camera.hfov_deg <= 360 and 0 < camera.vfov_deg <= 180):
        raise SettingsError(
            "camera",
            f"field of view {camera.hfov_deg:g} x {camera.vfov_deg:g} deg",
            "horizontal above 0 and up to 360, vertical above 0 and up to 180 deg",
        )
    if not 0 <= camera.min_range_m < camera.max_range_m:
        raise SettingsError(
            "camera", f"range {camera.min_range_m:g} to {camera.max_range_m:g} m", "0 <= smallest < largest"
        )
    if fov_deg is not None:
        return np.array([limits_of(each, settings, cloud) for each in camera.zoomed(fov_deg)])
    half_h, half_v = np.radians(camera.hfov_deg / 2), np.radians(camera.vfov_deg / 2)
    incidence = -1.0
    if settings.occlusion and cloud.normals is not None:
        incidence = max(float(np.cos(np.radians(settings.max_incidence_deg))), 1e-6)
    return np.array(
        [
            np.sin(half_h) if camera.hfov_deg < 360 else 0.0,
            np.cos(half_h),
            np.sin(half_v) if camera.vfov_deg < 180 else 1.0,
            np.cos(half_v) if camera.vfov_deg < 180 else 0.0,
            float(camera.hfov_deg >= 180),
            camera.min_range_m,
            camera.max_range_m,
            incidence,
        ]
    )


def coarseness(camera: Camera, fov_deg: Floats | None) -> Floats | None:
    """How many times as far off (P,) the camera would show as coarsely as it shows at these zooms.

    None where it does not zoom. A look through a wide field of view from 5 m may show no more than one
    through a narrow one from 20 m: times this, distances are of one camera, and may be compared.
    """
    if fov_deg is None:
        return None
    return focal_px(1, camera.hfov_deg) / np.array([focal_px(1, float(angle)) for angle in fov_deg[:, 0]])


def bunches_of(cloud: Cloud, origin: Floats, limits: Floats, poses: int) -> Bunches:
    """Sort a cloud into bunches, or leave it in one where only a few poses ask."""
    points, normals = np.asarray(cloud.points, float) - origin, np.zeros((len(cloud), 3))
    least_cosine = float(limits[..., 7].max())
    if least_cosine > 0 and cloud.normals is not None:
        normals = np.asarray(cloud.normals, float)
    if poses < _FEW_POSES or len(points) < 4 * _BUNCH:
        bounds = np.zeros((9, 1))
        bounds[3] = 1e300  # every camera is inside of that sphere
        order, start = np.arange(len(points)), np.array([0, len(points)])
    else:
        rows, face = np.arange(len(points)), np.abs(normals).argmax(axis=1)
        key = _places_on_curve(points) + ((2 * face + (normals[rows, face] > 0)) << 30)
        order = np.argsort(key, kind="stable")
        points, normals = points[order], normals[order]
        start = np.append(np.arange(0, len(points), _BUNCH), len(points))
        bounds = _bounds(points, normals, start, least_cosine)
    rows_of = np.ascontiguousarray
    return Bunches(rows_of(points.T), rows_of(normals.T), order, start, rows_of(bounds))


def _places_on_curve(points: Floats) -> Ints:
    """Place of each point on a Z-order curve of 2^30 cells."""
    low, extent = points.min(axis=0), float(np.ptp(points, axis=0).max())
    cell = np.minimum((points - low) * (1023 / max(extent, 1e-9)), 1023).astype(np.int64)
    for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
        cell = (cell | (cell << shift)) & mask
    return np.asarray(cell[:, 0] | (cell[:, 1] << 1) | (cell[:, 2] << 2), np.int64)


def _bounds(points: Floats, normals: Floats, start: Ints, least_cosine: float) -> Floats:
    """Sphere and cone of each bunch, (9, B)."""
    size = np.diff(start)[:, None]
    bunch = np.repeat(np.arange(len(size)), size[:, 0])
    centre = np.add.reduceat(points, start[:-1]) / size
    radius = np.maximum.reduceat(np.linalg.norm(points - centre[bunch], axis=1), start[:-1])
    axis = np.add.reduceat(normals, start[:-1])
    length = np.linalg.norm(axis, axis=1)
    axis /= np.maximum(length, 1e-9)[:, None]
    cosine = np.minimum.reduceat((normals * axis[bunch]).sum(axis=1), start[:-1])
    widest = np.arccos(np.clip(cosine, -1, 1)) + np.arccos(np.clip(least_cosine, -1, 1))
    widest[(length < 1e-9) | (widest > np.pi) | (least_cosine < 0)] = np.pi
    return np.column_stack([centre, radius, axis, np.cos(widest), np.sin(widest)]).T


@njit(cache=True, inline="always")
def _mark_bunches(camera: Floats, axes: Floats, bounds: Floats, limits: Floats, possible: Bools) -> None:
    """Mark the bunches of which a camera may see anything; never leaves one out of which it does."""
    at_x, at_y, at_z = camera[0], camera[1], camera[2]
    f_x, f_y, f_z = axes[0, 0], axes[1, 0], axes[2, 0]
    l_x, l_y, l_z = axes[0, 1], axes[1, 1], axes[2, 1]
    u_x, u_y, u_z = axes[0, 2], axes[1, 2], axes[2, 2]
    sin_h, cos_h, sin_v, cos_v, panoramic = limits[0], limits[1], limits[2], limits[3], limits[4] > 0
    for bunch in range(len(possible)):
        radius = bounds[3, bunch]
        x, y, z = bounds[0, bunch] - at_x, bounds[1, bunch] - at_y, bounds[2, bunch] - at_z
        distance = np.sqrt(x * x + y * y + z * z)
        forward = x * f_x + y * f_y + z * f_z
        left = abs(x * l_x + y * l_y + z * l_z)
        up = abs(x * u_x + y * u_y + z * u_z)
        reach = np.sqrt(forward * forward + left * left) if panoramic else forward
        ok = (distance - radius <= limits[6]) & (distance + radius >= limits[5])
        ok &= (forward * sin_h - left * cos_h >= -radius) & (reach * sin_v - up * cos_v >= -radius)
        # All normals lie within an angle of the axis, all sight lines within another of the centre's:
        # to be seen at all, the axis must face the camera within the sum of both and the limit.
        sine = min(radius / max(distance, 1e-12), 1.0)
        cosine = np.sqrt(1 - sine * sine)
        wide_cos, wide_sin = bounds[7, bunch], bounds[8, bunch]
        facing = -(x * bounds[4, bunch] + y * bounds[5, bunch] + z * bounds[6, bunch])
        faces = facing >= (wide_cos * cosine - wide_sin * sine - 1e-9) * distance
        whole_turn = wide_sin * cosine + wide_cos * sine <= 0
        possible[bunch] = ok & (faces | whole_turn | (distance <= radius))


@njit(cache=True, inline="always")
def _mark_inside(
    camera: Floats,
    axes: Floats,
    points: Floats,
    normals: Floats,
    first: int,
    last: int,
    limits: Floats,
    inside: Bools,
) -> None:
    """Mark in `inside` which points of a bunch lie in frustum, range and incidence.

    An angle t in [0, pi] is at most a half angle h just when ``sin(h - t) >= 0``: no arc tangents.
    There are no branches, so that several points are decided at a time.
    """
    at_x, at_y, at_z = camera[0], camera[1], camera[2]
    f_x, f_y, f_z = axes[0, 0], axes[1, 0], axes[2, 0]
    l_x, l_y, l_z = axes[0, 1], axes[1, 1], axes[2, 1]
    u_x, u_y, u_z = axes[0, 2], axes[1, 2], axes[2, 2]
    sin_h, cos_h, sin_v, cos_v, panoramic = limits[0], limits[1], limits[2], limits[3], limits[4] > 0
    nearest, farthest, cosine = limits[5] * limits[5], limits[6] * limits[6], limits[7]
    p_x, p_y, p_z = points[0, first:last], points[1, first:last], points[2, first:last]
    n_x, n_y, n_z = normals[0, first:last], normals[1, first:last], normals[2, first:last]
    for index in range(len(p_x)):
        x, y, z = p_x[index] - at_x, p_y[index] - at_y, p_z[index] - at_z
        squared = x * x + y * y + z * z
        forward = x * f_x + y * f_y + z * f_z
        left = abs(x * l_x + y * l_y + z * l_z)
        up = abs(x * u_x + y * u_y + z * u_z)
        reach = np.sqrt(forward * forward + left * left) if panoramic else forward
        ok = (squared >= nearest) & (squared <= farthest)
        ok &= (forward * sin_h >= left * cos_h) & (reach * sin_v >= up * cos_v)
        facing = -(x * n_x[index] + y * n_y[index] + z * n_z[index])
        ok &= (cosine < 0) | ((facing > 0) & (facing * facing >= cosine * cosine * squared))
        inside[index] = ok


@njit(cache=True)
def in_view(
    cameras: Floats,
    axes: Floats,
    limits: Floats,
    points: Floats,
    normals: Floats,
    order: Ints,
    start: Ints,
    bounds: Floats,
    seen: Bools,
) -> None:
    """Mark in `seen` (P, N) what frustum, range and incidence leave over."""
    inside, possible = np.zeros(len(order), np.bool_), np.zeros(len(start) - 1, np.bool_)
    for pose in range(len(cameras)):
        _mark_bunches(cameras[pose], axes[pose], bounds, limits[pose], possible)
        for bunch in range(len(possible)):
            if possible[bunch]:
                first, last = start[bunch], start[bunch + 1]
                _mark_inside(cameras[pose], axes[pose], points, normals, first, last, limits[pose], inside)
                for index in range(last - first):
                    seen[pose, order[first + index]] = inside[index]


@njit(cache=True)
def gather_rays(
    cameras: Floats,
    axes: Floats,
    limits: Floats,
    points: Floats,
    normals: Floats,
    order: Ints,
    start: Ints,
    bounds: Floats,
    grain: float,
    pose: int,
    rays: Floats,
    pairs: Ints,
) -> tuple[int, int]:
    """Rays of as many whole poses as fit, from `pose` on; the next pose, and how many rays there are.

    Each ray ends `grain` short of its point; `pairs` says which entry of (P, N) it decides.
    """
    count, number = 0, len(order)
    inside, possible = np.zeros(number, np.bool_), np.zeros(len(start) - 1, np.bool_)
    while pose < len(cameras) and count + number < len(rays):
        _mark_bunches(cameras[pose], axes[pose], bounds, limits[pose], possible)
        for bunch in range(len(possible)):
            if not possible[bunch]:
                continue
            first, last = start[bunch], start[bunch + 1]
            _mark_inside(cameras[pose], axes[pose], points, normals, first, last, limits[pose], inside)
            for index in range(first, last):
                # Always written, kept only where inside: cheaper than to guess.
                rays[count, 0] = cameras[pose, 0]
                rays[count, 1] = cameras[pose, 1]
                rays[count, 2] = cameras[pose, 2]
                rays[count, 3] = points[0, index] - cameras[pose, 0]
                rays[count, 4] = points[1, index] - cameras[pose, 1]
                rays[count, 5] = points[2, index] - cameras[pose, 2]
                pairs[count] = pose * number + order[index]
                count += inside[index - first]
        pose += 1
    if grain > 0:
        _shorten(rays, count, grain)
    return pose, count


@njit(cache=True)
def _shorten(rays: Floats, count: int, grain: float) -> None:
    for ray in range(count):
        length = np.sqrt(rays[ray, 3] ** 2 + rays[ray, 4] ** 2 + rays[ray, 5] ** 2)
        share = max(1 - grain / max(length, 1e-12), 0.0)
        for axis in range(3, 6):
            rays[ray, axis] *= share


@njit(cache=True)
def mark_free(pairs: Ints, blocked: Bools, seen: Bools) -> None:
    """Mark in `seen`, flat, the entries whose rays arrived."""
    for index in range(len(blocked)):
        if not blocked[index]:
            seen[pairs[index]] = True
