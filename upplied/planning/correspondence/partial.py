"""A target of which something was never scanned, registered: its box is no longer the source's.

Where a wing, a mast or an end is missing, boxes made equal stretch what is there by as much. So along each
axis the scale of the other axes is tried too, from either end, and the best ways are refined by the surfaces
that are on both.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from upplied.planning.constants import MAJORITY
from upplied.planning.correspondence.coherent_point_drift import spread_over
from upplied.planning.correspondence.misfit import FACING
from upplied.planning.geometry.boxes import diagonal_of, in_source_frame, spacing
from upplied.records import Cloud, Floats, Registration
from upplied.vectors import scaled_normals, with_normals

_SAMPLES = 700  # of each surface
_FAR = 0.06  # of the diagonal: farther surfaces are not on both, and count no more
_REFINED, _ROUNDS = 4, 12  # ways that are refined, and how often
_NEAREST = 0.015  # of the diagonal: what counts as on both in the last round; the first takes `_FAR`
_LEAST_SAMPLES = 50  # samples, at least, that are on both
_STEP = 1.25  # largest change of a scale in a round


def registered_partly(source: Cloud, target: Cloud, box: Registration) -> Registration | None:
    """The registration by the surfaces that are on both structures; None where the boxes are as good.

    Parameters
    ----------
    source, target : Cloud
        Surface samples with normals, each in its own frame.
    box : Registration
        By boxes made equal.
    """
    if source.normals is None or target.normals is None or diagonal_of(source.points) <= 0:
        return None
    both = _Both(source, target, box)
    ways = sorted(both.ways(), key=lambda way: both.apart(*way))
    scale, shift = min((both.refined(*way) for way in ways[:_REFINED]), key=lambda way: both.apart(*way))
    apart, before = both.apart(scale, shift), both.apart(np.ones(3), np.zeros(3))
    moved = np.linalg.norm(both.points * (scale - 1) + shift, axis=1).mean() / both.diagonal
    # Of twelve structures that nobody built, scanned whole or but for 10 to 40 % of their surface, those
    # whose boxes were right moved by 2.7 % at most and came nearer to no less than 0.75 (where the boxes fit
    # well nothing is tried), those whose boxes were wrong moved by 16 %.
    if apart >= before or (moved < _FAR and apart > MAJORITY * before):
        return None
    return Registration(
        scale * box.scale,
        box.rotation,
        scale * box.translation + shift,
        float("nan"),
        False,
        turn=box.turn,
    )


class _Both:
    """Both surfaces with the boxes equal, and ways (scale and shift, each (3,)) to register them."""

    def __init__(self, source: Cloud, target: Cloud, box: Registration) -> None:
        registered = in_source_frame(target, box)
        self.diagonal, self.slack = diagonal_of(source.points), spacing(source)
        self.weight = FACING * self.diagonal
        mine, theirs = spread_over(source, _SAMPLES), spread_over(target, _SAMPLES)
        self.fixed = with_normals(source.points[mine], source.outward[mine], self.weight)
        self.tree = cKDTree(self.fixed)
        self.points, self.normals = registered.points[theirs], registered.outward[theirs]
        self.ends = source.points.min(axis=0), source.points.max(axis=0)
        self.stretched = box.scale

    def ways(self) -> Iterator[tuple[Floats, Floats]]:
        """The boxes as they are, and along some axes the scale of the others, from either end."""
        yield np.ones(3), np.zeros(3)
        for ends in product((None, *self.ends), repeat=3):
            whole = [axis for axis in range(3) if ends[axis] is None]
            if not 0 < len(whole) < 3:
                continue
            scale, shift = np.ones(3), np.zeros(3)
            common = np.exp(np.log(self.stretched[whole]).mean())
            for axis, end in enumerate(ends):
                if end is not None:
                    scale[axis] = common / self.stretched[axis]
                    shift[axis] = (1 - scale[axis]) * end[axis]
            yield scale, shift

    def moved(self, scale: Floats, shift: Floats) -> Floats:
        """Target samples with normals beside their places, (S, 6)."""
        normals = scaled_normals(self.normals, scale)
        return with_normals(self.points * scale + shift, normals, self.weight)

    def apart(self, scale: Floats, shift: Floats) -> float:
        """Mean distance of the surfaces, both ways; what is on one alone counts no more than `_FAR`."""
        moved = self.moved(scale, shift)
        ways = self.tree.query(moved)[0], cKDTree(moved).query(self.fixed)[0]
        far = _FAR * self.diagonal
        return float(sum(np.clip(way - self.slack, 0, far).mean() for way in ways))

    def refined(self, scale: Floats, shift: Floats) -> tuple[Floats, Floats]:
        """A way in which the surfaces that are on both lie best, by least squares along each axis."""
        for round_ in range(_ROUNDS):
            moved = self.moved(scale, shift)
            (forth, there), (back, here) = self.tree.query(moved), cKDTree(moved).query(self.fixed)
            near = max(_NEAREST, _FAR * (1 - round_ / _ROUNDS)) * self.diagonal
            points = np.vstack([self.points[forth < near], self.points[here[back < near]]])
            goals = np.vstack([self.fixed[there[forth < near], :3], self.fixed[back < near, :3]])
            if len(points) < _LEAST_SAMPLES:
                break
            middle, goal = points.mean(axis=0), goals.mean(axis=0)
            spread = np.maximum(((points - middle) ** 2).sum(axis=0), 1e-12)
            wanted = ((points - middle) * (goals - goal)).sum(axis=0) / spread
            scale = np.clip(wanted, scale / _STEP, scale * _STEP)
            shift = goal - scale * middle
        return scale, shift
