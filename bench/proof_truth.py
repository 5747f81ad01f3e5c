"""What poses truly see: the ray test of bench/proof.py, which shares no code with the one it judges."""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.geometry.poses import yaw_pitch
from upplied.records import Bools, Camera, Cloud, Floats, Structure, Trajectory

_INCIDENCE_DEG = 75.0
_SLACK = 1e-3  # of a ray, at the sample, which lies on the surface itself


def truly_seen(structure: Structure, poses: Trajectory, surface: Cloud, camera: Camera) -> Bools:
    """Which samples (N,) some pose sees: angles in the camera, range, incidence, and a ray to the sample.

    Rays are intersected with every triangle (Moeller and Trumbore 1997), in double precision; independent of
    `upplied.planning.visibility` and of Open3D.
    """
    assert surface.normals is not None
    corners = structure.vertices[structure.triangles]
    seen = np.zeros(len(surface), bool)
    ahead, left, up = _frames(poses)
    for at in range(len(poses)):
        ray = surface.points - poses.positions[at]
        reach = np.linalg.norm(ray, axis=1)
        forward, across, above = ray @ ahead[at], ray @ left[at], ray @ up[at]
        inside = (forward > 0) & (reach >= camera.min_range_m) & (reach <= camera.max_range_m)
        inside &= np.abs(np.arctan2(across, forward)) <= np.radians(camera.hfov_deg / 2)
        inside &= np.abs(np.arctan2(above, forward)) <= np.radians(camera.vfov_deg / 2)
        inside &= -(ray * surface.normals).sum(axis=1) >= np.cos(np.radians(_INCIDENCE_DEG)) * reach
        some = np.flatnonzero(inside & ~seen)
        if len(some):
            seen[some] = ~hidden(poses.positions[at], ray[some], corners, _SLACK)
    return seen


def finest_looks(
    structure: Structure,
    looks: Trajectory,
    around: tuple[Trajectory, Trajectory],
    surface: Cloud,
    camera: Camera,
    rule: tuple[float, float] = (np.inf, 90.0),
    enough_m: Floats | None = None,
) -> Floats:
    """What a pixel covers at best (N,), over its angle in the middle of the picture, m; inf: no look.

    Distance over the cosine of the incidence, look by look, as CONVENTIONS.md and the pages state it.

    Parameters
    ----------
    structure : Structure
    looks : Trajectory
        K poses.
    around : tuple of Trajectory
        The poses shortly before and after each look, by which the picture moves.
    surface : Cloud
    camera : Camera
    rule : tuple of float
        The fastest motion in the picture, rad/s, and the largest incidence, deg.
    enough_m : array, shape (N,), optional
        Finer than this need not be told.
    """
    assert surface.normals is not None
    corners = structure.vertices[structure.triangles]
    finest = np.full(len(surface), np.inf)
    enough = np.zeros(len(surface)) if enough_m is None else enough_m
    fastest, incidence = rule
    least = np.cos(np.radians(min(_INCIDENCE_DEG, incidence)))
    before, after = around
    span = np.maximum(after.t_s - before.t_s, 1e-9)
    frames = [_frames(each) for each in (looks, before, after)]
    for at in range(len(looks)):
        ray = surface.points - looks.positions[at]
        reach = np.linalg.norm(ray, axis=1)
        ahead, left, up = (ray @ axis[at] for axis in frames[0])
        facing = -(ray * surface.normals).sum(axis=1)
        inside = (ahead > 0) & (reach >= camera.min_range_m) & (reach <= camera.max_range_m)
        inside &= np.abs(np.arctan2(left, ahead)) <= np.radians(camera.hfov_deg / 2)
        inside &= np.abs(np.arctan2(up, ahead)) <= np.radians(camera.vfov_deg / 2)
        inside &= (facing >= least * reach) & (finest > enough)
        some = np.flatnonzero(inside)
        if not len(some):
            continue
        sights = [_sight(surface.points[some], each, frame, at)
                  for each, frame in ((before, frames[1]), (after, frames[2]))]  # fmt: skip
        turned = 2 * np.arcsin(np.clip(np.linalg.norm(sights[1] - sights[0], axis=1) / 2, 0, 1))
        some = some[turned <= fastest * span[at]]
        longest = reach[some] ** 2 / facing[some]
        finer = longest < finest[some]
        some, longest = some[finer], longest[finer]
        if len(some):
            free = ~hidden(looks.positions[at], ray[some], corners, _SLACK)
            finest[some[free]] = longest[free]
    return finest


