"""A second ruler for plans: what the planner measures and keeps, measured again with nothing of its code.

Distances are those of points to triangles, over all pairs; a path is sampled so densely that nothing can
hide in between; fences are judged by the winding of their posts, rates by plain differences.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.config import Settings
from upplied.records import Camera, Floats, Ints, Structure, Trajectory

SAMPLED_M = 0.1
_FINE_M = 0.004  # where a path comes near, and where fences and keep-out boxes are asked
_TOLERANCE_M = 2e-3  # of fine sampling (half a step), and of single precision in what is ruled upon


def sampled(positions: Floats, step_m: float = SAMPLED_M) -> Floats:
    """Points of a polyline (N, 3) at most so far apart."""
    pieces = [positions[:1]]
    for start, end in itertools.pairwise(positions):
        count = max(int(np.ceil(np.linalg.norm(end - start) / step_m)), 1)
        pieces.append(start + np.linspace(0, 1, count + 1)[1:, None] * (end - start))
    return np.vstack(pieces)


def distance_to_triangles(points: Floats, vertices: Floats, triangles: Ints) -> Floats:
    """Distance (N,) from each point to the nearest of the triangles, m.

    The foot on a triangle's plane counts where it is inside; else the nearest point of the three sides.
    """
    best = np.full(len(points), np.inf)
    for a, b, c in vertices[triangles]:
        normal = np.cross(b - a, c - a)
        size = np.linalg.norm(normal)
        corners = (a, b, c)
        if size > 0:
            normal = normal / size
            height = (points - a) @ normal
            foot = points - height[:, None] * normal
            inside = np.ones(len(points), bool)
            for p, q in zip(corners, (b, c, a), strict=True):
                inside &= (np.cross(q - p, foot - p) @ normal) >= 0
            best = np.where(inside, np.minimum(best, np.abs(height)), best)
        for p, q in zip(corners, (b, c, a), strict=True):
            side = q - p
            share = np.clip((points - p) @ side / max(float(side @ side), 1e-300), 0, 1)
            best = np.minimum(best, np.linalg.norm(points - p - share[:, None] * side, axis=1))
    return best


def inside_polygon(polygon: Floats, points: Floats) -> np.ndarray:
    """Whether each point (N, 2) is wound round by a polygon: the angles to its posts sum to a full turn."""
    ray = polygon[None] - points[:, None]
    angle = np.arctan2(ray[..., 1], ray[..., 0])
    turn = np.diff(np.concatenate([angle, angle[:, :1]], axis=1), axis=1)
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    return np.abs(turn.sum(axis=1)) > np.pi


def clearance(structure: Structure, trajectory: Trajectory) -> float:
    """How near the whole path comes to the surface, m.

    A distance changes by no more than the way: the nearest place is within half a step of one that is
    nearer than the nearest found and half a step. There the path is asked again, finely.
    """
    along, surface = sampled(trajectory.positions), (structure.vertices, structure.triangles)
    distance = distance_to_triangles(along, *surface)
    near = np.flatnonzero(distance <= distance.min() + SAMPLED_M / 2)
    share = np.linspace(-0.5, 0.5, int(SAMPLED_M / _FINE_M) + 1)[:, None, None]
    before, after = along[np.maximum(near - 1, 0)], along[np.minimum(near + 1, len(along) - 1)]
    fine = (
        along[near]
        + np.maximum(share, 0) * (after - along[near])
        + np.minimum(share, 0) * (along[near] - before)
    )
    return float(min(distance.min(), distance_to_triangles(fine.reshape(-1, 3), *surface).min()))


def rates(trajectory: Trajectory) -> dict[str, float]:
    """Peaks of speed, acceleration, turning and looking, by differences: keys are those of the settings."""
    step = np.diff(trajectory.t_s)
    velocity = np.diff(trajectory.positions, axis=0) / step[:, None]
    between = (step[1:] + step[:-1]) / 2
    x, y, z, w = trajectory.quat_xyzw.T
    axis = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    left = np.column_stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)])
    yaw = np.degrees(np.unwrap(np.arctan2(-left[:, 0], left[:, 1])))
    pitch = np.degrees(np.arctan2(axis[:, 2], np.hypot(axis[:, 0], axis[:, 1])))
    turning = np.diff(yaw) / step
    return {
        "max_speed_mps": float(np.linalg.norm(velocity, axis=1).max()),
        "max_climb_mps": float(velocity[:, 2].max()),
        "max_descent_mps": float(-velocity[:, 2].min()),
        "max_acceleration_mps2": float(
            (np.linalg.norm(np.diff(velocity, axis=0), axis=1) / between).max(initial=0)
        ),
        "max_yaw_rate_degps": float(np.abs(turning).max()),
        "max_yaw_acceleration_degps2": float((np.abs(np.diff(turning)) / between).max(initial=0)),
        "max_gimbal_rate_degps": float(np.abs(np.diff(pitch) / step).max()),
        "max_gimbal_pitch_deg": float(pitch.max()),
        "min_gimbal_pitch_deg": float(-pitch.min()),
        "roll_deg": float(np.degrees(np.abs(left[:, 2])).max()),
    }


def broken_rules(structure: Structure, trajectory: Trajectory, settings: Settings) -> dict[str, float]:
    """Every limit of the settings and of the surroundings that a plan breaks, and by how much."""
    route, limits, around = settings.route, settings.retime, structure.surroundings
    along = sampled(trajectory.positions, 5 * _FINE_M)
    excess = {"clearance": route.clearance_m - clearance(structure, trajectory) - _TOLERANCE_M}
    if around.ground_z_m is not None:
        excess["ground"] = around.ground_z_m + route.ground_clearance_m - along[:, 2].min() - 1e-6
    if around.ceiling_z_m is not None:
        excess["ceiling"] = along[:, 2].max() - around.ceiling_z_m - 1e-6
    for number, (low, high) in enumerate(around.keep_out_m):
        excess[f"keep-out {number}"] = float(np.minimum(along - low, high - along).min(axis=1).max()) - 1e-6
    if len(around.geofence_m):
        excess["fence"] = float((~inside_polygon(around.geofence_m, along[:, :2])).sum())
    for name, rate in rates(trajectory).items():
        most = 0.01 if name == "roll_deg" else getattr(limits, name)
        if name == "min_gimbal_pitch_deg":
            most = -most
        excess[name] = rate - most * (1 + 1e-6) - 1e-5
    if not (np.diff(trajectory.t_s) > 0).all() or not np.isfinite(trajectory.positions).all():
        excess["times"] = 1.0
    return {name: by for name, by in excess.items() if by > 0}


def seen_along(
    structure: Structure, path: Trajectory, fov_deg: Floats, camera: Camera, points: Floats, normals: Floats
) -> np.ndarray:
    """Which surface points (N,) some pose sees, through its own field of view (M, 2), by plain ray casting.

    In the picture by two angles, in range, less oblique than 75 degrees, and no triangle in between.
    """
    corner = structure.vertices[structure.triangles]
    first, edges = corner[:, 0], (corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    seen = np.zeros(len(points), bool)
    for place, quat, (across, up) in zip(path.positions, path.quat_xyzw, fov_deg, strict=True):
        ray = points - place
        far = np.linalg.norm(ray, axis=1)
        x, y, z = Rotation.from_quat(quat).inv().apply(ray).T
        inside = np.abs(np.degrees(np.arctan2(y, x))) <= across / 2
        inside &= np.abs(np.degrees(np.arctan2(z, x))) <= up / 2
        inside &= (far >= camera.min_range_m) & (far <= camera.max_range_m)
        inside &= -(ray * normals).sum(axis=1) >= np.cos(np.radians(75.0)) * far
        index = np.flatnonzero(inside & ~seen)
        to, aside = place - first, np.cross(place - first, edges[0])
        normal = np.cross(edges[0], edges[1])
        turned = np.cross(to, edges[1])
        with np.errstate(
            divide="ignore", invalid="ignore"
        ):  # Moeller and Trumbore, all rays by all triangles
            slope = -ray[index] @ normal.T
            u = -(ray[index] @ turned.T) / slope
            v = (ray[index] @ aside.T) / slope
            share = (edges[1] * aside).sum(axis=1) / slope
            blocked = (u >= 0) & (v >= 0) & (u + v <= 1) & (share > 1e-6) & (share < 0.998)
        seen[index[~blocked.any(axis=1)]] = True
    return seen
