"""The score by which the CARIC challenge compares inspections: sight times sharpness times resolution.

Written from its published formula: a picture of a point is worth ``q_seen * q_blur * q_res``, and nothing
below a fifth; a point is worth its best picture.
"""

import numpy as np
from numba import njit

from upplied.config import InspectionSettings, focal_px
from upplied.geometry.poses import matrices
from upplied.geometry.scene import Scene
from upplied.overlap import Frames
from upplied.planning.measures.fidelity import Compared
from upplied.planning.visibility.line_of_sight import coarseness, visible
from upplied.planning.visibility.looks import sharp_looks
from upplied.planning.visibility.observations import TRULY, Moments, Views, rates, stations_at
from upplied.records import Bools, Camera, Cloud, Floats, Photos, Trajectory

_LEAST = 0.2  # below it a picture is worth nothing
_FLAT_DEG = 120.0  # of a field of view, beyond which there is no picture plane


def picture_score(of: Compared) -> dict[str, float]:
    """`Measures.picture_score`: mean worth of the patches, of which the demonstrated resolution is desired.

    Each step of the plan is a picture.
    """
    steps, shown, patches, rule = of.steps, of.views, of.patches, of.settings.inspection
    camera, finest_m = of.takes[0].inspection.camera, patches.shown.sampled_m
    known = np.isfinite(finest_m) & (patches.weight > 0)
    if not known.any() or camera.hfov_deg > _FLAT_DEG:
        return {}
    station, target = stations_at(shown, steps), patches.target[known]
    pixel = 1 / focal_px(camera.width_px or rule.width_px, camera.hfov_deg)
    worth = picture_worth(
        steps,
        shown.seen[np.ix_(station, target)],
        of.inspected.cloud.at(target),
        pixel * finest_m[known],
        pixel * shown.coarseness[station],
        camera.exposure_s or rule.exposure_s,
    )
    return {"picture_score": float(np.average(worth, weights=patches.weight[known]))}


def picture_worth(
    steps: Moments, seen: Bools, cloud: Cloud, desired_m: Floats, pixel: Floats, exposure_s: float
) -> Floats:
    """The worth (N,) of the best picture of each of N points, 0 to 1.

    ``q_blur`` is a pixel over the larger of the motions across and up during the exposure, ``q_res`` the
    desired metres a pixel over the larger of those where the tangent plane cuts the camera's horizontal
    and vertical plane; neither is more than 1.

    Parameters
    ----------
    steps : Moments
        K pictures.
    seen : array of bool, shape (K, N)
        ``q_seen``.
    desired_m : array, shape (N,)
        Metres a pixel, that are enough.
    pixel : array, shape (K,)
        Tangent of the angle of the middle pixel.
    """
    axes = np.ascontiguousarray(matrices(steps.poses.quat_xyzw).transpose(0, 2, 1))
    moving = steps.poses.positions, axes, steps.velocity, steps.turn
    arguments = (*moving, cloud.points, cloud.outward, desired_m, pixel)
    arrays = tuple(np.ascontiguousarray(of, float) for of in arguments)
    return _best(np.ascontiguousarray(seen), exposure_s, arrays)


@njit(cache=True)
def _best(
    seen: Bools, exposure_s: float, arrays: tuple[Floats, ...]
) -> Floats:  # pragma: no cover - compiled
    positions, axes, velocity, turn, points, normals, desired_m, pixel = arrays
    best, rows = np.zeros(len(points)), range(3)
    ray, moving = np.empty(3), np.empty(3)
    at, after, normal = np.empty(3), np.empty(3), np.empty(3)  # forward, left, up
    for pose in range(len(positions)):
        v, w, axis = velocity[pose], turn[pose], axes[pose]
        for index in range(len(points)):
            if not seen[pose, index]:
                continue
            for row in rows:
                ray[row] = points[index, row] - positions[pose, row]
            for row in rows:
                second, third = (row + 1) % 3, (row + 2) % 3
                moving[row] = v[row] + w[second] * ray[third] - w[third] * ray[second]
            for row in rows:
                at[row] = _dot(axis[row], ray)
                after[row] = at[row] - exposure_s * _dot(axis[row], moving)
                normal[row] = _dot(axis[row], normals[index])
            if at[0] <= 0 or after[0] <= 0:
                continue
            moved, covered = 0.0, 0.0
            for row in (1, 2):
                moved = max(moved, abs(after[row] / after[0] - at[row] / at[0]))
                # How far a metre moves in the picture, on the tangent plane with no step up (to the left).
                length = np.hypot(normal[row], normal[0])
                rate = abs(normal[0] + normal[row] * at[row] / at[0]) / max(length * at[0], 1e-12)
                covered = max(covered, pixel[pose] / max(rate, 1e-12))
            worth = min(pixel[pose] / max(moved, 1e-12), 1.0)
            worth *= min(desired_m[index] / max(covered, 1e-12), 1.0)
            if worth >= _LEAST:
                best[index] = max(best[index], worth)
    return best


@njit(cache=True, inline="always")
def _dot(one: Floats, other: Floats) -> float:  # pragma: no cover - compiled
    return float(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])


def photos_of(
    path: Trajectory, photo: Bools, cloud: Cloud, camera: Camera, scene: Scene, rule: InspectionSettings
) -> Photos:
    """What each photo (N,) of a path of N poses shows of some surface samples, how finely and how sharply.

    The samples have normals; `rule` limits the looks that count, and says what is assumed of a camera.
    """
    taken = path.take(photo)
    velocity, turn = (of[photo] for of in rates(path))
    seen = visible(taken.positions, taken.quat_xyzw, cloud, camera, TRULY, scene, fov_deg=taken.fov_deg).seen
    coarse = coarseness(camera, taken.fov_deg)
    limits = (
        rule.sharp_radps(camera.hfov_deg, camera.width_px, camera.exposure_s),
        float(np.cos(np.radians(rule.max_incidence_deg))),
    )
    rows = []
    for at in range(len(taken)):
        one = slice(at, at + 1)
        steps = Moments(taken.take(one), np.ones(1), velocity[one], turn[one])
        shown = Views(taken.take(one), seen[one], None if coarse is None else coarse[one])
        looks = sharp_looks(steps, shown, cloud, camera, *limits)
        sharp = np.isfinite(looks.sampled_m)
        shown_by = (looks.sampled_m[sharp], looks.moved[sharp])
        rows.append([float(sharp.sum()), *(np.median(of) if len(of) else np.nan for of in shown_by)])
    count, sampled, moved = np.array(rows).reshape(-1, 3).T
    focal = focal_px(camera.width_px or rule.width_px, camera.hfov_deg)
    frames = Frames(taken, camera, scene)
    overlap = [np.nan, *(100 * frames.overlap(at - 1, at) for at in range(1, len(taken)))][: len(taken)]
    return Photos(
        taken.t_s,
        taken.positions,
        taken.quat_xyzw,
        count.astype(np.int64),
        1e3 * sampled / focal,
        moved * focal * (camera.exposure_s or rule.exposure_s),
        np.array(overlap),
    )
