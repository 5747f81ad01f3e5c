"""Resolution, blur and number of the pictures of each piece of surface, as a plan's page colours it."""

from __future__ import annotations

from typing import Any

import numpy as np

from upplied.catalog.verbs.recipes import settings_of
from upplied.config import settings_for
from upplied.errors import UppliedError
from upplied.geometry.scene import Scene
from upplied.outputs.display import DisplayMesh, nearest_samples, packed
from upplied.proof.inspected import pictured
from upplied.records import SURFACE_STATES, Camera, Cloud, Floats, Plan

_INSPECTED = [SURFACE_STATES.index(name) for name in ("shown", "missed", "unattainable")]
_NAMES = {"gsd_mm": "resolution (mm/px)", "blur_px": "motion blur (px)", "sharp_s": "time in sharp view (s)"}
_NONE = 255  # code of surface that no sharp picture shows
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
    shown = pictured(path, Cloud(surface.points, surface.normals), camera, scene, rule)
    nearest = nearest_samples(mesh, surface)
    nearest = nearest if nearest.ndim == 1 else nearest[:, 0]
    inspected = np.isin(surface.state, _INSPECTED)
    return [
        {"name": name, **_coded(np.where(inspected, shown[key], np.nan)[nearest])}
        for key, name in _NAMES.items()
    ]


def _coded(values: Floats) -> dict[str, Any]:
    known = np.isfinite(values)
    most = float(np.percentile(values[known], _MOST_PCT)) if known.any() else 0.0
    step = max(most, 1e-9) / (_NONE - 1)
    codes = np.full(len(values), _NONE, np.uint8)
    codes[known] = np.clip(np.round(values[known] / step), 0, _NONE - 1).astype(np.uint8)
    return {"step": step, "codes": packed(codes)}
