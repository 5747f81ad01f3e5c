"""Which way round the target stands, where that is not known: ranked candidates and how sure the best is.

Principal axes with their 24 proper assignments and a grid of headings give the candidates. Each is
judged with the boxes matched, both ways, normals counted; the best few are refined by ICP. A
symmetric structure has no orientation of its own: then the declared heading decides, and that is said."""

from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from upplied.geometry.vectors import scaled_normals
from upplied.planning.constants import CLEARLY_BETTER, FACING, TOLERANCE
from upplied.planning.correspondence.coherent_point_drift import spread_over
from upplied.planning.geometry.clouds import box_scale, diagonal_of, icp
from upplied.records import Cloud, Floats, Ints, Record

_STEP_DEG = 10.0  # between headings
SAME_TURN_DEG = 2.5 * _STEP_DEG  # nearer orientations are one: a heading, and the two to either side of it
_COARSE, _FINE = 250, 700  # samples by which all candidates and by which the best are judged
_REFINED = 6  # candidates
_ITERATIONS = 15
_BOXES = 3  # in which the best is refined, one after another


@dataclass(frozen=True, eq=False, repr=False)
class Orientation(Record):
    """How to turn the target."""

    turn: Floats  # (3, 3) proper: target frame to the demonstration's orientation
    gap: float  # by what share the next best orientation fits worse; NaN where there is none
    evidence: str  # in words


def find_orientation(
    source: Cloud, target: Cloud, search: Literal["heading", "orientation"], declared: Floats | None = None
) -> Orientation:
    """Turn that brings the target onto the source best, about the vertical or about any axis.

    `declared` (3, 3) is the turn that was declared, none without it. Samples need normals.
    """
    declared = np.eye(3) if declared is None else declared
    few, few_target = (cloud.at(spread_over(cloud, _COARSE)) for cloud in (source, target))
    about = np.arange(0, 360, _STEP_DEG)[:, None]
    turns = Rotation.from_euler("z", about, degrees=True).as_matrix()
    if search == "orientation":
        turns = np.concatenate([turns, _axes(source, target)])
    rough = np.array([_cost(few, few_target, turn) for turn in turns])
    more, more_target = (cloud.at(spread_over(cloud, _FINE)) for cloud in (source, target))
    best = turns[np.argsort(rough, kind="stable")]
    refined = [_refined(more, more_target, turn, search) for turn in best[_distinct(best)[:_REFINED]]]
    refined.sort(key=lambda turn_and_cost: turn_and_cost[1])
    candidates, costs = np.array([turn for turn, _ in refined]), np.array([cost for _, cost in refined])
    distinct = _distinct(candidates)
    # What two samplings of one surface cost: no orientation is better than another below it.
    noise = 0.7 * np.sqrt(source.areas.sum() / _FINE) / diagonal_of(source.points)
    chosen = _chosen(candidates[distinct], np.maximum(costs[distinct], noise), len(turns), declared)
    # The box of a turned target is another one: in it the turn is refined again.
    turn = chosen.turn
    for _ in range(_BOXES):
        turn, _ = _refined(more, more_target, turn, search)
    return replace(chosen, turn=turn)


def _chosen(turns: Floats, costs: Floats, tried: int, declared: Floats) -> Orientation:
    gap = float(1 - costs[0] / max(costs[1], 1e-12)) if len(costs) > 1 else float("nan")
    angle = np.degrees(Rotation.from_matrix(turns @ declared.T).magnitude())
    evidence = f"{tried} orientations tried"
    if gap < 1 - CLEARLY_BETTER:
        alike = costs <= costs[0] / CLEARLY_BETTER
        nearest = int(np.argmin(np.where(alike, angle, np.inf)))
        evidence += (
            f"; {int(alike.sum())} of them fit alike (the next best {100 * max(gap, 0):.0f} % worse), "
            f"so the one nearest to the declared heading is used, {angle[nearest]:.0f} deg from it"
        )
        return Orientation(turns[nearest], gap, evidence)
    return Orientation(
        turns[0], gap, f"{evidence}; turned by {angle[0]:.0f} deg, the next best fits {100 * gap:.0f} % worse"
    )


def _cost(source: Cloud, target: Cloud, turn: Floats) -> float:
    """Two-way distance over the diagonal, boxes matched, plus what turned normals and stretch count."""
    points, normals, scale = _in_box(source, target, turn)
    diagonal = diagonal_of(source.points)
    total = 0.0
    for a, na, tree, nb in (
        (source.points, source.outward, cKDTree(points), normals),
        (points, normals, cKDTree(source.points), source.outward),
    ):
        distance, index = tree.query(a)
        facing = np.einsum("ij,ij->i", na, nb[index])
        total += float(np.mean(distance) / diagonal + FACING * np.mean(1 - facing) / 2) / 2
    logs = np.sort(np.log(scale))
    return total + FACING * float(np.abs(logs - logs[1]).max())


def _in_box(source: Cloud, target: Cloud, turn: Floats) -> tuple[Floats, Floats, Floats]:
    points = target.points @ turn.T
    scale = box_scale(source.points, points)
    normals = scaled_normals(target.outward @ turn.T, scale)
    middle = (source.points.min(axis=0) + source.points.max(axis=0)) / 2
    return scale * (points - (points.min(axis=0) + points.max(axis=0)) / 2) + middle, normals, scale


def _refined(source: Cloud, target: Cloud, turn: Floats, search: str) -> tuple[Floats, float]:
    """The turn after ICP, where that lowers the cost, and its cost; a heading stays about the vertical."""
    points, _, _ = _in_box(source, target, turn)
    rotation, _ = icp(points, source.points, _ITERATIONS)
    if search == "heading":
        rotation = Rotation.from_euler("z", float(np.arctan2(rotation[1, 0], rotation[0, 0]))).as_matrix()
    candidate = rotation @ turn
    before, after = _cost(source, target, turn), _cost(source, target, candidate)
    return (candidate, after) if after < (1 - TOLERANCE) * before else (turn, before)


def _axes(source: Cloud, target: Cloud) -> Floats:
    """Turns (24, 3, 3) of the target's principal axes onto the source's, in every proper assignment."""
    both, turns = [], []
    for cloud in (source, target):
        weight = cloud.areas
        offset = cloud.points - np.average(cloud.points, axis=0, weights=weight)
        axes = np.linalg.eigh((offset * weight[:, None]).T @ offset)[1]
        both.append(axes * np.array([1.0, 1.0, np.sign(np.linalg.det(axes))]))  # right-handed
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        assigned = np.eye(3)[list(order)] * np.array(signs)
        if np.linalg.det(assigned) > 0:
            turns.append(both[0] @ assigned @ both[1].T)
    return np.array(turns)


def _distinct(turns: Floats) -> Ints:
    """Indices of the turns, in their order, without those near an earlier one that is kept."""
    cosine = (np.einsum("aij,bij->ab", turns, turns) - 1) / 2  # of the angle between two turns
    apart = cosine < np.cos(np.radians(SAME_TURN_DEG))
    chosen: list[int] = []
    for index in range(len(turns)):
        if apart[index, chosen].all():
            chosen.append(index)
    return np.array(chosen, np.int64)
