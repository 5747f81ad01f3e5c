"""Which points of the target correspond to what the demonstration was about, and how near to show them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import Settings, focal_px
from upplied.geometry.vectors import with_normals
from upplied.planning.carry.affine import registered_map
from upplied.planning.carry.standoff import carried_sight
from upplied.planning.constants import FACING, SAME_FACE
from upplied.planning.demonstration.repetition import Take, look_limits
from upplied.planning.geometry.clouds import diagonal_of, spacing
from upplied.planning.surface.parts import labels_of
from upplied.planning.visibility.looks import Looks, sharp_looks
from upplied.planning.visibility.observations import Views
from upplied.records import Bools, Cloud, Correspondences, Floats, Ints, Record

_ROUND = 6  # counterparts between which a sample of the target lies: a triangle and its neighbours
_CORRESPONDS = 2.0  # spacings of samples from a counterpart, at which target surface corresponds to nothing
_BESIDE = 4  # counterparts nearest to each: the last is a spacing away, also where they are stretched


@dataclass(frozen=True, eq=False, repr=False)
class InspectedSurface(Record):
    """What a target path should show, since the demonstration was about its counterpart."""

    cloud: Cloud  # N points of the target
    need: Floats  # (N,) area of each times the attention of what it corresponds to, m^2; of voxels, points
    standoff_m: Floats  # (N,) from how near it is to be shown, m: the best look; NaN where need is 0
    without: float  # how much of that has no counterpart, in the unit of `need`

    @property
    def whole(self) -> float:
        """How much surface the demonstration was about, with or without a counterpart."""
        return float(self.need.sum()) + self.without

    @property
    def without_pct(self) -> float:
        """Share of what the demonstration was about that has no counterpart; NaN if it was about nothing."""
        return 100 * self.without / self.whole if self.whole > 0 else float("nan")

    @classmethod
    def together(cls, parts: "Sequence[InspectedSurface]") -> "InspectedSurface":
        """What several flights over one target should show, each adding its need."""
        if len(parts) == 1:
            return parts[0]
        needs = np.array([part.need for part in parts])
        need = needs.sum(axis=0)
        distances = np.where(needs > 0, [part.standoff_m for part in parts], 0.0)
        with np.errstate(invalid="ignore"):
            standoff = (distances * needs).sum(axis=0) / need
        return cls(parts[0].cloud, need, standoff, sum(part.without for part in parts))


def inspected_surface(
    source: Cloud,
    target: Cloud,
    correspondences: Correspondences,
    demonstrated: Views,
    carry: Floats | None = None,
    weight: Floats | None = None,
    near_m: Floats | None = None,
) -> InspectedSurface:
    """Which target points correspond to what the demonstration was about, and how much of each.

    A sample of the target has the attention of the samples of the source between whose counterparts it lies,
    so that no millimetre decides which sample a counterpart falls to. Voxels count their counterparts.

    Parameters
    ----------
    source, target : Cloud
        Both of one sort: the paper's voxel clouds, where every point counts 1, or surface samples,
        which count by the demonstrated area.
    demonstrated : Views
        Of `source`; what has no counterpart is counted apart.
    carry : array, shape (3, 3), optional
        How a line of sight is carried to the target where stand-offs scale with the structure.
    weight : array, shape (N,), optional
        Attention, 0 to 1; everything that it saw counts, where not given.
    near_m : array, shape (N,), m, optional
        From how near it looked at each, carried; where infinite or not given, the nearest of all views.
    """
    share = source.areas
    share = share * demonstrated.total if weight is None else share * weight * demonstrated.total
    inspected = share > 0
    paired = inspected & (correspondences.target_index >= 0)
    near, _ = demonstrated.nearest(source.points, carry=carry)
    if near_m is not None:
        near = np.where(np.isfinite(near_m), near_m, near)
    without = float(share[inspected & ~paired].sum())
    if target.normals is None:
        index, number = correspondences.target_index[paired], len(target)
        need: Floats = np.bincount(index, share[paired], number).astype(float)
        with np.errstate(invalid="ignore"):
            standoff = np.bincount(index, near[paired] * share[paired], number) / need
        return InspectedSurface(target, need, standoff, without)
    between, part = correspondences.derived("between", lambda: _between(target, correspondences))
    part = part * (share / source.areas)[between]
    need = part.sum(axis=1) * target.areas
    far = np.where(np.isfinite(near), near, 0.0)[between]
    with np.errstate(invalid="ignore", divide="ignore"):
        standoff = (part * far).sum(axis=1) / part.sum(axis=1)
    if not need.any():
        return InspectedSurface(target, need, standoff, float(share.sum()))
    # What has no counterpart is as much larger on the target as what has one.
    larger = float(need.sum()) / max(float(share[paired].sum()), 1e-12)
    return InspectedSurface(target, need, standoff, without * larger)


def _between(target: Cloud, correspondences: Correspondences) -> tuple[Ints, Floats]:
    """Samples of the source (N, K) between whose counterparts each target sample lies, and their shares."""
    # They add up to 1 where the target corresponds to something, and fall to 0 beside it, round its edges.
    outward, weight, parts = target.outward, FACING * diagonal_of(target.points), labels_of(target)
    placed = np.isfinite(correspondences.target_points[:, 0])
    known = np.flatnonzero((correspondences.target_index >= 0) & placed)
    if len(known) == 0:
        return np.zeros((len(target), 1), np.int64), np.zeros((len(target), 1))
    index, points = correspondences.target_index[known], correspondences.target_points[known]
    count = min(_ROUND + 1, len(known))
    tree = cKDTree(with_normals(points, outward[index], weight))
    away, near = tree.query(with_normals(target.points, outward, weight), k=count)
    away, near = np.maximum(away.reshape(-1, count), 1e-9), near.reshape(-1, count)
    # Franke and Little's weights: whole at a counterpart, and nothing where the next beyond the K would be.
    like = parts[index][near] == parts[:, None]
    share = (1 / away - 1 / away[:, -1:]) ** 2 * like
    alone = (share.sum(axis=1) <= 0) & like[:, 0]
    share[alone, 0] = 1.0
    beside = cKDTree(points).query(points, k=[min(_BESIDE + 1, len(known))])[0]
    apart = max(spacing(target), float(np.median(beside)))
    whole = share.sum(axis=1, keepdims=True)
    share = np.where(whole > 0, share / np.where(whole > 0, whole, 1.0), 0.0)
    facing = np.einsum("nki,ni->nk", outward[index][near], outward)
    gap = np.linalg.norm(points[near] - target.points[:, None], axis=2).min(axis=1, keepdims=True)
    share *= np.clip(2 * (facing / SAME_FACE - 1), 0, 1) * np.clip(_CORRESPONDS - gap / apart, 0, 1)
    return known[near], share


def demonstrated_looks(take: Take, limits: tuple[float, float]) -> Looks:
    """The sharp looks of a take at its source's samples, within limits as those of `look_limits`."""
    inspection, fit = take.inspection, take.pair.surface
    seen = inspection.steps, inspection.truly, fit.source, inspection.camera
    carry = registered_map(fit.registration).matrix
    return take.derived(f"looks {limits}", lambda: sharp_looks(*seen, *limits, carry))


