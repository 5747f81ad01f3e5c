"""What poses truly see: the ray test of bench/proof.py, which shares no code with the one it judges."""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.poses import yaw_pitch
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
    yaw, pitch = yaw_pitch(poses.quat_xyzw)
    ahead = np.column_stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    left = np.column_stack([-np.sin(yaw), np.cos(yaw), np.zeros(len(yaw))])
    up = np.cross(ahead, left)
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
            seen[some] = ~_hidden(poses.positions[at], ray[some], corners, _SLACK)
    return seen


@njit(cache=True)
def _hidden(origin: Floats, rays: Floats, corners: Floats, slack: float) -> Bools:
    """Which rays (K, 3) from one origin meet a triangle (T, 3, 3) before their end."""
    hidden = np.zeros(len(rays), np.bool_)
    for k in range(len(rays)):
        d0, d1, d2 = rays[k]
        for t in range(len(corners)):
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


def least_distance(structure: Structure, positions: Floats) -> float:
    """The least distance of positions (N, 3) from the mesh, m: to every triangle (Ericson 2005, 5.1.5)."""
    return float(_least(np.ascontiguousarray(positions), structure.vertices[structure.triangles]))


@njit(cache=True)
def _least(points: Floats, corners: Floats) -> float:
    best = np.inf
    for p in points:
        for t in range(len(corners)):
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
