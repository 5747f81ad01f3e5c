"""Convergence check: how the target lies on the demonstration structure, and whether it fits (Sec. III-A)."""

from __future__ import annotations

import numpy as np

from upplied.config import RegistrationSettings
from upplied.planning.icp import icp, mean_squared_nn_distance
from upplied.records import Cloud, Floats, Registration


def register(source: Cloud, target: Cloud, settings: RegistrationSettings) -> Registration:
    """Scale the target until the bounding boxes match, align it by ICP, and judge the fit (Alg. 1).

    Parameters
    ----------
    source : Cloud
        Of the demonstration structure.
    target : Cloud
    settings : RegistrationSettings

    Returns
    -------
    Registration
        ``p_demo = rotation @ (scale * p_target) + translation``, PCL's score in m^2, and the verdict.
    """
    scale = box_scale(source.points, target.points)
    offset = source.points.min(axis=0) - scale * target.points.min(axis=0)
    scaled = scale * target.points + offset
    # Algorithm 1 gives the demonstration's cloud as source, so the motion found goes to the target;
    # its inverse lays the target on the demonstration and leaves every distance as it is.
    forward, shift = icp(source.points, scaled, settings.iterations)
    rotation, translation = forward.T, forward.T @ (offset - shift)
    aligned = (scale * target.points) @ rotation.T + translation
    score = mean_squared_nn_distance(source.points, aligned)
    gate = settings.gamma * spacing(source) ** 2
    accepted = score < gate
    return Registration(
        scale=scale,
        rotation=rotation,
        translation=translation,
        score_m2=score,
        accepted=accepted,
        reason="" if accepted else _refusal(score, gate, settings.gamma, spacing(source)),
    )


def box_scale(source: Floats, target: Floats) -> Floats:
    """Factors (3,) per axis that make the target's bounding box as large as the source's.

    Where either is flat (no extent along an axis) the factor of that axis is 1.
    """
    size_d, size_t = np.ptp(source, axis=0), np.ptp(target, axis=0)
    flat = np.minimum(size_d, size_t) <= 1e-9 * max(size_d.max(), size_t.max())
    return np.where(flat, 1.0, size_d / np.where(flat, 1.0, size_t))


def spacing(cloud: Cloud) -> float:
    """Distance between neighbouring samples, m: the leaf of a voxel cloud, else from the area."""
    if cloud.leaf_m > 0:
        return cloud.leaf_m
    if cloud.area_m2 is not None:
        return float(np.sqrt(cloud.area_m2.mean()))
    size = np.sort(np.ptp(cloud.points, axis=0))
    return float(np.sqrt(2 * (size[2] * size[1] + size[2] * size[0] + size[1] * size[0]) / len(cloud)))


def _refusal(score: float, gate: float, gamma: float, leaf: float) -> str:
    return (
        f"the clouds do not fit: mean squared nearest-neighbour distance {score:.3g} m^2, "
        f"gate {gate:.3g} m^2 (gamma {gamma:g} times the squared spacing of {leaf:.3g} m)"
    )
