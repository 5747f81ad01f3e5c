"""Convergence check: how the target lies on the demonstration structure, and whether it fits (Sec. III-A)."""

from dataclasses import dataclass, field, replace

import numpy as np

from upplied.config import RegistrationSettings
from upplied.planning.constants import CLEARLY_BETTER, MAJORITY
from upplied.planning.correspondence.misfit import Misfit, misfit_of
from upplied.planning.correspondence.orientation import SAME_TURN_DEG, find_orientation
from upplied.planning.correspondence.partial import is_open, registered_partly, ways_of_open
from upplied.planning.geometry.clouds import (
    UNTURNED,
    box_scale,
    icp,
    in_source_frame,
    mean_squared_nn_distance,
    spacing,
)
from upplied.planning.surface.frames import named_axes
from upplied.planning.surface.parts import blades_of, labels_of, parts_of
from upplied.records import Cloud, Floats, Frame, Record, Registration, Structure

# Where the boxes alone would refuse: how well, in gates, the target's surface must lie on the source, and how
# much of that it must cover. Of 38 real meshes, whole or cut, 0 of 460 pairs of other kinds are accepted so,
# 0 of 17 of the same kind by a wrong way, and 8 of 13 by a right one; from 0.25 on a hotel lies on a hull.
# At a smaller misfit of the boxes nothing else is tried, no other heading either.
_PARTLY, _COVERED = 0.2, 0.5
_CIRCLE = 2**32  # distinct headings


@dataclass(frozen=True, eq=False, repr=False)
class Declared(Record):
    """What was said of how two structures stand, in the frames that their clouds are given in."""

    turn: Floats = field(default_factory=lambda: UNTURNED)  # (3, 3) target to the source's orientation
    words: Floats = field(default_factory=lambda: UNTURNED)  # (3, 3) source to +X front, +Y left


def declared_for(source: Structure, target: Structure) -> Declared:
    """What was said of how two structures stand: the turn is that of their declared headings."""
    circle = (target.frame.heading_rad - source.frame.heading_rad) / (2 * np.pi)
    # Rounded, so that equal structures in other axes give the same number, and a whole circle none.
    turn = Frame(2 * np.pi * float(np.round(circle * _CIRCLE) % _CIRCLE / _CIRCLE)).turn
    return Declared(turn, named_axes(source.frame))


def register(
    source: Cloud, target: Cloud, settings: RegistrationSettings, declared: Declared | None = None
) -> Registration:
    """Lay the target on the source and judge the fit: as published, or as `settings.acceptance` asks.

    Parameters
    ----------
    source, target : Cloud
        Of the demonstration structure, and of the target.
    declared : Declared, optional
        Without it both clouds are in their declared frames.

    Returns
    -------
    Registration
        With PCL's score in m^2 and the verdict; where refused, the reason says what and where.
    """
    declared, gate = Declared() if declared is None else declared, settings.acceptance
    if gate is None or source.normals is None or target.normals is None:
        return published(source, target, settings, declared.turn)
    turn, gap, evidence, doubt = declared.turn, float("nan"), "orientation as declared", ""
    if settings.search != "none":
        best = find_orientation(source, target, settings.search, turn)
        turn, gap, evidence = best.turn, best.gap, best.evidence
    chosen = _best_registration(source, target, turn, gate, declared.words)
    if settings.search == "none" and chosen[1].value > _PARTLY * gate:
        best = find_orientation(source, target, "heading", turn)
        doubt = _doubt(best.turn @ turn.T, best.gap)
    score = mean_squared_nn_distance(source.points, in_source_frame(target, chosen[0]).points)
    return replace(_verdict(*chosen, gate, evidence, doubt), score_m2=score, runner_up_gap=gap)


def published(
    source: Cloud, target: Cloud, settings: RegistrationSettings, turn: Floats = UNTURNED
) -> Registration:
    """Scale the target until the bounding boxes match, align it by ICP, and judge the score (Alg. 1).

    The paper's structures stand alike; others are turned so first.
    """
    start = box_on_box(source, target, turn)
    scale, offset, turned = start.scale, start.translation, target.points @ start.turn.T
    scaled = scale * turned + offset
    # Algorithm 1 gives the demonstration's cloud as source, so the motion found goes to the target;
    # its inverse brings the target onto the source and leaves every distance as it is.
    forward, shift = icp(source.points, scaled, settings.iterations)
    rotation, translation = forward.T, forward.T @ (offset - shift)
    aligned = (scale * turned) @ rotation.T + translation
    score = mean_squared_nn_distance(source.points, aligned)
    leaf = spacing(source)
    gate = settings.gamma * leaf**2
    reason = (
        f"the clouds do not fit: mean squared nearest-neighbour distance {score:.3g} m^2, "
        f"gate {gate:.3g} m^2 (gamma {settings.gamma:g} times the squared spacing of {leaf:.3g} m)"
    )
    verdict = (True, "") if score < gate else (False, reason)
    return Registration(scale, rotation, translation, score, *verdict, turn=start.turn)


