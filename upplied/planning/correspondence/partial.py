"""A target of which something was never scanned, registered: its box is no longer the source's.

Where a wing, a mast or an end is missing, boxes made equal stretch what is there by as much. So along each
axis other scales are tried too, from either end, and the best ways are refined by the surfaces that are on
both. Where the scan is open, what of the source lies beyond an opening counts for no way and against none.
"""

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from upplied.geometry.vectors import scaled_normals, with_normals
from upplied.planning.constants import LEAST_PART, MAJORITY
from upplied.planning.correspondence.coherent_point_drift import spread_over
from upplied.planning.correspondence.misfit import GAP_FACING
from upplied.planning.geometry.clouds import diagonal_of, in_source_frame, spacing
from upplied.records import Bools, Cloud, Floats, Registration

Way = tuple[Floats, Floats]  # scale and shift, each (3,), of a target whose box was made equal

_SAMPLES = 700  # of each surface
_FAR = 0.06  # of the diagonal: farther surfaces are not on both, and count no more
_REFINED, _ROUNDS = 4, 12  # ways that are refined, and how often
_NEAREST = 0.015  # of the diagonal: what counts as on both in the last round; the first takes `_FAR`
_LEAST_SAMPLES = 50  # samples, at least, that are on both
_STEP = 1.25  # largest change of a scale in a round
# Shares of an axis that may be left of an open target.
_LEFT = (0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.65, 0.6, 0.55, 0.5)


def is_open(cloud: Cloud) -> bool:
    """Whether a scan ends on so much of its surface that something was never scanned."""
    return cloud.open is not None and bool(cloud.areas[cloud.open].sum() >= LEAST_PART * cloud.areas.sum())


def registered_partly(source: Cloud, target: Cloud, box: Registration) -> Registration | None:
    """The registration by the surfaces that are on both structures; None where the boxes are as good.

    `box` is the registration by boxes made equal; samples have normals.
    """
    if diagonal_of(source.points) <= 0:
        return None
    both = _Both(source, target, box)
    ways = sorted(both.ways(), key=lambda way: both.judged(*way).apart_m)
    refined = [both.refined(*way) for way in ways[:_REFINED]]
    scale, shift = min(refined, key=lambda way: both.judged(*way).apart_m)
    after, before_m = both.judged(scale, shift), both.judged(np.ones(3), np.zeros(3)).apart_m
    moved = np.linalg.norm(both.points * (scale - 1) + shift, axis=1).mean() / both.diagonal
    # Of twelve structures that nobody built, scanned whole or but for 10 to 40 % of their surface, those
    # whose boxes were right moved by 2.7 % at most and came nearer to no less than 0.75 (where the boxes fit
    # well nothing is tried), those whose boxes were wrong moved by 16 %.
    if after.apart_m >= before_m or (moved < _FAR and after.apart_m > MAJORITY * before_m):
        return None
    return after.registration


class Judged(NamedTuple):
    """A registration, and how far the surfaces lie apart in it."""

    apart_m: float  # mean distance both ways, at the source's scale, where both are known
    error_m: float  # of that mean, two standard errors
    registration: Registration


def ways_of_open(source: Cloud, target: Cloud, box: Registration, registration: Registration) -> list[Judged]:
    """Registrations of an open target: one that was found, and others, the best first.

    `box` is the registration by boxes made equal, turned as `registration`.
    """
    both = _Both(source, target, box)
    ways = list(both.ways())
    known = [both.judged(*way) for way in ways]
    best = sorted(range(len(ways)), key=lambda way: known[way].apart_m)
    known += [both.judged(*both.refined(*ways[way])) for way in best[:_REFINED]]
    scale = registration.scale / box.scale
    shift = registration.translation - scale * box.translation
    first = both.judged(scale, shift)._replace(registration=registration)
    return [first, *sorted(known, key=lambda each: each.apart_m)]


def as_likely(source: Cloud, target: Cloud, registration: Registration) -> list[tuple[Registration, Bools]]:
    """Registrations by which an open target goes on farther at an open end, that samples cannot rule out.

    With each, which samples of the source (N,) lie past where the target ends.
    """
    both = _Both(source, target, registration)
    first = both.judged(np.ones(3), np.zeros(3))
    likely = []
    for axis, side in both.open_ends():
        for scale, shift in both.longer(axis, side):
            way = both.judged(scale, shift)
            if way.apart_m <= first.apart_m + first.error_m:
                beyond = source.points[:, axis] - (scale * both.ends[side] + shift)[axis]
                likely.append((way.registration, (beyond if side else -beyond) > both.slack))
    return likely


