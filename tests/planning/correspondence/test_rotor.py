"""A rotor that stopped elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_structures import one_piece

from upplied.config import settings_for
from upplied.planning.correspondence.pair import study_pair
from upplied.planning.surface.parts import blades_of
from upplied.records import Structure
from upplied.samples.fleet import member
from upplied.scene import scene_of


def stopped(degrees: float) -> tuple[Structure, np.ndarray]:
    """Turbine 2 with its rotor turned, and which of its triangles are of blades."""
    of = member("turbine-2-v1")
    blade = np.isin(of.part_of_triangle, [at for at, name in enumerate(of.part_names) if "blade" in name])
    vertices = of.structure.vertices.copy()
    hub = vertices[np.unique(of.structure.triangles[of.triangles_of("hub")])]
    middle, angle = (hub.min(axis=0) + hub.max(axis=0)) / 2, np.radians(degrees)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    moving = np.unique(of.structure.triangles[blade])
    vertices[moving] = (vertices[moving] - middle) @ turn.T + middle
    return replace(of.structure, vertices=vertices, sha256=""), blade


@pytest.mark.parametrize("degrees", [0.0, 40.0])
def test_blades_of_a_scan_are_found_wherever_the_rotor_stopped(degrees: float) -> None:
    target, blade = stopped(degrees)
    fit = study_pair(member("turbine-1-v1").structure, one_piece(target), settings_for("recommended")).surface
    true = blade[scene_of(target, 1).closest(fit.target.points)[1]]
    found = blades_of(fit.target)
    assert (found & true).sum() > 0.9 * (found | true).sum()
    assert fit.registration.accepted