def fitted(source: Cloud, target: Cloud, gate: float) -> Registration:
    """As `register` in the declared orientation: the same verdict, without the score or a doubted heading."""
    return _verdict(*_best_registration(source, target, np.eye(3), gate), gate)


def _verdict(
    registration: Registration,
    misfit: Misfit,
    chosen: str,
    gate: float,
    evidence: str = "orientation as declared",
    doubt: str = "",
) -> Registration:
    """A registration with whether it is accepted, and why."""
    accepted, figures = misfit.value < gate, misfit.figures
    where = f"; {misfit.where}" if misfit.where else ""
    reason = f"the structures do not correspond: misfit {misfit.value:.2f}, gate {gate:g} ({figures}){where}"
    return replace(
        registration,
        accepted=accepted,
        reason="" if accepted else reason + doubt,
        acceptance=misfit.value,
        scanned=misfit.scanned,
        evidence=f"{evidence}{chosen}; {figures}{doubt}",
    )


def _best_registration(
    source: Cloud, target: Cloud, turn: Floats, gate: float, words: Floats = UNTURNED
) -> tuple[Registration, Misfit, str]:
    """The target, turned, on the source: box on box, or a way that fits much better, and which."""
    start = box_on_box(source, target, turn)
    best, misfit, chosen = start, misfit_of(source, target, start, words), ""
    if blades_of(source).any() and blades_of(target).any():
        body = body_on_body(source, target, turn)
        judgement = misfit_of(source, target, body, words)
        if judgement.value < CLEARLY_BETTER * misfit.value:
            best, misfit, chosen = body, judgement, "; registered body on body, since blades may have turned"
    if is_open(target):
        # As a whole target, unless a partial one leaves clearly less of its residual.
        before, *others = ways_of_open(source, target, start, best)
        for other in others:
            if other.apart_m > MAJORITY * before.apart_m:
                break
            judgement = misfit_of(source, target, other.registration, words)
            if judgement.value < gate and judgement.common > _COVERED:
                return other.registration, judgement, "; registered by what was scanned"
        return best, misfit, chosen
    if misfit.value > _PARTLY * gate and (partly := registered_partly(source, target, start)) is not None:
        judgement = misfit_of(source, target, partly, words)
        lies_well = judgement.scanned < _PARTLY * gate and judgement.common > _COVERED
        # What is missing counts more where the rest is no longer stretched to make up for it.
        if CLEARLY_BETTER * judgement.value < misfit.value if misfit.value < gate else lies_well:
            best, misfit, chosen = partly, judgement, "; registered by what is on both structures"
    return best, misfit, chosen


def box_on_box(source: Cloud, target: Cloud, turn: Floats = UNTURNED) -> Registration:
    """The registration that makes the bounding boxes equal, after a turn of the target; not judged."""
    turned = target.points @ turn.T
    scale = box_scale(source.points, turned)
    offset = source.points.min(axis=0) - scale * turned.min(axis=0)
    return Registration(scale, np.eye(3), offset, float("nan"), False, turn=turn)


def body_on_body(source: Cloud, target: Cloud, turn: Floats = UNTURNED) -> Registration:
    """Boxes without the blades made equal, but across the axis of the rotor the blades' lengths.

    Where a rotor stopped shifts and widens the box of a turbine. Its axis is the one of the two
    horizontal axes along which the blades are spread less.
    """
    turned = Cloud(target.points @ turn.T, None, target.area_m2, target.part)
    both = [(cloud, blades_of(cloud)) for cloud in (source, turned)]
    body, other_body = (cloud.points[~blades] for cloud, blades in both)
    scale = box_scale(body, other_body)
    across = int(np.argmax(source.points[both[0][1]][:, :2].std(axis=0)))
    lengths = [parts_of(cloud).extent[np.unique(labels_of(cloud)[some]), 0].mean() for cloud, some in both]
    scale[across] = float(lengths[0]) / float(lengths[1])
    middle, other_middle = ((points.min(axis=0) + points.max(axis=0)) / 2 for points in (body, other_body))
    return Registration(scale, np.eye(3), middle - scale * other_middle, float("nan"), False, turn=turn)


def _doubt(turn: Floats, gap: float) -> str:
    """Evidence against the declared heading, in words; empty where nothing does."""
    angle = float(np.degrees(np.arctan2(turn[1, 0], turn[0, 0])))
    if abs(angle) < SAME_TURN_DEG or not gap > 1 - CLEARLY_BETTER:
        return ""
    return (
        f"; turned by {angle:.0f} deg about the vertical the target would fit {100 * gap:.0f} % better "
        "than in any other heading: check its declared forward axis, or search the heading"
    )