class _Both:
    """Both surfaces with the boxes equal, and ways to register them."""

    def __init__(self, source: Cloud, target: Cloud, box: Registration) -> None:
        registered = in_source_frame(target, box)
        self.box, self.diagonal, self.slack = box, diagonal_of(source.points), spacing(source)
        self.weight = GAP_FACING * self.diagonal
        mine, theirs = spread_over(source, _SAMPLES), spread_over(target, _SAMPLES)
        self.fixed = with_normals(source.points[mine], source.outward[mine], self.weight)
        self.tree = cKDTree(self.fixed)
        self.points, self.normals = registered.points[theirs], registered.outward[theirs]
        self.ends = registered.points.min(axis=0), registered.points.max(axis=0)
        self.open = target.open[theirs] if target.open is not None else np.zeros(len(theirs), bool)

    def ways(self) -> Iterator[Way]:
        """The boxes as they are, and along some axes the scale of the others, or less, from either end."""
        yield np.ones(3), np.zeros(3)
        anywhere = list(product(range(3), (0, 1)))
        cut = self.open_ends() if self.open.any() else anywhere  # of a closed target any end may be missing
        for sides in product(*((None, *(side for at, side in cut if at == axis)) for axis in range(3))):
            whole = [axis for axis in range(3) if sides[axis] is None]
            if not 0 < len(whole) < 3:
                continue
            scale, shift = np.ones(3), np.zeros(3)
            common = np.exp(np.log(self.box.scale[whole]).mean())
            for axis, side in enumerate(sides):
                if side is not None:
                    scale[axis] = common / self.box.scale[axis]
                    shift[axis] = (1 - scale[axis]) * self.ends[1 - side][axis]
            yield scale, shift
        for axis, side in self.open_ends():
            yield from self.longer(axis, side)

    def longer(self, axis: int, side: int) -> Iterator[Way]:
        """The target is some share of the whole along an axis, and goes on at its low (0) or high (1) end."""
        for left in _LEFT:
            scale, shift = np.ones(3), np.zeros(3)
            scale[axis], shift[axis] = left, (1 - left) * self.ends[1 - side][axis]
            yield scale, shift

    def open_ends(self) -> list[tuple[int, int]]:
        """The axes along which the target is open, at its low (0) or high (1) end."""
        return [
            (axis, side)
            for axis, side in product(range(3), (0, 1))
            if (np.abs(self.points[self.open, axis] - self.ends[side][axis]) < _FAR * self.diagonal).any()
        ]

    def moved(self, scale: Floats, shift: Floats) -> Floats:
        """Target samples with normals beside their places, (S, 6)."""
        normals = scaled_normals(self.normals, scale)
        return with_normals(self.points * scale + shift, normals, self.weight)

    def judged(self, scale: Floats, shift: Floats) -> Judged:
        """A way as a registration of the target in its own frame, and how far the surfaces lie apart.

        What is on one alone counts no more than `_FAR`, and samples of the source beyond openings nothing.
        """
        moved, far, box = self.moved(scale, shift), _FAR * self.diagonal, self.box
        back, here = cKDTree(moved).query(self.fixed)
        known = ~self.open[here]
        forth, back = self.tree.query(moved)[0], back[known] if known.any() else np.full(1, far)
        both_ways = [np.clip(of - self.slack, 0, far) for of in (forth, back)]
        apart, error = sum(of.mean() for of in both_ways), sum(of.var() / len(of) for of in both_ways)
        offset = scale * box.translation + shift
        way = Registration(scale * box.scale, box.rotation, offset, float("nan"), False, turn=box.turn)
        return Judged(float(apart), float(2 * np.sqrt(error)), way)

    def refined(self, scale: Floats, shift: Floats) -> Way:
        """A way in which the surfaces that are on both lie best, by least squares along each axis."""
        for round_ in range(_ROUNDS):
            moved = self.moved(scale, shift)
            (forth, there), (back, here) = self.tree.query(moved), cKDTree(moved).query(self.fixed)
            near = max(_NEAREST, _FAR * (1 - round_ / _ROUNDS)) * self.diagonal
            counts = (back < near) & ~self.open[here]
            points = np.vstack([self.points[forth < near], self.points[here[counts]]])
            goals = np.vstack([self.fixed[there[forth < near], :3], self.fixed[counts, :3]])
            if len(points) < _LEAST_SAMPLES:
                break
            middle, goal = points.mean(axis=0), goals.mean(axis=0)
            spread = np.maximum(((points - middle) ** 2).sum(axis=0), 1e-12)
            slope = ((points - middle) * (goals - goal)).sum(axis=0) / spread
            scale = np.clip(slope, scale / _STEP, scale * _STEP)
            shift = goal - scale * middle
        return scale, shift
