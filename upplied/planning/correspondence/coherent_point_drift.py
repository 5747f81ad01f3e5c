"""Coherent point drift with normals and parts: a smooth displacement of one surface onto another.

After Myronenko and Song (2010), with three changes that inspected structures ask for. Points whose
normals disagree hardly pull. Only the pull along the target's normal counts, so that featureless
skins do not creep (soft assignment point to point moves a box that fits already by 2 % of its
diagonal, this by 0.02 %). Points of matched parts pull only each other, and each part has a
displacement of its own, an engine beside its wing. `brought_onto` knows no parts.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from upplied.planning.geometry.clouds import diagonal_of
from upplied.records import Cloud, Floats, Ints, Record, Rows

_REACH = 0.12  # of the diagonal: how far a displacement is felt in the same part
_STIFF, _LOOSE = 3.0, 0.5  # stiffness of parts that were aligned before, and of what belongs to none
_NORMALS = 4.0  # weight of one minus the cosine between normals
_START, _END, _STEPS = 0.04, 0.006, 16  # width of the soft assignment over the diagonal, and iterations
_OUTLIERS = 1e-3
_LEAST_MODE = 0.01  # of a point's own pull: a weaker mode follows by less than a fiftieth, however loose
CONTROLS, ANCHORS = 200, 450  # points of the source that move, points of the target that pull
_MOST_SPREAD = 1000  # points of a cloud that are put in order


@dataclass(frozen=True, eq=False, repr=False)
class Patch(Rows):
    """Points with normals and the class of their part; -1 pairs with any."""

    points: Floats  # (N, 3) m
    normals: Floats  # (N, 3) unit
    label: Ints  # (N,)


@dataclass(frozen=True, eq=False, repr=False)
class Drift(Record):
    """A displacement: control points, their classes, and what each adds."""

    control: Patch
    weights: Floats  # (M, 3) m
    reach_m: float

    def at(self, points: Floats, label: Ints) -> Floats:
        """Displacement (N, 3), m, of points of the given classes."""
        return _kernel(points, label, self.control.points, self.control.label, self.reach_m) @ self.weights


def drift(moving: Patch, fixed: Patch, diagonal_m: float) -> Drift:
    """Displacement of `moving`, a few hundred control points, onto `fixed`.

    Each iteration solves a system of three times as many unknowns; `diagonal_m` measures all widths.
    """
    reach = _REACH * diagonal_m
    # A kernel as wide as a part's neighbourhood has far fewer modes that matter than control points.
    strength, modes = np.linalg.eigh(_kernel(moving.points, moving.label, moving.points, moving.label, reach))
    strong = strength > _LEAST_MODE
    modes = modes[:, strong] * np.sqrt(strength[strong])  # their outer product is the kernel
    apart = (moving.label[:, None] != fixed.label[None, :]) & (moving.label[:, None] >= 0)
    prior = np.where(apart, 0.0, np.exp(_NORMALS * (moving.normals @ fixed.normals.T - 1)))
    outer = fixed.normals[:, :, None] * fixed.normals[:, None, :]
    pull = np.einsum("nij,nj->ni", outer, fixed.points)
    stiffness = np.where(moving.label >= 0, _STIFF, _LOOSE)[:, None]
    weights, here = np.zeros_like(moving.points), moving.points
    for width in np.geomspace(_START, _END, _STEPS) * diagonal_m:
        share = prior * np.exp(-cdist(here, fixed.points, "sqeuclidean") / (2 * width**2))
        share /= (share.sum(axis=0) + _OUTLIERS) * stiffness
        metric = (share @ outer.reshape(-1, 9)).reshape(-1, 3, 3)
        pulls = share @ pull - np.einsum("mij,mj->mi", metric, moving.points)
        moved = modes @ _strengths(metric, pulls, modes)
        weights = pulls - np.einsum("mij,mj->mi", metric, moved)
        here = moving.points + moved
    return Drift(moving, weights, reach)


def _strengths(metric: Floats, pulls: Floats, modes: Floats) -> Floats:
    """How much of each mode (R, 3): c with ``(1 + modes' metric modes) c = modes' wanted``."""
    # That is ``metric_m (kernel @ w)_m + w_m = wanted_m`` for every point m, with ``kernel = modes modes'``
    # and ``c = modes' w``. `metric` is (M, 3, 3) and symmetric, `pulls` (M, 3), `modes` (M, R).
    number = modes.shape[1]
    system = np.eye(3 * number)
    for one in range(3):
        for other in range(one, 3):
            block = (modes * metric[:, one, other, None]).T @ modes
            system[one * number : (one + 1) * number, other * number : (other + 1) * number] += block
    solved = cho_solve(cho_factor(system, overwrite_a=True, check_finite=False), (modes.T @ pulls).T.ravel())
    return np.asarray(solved.reshape(3, number).T)


def spread_over(cloud: Cloud, number: int) -> Ints:
    """The first `number` of a cloud's `farthest_points`, `_MOST_SPREAD` or fewer."""
    order: Ints = cloud.derived("farthest points", lambda: farthest_points(cloud.points, _MOST_SPREAD))
    return order[:number]


@njit(cache=True)
def farthest_points(points: Floats, number: int) -> np.ndarray:
    """Indices (number,) of points (N, 3) that lie far from each other, the first nearest the middle."""
    total = len(points)
    middle = np.zeros(3)
    for row in range(total):
        middle += points[row] / total
    last, nearest = 0, np.inf
    for row in range(total):
        gap = np.sum((points[row] - middle) ** 2)
        if gap < nearest:
            last, nearest = row, gap
    x, y, z = points[:, 0].copy(), points[:, 1].copy(), points[:, 2].copy()
    distance = np.full(total, np.inf)
    bits = distance.view(np.int64)  # of numbers that are not negative: they compare alike, several at a time
    chosen = np.empty(min(number, total), np.int64)
    for place in range(len(chosen)):
        chosen[place] = last
        at_x, at_y, at_z = x[last], y[last], z[last]
        for row in range(total):
            dx, dy, dz = x[row] - at_x, y[row] - at_y, z[row] - at_z
            gap = dx * dx + dy * dy + dz * dz
            distance[row] = gap if gap < distance[row] else distance[row]
        most = np.int64(-1)
        for row in range(total):
            most = bits[row] if bits[row] > most else most
        last = 0
        while bits[last] != most:
            last += 1
    return chosen


def _kernel(points: Floats, label: Ints, control: Floats, control_label: Ints, reach_m: float) -> Floats:
    near = np.exp(-cdist(points, control, "sqeuclidean") / (2 * reach_m**2))
    return np.where(label[:, None] == control_label[None, :], near, 0.0)


def brought_onto(whole: Cloud, known: Cloud) -> Cloud:
    """A structure, `known`, by a smooth displacement brought onto another that it is registered with."""
    fixed, moving = (Patch(cloud.points, cloud.outward, np.full(len(cloud), -1)) for cloud in (whole, known))
    anchors = fixed.rows(spread_over(whole, ANCHORS))
    field = drift(moving.rows(spread_over(known, CONTROLS)), anchors, diagonal_of(fixed.points))
    return replace(known, points=moving.points + field.at(moving.points, moving.label))
