"""Resolution, blur and number of the pictures of each piece of surface, as a plan's page colours it."""

from __future__ import annotations

from typing import Any

import numpy as np

from upplied.catalog.verbs.recipes import settings_of
from upplied.config import focal_px, settings_for
from upplied.errors import UppliedError
from upplied.outputs.display import DisplayMesh, nearest_samples, packed
from upplied.planning.visibility.moments import moments
from upplied.planning.visibility.observations import TRULY, views
from upplied.planning.visibility.pictures import pictures
from upplied.records import SURFACE_STATES, Camera, Cloud, Floats, Plan
from upplied.scene import Scene

_INSPECTED = [SURFACE_STATES.index(name) for name in ("shown", "missed", "unattainable")]
_NONE = 255  # code of what no sharp picture shows
_MOST_PCT = 99.0  # of the values; larger ones have the last colour


def quality_data(
    plan: Plan, camera: Camera, scene: Scene, mesh: DisplayMesh, settings_json: str
) -> list[dict[str, Any]]:
    """Quantities of the finest sharp picture of each triangle, or point of a cloud, for a page.

    Each has a ``name`` with its unit, ``codes`` of one byte, 255 where the surface is not inspected or no
    picture is sharp, and ``step``, by which a code becomes a value. Empty where the surface is not known.
    """
    surface, path = plan.surface, plan.trajectory
    if surface is None or surface.normals is None or path is None or not len(surface.points):
        return []
    try:
        rule = settings_of(settings_json).inspection
    except (ValueError, KeyError, UppliedError):  # of a program that knew other settings
        rule = settings_for("recommended").inspection
    cloud = Cloud(surface.points, surface.normals)
    sharp = rule.sharp_radps(camera.hfov_deg, camera.width_px, camera.exposure_s)
    limits = sharp, float(np.cos(np.radians(rule.max_incidence_deg)))
    steps = moments(path)
    shown = pictures(steps, views(path, cloud, camera, TRULY, scene), cloud, camera, *limits)
    focal = focal_px(camera.width_px or rule.width_px, camera.hfov_deg)
    nearest = nearest_samples(mesh, surface)
    nearest = nearest if nearest.ndim == 1 else nearest[:, 0]
    quantities = {
        "resolution, mm/px": 1e3 * shown.sampled_m / focal,
        "motion blur, px": shown.moved * focal * (camera.exposure_s or rule.exposure_s),
        "time in sharp view, s": np.where(shown.looks > 0, shown.looks * float(steps.step_s.mean()), np.nan),
    }
    inspected = np.isin(surface.state, _INSPECTED)
    return [
        {"name": name, **_coded(np.where(inspected, values, np.nan)[nearest])}
        for name, values in quantities.items()
    ]


def _coded(values: Floats) -> dict[str, Any]:
    known = np.isfinite(values)
    most = float(np.percentile(values[known], _MOST_PCT)) if known.any() else 0.0
    step = max(most, 1e-9) / (_NONE - 1)
    codes = np.full(len(values), _NONE, np.uint8)
    codes[known] = np.clip(np.round(values[known] / step), 0, _NONE - 1).astype(np.uint8)
    return {"step": step, "codes": packed(codes)}
