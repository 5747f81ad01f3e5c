"""Which points of a cloud each camera pose sees (paper, Sec. III-C: frustum culling), and truly sees.

The paper's frustum tells only where the camera points. With `VisibilitySettings.occlusion` a point
also needs a free line of sight and must not be seen too obliquely. The frustum and the incidence
are decided first, for all pairs, so that rays are cast only where they matter."""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.config import VisibilitySettings
from upplied.errors import SettingsError
from upplied.geometry.poses import matrices
from upplied.geometry.scene import Scene
from upplied.planning.visibility.frustum import Closeness, facing_normals, in_view, limits_of
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Visibility

_BLOCK = 200_000  # rays at a time
_SOME = (0.5, 0.25, 0.75)  # of the poses that may see a point, asked before all of them


def visible(
    positions: Floats,
    quat_xyzw: Floats,
    cloud: Cloud,
    camera: Camera,
    settings: VisibilitySettings,
    scene: Scene | None = None,
    fov_deg: Floats | None = None,
    closeness: Closeness | None = None,
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
    closeness : Closeness, optional
        From how near each point must be seen.

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
    seen = _in_frustum(positions, quat_xyzw, cloud, camera, settings, scene, fov_deg, closeness)
    if settings.occlusion and scene is not None:
        entries = np.flatnonzero(seen)
        for first in range(0, len(entries), _BLOCK):
            some = entries[first : first + _BLOCK]
            rays = np.divmod(some, len(cloud))
            seen.reshape(-1)[some] = _arrives(positions, cloud.points, *rays, scene)
    return Visibility(seen)


def seen_by_any(
    positions: Floats,
    quat_xyzw: Floats,
    cloud: Cloud,
    camera: Camera,
    settings: VisibilitySettings,
    scene: Scene,
    fov_deg: Floats | None = None,
    closeness: Closeness | None = None,
) -> Bools:
    """Which points some pose sees: as `visible(...).seen.any(axis=0)`, with a few rays for each point.

    Parameters
    ----------
    positions, quat_xyzw, cloud, camera, settings, scene, fov_deg, closeness
        As above; `settings` with occlusion.

    Returns
    -------
    array of bool, shape (N,)
    """
    may = _in_frustum(positions, quat_xyzw, cloud, camera, settings, scene, fov_deg, closeness)
    point, pose = np.nonzero(np.ascontiguousarray(may.T))
    first = np.searchsorted(point, np.arange(len(cloud) + 1))
    number = np.diff(first)
    seen, tried = np.zeros(len(cloud), bool), np.zeros(len(point), bool)
    for share in (*_SOME, None):  # of its poses in order: of neighbours one is as good as another
        open_ = np.flatnonzero(~seen & (number > 0))
        some = np.flatnonzero(~(tried | seen[point]))
        if share is not None:
            some = first[open_] + (share * number[open_]).astype(np.int64)
        tried[some] = True
        free = _arrives(positions, cloud.points, pose[some], point[some], scene)
        seen[point[some[free]]] = True
    return seen


def _arrives(positions: Floats, points: Floats, pose: Ints, point: Ints, scene: Scene) -> Bools:
    """Which of these lines of sight (K,), from a pose to a point, are free but for the scene's grain."""
    rays = np.empty((len(pose), 6), np.float32)
    _set_rays(rays, positions - scene.origin, points - scene.origin, pose, point)
    if scene.grain_m:
        length = np.maximum(np.linalg.norm(rays[:, 3:], axis=1, keepdims=True), 1e-12)
        rays[:, 3:] *= np.maximum(1 - scene.grain_m / length, 0.0)
    return ~scene.blocked(rays)


@njit(cache=True)
def _set_rays(rays: Floats, positions: Floats, points: Floats, pose: Ints, point: Ints) -> None:
    for ray in range(len(pose)):
        for axis in range(3):
            start = positions[pose[ray], axis]
            rays[ray, axis], rays[ray, 3 + axis] = start, points[point[ray], axis] - start


def _in_frustum(
    positions: Floats,
    quat_xyzw: Floats,
    cloud: Cloud,
    camera: Camera,
    settings: VisibilitySettings,
    scene: Scene | None,
    fov_deg: Floats | None,
    closeness: Closeness | None,
) -> Bools:
    """Which points (P, N) lie where each pose could see them, local to the scene; no rays are cast."""
    limits = limits_of(camera, settings, cloud, fov_deg)
    origin = np.zeros(3) if scene is None else scene.origin
    cameras, axes = np.ascontiguousarray(positions, float) - origin, matrices(quat_xyzw)
    points = np.asarray(cloud.points, float) - origin
    normals, coarse, nothing = facing_normals(cloud, limits), np.zeros(len(positions)), np.zeros(len(cloud))
    farthest_m = least_cosine = nothing
    if closeness is not None:
        normals, farthest_m = cloud.outward, closeness.farthest_m
        least_cosine = nothing if closeness.least_cosine is None else closeness.least_cosine
        coarse = np.ones(len(positions)) if closeness.coarse is None else closeness.coarse
    limits = np.repeat(limits[None], len(positions), axis=0) if limits.ndim == 1 else limits
    points, normals = (np.ascontiguousarray(of.T) for of in (points, normals))
    seen = np.zeros((len(positions), len(cloud)), bool)
    in_view(cameras, axes, limits, coarse, points, normals, farthest_m, least_cosine, seen)
    return seen