def _frames(poses: Trajectory) -> tuple[Floats, Floats, Floats]:
    """Ahead, left and up (K, 3) of cameras without roll."""
    yaw, pitch = yaw_pitch(poses.quat_xyzw)
    ahead = np.column_stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    left = np.column_stack([-np.sin(yaw), np.cos(yaw), np.zeros(len(yaw))])
    return ahead, left, np.cross(ahead, left)


def _sight(points: Floats, poses: Trajectory, frame: tuple[Floats, Floats, Floats], at: int) -> Floats:
    """Directions (N, 3) of points in the frame of one camera."""
    ray = points - poses.positions[at]
    own = np.column_stack([ray @ axis[at] for axis in frame])
    return np.asarray(own / np.linalg.norm(own, axis=1, keepdims=True))


@njit(cache=True)
def hidden(origin: Floats, rays: Floats, corners: Floats, slack: float) -> Bools:
    """Which rays (K, 3) from one origin meet a triangle (T, 3, 3) before their end."""
    hidden = np.zeros(len(rays), np.bool_)
    centres, radii = _balls(corners)
    for k in range(len(rays)):
        d0, d1, d2 = rays[k]
        square = d0 * d0 + d1 * d1 + d2 * d2
        for t in range(len(corners)):
            c0, c1, c2 = centres[t, 0] - origin[0], centres[t, 1] - origin[1], centres[t, 2] - origin[2]
            near = min(max((c0 * d0 + c1 * d1 + c2 * d2) / square, 0.0), 1.0)
            c0, c1, c2 = c0 - near * d0, c1 - near * d1, c2 - near * d2
            if c0 * c0 + c1 * c1 + c2 * c2 > radii[t] * radii[t]:
                continue
            a0, a1, a2 = corners[t, 0]
            e0, e1, e2 = corners[t, 1, 0] - a0, corners[t, 1, 1] - a1, corners[t, 1, 2] - a2
            f0, f1, f2 = corners[t, 2, 0] - a0, corners[t, 2, 1] - a1, corners[t, 2, 2] - a2
            p0, p1, p2 = d1 * f2 - d2 * f1, d2 * f0 - d0 * f2, d0 * f1 - d1 * f0
            scale = e0 * p0 + e1 * p1 + e2 * p2
            if scale == 0.0:
                continue
            s0, s1, s2 = origin[0] - a0, origin[1] - a1, origin[2] - a2
            u = (s0 * p0 + s1 * p1 + s2 * p2) / scale
            if u < 0.0 or u > 1.0:
                continue
            q0, q1, q2 = s1 * e2 - s2 * e1, s2 * e0 - s0 * e2, s0 * e1 - s1 * e0
            v = (d0 * q0 + d1 * q1 + d2 * q2) / scale
            if v < 0.0 or u + v > 1.0:
                continue
            along = (f0 * q0 + f1 * q1 + f2 * q2) / scale
            if 1e-9 < along < 1.0 - slack:
                hidden[k] = True
                break
    return hidden


