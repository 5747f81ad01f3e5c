"""Which points of a cloud each camera pose sees (paper, Sec. III-C: frustum culling), and truly sees.

The paper's frustum tells only where the camera points. With `VisibilitySettings.occlusion` a point
also needs a free line of sight and must not be seen too obliquely. The frustum and the incidence
are decided first, for all pairs in one compiled pass, so that rays are cast only where they matter.
"""

from __future__ import annotations

import numpy as np

from upplied.config import VisibilitySettings
from upplied.errors import SettingsError
from upplied.planning.visibility.frustum import bunches_of, gather_rays, in_view, limits_of, mark_free
from upplied.poses import matrices
from upplied.records import Camera, Cloud, Floats, Visibility
from upplied.scene import Scene

_BLOCK = 200_000  # rays at a time: 5 MB


def visible(
    positions: Floats,
    quat_xyzw: Floats,
    cloud: Cloud,
    camera: Camera,
    settings: VisibilitySettings,
    scene: Scene | None = None,
    fov_deg: Floats | None = None,
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
    fov_deg : array, shape (P, 2), deg, optional
        Horizontal and vertical field of view of each pose, where the camera zooms.

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
    limits = limits_of(camera, settings, cloud, fov_deg)
    origin = np.zeros(3) if scene is None else scene.origin
    sorted_cloud = bunches_of(cloud, origin, limits, len(positions))
    bunches = (
        sorted_cloud.points,
        sorted_cloud.normals,
        sorted_cloud.order,
        sorted_cloud.start,
        sorted_cloud.bounds,
    )
    limits = np.repeat(limits[None], len(positions), axis=0) if limits.ndim == 1 else limits
    cameras = np.ascontiguousarray(positions, float) - origin
    axes = np.ascontiguousarray(matrices(quat_xyzw))
    seen = np.zeros((len(cameras), len(cloud)), bool)
    if not settings.occlusion or scene is None:
        in_view(cameras, axes, limits, *bunches, seen)
        return Visibility(seen)
    rays = np.empty((max(_BLOCK, len(cloud)) + 1, 6), np.float32)
    pairs = np.empty(len(rays), np.int64)
    pose = 0
    while pose < len(cameras):
        pose, count = gather_rays(cameras, axes, limits, *bunches, scene.grain_m, pose, rays, pairs)
        mark_free(pairs[:count], scene.blocked(rays[:count]), seen.reshape(-1))
    return Visibility(seen)