def inspected_by(take: Take, settings: Settings) -> InspectedSurface:
    """What a take of a demonstration was about, on its target, to be shown as near as the settings ask.

    `scaled` carries the demonstrated distances with the structure, `kept` leaves them, and a ground
    sampling distance sets them all; the vehicle's safety distance and the camera's range limit them.
    """
    inspection, transfer, fit = take.inspection, settings.transfer, take.pair.surface
    camera = inspection.camera
    looks = demonstrated_looks(take, look_limits([take], settings.inspection))
    surface = inspected_surface(
        fit.source,
        fit.target,
        fit.correspondences,
        inspection.truly,
        carry=carried_sight(registered_map(fit.registration), transfer),
        weight=inspection.attention.weight,
        near_m=looks.carried_m if transfer.standoff == "scaled" else looks.sampled_m,
    )
    standoff_m = surface.standoff_m
    if transfer.gsd_m is not None and camera.width_px:
        sampled_m = transfer.gsd_m * focal_px(camera.width_px, camera.hfov_deg)
        standoff_m = np.where(surface.need > 0, sampled_m, np.nan)
    lowest = max(settings.route.clearance_m, camera.min_range_m)
    widest = float(inspection.truly.coarseness.max(initial=1.0))  # a zooming camera's distances are of one
    return replace(surface, standoff_m=np.clip(standoff_m, lowest, max(camera.max_range_m, lowest) * widest))


def coverage(inspected: InspectedSurface, seen: Bools, whole: bool = False) -> float:
    """Share, in percent, of the demonstrated surface whose counterpart is in `seen` (N,); NaN for none.

    With `whole`, surface without a counterpart counts as not seen; else it does not count.
    """
    total = float(inspected.need.sum())
    missed = float(inspected.need[~seen].sum())  # exactly 0, and so exactly 100 %, where nothing is missed
    if whole:
        total, missed = total + inspected.without, missed + inspected.without
    return 100 * (1 - missed / total) if total > 0 else float("nan")


def area_ratio(takes: Sequence[Take], inspected: InspectedSurface) -> float:
    """How many times as large what corresponds to the inspected surface is; 1 where nothing does."""
    there, here = float(inspected.need.sum()), 0.0
    for take in takes:
        fit = take.pair.surface
        known = fit.correspondences.target_index >= 0
        here += float((fit.source.areas * take.inspection.attention.weight)[known].sum())
    return there / here if here > 0 and there > 0 else 1.0
