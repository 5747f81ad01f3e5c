"""The door to Open3D: what it leaves aside while it loads, and the threads that it keeps to."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
from random_members import random_member

from upplied.fleet.workers import Workers
from upplied.geometry.scene import Scene, _few, discs_of, scene_of
from upplied.records import Structure
from upplied.samples.fleet import member
from upplied.threads import cast_rays_on, ray_threads

PLOTS_TWICE = """
from upplied.geometry.scene import _few, open3d
module = open3d()
drawing, box = module.visualization, module.geometry.TriangleMesh.create_box()
print("dash" in __import__("sys").modules)
for _ in range(2):
    print(type(drawing.get_plotly_fig([box])).__name__, drawing.draw_plotly.__name__ if _ else "")
import open3d.visualization.draw_plotly
"""


def test_open3ds_plots_load_when_they_are_asked_for():
    process = subprocess.run([sys.executable, "-c", PLOTS_TWICE], capture_output=True, text=True, check=True)
    assert process.stdout.split() == ["False", "Figure", "Figure", "draw_plotly"]


def test_an_open3d_that_is_loaded_already_stays_as_it_is():
    code = """
from upplied.geometry.scene import _few, open3d
before = open3d().visualization.draw_plotly
open3d.cache_clear()
print(open3d().visualization.draw_plotly is before)
"""
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.split() == ["True"]


class Counted:
    """A native scene that notes of each call on how many threads it is to compute."""

    def __init__(self, native: Any, calls: dict[str, int]) -> None:
        self._native, self._calls = native, calls

    def __getattr__(self, name: str) -> Any:
        if name.isupper():
            return getattr(self._native, name)

        def call(tensor: Any, threads: int = 0, **options: Any) -> Any:
            self._calls[name] = options.pop("nthreads", threads)
            return getattr(self._native, name)(tensor, nthreads=self._calls[name], **options)

        return call


def threads_of_each_call() -> dict[str, int]:
    """On how many threads the library is told to compute, by its own name of each question to a scene."""
    shape = member("cube-v1").structure
    scene, calls = Scene(shape.vertices, shape.triangles), dict[str, int]()
    scene._scene = Counted(scene._scene, calls)
    starts, ends = np.random.default_rng(0).uniform(-60, 60, (2, 100, 3))
    for question in (scene.occluded, scene.cast, scene.hits):
        question(starts, ends)
    scene.distance(starts), scene.closest(starts)
    return calls


def test_a_worker_casts_on_one_thread_and_its_parent_as_before() -> None:
    questions = (
        "test_occlusions",
        "cast_rays",
        "count_intersections",
        "compute_distance",
        "compute_closest_points",
    )
    with Workers(1) as workers:
        assert workers.run(threads_of_each_call) == dict.fromkeys(questions, 1)
    assert ray_threads() == 0 and threads_of_each_call() == dict.fromkeys(questions, 0)


def test_new_scenes_cast_on_as_many_threads_as_were_told() -> None:
    shape = member("cube-v1").structure
    try:
        cast_rays_on(3)
        assert Scene(shape.vertices, shape.triangles).threads == 3
        assert Scene(shape.vertices, shape.triangles, 2).threads == 2
    finally:
        cast_rays_on(0)
    assert Scene(shape.vertices, shape.triangles).threads == 0


def test_a_scene_is_kept_with_the_record_of_its_structure_and_a_changed_one_has_its_own() -> None:
    shape = member("cube-v1").structure
    changed = replace(shape, vertices=shape.vertices + 100.0)
    assert scene_of(shape) is scene_of(shape)
    assert np.allclose(scene_of(changed).origin, scene_of(shape).origin + 100.0)


def test_answers_do_not_depend_on_the_number_of_threads():
    shape = random_member("airliner", 3).structure
    one, many = (Scene(shape.vertices, shape.triangles, threads) for threads in (1, 3))
    rng = np.random.default_rng(1)
    low, high = shape.vertices.min(axis=0) - 20, shape.vertices.max(axis=0) + 20
    starts, ends = rng.uniform(low, high, (2, 5000, 3))
    for ask in (
        lambda scene: [scene.occluded(starts, ends)],
        lambda scene: scene.cast(starts, ends - starts),
        lambda scene: [scene.hits(starts, ends - starts)],
        lambda scene: [scene.distance(starts)],
        lambda scene: scene.closest(starts),
    ):
        for left, right in zip(ask(one), ask(many), strict=True):
            assert np.array_equal(left, right)


def test_a_cloud_of_many_points_takes_bounded_discs_that_keep_its_distances_and_hide_what_is_behind() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(400_000, 3))
    points *= 10.0 / np.linalg.norm(points, axis=1, keepdims=True)
    cloud = Structure("ball", "tank", points, np.empty((0, 3), np.int64))
    scene = scene_of(cloud, 1)
    places = rng.normal(size=(500, 3))
    places *= rng.uniform(10.5, 20.0, (500, 1)) / np.linalg.norm(places, axis=1, keepdims=True)
    off = scene.distance(places) - (np.linalg.norm(places, axis=1) - 10.0)
    assert np.abs(off).max() < scene.grain_m < 0.2
    assert scene.occluded(places, -places).all()
    assert _few(points, points)[0].shape == (60_000, 3)
    assert _few(points[:10], None)[1] is None and np.array_equal(_few(points[:10], None)[0], points[:10])


def test_a_ray_at_a_cloud_meets_what_it_meets_of_the_discs_in_the_order_of_its_points() -> None:
    rng = np.random.default_rng(2)
    normals = rng.normal(size=(3000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ball = Structure(
        "ball", "tank", 5 * normals + rng.normal(0, 0.02, (3000, 3)), np.empty((0, 3), int), normals
    )
    starts, ways = 12 * normals[:500], -normals[:500] + rng.normal(0, 0.3, (500, 3))
    vertices, triangles = discs_of(ball).mesh()
    actual, expected = scene_of(ball).cast(starts, ways), Scene(vertices, triangles).cast(starts, ways)
    np.testing.assert_array_equal(actual[0], expected[0])
    np.testing.assert_array_equal(actual[1], expected[1])
    assert (actual[1] < 0).any() and (actual[1] >= 0).any()
