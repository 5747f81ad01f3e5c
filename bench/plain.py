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
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation, Slerp

FOV, NEAR, FAR = np.radians(75.0), 2.0, 50.0
POINTS, VOXELS, ITERATIONS, STEPS = 60_000, 1000, 30, 20
INCIDENCE, CLEARANCE = np.radians(75.0), 2.0
STATIONS, SAMPLES = 3000, 4000

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
        found = mesh.sample_points_poisson_disk(number, init_factor=3, use_triangle_normal=True)
        points, normals = np.asarray(found.points), np.asarray(found.normals)
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
            need, standoff = self.wanted(target, answers, carry)
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

    def wanted(self, target, answers, carry):
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


def drifted(source, target):
    """Which sample of the target answers to each of the source: coherent point drift after box scaling."""
    scale = np.ptp(source.vertices, axis=0) / np.ptp(target.vertices, axis=0)
    scaled = (target.samples - target.vertices.min(0)) * scale + source.vertices.min(0)
    normals = target.normals / scale
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    size = np.linalg.norm(np.ptp(source.vertices, axis=0))
    control, fixed = (points[:: len(points) // 450] for points in (source.samples, scaled))

    def felt(points):
        return np.exp(-cdist(points, control, "sqeuclidean") / (2 * (0.12 * size) ** 2))

    kernel, here, variance = felt(control), control, (0.04 * size) ** 2
    weights = np.zeros_like(control)
    for _ in range(50):
        share = np.exp(-cdist(here, fixed, "sqeuclidean") / (2 * variance))
        share /= share.sum(axis=0) + 1e-3
        mass = np.maximum(share.sum(axis=1), 1e-9)
        system = kernel + 2 * variance * np.diag(1 / mass)
        weights = np.linalg.solve(system, share @ fixed / mass[:, None] - control)
        here = control + kernel @ weights
        off = cdist(here, fixed, "sqeuclidean")
        variance = max((share * off).sum() / share.sum() / 3, (0.004 * size) ** 2)
    warped = source.samples + felt(source.samples) @ weights
    tree = cKDTree(np.hstack([scaled, 0.03 * size * normals]))
    distance, answers = tree.query(np.hstack([warped, 0.03 * size * source.normals]))
    return np.where(distance < 0.05 * size, answers, -1), np.diag(1 / scale)


def views(dense, body):
    """Which samples are seen from any pose, from how near, and with which largest cosine."""
    near, frontal = np.full(len(body.samples), np.inf), np.full(len(body.samples), -1.0)
    for place, quat in zip(*dense, strict=True):
        seen = truly_sees(place, quat, body)
        ray = place - body.samples[seen]
        distance = np.linalg.norm(ray, axis=1)
        near[seen] = np.minimum(near[seen], distance)
        cosine = np.einsum("ij,ij->i", ray, body.normals[seen]) / distance
        frontal[seen] = np.maximum(frontal[seen], cosine)
    return np.isfinite(near), near, frontal


def truly_sees(position, quat, body):
    """Index of the samples in the frustum that face one pose and are not hidden from it."""
    ray = position - body.samples
    facing = np.einsum("ij,ij->i", ray, body.normals)
    asked = sees(position, quat, body.samples) & (facing >= np.cos(INCIDENCE) * np.linalg.norm(ray, axis=1))
    index = np.flatnonzero(asked)
    return index[~body.hidden(np.tile(position, (len(index), 1)), body.samples[index])]


def attainable(body):
    """Which samples some position could see: candidates one by one, then what served the neighbours."""
    served = np.full(body.samples.shape, np.nan)
    ladder = np.roll(np.geomspace(max(NEAR, CLEARANCE) * 1.001, FAR * 0.999, 8), -2)
    candidates = [(0.0, 0.0, length) for length in ladder]
    for share in (0.3, 0.55, 0.75, 0.88, 0.98):
        candidates += [
            (share * INCIDENCE, turn, length) for length in ladder for turn in np.arange(16) * np.pi / 8
        ]
    aside = np.where(np.abs(body.normals[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    first = np.cross(body.normals, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(body.normals, first)
    for tilt, turn, length in candidates:
        left = np.flatnonzero(np.isnan(served[:, 0]))
        around = np.cos(turn) * first[left] + np.sin(turn) * second[left]
        places = body.samples[left] + length * (np.cos(tilt) * body.normals[left] + np.sin(tilt) * around)
        good = ~body.hidden(places, body.samples[left])
        good[good] = body.distance(places[good]) >= CLEARANCE
        served[left[good]] = places[good]
    left = np.flatnonzero(np.isnan(served[:, 0]))
    near = cKDTree(body.samples).query(body.samples[left], k=25)[1]
    for _ in range(6):
        before = np.isnan(served[left, 0]).sum()
        for sample, others in zip(left, near, strict=True):
            if np.isnan(served[sample, 0]):
                places = served[others]
                ray = places - body.samples[sample]
                length = np.linalg.norm(ray, axis=1)
                fits = ray @ body.normals[sample] >= np.cos(INCIDENCE) * length
                places = places[fits & (length >= NEAR) & (length <= FAR)]
                places = places[~body.hidden(places, np.tile(body.samples[sample], (len(places), 1)))]
                places = places[body.distance(places) >= CLEARANCE] if len(places) else places
                served[sample] = places[0] if len(places) else np.nan
        if np.isnan(served[left, 0]).sum() == before:
            break
    return np.isfinite(served[:, 0])


def percentile(values, weights, percent):
    """Weighted."""
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order]) / weights.sum()
    return values[order][min(np.searchsorted(share, percent / 100), len(values) - 1)]


def voxel_cloud(vertices, triangles):
    """Points spread by area, then one centroid per voxel; the leaf leaves about 1000."""
    corners = vertices[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    rng = np.random.default_rng(0)
    along = (np.arange(POINTS) + rng.random(POINTS)) / POINTS * area.sum()
    chosen = corners[np.minimum(np.searchsorted(np.cumsum(area), along, side="right"), len(area) - 1)]
    root, second = np.sqrt(rng.random(POINTS))[:, None], rng.random(POINTS)[:, None]
    raw = chosen[:, 0] * (1 - root) + root * (chosen[:, 1] * (1 - second) + chosen[:, 2] * second)
    pcd = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(raw))
    extent = np.ptp(raw, axis=0).max()
    low, high = np.log(extent / 2000), np.log(extent)
    for _ in range(20):
        middle = (low + high) / 2
        if len(downsampled(pcd, raw, np.exp(middle))) > VOXELS:
            low = middle
        else:
            high = middle
    return downsampled(pcd, raw, np.exp(high))


def downsampled(pcd, raw, leaf):
    """Open3D's voxel filter with the grid at the corner of the box, in a stable order."""
    low = raw.min(0)
    high = low + leaf * np.ceil((raw.max(0) - low) / leaf + 1)
    found, _, _ = pcd.voxel_down_sample_and_trace(leaf, low, high)
    points = np.asarray(found.points)
    return points[np.lexsort(np.floor((points - low) / leaf)[:, ::-1].T)]


def counterparts(source, target):
    """Boxes matched, ICP by Open3D with its early stop turned off, then nearest neighbours."""
    scale = np.ptp(source, axis=0) / np.ptp(target, axis=0)
    scaled = (target - target.min(0)) * scale + source.min(0)
    icp = o3d.pipelines.registration.registration_icp(
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(source)),
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scaled)),
        1e6,
        np.eye(4),
        o3d.pipelines.registration.TransformationEstimationPointToPoint(),
        o3d.pipelines.registration.ICPConvergenceCriteria(0, 0, ITERATIONS),
    )
    aligned = source @ icp.transformation[:3, :3].T + icp.transformation[:3, 3]
    return cKDTree(scaled).query(aligned)[1]


def sees(position, quat, cloud):
    """The points in the frustum and range of one pose."""
    x, y, z = (Rotation.from_quat(quat).inv().apply(cloud - position)).T
    distance = np.sqrt(x**2 + y**2 + z**2)
    inside = (np.abs(np.arctan2(y, x)) <= FOV / 2) & (np.abs(np.arctan2(z, x)) <= FOV / 2)
    return inside & (distance >= NEAR) & (distance <= FAR)


def segments(seen, shared):
    """First and last pose of each stretch that looks at one region."""
    starts = [0]
    for index in range(1, len(seen)):
        first = seen[starts[-1]]
        if (first & seen[index]).sum() < shared * first.sum() if first.any() else seen[index].any():
            starts.append(index)
    return list(zip(starts, [*starts[1:], len(seen)], strict=True))


def refined(place, start, seen, source, target, partner):
    """The place from which the counterparts are as far as the points were, both standardised.

    Plain Gauss-Newton steps, as published, and the best of the places they came by: where no place fits,
    they do not settle. A damped solver finds better ones there, which lie up to seven metres away.
    """
    if seen.sum() < 3:
        return start
    sigma_d, sigma_t = source.std(0), target.std(0)
    points = (target[partner[seen]] - target.mean(0)) / sigma_t
    wanted = np.linalg.norm((source[seen] - place) / sigma_d, axis=1)
    here = best = (start - target.mean(0)) / sigma_t
    least = np.inf
    for _ in range(STEPS + 1):
        ray = here - points
        distance = np.linalg.norm(ray, axis=1)
        residual = distance - wanted
        if residual @ residual < least:
            best, least = here, residual @ residual
        slope = ray / distance[:, None]
        here = here - np.linalg.solve(slope.T @ slope, slope.T @ residual)
    return best * sigma_t + target.mean(0)


def carried(scale, quat):
    """The orientation after the scaling, made orthonormal again."""
    axes = np.diag(scale) @ quat.as_matrix()
    forward = axes[:, 0] / np.linalg.norm(axes[:, 0])
    left = np.cross(axes[:, 2], forward)
    left /= np.linalg.norm(left)
    return Rotation.from_matrix(np.column_stack([forward, left, np.cross(forward, left)]))


def smallest_turn(a, b):
    """The smallest rotation that brings direction a onto b."""
    axis = np.cross(a, b)
    angle = np.arctan2(np.linalg.norm(axis), a @ b)
    return Rotation.from_rotvec(axis / max(np.linalg.norm(axis), 1e-12) * angle)


def densified(positions, quats):
    """Poses between the poses: every half metre or three degrees, at most three thousand or so."""
    turns = Rotation.from_quat(quats)
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1) / 0.5
    steps += (turns[:-1].inv() * turns[1:]).magnitude() / np.radians(3)
    if len(positions) >= STATIONS:
        along = np.concatenate([[0.0], np.cumsum(steps + 1e-9)])
        keep = np.unique(
            np.clip(np.searchsorted(along, np.linspace(0, along[-1], STATIONS)), 0, len(positions) - 1)
        )
        return positions[keep], np.asarray(quats)[keep]
    coarse = max(1.0, steps.sum() / (STATIONS - len(positions)))
    times = [
        np.linspace(i, i + 1, max(int(np.ceil(s / coarse)), 1), endpoint=False) for i, s in enumerate(steps)
    ]
    times = np.append(np.concatenate(times), len(positions) - 1)
    between = np.column_stack([np.interp(times, np.arange(len(positions)), axis) for axis in positions.T])
    return between, Slerp(np.arange(len(positions)), turns)(times).as_quat()


def zscored(path):
    """Each axis by the mean and deviation along the path, a level axis by a tenth of the largest."""
    legs, middle = np.diff(path, axis=0), (path[1:] + path[:-1]) / 2
    weight = np.linalg.norm(legs, axis=1) / np.linalg.norm(legs, axis=1).sum()
    mean = weight @ middle
    deviation = np.sqrt(weight @ ((middle - mean) ** 2 + legs**2 / 12))
    return (path - mean) / np.maximum(deviation, deviation.max() / 10)


def nearest(body, path):
    """Least distance of the path to the mesh, asked every five centimetres."""
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.arange(0, length[-1], 0.05)
    return float(body.distance(np.column_stack([np.interp(at, length, axis) for axis in path.T])).min())
