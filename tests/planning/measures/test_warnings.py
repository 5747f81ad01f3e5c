"""What a plan says of its target's surface."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from upplied.config import settings_for
from upplied.geometry.scene import open3d, scene_of
from upplied.planning.carry.inspected_surface import InspectedSurface
from upplied.planning.measures.fidelity import Shown
from upplied.planning.measures.verdict import of_parts, of_surface
from upplied.records import Cloud, Frame, Measures, Structure


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


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        ((1.0, 0.7, 0.0), []),  # of the last part little is to be shown
        ((1.0, 0.5, 1.0), ["is to be shown, is shown by 50 %"]),
        ((0.1, 0.0, 1.0), ["76 % of what is to be shown, is shown by 10 %", "19 % of what is to be shown"]),
    ],
)
def test_an_inspected_part_that_is_hardly_shown_is_named(shown: tuple[float, ...], words: list[str]) -> None:
    """Of a body, an engine at its left and a fin, 80, 20 and 5 m2 are to be shown."""
    rng, count = np.random.default_rng(2), (160, 40, 10)
    middle, size = np.array([[0, 0, 0], [0, 9, 0], [-15, 0, 4]]), np.array([[40, 4, 4], [4, 2, 2], [2, 1, 4]])
    label = np.repeat(np.arange(3), count)
    points = middle[label] + size[label] * rng.uniform(-0.5, 0.5, (len(label), 3))
    cloud = Cloud(points, area_m2=np.full(len(label), 0.5), part=label)
    as_well = np.concatenate([np.arange(n) < n * share for n, share in zip(count, shown, strict=True)])
    surface = InspectedSurface(cloud, cloud.areas, np.ones(len(label)), 0.0)
    fit = SimpleNamespace(source=cloud, registered=cloud)
    pair: Any = SimpleNamespace(surface=fit, source=SimpleNamespace(frame=Frame()))
    outcome = Shown(surface, as_well, ~as_well)
    warnings = list(of_parts(outcome, pair, settings_for("recommended")))
    assert len(warnings) == len(words)
    assert all(word in each for word, each in zip(words, warnings, strict=True))
    assert not words or f"part_{int(len(words) == 1)} (" in warnings[0]


def test_one_piece_has_no_part_to_name() -> None:
    cloud = Cloud(np.random.default_rng(2).normal(size=(50, 3)), area_m2=np.ones(50))
    surface = InspectedSurface(cloud, cloud.areas, np.ones(50), 0.0)
    fit = SimpleNamespace(source=cloud, registered=cloud)
    pair: Any = SimpleNamespace(surface=fit, source=SimpleNamespace(frame=Frame()))
    outcome = Shown(surface, np.zeros(50, bool), np.ones(50, bool))
    assert not list(of_parts(outcome, pair, settings_for("recommended")))
