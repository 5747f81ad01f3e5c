"""The steps of bench/plain.py: drift of points, views, voxel clouds, segments, refinement, distances."""

from __future__ import annotations

import numpy as np
import open3d as o3d
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation, Slerp

FOV, NEAR, FAR = np.radians(75.0), 2.0, 50.0
POINTS, VOXELS, ITERATIONS, STEPS = 60_000, 1000, 30, 20
INCIDENCE, CLEARANCE = np.radians(75.0), 2.0
STATIONS, SAMPLES = 3000, 4000


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
    visible = sees(position, quat, body.samples) & (facing >= np.cos(INCIDENCE) * np.linalg.norm(ray, axis=1))
    index = np.flatnonzero(visible)
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
    thinned, _, _ = pcd.voxel_down_sample_and_trace(leaf, low, high)
    points = np.asarray(thinned.points)
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
    demonstrated = np.linalg.norm((source[seen] - place) / sigma_d, axis=1)
    here = best = (start - target.mean(0)) / sigma_t
    least = np.inf
    for _ in range(STEPS + 1):
        ray = here - points
        distance = np.linalg.norm(ray, axis=1)
        residual = distance - demonstrated
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
