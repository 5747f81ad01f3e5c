"""What a plan says of its target's surface."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from upplied.config import settings_for
from upplied.geometry.scene import open3d, scene_of
from upplied.planning.carry.inspected_surface import InspectedSurface
from upplied.planning.measures.verdict import of_surface
from upplied.records import Measures, Structure


@pytest.fixture(scope="module")
def reconstructed() -> Structure:
    """A ball of even triangles, rough by 3 cm."""
    ball = open3d().geometry.TriangleMesh.create_sphere(5.0, 40)
    ball = ball.simplify_quadric_decimation(2500)
    vertices = np.asarray(ball.vertices)
    vertices = vertices + np.random.default_rng(1).normal(0, 0.03, vertices.shape)
    return Structure("ball", "tank", vertices, np.asarray(ball.triangles, np.int64))


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({}, "looks like a reconstruction of a scan and counts as drawn: declare surface = 'scanned'"),
        ({"surface": "drawn"}, ""),
        ({"surface": "drawn", "surface_error_m": 0.2}, "the target is known to 0.20 m"),
        ({"surface": "scanned"}, "the target is a scan, whose surface is known to"),
    ],
)
def test_what_is_said_of_the_surface(reconstructed: Structure, stated: dict[str, Any], words: str) -> None:
    target = replace(reconstructed, **stated)
    scene, settings = scene_of(target, 1), settings_for("recommended")
    measures = replace(Measures(), surface_error_m=scene.error_m, min_clearance_m=9.0)
    seen = cast(InspectedSurface, type("Seen", (), {"without_pct": 0.0}))
    warnings = list(of_surface(measures, seen, target, scene, settings))
    assert [words in each for each in warnings] == ([True] if words else [])
