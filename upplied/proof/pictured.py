"""How fine, how sharp and how long the pictures of a flight show each sample of a surface."""

from __future__ import annotations

import numpy as np

from upplied.config import InspectionSettings, focal_px
from upplied.geometry.scene import Scene
from upplied.planning.visibility.looks import sharp_looks
from upplied.planning.visibility.moments import moments
from upplied.planning.visibility.observations import TRULY, views
from upplied.records import Camera, Cloud, Floats, Trajectory


def pictured(
    path: Trajectory, cloud: Cloud, camera: Camera, scene: Scene, rule: InspectionSettings
) -> dict[str, Floats]:
    """Ground sample distance, mm, motion blur, px, and time in sharp view, s, of each sample (N,); NaN: none.

    Distance and blur are those of the finest sharp look.

    Parameters
    ----------
    path : Trajectory
    cloud : Cloud
        N samples with normals.
    camera : Camera
    scene : Scene
    rule : InspectionSettings
        The limits of a sharp look, and what is assumed of the camera.
    """
    steps = moments(path)
    sharp = rule.sharp_radps(camera.hfov_deg, camera.width_px, camera.exposure_s)
    limits = sharp, float(np.cos(np.radians(rule.max_incidence_deg)))
    shown = sharp_looks(steps, views(path, cloud, camera, TRULY, scene), cloud, camera, *limits)
    focal = focal_px(camera.width_px or rule.width_px, camera.hfov_deg)
    return {
        "gsd_mm": np.where(np.isfinite(shown.sampled_m), 1e3 * shown.sampled_m / focal, np.nan),
        "blur_px": shown.moved * focal * (camera.exposure_s or rule.exposure_s),
        "sharp_s": np.where(shown.number > 0, shown.number * float(steps.step_s.mean()), np.nan),
    }
