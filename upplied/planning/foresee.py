"""How well a demonstration would transfer, foreseen from what is known of the pair, without planning.

The viewpoints that saw each piece of surface best are carried as the boxes are, and each is asked
whether it still faces its piece on the target from within the camera's range.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from upplied.planning.boxes import diagonal_of, laid
from upplied.planning.cpd import farthest_points
from upplied.planning.layout import matched
from upplied.planning.measure import TRULY, Views
from upplied.planning.parts import labels_of, parts_of
from upplied.planning.wording import place_of
from upplied.records import Camera, Cloud, Floats, Record, Registration

_SAMPLES = 800  # of what was inspected, asked for their counterpart
_FACING = 0.05  # of the diagonal: what turning a normal by a right angle counts beside distance
_GONE, _SAME_FACE = 0.05, 0.3  # of the diagonal, and a cosine: beyond them a sample has no counterpart
_PARTS = 3  # inspected parts that are named


@dataclass(frozen=True, eq=False, repr=False)
class Inspected(Record):
    """What a demonstration saw of its structure."""

    points: Floats  # (K, 3) m, samples that it saw, structure frame
    normals: Floats  # (K, 3)
    area_m2: Floats  # (K,) that each stands for
    camera_at: Floats  # (K, 3) m, from where it was seen most frontally
    share: float  # of the structure's surface
    parts: Floats  # (P,) share of each part that was seen
    summary: str  # the parts in words


@dataclass(frozen=True, eq=False, repr=False)
class Agreement(Record):
    """How much of one structure answers to another, as a whole."""

    parts: int  # of the source
    parts_matched: int
    area_matched: float  # share of the source's surface on them


@dataclass(frozen=True, eq=False, repr=False)
class Foreseen(Record):
    """What is expected of a transfer."""

    coverage_seen_pct: float  # of what was inspected and has a counterpart; NaN where nothing has
    without_pct: float  # share of what was inspected that has no counterpart


def inspected(cloud: Cloud, views: Views) -> Inspected:
    """What of a structure's samples a demonstration saw, and from where best.

    Parameters
    ----------
    cloud : Cloud
        Of the structure, with normals and areas.
    views : Views
        Of that cloud, as `upplied.planning.measure.TRULY` sees it.
    """
    assert cloud.normals is not None and cloud.area_m2 is not None
    total, label = views.total, labels_of(cloud)
    whole = np.bincount(label, weights=cloud.area_m2)
    of_part = np.bincount(label[total], weights=cloud.area_m2[total], minlength=len(whole)) / whole
    index = np.flatnonzero(total)
    chosen = index[farthest_points(cloud.points[index], _SAMPLES)] if len(index) else index
    cosine = np.full((len(chosen), len(views.stations)), -1.0)
    for row, sample in enumerate(chosen):
        offset = views.stations.positions - cloud.points[sample]
        cosine[row] = offset @ cloud.normals[sample] / np.maximum(np.linalg.norm(offset, axis=1), 1e-12)
    cosine[~views.seen[:, chosen].T] = -1.0
    best = cosine.argmax(axis=1) if len(chosen) else np.empty(0, np.int64)
    parts = parts_of(cloud)
    order = np.argsort(-of_part * whole, kind="stable")[:_PARTS]
    named = [
        f"{100 * of_part[part]:.0f} % of part_{part} ({place_of(parts, int(part))})"
        for part in order
        if of_part[part] > 0
    ]
    share = float(cloud.area_m2[total].sum() / cloud.area_m2.sum())
    return Inspected(
        points=cloud.points[chosen],
        normals=cloud.normals[chosen],
        area_m2=cloud.area_m2[chosen],
        camera_at=views.stations.positions[best],
        share=share,
        parts=of_part,
        summary=f"inspected {100 * share:.0f} % of its structure"
        + (f": {', '.join(named)}" if named else ""),
    )


def agreement(source: Cloud, target: Cloud, registration: Registration) -> Agreement:
    """How many parts of the source find their like on the target."""
    matching = matched(source, laid(target, registration))
    has = matching.source_class >= 0
    return Agreement(len(has), int(has.sum()), float(parts_of(source).area[has].sum()))


def foresee(
    source_diagonal_m: float, target: Cloud, registration: Registration, seen: Inspected, camera: Camera
) -> Foreseen:
    """Expected coverage of a transfer.

    Parameters
    ----------
    source_diagonal_m : float
    target : Cloud
        With normals, in its own frame.
    registration : Registration
        Of the target on the demonstration's structure.
    seen : Inspected
        By the demonstration.
    camera : Camera
    """
    if not len(seen.points):
        return Foreseen(float("nan"), 100.0)
    lying = laid(target, registration)
    assert lying.normals is not None and target.normals is not None
    weight = _FACING * source_diagonal_m
    tree = cKDTree(np.hstack([lying.points, weight * lying.normals]))
    index = tree.query(np.hstack([seen.points, weight * seen.normals]))[1]
    apart = np.linalg.norm(lying.points[index] - seen.points, axis=1)
    facing = np.einsum("ij,ij->i", lying.normals[index], seen.normals)
    paired = (apart < _GONE * source_diagonal_m) & (facing > _SAME_FACE)
    area = float(seen.area_m2.sum())
    without = 100 * float(seen.area_m2[~paired].sum()) / area
    if not paired.any():
        return Foreseen(float("nan"), without)
    ray = registration.to_target(seen.camera_at) - target.points[index]
    distance = np.linalg.norm(ray, axis=1)
    cosine = np.einsum("ij,ij->i", ray, target.normals[index]) / np.maximum(distance, 1e-12)
    good = cosine > np.cos(np.radians(TRULY.max_incidence_deg))
    good &= (distance >= camera.min_range_m) & (distance <= camera.max_range_m)
    covered = float(seen.area_m2[paired & good].sum() / seen.area_m2[paired].sum())
    return Foreseen(100 * covered, without)


def diagonal_m(cloud: Cloud) -> float:
    """Length of a structure's diagonal, from its samples, m."""
    return diagonal_of(cloud.points)
