"""Which points of the target correspond to what the demonstration was about, and how near to show them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import Settings, focal_px
from upplied.geometry.vectors import with_normals
from upplied.planning.carry.affine import registered_map
from upplied.planning.carry.standoff import carried_sight
from upplied.planning.constants import FACING
from upplied.planning.demonstration.repetition import Take, look_limits
from upplied.planning.geometry.clouds import diagonal_of, spacing
from upplied.planning.surface.parts import labels_of
from upplied.planning.visibility.looks import Looks, sharp_looks
from upplied.planning.visibility.observations import Views
from upplied.records import Bools, Cloud, Correspondences, Floats, Ints, Record

_ROUND = 6  # samples among which a counterpart is shared: a triangle and its neighbours
_CORRESPONDS = 3.0  # sample spacings from a carried sample, within which target surface corresponds to it


@dataclass(frozen=True, eq=False, repr=False)
class InspectedSurface(Record):
    """What a target path should show, since the demonstration was about its counterpart."""

    cloud: Cloud  # N points of the target
    need: Floats  # (N,) how much demonstrated surface corresponds to each: weighted m^2, or points; 0: none
    standoff_m: Floats  # (N,) from how near it is to be shown, m: the best look; NaN where need is 0
    without: float  # how much of that surface has no counterpart, in the unit of `need`

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
    """Which target points correspond to what the demonstration was about, and for how much of it.

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
    index, number = correspondences.target_index[paired], len(target)
    part = np.ones((len(index), 1))
    if target.normals is None:
        index = index[:, None]
    elif len(index):
        index, part = _spread(target, index, correspondences.target_points[paired])
    parts = share[paired, None] * part
    need: Floats = np.bincount(index.ravel(), parts.ravel(), number).astype(float)
    with np.errstate(invalid="ignore"):
        standoff = np.bincount(index.ravel(), (near[paired, None] * parts).ravel(), number) / need
    return InspectedSurface(target, need, standoff, float(share[inspected & ~paired].sum()))


def _spread(target: Cloud, index: Ints, points: Floats) -> tuple[Ints, Floats]:
    """The target samples (P, K) round each counterpart, and the share that each has of it."""
    # Counterparts (P, 3) lie between samples; one that was given to the nearest alone would go to another one
    # for a change of a millimetre. The share is whole at a sample, and falls to nothing where the next sample
    # beyond the K would be (Franke and Little's weights).
    outward, weight = target.outward, FACING * diagonal_of(target.points)
    count = min(_ROUND + 1, len(target))
    tree = cKDTree(with_normals(target.points, outward, weight))
    away, near = tree.query(with_normals(points, outward[index], weight), k=count)
    away, near = away.reshape(len(index), count), near.reshape(len(index), count)
    away = np.maximum(away, 1e-9)
    part = labels_of(target)
    share = (1 / away - 1 / away[:, -1:]) ** 2 * (part[near] == part[index][:, None])
    whole = share.sum(axis=1, keepdims=True)
    alone = whole[:, 0] <= 0
    near[alone, 0], share[alone, 0] = index[alone], 1.0
    return near, share / np.where(whole > 0, whole, 1.0)


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


def target_attention(takes: Sequence[Take], inspected: InspectedSurface) -> tuple[Floats, Ints]:
    """Attention (N,) of what each target sample corresponds to, and the sample (N,) it is judged like."""
    cloud = inspected.cloud
    attention, like = np.zeros(len(cloud)), np.zeros(len(cloud), np.int64)
    nearest = np.full(len(cloud), _CORRESPONDS * spacing(cloud))
    for take in takes:
        match, weight = take.pair.surface.correspondences, take.inspection.attention.weight
        known = np.flatnonzero((match.target_index >= 0) & np.isfinite(match.target_points[:, 0]))
        if not len(known):
            continue
        distance, place = cKDTree(match.target_points[known]).query(cloud.points)
        mine = distance < nearest
        nearest = np.where(mine, distance, nearest)
        attention = np.where(mine, weight[known[place]], attention)
        like = np.where(mine, match.target_index[known[place]], like)
    return attention, like


def area_ratio(takes: Sequence[Take], inspected: InspectedSurface) -> float:
    """How many times as large what corresponds to the inspected surface is; 1 where nothing does."""
    there = float(inspected.cloud.areas @ target_attention(takes, inspected)[0])
    here = 0.0
    for take in takes:
        fit = take.pair.surface
        known = fit.correspondences.target_index >= 0
        here += float((fit.source.areas * take.inspection.attention.weight)[known].sum())
    return there / here if here > 0 and there > 0 else 1.0
