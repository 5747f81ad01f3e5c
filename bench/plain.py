"""The paper's method as one would otherwise write it: a script with Open3D, scipy and loops.

The peer of bench/fleet.py. It plans what preset `paper` plans (voxel clouds, box scaling and ICP,
nearest counterparts, frustum visibility, segments, z-score transfer, Gauss-Newton by scipy) and
measures what the paper measures. It is written as decently as such scripts are: arrays within each
step, a loop over poses and viewpoints, nothing about the source computed twice. Points
are drawn by the same rule as ours, or the results could not be compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from curvesimilarities.frechet import fd
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation, Slerp

FOV, NEAR, FAR = np.radians(75.0), 2.0, 50.0
POINTS, VOXELS, ITERATIONS = 60_000, 1000, 30


@dataclass
class Result:
    """What is compared with ours."""

    positions: np.ndarray
    coverage_pct: float
    frechet_z: float
    clearance_m: float


class Script:
    """One demonstration, and a function for each target."""

    def __init__(self, vertices, triangles, positions, quats, shared: float) -> None:
        self.cloud = voxel_cloud(vertices, triangles)
        self.positions, self.quats, self.shared = positions, quats, shared
        self.seen = np.array([sees(p, q, self.cloud) for p, q in zip(positions, quats, strict=True)])
        self.dense = densified(positions, quats)
        self.seen_on_the_way = np.any(
            [sees(p, q, self.cloud) for p, q in zip(*self.dense, strict=True)], axis=0
        )
        self.segments = segments(self.seen, shared)

    def transfer(self, vertices, triangles) -> Result:
        """Plan and measure on one target."""
        cloud = voxel_cloud(vertices, triangles)
        partner = counterparts(self.cloud, cloud)
        scale = cloud.std(0) / self.cloud.std(0)
        shift = cloud.mean(0) - scale * self.cloud.mean(0)
        places, quats = [], []
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
        places, quats = np.array(places), np.array(quats)
        seen = np.any([sees(p, q, cloud) for p, q in zip(*densified(places, quats), strict=True)], axis=0)
        wanted = partner[self.seen_on_the_way]
        low, low_d = cloud.min(0), self.cloud.min(0)
        box = np.ptp(cloud, axis=0) / np.ptp(self.cloud, axis=0)
        flown = (self.dense[0] - low_d) * box + low
        return Result(
            places,
            100 * seen[wanted].mean(),
            fd(zscored(flown), zscored(places)),
            clearance(vertices, triangles, places),
        )


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
    """The place from which the counterparts are as far as the points were, both standardised."""
    if seen.sum() < 3:
        return start
    sigma_d, sigma_t = source.std(0), target.std(0)
    points = (target[partner[seen]] - target.mean(0)) / sigma_t
    wanted = np.linalg.norm((source[seen] - place) / sigma_d, axis=1)
    found = least_squares(
        lambda x: np.linalg.norm(x - points, axis=1) - wanted, (start - target.mean(0)) / sigma_t, method="lm"
    )
    return found.x * sigma_t + target.mean(0)


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
    """Poses between the poses: every half metre or three degrees, at most a thousand or so."""
    turns = Rotation.from_quat(quats)
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1) / 0.5
    steps += (turns[:-1].inv() * turns[1:]).magnitude() / np.radians(3)
    if len(positions) >= 1000:
        along = np.concatenate([[0.0], np.cumsum(steps + 1e-9)])
        keep = np.unique(
            np.clip(np.searchsorted(along, np.linspace(0, along[-1], 1000)), 0, len(positions) - 1)
        )
        return positions[keep], np.asarray(quats)[keep]
    coarse = max(1.0, steps.sum() / (1000 - len(positions)))
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


def clearance(vertices, triangles, path):
    """Least distance of the path to the mesh, asked every five centimetres."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(triangles.astype(np.uint32))
    )
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.arange(0, length[-1], 0.05)
    points = np.column_stack([np.interp(at, length, axis) for axis in path.T])
    return float(scene.compute_distance(points.astype(np.float32)).numpy().min())
