"""What each photo of a plan shows, how finely and sharply, and what of it the one before shows too."""

from __future__ import annotations

import numpy as np

from upplied.config import InspectionSettings, focal_px
from upplied.geometry.scene import Scene
from upplied.overlap import Frames
from upplied.planning.visibility.frustum import coarseness, visible
from upplied.planning.visibility.looks import sharp_looks
from upplied.planning.visibility.observations import TRULY, Moments, Views, rates
from upplied.records import Bools, Camera, Cloud, Photos, Trajectory


def photos_of(
    path: Trajectory, photo: Bools, cloud: Cloud, camera: Camera, scene: Scene, rule: InspectionSettings
) -> Photos:
    """What each photo of a path shows of some surface samples, how finely and how sharply.

    Parameters
    ----------
    path : Trajectory
        N poses.
    photo : array of bool, shape (N,)
    cloud : Cloud
        Surface samples with normals.
    camera : Camera
    scene : Scene
    rule : InspectionSettings
        The limits of a look that counts, and what is assumed of a camera.
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
