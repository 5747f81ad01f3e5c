"""Which points of a cloud each camera pose sees (paper, Sec. III-C: frustum culling), and truly sees.

The paper's frustum tells only where the camera points. With `VisibilitySettings.occlusion` a point
also needs a free line of sight and must not be seen too obliquely. The frustum and the incidence
are decided first, for all pairs, so that rays are cast only where they matter."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.config import VisibilitySettings, focal_px
from upplied.errors import SettingsError
from upplied.geometry.poses import matrices
from upplied.geometry.scene import Scene
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Visibility

_BLOCK = 200_000  # rays at a time
_SOME = (0.5, 0.25, 0.75)  # of the poses that may see a point, asked before all of them


@dataclass(frozen=True, eq=False, repr=False)
class Closeness(Record):
    """From how near, and how frontally, each of N points with normals must be seen to count."""

    farthest_m: Floats  # (N,) from where a frontal look resolves each, an oblique one times its cosine
    least_cosine: Floats | None = None  # (N,) of the incidence
    coarse: Floats | None = None  # (P,) what the distances from each pose are taken times: `coarseness`


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
    positions, quat_xyzw : array, shape (P, 3) and (P, 4), m, structure frame
    cloud : Cloud
        N points. Its normals, where it has them, limit the incidence and hide back faces.
    settings : VisibilitySettings
        Without `occlusion` the frustum and the range alone decide, as in the paper.
    scene : Scene, optional
        What may stand in the way; needed with `occlusion`.
    fov_deg : array, shape (P, 2), deg, optional
        Horizontal and vertical field of view of each pose, where the camera zooms.
    closeness : Closeness, optional
        From how near each point must be seen.

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
    """Which points (N,) some pose sees: as `visible(...).seen.any(axis=0)`, with a few rays for each point.

    The parameters are those of `visible`, with occlusion.
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
    start = (positions - scene.origin)[pose]
    rays = np.hstack([start, (points - scene.origin)[point] - start]).astype(np.float32)
    if scene.grain_m:
        length = np.maximum(np.linalg.norm(rays[:, 3:], axis=1, keepdims=True), 1e-12)
        rays[:, 3:] *= np.maximum(1 - scene.grain_m / length, 0.0)
    return ~scene.blocked(rays)


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
