"""Convergence check: how the target lies on the demonstration structure, and whether it fits (Sec. III-A)."""

from __future__ import annotations

from upplied.config import RegistrationSettings
from upplied.planning.boxes import box_scale, spacing
from upplied.planning.icp import icp, mean_squared_nn_distance
from upplied.records import Cloud, Registration


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


def _refusal(score: float, gate: float, gamma: float, leaf: float) -> str:
    return (
        f"the clouds do not fit: mean squared nearest-neighbour distance {score:.3g} m^2, "
        f"gate {gate:.3g} m^2 (gamma {gamma:g} times the squared spacing of {leaf:.3g} m)"
    )
