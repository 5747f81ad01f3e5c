"""Visibility against the ray caster's own peak: how much of the time is not spent on rays?

    python bench/visibility.py [--real] [--poses N] [--samples N]

For each structure: N poses on a spiral round it see N surface samples. `rays` are those that frustum,
range and incidence leave over. The peak is the best rate at which the same scene answers the same
rays, already made and in one array. `plain` is what one would otherwise write: every pose in a loop,
the frustum in numpy, and the rays through Open3D's cast_rays.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from real_data import real_folder, real_structure

from upplied.config import CloudSettings
from upplied.geometry.poses import look_at, matrices
from upplied.geometry.scene import Scene, scene_of
from upplied.planning.surface.samples import surface_samples
from upplied.planning.visibility.line_of_sight import visible
from upplied.planning.visibility.observations import TRULY
from upplied.records import Bools, Camera, Cloud, Floats, Structure
from upplied.samples.fleet import sample_structures

_SAMPLES = ("a320", "b747", "turbine_1", "cruise_ship", "bridge_1")
_REAL = (
    "airplane/a320_fr24",
    "airplane/b744_fr24",
    "wind_turbine/vestas_v112_119m",
    "ship/cruise_ship_219m",
    "bridge/larics_bridge",
)


def main() -> None:
    """Print one line per structure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--real", action="store_true", help="real meshes, see bench/real_data.py")
    parser.add_argument("--poses", type=int, default=1000)
    parser.add_argument("--samples", type=int, default=4000)
    options = parser.parse_args()
    print(
        f"{'structure':24}{'triangles':>10}{'pairs':>10}{'rays':>10}{'ours, CPU s':>13}{'peak Mray/s':>13}"
        f"{'ours Mray/s':>13}{'of peak':>9}{'plain, CPU s':>14}{'ratio':>7}{'differ':>10}"
    )
    total = np.zeros(3)
    for structure in structures(options.real):
        line, spent = _line(structure, options.poses, options.samples)
        total += spent
        print(line, flush=True)
    rays, ours, peak = total
    rates = f"{rays / peak / 1e6:13.2f}{rays / ours / 1e6:13.2f}{peak / ours:9.0%}"
    print(f"{'all':44}{int(rays):10d}{ours:13.3f}{rates}")


def structures(real: bool) -> list[Structure]:
    """What is looked at."""
    folder = real_folder()
    if real:
        if folder is None:
            raise SystemExit("no real structures; set UPPLIED_REAL_DATA to a folder that has them")
        return [real_structure(folder, place) for place in _REAL]
    every = sample_structures()
    chosen = [one for one in every if one.structure_id.replace("-", "_").startswith(_SAMPLES)]
    return chosen or every[:5]


def _line(structure: Structure, poses: int, samples: int) -> tuple[str, Floats]:
    scene = scene_of(structure, threads=1)
    cloud = surface_samples(structure, scene, CloudSettings(surface_samples=samples))
    positions, quats = spiral(structure, poses)
    rays = wanted_rays(positions, quats, cloud, scene)
    ours, seen = clocked(lambda: visible(positions, quats, cloud, Camera(), TRULY, scene).seen, 5)
    best = clocked(lambda: scene.blocked(rays), 5)[0]
    peak = len(rays) / best
    every = max(1, poses // 50)  # the plain way is slow: a share of the poses, scaled up
    plain, same = clocked(lambda: plainly(positions[::every], quats[::every], cloud, scene), 1)
    plain *= poses / len(same)
    line = (
        f"{structure.structure_id:24}{len(structure.triangles):10d}{poses * len(cloud):10d}{len(rays):10d}"
        f"{ours:13.3f}{peak / 1e6:13.2f}{len(rays) / ours / 1e6:13.2f}{len(rays) / ours / peak:9.0%}"
        f"{plain:14.2f}{plain / ours:7.0f}{(seen[::every] != same).mean():10.1e}"
    )
    return line, np.array([len(rays), ours, best])


def spiral(structure: Structure, poses: int) -> tuple[Floats, Floats]:
    """Three turns round the structure from end to end, about 10 m off its box, looking at its middle line."""
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    axis = int(np.argmax(half))
    first, second = (k for k in range(3) if k != axis)
    angle, along = np.linspace(0, 6 * np.pi, poses), np.linspace(-1, 1, poses)
    positions, targets = np.tile(middle, (poses, 1)), np.tile(middle, (poses, 1))
    positions[:, axis] += along * half[axis]
    targets[:, axis] = positions[:, axis]
    positions[:, first] += (half[first] + 10) * np.cos(angle)
    positions[:, second] += (half[second] + 10) * np.sin(angle)
    return positions, look_at(positions, targets)


def wanted_rays(positions: Floats, quats: Floats, cloud: Cloud, scene: Scene) -> np.ndarray:
    """The rays that `visible` casts."""
    assert cloud.normals is not None
    frustum = replace(TRULY, occlusion=False)
    pose, point = np.nonzero(visible(positions, quats, cloud, Camera(), frustum).seen)
    back = positions[pose] - cloud.points[point]
    facing = np.einsum("ij,ij->i", back, cloud.normals[point])
    frontal = facing >= np.cos(np.radians(TRULY.max_incidence_deg)) * np.linalg.norm(back, axis=1)
    start = positions[pose[frontal]] - scene.origin
    return np.concatenate([start, -back[frontal]], axis=1).astype(np.float32)


def plainly(positions: Floats, quats: Floats, cloud: Cloud, scene: Scene) -> Bools:
    """Pose by pose, decently."""
    assert cloud.normals is not None
    camera, rows = Camera(), []
    half_h, half_v = np.radians(camera.hfov_deg / 2), np.radians(camera.vfov_deg / 2)
    limit = np.cos(np.radians(TRULY.max_incidence_deg))
    for position, axes in zip(positions, matrices(quats), strict=True):
        ray = cloud.points - position
        distance = np.linalg.norm(ray, axis=1)
        local = ray @ axes
        seen = (distance >= camera.min_range_m) & (distance <= camera.max_range_m)
        seen &= np.abs(np.arctan2(local[:, 1], local[:, 0])) <= half_h
        seen &= np.abs(np.arctan2(local[:, 2], local[:, 0])) <= half_v
        seen &= -np.einsum("ij,ij->i", ray, cloud.normals) >= limit * distance
        candidates = np.flatnonzero(seen)
        hit, _, _ = scene.cast(np.tile(position, (len(candidates), 1)), ray[candidates])
        seen[candidates] = hit >= 1 - 1e-3
        rows.append(seen)
    return np.array(rows)


def clocked(function: Callable[[], Bools], times: int) -> tuple[float, Bools]:
    """Best CPU time, s, after one run to warm up, and the result."""
    result, spent = function(), np.inf
    for _ in range(times):
        began = time.process_time()
        result = function()
        spent = min(spent, time.process_time() - began)
    return spent, result


if __name__ == "__main__":
    main()
