"""Bounding boxes made equal: the scale between two structures (paper, Sec. III-A), and spacing of samples."""

from __future__ import annotations

import numpy as np

from upplied.records import Cloud, Floats, Registration


def box_scale(source: Floats, target: Floats) -> Floats:
    """Factors (3,) per axis that make the target's bounding box as large as the source's.

    Where either is flat (no extent along an axis) the factor of that axis is 1.
    """
    return axis_ratios(np.ptp(source, axis=0), np.ptp(target, axis=0))


def axis_ratios(one: Floats, other: Floats) -> Floats:
    """Extents (3,) of one thing over those of another along each axis; 1 where either is flat."""
    flat = np.minimum(one, other) <= 1e-9 * max(one.max(), other.max())
    return np.where(flat, 1.0, one / np.where(flat, 1.0, other))


def diagonal_of(points: Floats) -> float:
    """Length of the diagonal of the bounding box, m."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def spacing(cloud: Cloud) -> float:
    """Distance between neighbouring samples, m: the leaf of a voxel cloud, else from the area."""
    if cloud.leaf_m > 0:
        return cloud.leaf_m
    if cloud.area_m2 is not None:
        return float(np.sqrt(cloud.area_m2.mean()))
    size = np.sort(np.ptp(cloud.points, axis=0))
    return float(np.sqrt(2 * (size[2] * size[1] + size[2] * size[0] + size[1] * size[0]) / len(cloud)))


def in_source_frame(target: Cloud, registration: Registration) -> Cloud:
    """The target's samples in the frame and at the scale of the demonstration structure.

    Normals are carried as normals, areas as areas.
    """
    points = registration.to_demo(target.points)
    if target.normals is None:
        return Cloud(points, None, target.area_m2, target.part, target.leaf_m, target.open)
    cofactor = np.linalg.det(registration.matrix) * np.linalg.inv(registration.matrix).T
    normals = target.normals @ cofactor.T
    stretch = np.linalg.norm(normals, axis=1)
    area = None if target.area_m2 is None else target.area_m2 * stretch
    # A mirroring turns a surface inside out; the outside stays outside.
    outward = np.sign(np.linalg.det(registration.matrix)) * normals / stretch[:, None]
    return Cloud(points, outward, area, target.part, target.leaf_m, target.open)
