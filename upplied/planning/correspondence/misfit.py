"""Do two structures correspond at all? A measure free of density and scale, and where they do not fit.

The published score cannot tell: it grows with the spacing of the samples and with the structure, sees one
direction only, and the boxes it starts from make anything as large as anything. Here three things count, each
without a unit: how much of the space that one occupies the other occupies too, how far the surfaces are apart
beyond the spacing of their samples, and how unevenly the boxes had to be stretched.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from upplied.planning.constants import LEAST_PART, TOLERANCE
from upplied.planning.correspondence.coherent_point_drift import spread_over
from upplied.planning.correspondence.naming import place_in
from upplied.planning.correspondence.part_alignment import aligned_parts, blade_classes, matched, patches
from upplied.planning.geometry.clouds import UNTURNED, diagonal_of, in_source_frame, nearest_facing, spacing
from upplied.planning.surface.parts import blades_of
from upplied.records import Cloud, Floats, Record, Registration, Structure

_CELLS = 16  # along each axis of the common box
_SAMPLES = 1000  # of each structure, asked for their distance
GAP_FACING = 0.05  # of the diagonal: what turning a normal by a right angle counts beside distance
# Of missing overlap, gap and stretch; each alone reaches the gate at 1.
_WEIGHTS = 1 / 0.45, 1 / 0.09, 1 / 6


@dataclass(frozen=True, eq=False, repr=False)
class Misfit(Record):
    """How badly two structures fit, lower is better."""

    overlap: float  # share of the cells of either that are at most one cell from the other's
    gap: float  # mean distance of the surfaces, both ways, over the diagonal
    stretch: float  # |log| of the scale of the axis that differs most from the middle one
    value: float  # what is gated, by `RegistrationSettings.acceptance`
    scanned: float  # the same of the target's surface alone: blind to what was never scanned
    common: float  # share of the source's cells that are at most one cell from the target's
    where: str  # what fits worst, in words; empty where nothing does

    @property
    def figures(self) -> str:
        """The three measures in words."""
        return (
            f"{100 * self.overlap:.0f} % of the space is common, the surfaces are apart by "
            f"{100 * self.gap:.1f} % of the diagonal, stretched unevenly {np.exp(self.stretch):.2f} : 1"
        )


def sizes_beyond(source: Structure, target: Structure, most: float, setting: str) -> str:
    """That two structures differ by more than so many times in size, in words; empty where they do not."""
    sizes = (source.diagonal_m, target.diagonal_m)
    ratio = float(max(sizes) / max(min(sizes), 1e-9))
    if ratio <= most:
        return ""
    lengths = f"the target is {target.diagonal_m:.3g} m across, the source {source.diagonal_m:.3g} m"
    return f"{lengths}: {ratio:.1f} times, more than {most:g} (verdict.{setting}); check their units"


def of_other_kinds(source: Structure, target: Structure) -> str:
    """That two structures are declared to be of other kinds, in words; empty where they are of one."""
    if source.kind == target.kind:
        return ""
    kinds = f"the target is of kind {target.kind}, the source of kind {source.kind}"
    return f"{kinds}: a flight is carried within its kind; declare one kind for both where they are alike"


def misfit_of(source: Cloud, target: Cloud, registration: Registration, words: Floats = UNTURNED) -> Misfit:
    """Judge a registration of two clouds of surface samples.

    `words` (3, 3) turns the source to the axes in which places are named.

    Long parts that point another way on the target, as the blades of a rotor that stopped elsewhere
    do, are turned along their counterparts first.
    """
    registered = in_source_frame(target, registration)
    here, diagonal = source, diagonal_of(source.points)
    if blades_of(source).any() and blades_of(registered).any():
        both = source, registered, matched(source, registered)
        moved = aligned_parts(*patches(*both), blade_classes(*both), turned_only=True)
        here = Cloud(moved.points, moved.normals, source.area_m2, source.part)
    # Share of the cells of either that are at most one cell from the other's.
    low = np.minimum(here.points.min(axis=0), registered.points.min(axis=0))
    size = np.maximum(np.maximum(here.points.max(axis=0), registered.points.max(axis=0)) - low, 1e-9)
    one, other = np.zeros((2, _CELLS, _CELLS, _CELLS), bool)
    for grid, places in ((one, here.points), (other, registered.points)):
        cell = np.clip(((places - low) / size * _CELLS).astype(int), 0, _CELLS - 1)
        grid[tuple(cell.T)] = True
    common = float((one & ndimage.binary_dilation(other)).sum() / one.sum())
    explained = float((other & ndimage.binary_dilation(one)).sum() / other.sum())
    overlap = (common + explained) / 2
    forth, gap_here = _distances(here, registered, diagonal)
    back, gap_there = _distances(registered, here, diagonal)
    gap = (gap_here + gap_there) / 2
    logs = np.sort(np.log(registration.scale))
    stretch = float(np.abs(logs - logs[1]).max())
    value = float(np.dot(_WEIGHTS, (1 - overlap, gap, stretch)))
    scanned = float(np.dot(_WEIGHTS, (1 - explained, gap_there, stretch)))
    worst = _worst(source, registered, forth, back, diagonal, words)
    return Misfit(overlap, gap, stretch, value, scanned, common, worst)


def _distances(cloud: Cloud, other: Cloud, diagonal_m: float) -> tuple[Floats, float]:
    """For some samples, (_SAMPLES,), how far the other surface is beyond its spacing, and the mean."""
    # Over the diagonal. A surface that faces another way is farther.
    index = spread_over(cloud, _SAMPLES)
    away = nearest_facing(cloud.at(index), other, GAP_FACING * diagonal_m)[0]
    distances = np.maximum(away - spacing(other), 0) / diagonal_m
    return distances, float(np.average(distances, weights=cloud.areas[index]))


def _worst(
    source: Cloud, registered: Cloud, forth: Floats, back: Floats, diagonal_m: float, words: Floats
) -> str:
    """The region, of either structure, with most surface that is far from the other."""
    most, worst = 0.0, ""
    for name, cloud, distance in (("source", source, forth), ("target", registered, back)):
        some = spread_over(cloud, _SAMPLES)
        share = cloud.areas[some] / cloud.areas[some].sum()
        far = distance > TOLERANCE
        if share[far].sum() < LEAST_PART:
            continue
        named = cloud.points @ words.T
        centre, region = place_in(named, named[some][far], share[far])
        area = 100 * share[far][region].sum()
        apart_m = float(distance[far][region].max()) * diagonal_m
        if area >= most:
            reach = f"up to {apart_m:.1f} m away at the source's scale"
            worst = f"{centre} of the {name}, {area:.0f} % of its area, has no counterpart: {reach}"
            most = area
    return worst
