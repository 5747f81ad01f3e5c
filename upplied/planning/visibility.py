"""Which points of a cloud each camera pose sees (paper, Sec. III-C: frustum culling), and truly sees.

The paper's frustum tells only where the camera points. With `VisibilitySettings.occlusion` a point
also needs a free line of sight and must not be seen too obliquely. The frustum and the incidence
are decided first, for all pairs in one compiled pass, so that rays are cast only where they matter.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.config import VisibilitySettings
from upplied.errors import SettingsError
from upplied.poses import matrices
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Visibility
from upplied.scene import Scene

_BLOCK = 400_000  # rays at a time: 10 MB


def visible(
    positions: Floats,
    quat_xyzw: Floats,
    cloud: Cloud,
    camera: Camera,
    settings: VisibilitySettings,
    scene: Scene | None = None,
) -> Visibility:
    """What each pose sees of a cloud.

    A point is in the frustum if, in the camera frame (x forward, y left, z up), its horizontal angle
    ``|atan2(y, x)|`` is at most half of `hfov_deg` and its vertical angle ``|atan2(z, x)|`` at most
    half of `vfov_deg`: a pyramid, which never holds anything behind the camera. From a horizontal
    field of 180 degrees on there is no picture plane, and the vertical angle is the elevation
    ``|atan2(z, hypot(x, y))|``; 360 by 180 degrees is the whole sphere.

    Parameters
    ----------
    positions : array, shape (P, 3), m, structure frame
    quat_xyzw : array, shape (P, 4)
        Camera to structure.
    cloud : Cloud
        N points. Its normals, where it has them, limit the incidence and hide back faces.
    camera : Camera
    settings : VisibilitySettings
        Without `occlusion` the frustum and the range alone decide, as in the paper.
    scene : Scene, optional
        What may stand in the way; needed with `occlusion`.

    Returns
    -------
    Visibility
        `seen` (P, N).

    Raises
    ------
    SettingsError
        If occlusion is asked for without a scene, or the camera's angles or ranges make no sense.

    Examples
    --------
    >>> ahead, behind, high = [10.0, 0, 0], [-10.0, 0, 0], [10.0, 0, 9]
    >>> cloud = Cloud(np.array([ahead, behind, high]))
    >>> at, level = np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]])
    >>> visible(at, level, cloud, Camera(), VisibilitySettings()).seen
    array([[ True, False, False]])
    """
    if settings.occlusion and scene is None:
        raise SettingsError("visibility", "occlusion without a scene", "a scene says what stands in the way")
    limits = _limits(camera, settings, cloud)
    origin = np.zeros(3) if scene is None else scene.origin
    points = np.ascontiguousarray(cloud.points, float) - origin
    normals = np.zeros((1, 3)) if cloud.normals is None else np.ascontiguousarray(cloud.normals, float)
    cameras = np.ascontiguousarray(positions, float) - origin
    axes = np.ascontiguousarray(matrices(quat_xyzw))
    seen = np.zeros((len(cameras), len(points)), bool)
    if not settings.occlusion:
        _cull(cameras, axes, points, normals, limits, seen)
        return Visibility(seen)
    assert scene is not None
    rays = np.empty((max(_BLOCK, len(points)), 6), np.float32)
    pairs = np.empty(len(rays), np.int64)
    pose = 0
    while pose < len(cameras):
        pose, count = _gather(cameras, axes, points, normals, limits, scene.grain_m, pose, rays, pairs)
        free = ~scene.blocked(rays[:count])
        seen.reshape(-1)[pairs[:count][free]] = True
    return Visibility(seen)


def _limits(camera: Camera, settings: VisibilitySettings, cloud: Cloud) -> Floats:
    """Sines and cosines of the half angles, squared ranges, and the least cosine of the incidence."""
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
            camera.min_range_m**2,
            camera.max_range_m**2,
            incidence,
        ]
    )


@njit(cache=True, inline="always")
def _inside(
    ray_x: float, ray_y: float, ray_z: float, axes: Floats, normals: Floats, index: int, limits: Floats
) -> bool:
    """Whether one ray, from a camera to a point, lies in frustum, range and incidence.

    An angle t in [0, pi] is at most a half angle h just when ``sin(h - t) >= 0``: no arc tangents.
    """
    squared = ray_x * ray_x + ray_y * ray_y + ray_z * ray_z
    if squared < limits[5] or squared > limits[6]:
        return False
    forward = ray_x * axes[0, 0] + ray_y * axes[1, 0] + ray_z * axes[2, 0]
    left = abs(ray_x * axes[0, 1] + ray_y * axes[1, 1] + ray_z * axes[2, 1])
    if forward * limits[0] < left * limits[1]:
        return False
    up = abs(ray_x * axes[0, 2] + ray_y * axes[1, 2] + ray_z * axes[2, 2])
    reach = np.sqrt(forward * forward + left * left) if limits[4] > 0 else forward
    if reach * limits[2] < up * limits[3]:
        return False
    if limits[7] < 0:
        return True
    facing = -(ray_x * normals[index, 0] + ray_y * normals[index, 1] + ray_z * normals[index, 2])
    return facing > 0 and facing * facing >= limits[7] * limits[7] * squared


@njit(cache=True)
def _cull(
    cameras: Floats, axes: Floats, points: Floats, normals: Floats, limits: Floats, seen: Bools
) -> None:
    for pose in range(len(cameras)):
        for index in range(len(points)):
            seen[pose, index] = _inside(
                points[index, 0] - cameras[pose, 0],
                points[index, 1] - cameras[pose, 1],
                points[index, 2] - cameras[pose, 2],
                axes[pose],
                normals,
                index,
                limits,
            )


@njit(cache=True)
def _gather(
    cameras: Floats,
    axes: Floats,
    points: Floats,
    normals: Floats,
    limits: Floats,
    grain: float,
    pose: int,
    rays: Floats,
    pairs: Ints,
) -> tuple[int, int]:
    """Rays of as many whole poses as fit, from `pose` on; the next pose, and how many rays there are.

    Each ray ends `grain` short of its point.
    """
    count, number = 0, len(points)
    while pose < len(cameras) and count + number <= len(rays):
        for index in range(number):
            ray_x = points[index, 0] - cameras[pose, 0]
            ray_y = points[index, 1] - cameras[pose, 1]
            ray_z = points[index, 2] - cameras[pose, 2]
            if _inside(ray_x, ray_y, ray_z, axes[pose], normals, index, limits):
                rays[count, 0] = cameras[pose, 0]
                rays[count, 1] = cameras[pose, 1]
                rays[count, 2] = cameras[pose, 2]
                share = 1.0
                if grain > 0:
                    length = np.sqrt(ray_x * ray_x + ray_y * ray_y + ray_z * ray_z)
                    share = max(1.0 - grain / max(length, 1e-12), 0.0)
                rays[count, 3] = ray_x * share
                rays[count, 4] = ray_y * share
                rays[count, 5] = ray_z * share
                pairs[count] = pose * number + index
                count += 1
        pose += 1
    return pose, count