@njit(cache=True)
def met(origin: Floats, rays: Floats, corners: Floats) -> Floats:
    """How many times its length each ray (K, 3) from one origin goes to the first triangle (T, 3, 3); inf."""
    first = np.full(len(rays), np.inf)
    for t in range(len(corners)):
        a0, a1, a2 = corners[t, 0]
        e0, e1, e2 = corners[t, 1, 0] - a0, corners[t, 1, 1] - a1, corners[t, 1, 2] - a2
        f0, f1, f2 = corners[t, 2, 0] - a0, corners[t, 2, 1] - a1, corners[t, 2, 2] - a2
        s0, s1, s2 = origin[0] - a0, origin[1] - a1, origin[2] - a2
        q0, q1, q2 = s1 * e2 - s2 * e1, s2 * e0 - s0 * e2, s0 * e1 - s1 * e0
        n0, n1, n2 = e1 * f2 - e2 * f1, e2 * f0 - e0 * f2, e0 * f1 - e1 * f0
        m0, m1, m2 = f1 * s2 - f2 * s1, f2 * s0 - f0 * s2, f0 * s1 - f1 * s0
        height = f0 * q0 + f1 * q1 + f2 * q2
        for k in range(len(rays)):
            d0, d1, d2 = rays[k]
            scale = -(d0 * n0 + d1 * n1 + d2 * n2)
            if scale == 0.0:
                continue
            u, v = (d0 * m0 + d1 * m1 + d2 * m2) / scale, (d0 * q0 + d1 * q1 + d2 * q2) / scale
            along = height / scale
            if u >= 0.0 and v >= 0.0 and u + v <= 1.0 and 1e-9 < along < first[k]:
                first[k] = along
    return first


@njit(cache=True)
def _balls(corners: Floats) -> tuple[Floats, Floats]:
    """Centres (T, 3) and radii (T,) of balls that hold the triangles (T, 3, 3), a little larger."""
    centres, radii = np.empty((len(corners), 3)), np.zeros(len(corners))
    for t in range(len(corners)):
        for axis in range(3):
            centres[t, axis] = (corners[t, 0, axis] + corners[t, 1, axis] + corners[t, 2, axis]) / 3
        for corner in range(3):
            square = 0.0
            for axis in range(3):
                square += (corners[t, corner, axis] - centres[t, axis]) ** 2
            radii[t] = max(radii[t], np.sqrt(square) * (1 + 1e-9) + 1e-9)
    return centres, radii


def least_distance(structure: Structure, positions: Floats) -> float:
    """The least distance of positions (N, 3) from the mesh, m: to every triangle (Ericson 2005, 5.1.5)."""
    return float(_least(np.ascontiguousarray(positions), structure.vertices[structure.triangles]))


@njit(cache=True)
def _least(points: Floats, corners: Floats) -> float:
    best = np.inf
    centres, radii = _balls(corners)
    for p in points:
        for t in range(len(corners)):
            far = radii[t] + np.sqrt(best)
            x, y, z = p[0] - centres[t, 0], p[1] - centres[t, 1], p[2] - centres[t, 2]
            if x * x + y * y + z * z > far * far:
                continue
            a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
            ab, ac, ap = b - a, c - a, p - a
            d1, d2 = np.dot(ab, ap), np.dot(ac, ap)
            bp, cp = p - b, p - c
            d3, d4 = np.dot(ab, bp), np.dot(ac, bp)
            d5, d6 = np.dot(ab, cp), np.dot(ac, cp)
            va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
            if d1 <= 0 and d2 <= 0:
                near = a
            elif d3 >= 0 and d4 <= d3:
                near = b
            elif d6 >= 0 and d5 <= d6:
                near = c
            elif vc <= 0 and d1 >= 0 and d3 <= 0:
                near = a + ab * (d1 / (d1 - d3))
            elif vb <= 0 and d2 >= 0 and d6 <= 0:
                near = a + ac * (d2 / (d2 - d6))
            elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
                near = b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))
            else:
                near = a + ab * (vb / (va + vb + vc)) + ac * (vc / (va + vb + vc))
            gap = p - near
            best = min(best, np.dot(gap, gap))
    return np.sqrt(best)
