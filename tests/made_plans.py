"""A plan that flies as a demonstration did, with what it shows of its structure."""

from __future__ import annotations

import numpy as np

from upplied.geometry.poses import interpolate
from upplied.geometry.scene import scene_of
from upplied.proof.looks import looks_of
from upplied.records import Cloud, Demonstration, Plan, Structure, SurfaceStates


def plan_as_demonstrated(structure: Structure, flown: Demonstration, surface: Cloud) -> Plan:
    """The first two minutes of a flight as the plan for the structure it was flown round."""
    path = interpolate(flown.trajectory, np.arange(0.0, 120.0, 0.5))
    shown = looks_of(path, surface, flown.camera, scene_of(structure)).seen
    return Plan(
        flown.demonstration_id, structure.structure_id, structure.structure_id, structure.kind, "recommended",
        "ok", trajectory=path, is_viewpoint=np.arange(len(path)) % 4 == 0, flyable=True,
        surface=SurfaceStates(surface.points, shown.astype(np.int64), surface.normals),
    )  # fmt: skip
