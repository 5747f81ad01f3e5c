"""The paper's method and all its measures as one would otherwise write them: Open3D, scipy and loops.

The peer of bench/fleet.py. It plans what preset `paper` plans (voxel clouds, box scaling and ICP,
nearest counterparts, frustum visibility, segments, z-score transfer, Gauss-Newton) and fills the same
columns of results. It is written as decently as such scripts are: arrays within each step, a loop over
poses, viewpoints and candidates, nothing about the source computed twice. Points of the voxel clouds
are drawn by the same rule as ours, or the results could not be compared.

What is truly seen is asked of samples of the surfaces, and of which of them answer to which. The
script makes its own: Open3D's Poisson discs, sides from which rays escape, coherent point drift. They
cannot be ours, so what follows from them is alike and not equal. It may instead be given ours
(`Surface`, `answers`): then every column must come out equal, and it has that much less to do.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import process_time

import numpy as np
import open3d as o3d
from curvesimilarities.frechet import fd
from plain_steps import (
    SAMPLES,
    attainable,
    carried,
    counterparts,
    densified,
    drifted,
    nearest,
    percentile,
    refined,
    sees,
    segments,
    smallest_turn,
    truly_sees,
    views,
    voxel_cloud,
    zscored,
)
from scipy.spatial.transform import Rotation

spent: Counter[str] = Counter()  # CPU seconds by stage


@contextmanager
def clocked(stage: str) -> Iterator[None]:
    """Add the CPU time of what happens within to a stage."""
    began = process_time()
    yield
    spent[stage] += process_time() - began


@dataclass
class Surface:
    """Samples of a surface."""

    points: np.ndarray
    normals: np.ndarray
    area: np.ndarray


class Body:
    """A mesh, its ray caster, its voxel cloud, and samples of its surface: those given, or its own."""

    def __init__(self, vertices, triangles, surface: Surface | None = None) -> None:
        self.vertices, self.triangles = vertices, triangles
        self.origin = (vertices.min(0) + vertices.max(0)) / 2
        self.scene = o3d.t.geometry.RaycastingScene()
        self.scene.add_triangles(
            o3d.core.Tensor((vertices - self.origin).astype(np.float32)),
            o3d.core.Tensor(triangles.astype(np.uint32)),
        )
        with clocked("voxel cloud"):
            self.cloud = voxel_cloud(vertices, triangles)
        with clocked("surface samples"):
            surface = surface or self.sampled()
        self.samples, self.normals, self.area = surface.points, surface.normals, surface.area

    def sampled(self, number=SAMPLES) -> Surface:
        """Evenly spaced samples on every side from which enough rays escape."""
        o3d.utility.random.seed(0)
        mesh = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(self.vertices), o3d.utility.Vector3iVector(self.triangles)
        )
        mesh.compute_triangle_normals()
        sampled = mesh.sample_points_poisson_disk(number, init_factor=3, use_triangle_normal=True)
        points, normals = np.asarray(sampled.points), np.asarray(sampled.normals)
        area = np.full(number, mesh.get_surface_area() / number)
        size = np.linalg.norm(np.ptp(self.vertices, axis=0))
        height = 1 - (2 * np.arange(64) + 1) / 64
        turn = np.pi * (1 + np.sqrt(5)) * (np.arange(64) + 0.5)
        ring = np.sqrt(1 - height**2)
        directions = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])
        sides = []
        for sign in (1, -1):
            starts = points + sign * 1e-5 * size * normals
            free, cast = np.zeros(number), np.zeros(number)
            for direction in directions:
                up = np.flatnonzero(sign * normals @ direction > 0.1)
                free[up] += ~self.hidden(starts[up], starts[up] + 2 * size * direction)
                cast[up] += 1
            sides.append(free >= 0.06 * cast)
        return Surface(
            np.vstack([points[side] for side in sides]),
            np.vstack([normals[sides[0]], -normals[sides[1]]]),
            np.concatenate([area[side] for side in sides]),
        )

    def hidden(self, starts, ends):
        """Whether the mesh stands between each start and its end."""
        starts, ends = (np.asarray(points - self.origin, np.float32) for points in (starts, ends))
        rays = o3d.core.Tensor(np.hstack([starts, ends - starts]))
        return self.scene.test_occlusions(rays, tnear=0.0, tfar=1 - 1e-3).numpy()

    def distance(self, points):
        """Of points from the mesh."""
        return self.scene.compute_distance((points - self.origin).astype(np.float32)).numpy()


@dataclass
class Result:
    """What is compared with ours."""

    positions: np.ndarray
    measures: dict[str, float]


class Script:
    """One demonstration, and a function for each target."""

    def __init__(self, body: Body, positions, quats, t_s, shared: float) -> None:
        self.body, self.cloud = body, body.cloud
        self.positions, self.quats, self.t_s = positions, quats, t_s
        self.seen = np.array([sees(p, q, self.cloud) for p, q in zip(positions, quats, strict=True)])
        self.dense = densified(positions, quats)
        poses = list(zip(*self.dense, strict=True))
        self.seen_on_the_way = np.any([sees(p, q, self.cloud) for p, q in poses], axis=0)
        self.truly = [truly_sees(p, q, body) for p, q in poses]
        self.segments = segments(self.seen, shared)

    def transfer(self, target: Body, answers=None, carry=None) -> Result:
        """Plan and measure on one target.

        `answers` says which sample of the target answers to each of the source, -1 where none does;
        `carry` (3, 3) is how lines of sight are carried. Both are found where they are not given.
        """
        cloud = target.cloud
        if answers is None:
            with clocked("drift"):
                answers, carry = drifted(self.body, target)
        with clocked("ICP"):
            partner = counterparts(self.cloud, cloud)
        with clocked("viewpoints"):
            places, quats, t_s = self.viewpoints(cloud, partner)
        with clocked("frustum"):
            dense = densified(places, quats)
            seen = np.any([sees(p, q, cloud) for p, q in zip(*dense, strict=True)], axis=0)
        with clocked("true visibility"):
            truly, near, frontal = views(dense, target)
        with clocked("attainable"):
            could = attainable(target)
        low, low_d = cloud.min(0), self.cloud.min(0)
        box = np.ptp(cloud, axis=0) / np.ptp(self.cloud, axis=0)
        flown = (self.positions - low_d) * box + low
        with clocked("Frechet"):
            frechet_z = fd(zscored(flown), zscored(places), rel_tol=1e-9)
            frechet_m = fd(flown, places, rel_tol=1e-9)
        with clocked("clearance"):
            clearance = nearest(target, places)
        with clocked("other measures"):
            need, standoff = self.needs(target, answers, carry)
            used = (need > 0) & np.isfinite(near)
            angle = np.degrees(np.arccos(np.clip(frontal[used], -1, 1)))
            legs = np.diff(places, axis=0)
            step = np.diff(t_s)
            velocity = legs / step[:, None]
            change = np.diff(velocity, axis=0) / ((step[1:] + step[:-1]) / 2)[:, None]
            measures = {
                "coverage_paper_pct": 100 * seen[partner[self.seen_on_the_way]].mean(),
                "coverage_seen_pct": 100 * need[truly].sum() / need.sum(),
                "coverage_attainable_pct": 100 * need[could].sum() / need.sum(),
                "frechet_floored": frechet_z,
                "frechet_m": frechet_m,
                "min_clearance_m": clearance,
                "path_length_m": np.linalg.norm(legs, axis=1).sum(),
                "duration_s": t_s[-1] - t_s[0],
                "standoff_ratio_p50": percentile(near[used] / standoff[used], need[used], 50),
                "incidence_p95_deg": percentile(angle, need[used], 95),
                "peak_speed_mps": np.linalg.norm(velocity, axis=1).max(),
                "peak_acceleration_mps2": np.linalg.norm(change, axis=1).max(),
            }
        return Result(places, measures)

    def viewpoints(self, cloud, partner):
        """Place, orientation and time of each viewpoint on the target."""
        scale = cloud.std(0) / self.cloud.std(0)
        shift = cloud.mean(0) - scale * self.cloud.mean(0)
        places, quats, times = [], [], []
        for first, last in self.segments:
            place = self.positions[first:last].mean(0)
            quat = Rotation.from_quat(self.quats[first:last]).mean()
            seen = self.seen[first:last].any(0)
            moved = refined(place, place * scale + shift, seen, self.cloud, cloud, partner)
            places.append(moved)
            turned = carried(scale, quat)
            if seen.any():
                ahead = quat.inv().apply(self.cloud[seen].mean(0) - place)
                turned = smallest_turn(turned.apply(ahead), cloud[partner[seen]].mean(0) - moved) * turned
            quats.append(turned.as_quat())
            times.append(self.t_s[first:last].mean())
        return np.array(places), np.array(quats), self.timed(np.array(places), np.array(times))

    def timed(self, places, times):
        """Each leg as fast as the expert flew between the same two places."""
        legs = np.linalg.norm(np.diff(self.positions, axis=0), axis=1)
        along = np.interp(times, self.t_s, np.concatenate([[0], np.cumsum(legs)]))
        flown = np.diff(along)
        usual = legs.sum() / self.t_s[-1]
        speed = np.where(flown > 1e-6, flown / np.maximum(np.diff(times), 1e-9), usual)
        step = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.maximum(speed, 0.05)
        return np.concatenate([[0], np.cumsum(np.maximum(step, 1e-3))])

    def needs(self, target, answers, carry):
        """For how much demonstrated area each target sample answers, and from how near that was seen."""
        near = np.full(len(self.body.samples), np.inf)
        for place, seen in zip(self.dense[0], self.truly, strict=True):
            ray = (self.body.samples[seen] - place) @ carry.T
            near[seen] = np.minimum(near[seen], np.linalg.norm(ray, axis=1))
        used = np.isfinite(near) & (answers >= 0)
        weight = self.body.area[used]
        need = np.bincount(answers[used], weight, len(target.samples))
        with np.errstate(invalid="ignore"):
            return need, np.bincount(answers[used], weight * near[used], len(target.samples)) / need
