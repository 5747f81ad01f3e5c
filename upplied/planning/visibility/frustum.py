"""Which points lie in the frustum, range and incidence of which camera, and near enough to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.config import VisibilitySettings, focal_px
from upplied.errors import SettingsError
from upplied.records import Bools, Camera, Cloud, Floats, Record


@dataclass(frozen=True, eq=False, repr=False)
class Closeness(Record):
    """From how near, and how frontally, each of N points with normals must be seen to count."""

    farthest_m: Floats  # (N,) from where a frontal look resolves each, an oblique one times its cosine
    least_cosine: Floats | None = None  # (N,) of the incidence
    coarse: Floats | None = None  # (P,) what the distances from each pose are taken times: `coarseness`


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


def facing_normals(cloud: Cloud, limits: Floats) -> Floats:
    """The cloud's normals (N, 3); zero where the incidence does not count."""
    if cloud.normals is None or float(limits[..., 7].max()) <= 0:
        return np.zeros((len(cloud), 3))
    return np.asarray(cloud.normals, float)


@njit(cache=True)
def in_view(
    cameras: Floats,
    axes: Floats,
    limits: Floats,
    coarse: Floats,
    points: Floats,
    normals: Floats,
    farthest_m: Floats,
    least_cosine: Floats,
    seen: Bools,
) -> None:
    """Mark in `seen` (P, N) which points (3, N) with normals lie in frustum, range and incidence.

    Where `coarse` (P,) is above zero, as near and as frontally as each point (N,) has to be seen, too.

    An angle t in [0, pi] is at most a half angle h just when ``sin(h - t) >= 0``: no arc tangents.
    There are no branches, so that several points are decided at a time.
    """
    p_x, p_y, p_z = points[0], points[1], points[2]
    n_x, n_y, n_z = normals[0], normals[1], normals[2]
    inside = np.zeros(len(p_x), np.bool_)
    for pose in range(len(cameras)):
        at_x, at_y, at_z = cameras[pose, 0], cameras[pose, 1], cameras[pose, 2]
        f_x, f_y, f_z = axes[pose, 0, 0], axes[pose, 1, 0], axes[pose, 2, 0]
        l_x, l_y, l_z = axes[pose, 0, 1], axes[pose, 1, 1], axes[pose, 2, 1]
        u_x, u_y, u_z = axes[pose, 0, 2], axes[pose, 1, 2], axes[pose, 2, 2]
        sin_h, cos_h, sin_v, cos_v = limits[pose, 0], limits[pose, 1], limits[pose, 2], limits[pose, 3]
        panoramic, cosine = limits[pose, 4] > 0, limits[pose, 7]
        nearest, farthest = limits[pose, 5] * limits[pose, 5], limits[pose, 6] * limits[pose, 6]
        wide, anywhere = coarse[pose], coarse[pose] <= 0
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
            least = least_cosine[index]
            near = squared * wide <= farthest_m[index] * facing
            ok &= anywhere | (near & (facing * facing >= least * least * squared))
            inside[index] = ok
        seen[pose] = inside
