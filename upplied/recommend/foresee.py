"""Prediction of the result of a transfer, without planning.

Each part of the source is aligned with its counterpart, as in planning before the displacement field. The
flight is scaled like the boxes, and each sample of the inspected surface is tested for visibility from any
station of that path.

Lines of sight need neither the mesh nor the ray caster, so that queries need not load them: each sample is an
opaque disc. That differs from the mesh where surfaces are nearer to each other than their samples.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit

from upplied.geometry.polylines import chosen_evenly
from upplied.planning.correspondence.correspondences import facing_nearest
from upplied.planning.correspondence.naming import place_of
from upplied.planning.correspondence.part_alignment import aligned_parts, blade_classes, matched, patches
from upplied.planning.geometry.clouds import diagonal_of, in_source_frame, spacing
from upplied.planning.surface.parts import labels_of, parts_of
from upplied.planning.visibility.observations import TRULY, Views
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Registration

FORESIGHT_VERSION = 2  # increased with every change of a record of this module

_STATIONS = 60  # along a flight
_GONE = 0.05  # of the diagonal: beyond it a sample of an unmatched part has no counterpart
_PARTS = 3  # inspected parts that are named
_OWN_SURFACE = 0.5  # of the spacing: nearer discs belong to the sample's own surface
_CELLS = 10  # along the longest side: the discs in one cell are a bunch


@dataclass(frozen=True, eq=False, repr=False)
class Inspected(Record):
    """The surface of its structure that a demonstration saw."""

    sample: Ints  # (K,) indices of the seen samples
    stations: Floats  # (S, 3) m, along the flight, structure frame
    share: float  # of the structure's surface
    parts: Floats  # (P,) share of each part that was seen
    summary: str  # the parts in words


@dataclass(frozen=True, eq=False, repr=False)
class Agreement(Record):
    """The correspondence of two whole structures."""

    counterpart: Ints  # (N,) for each sample of the source one of the target's; -1: none
    parts: int  # of the source
    parts_matched: int
    area_matched: float  # share of the source's surface on them


@dataclass(frozen=True, eq=False, repr=False)
class Foreseen(Record):
    """The predicted result of a transfer."""

    coverage_seen_pct: float  # of the inspected surface with a counterpart; NaN if there is none
    without_pct: float  # share of the inspected surface without a counterpart


def inspected(cloud: Cloud, views: Views) -> Inspected:
    """The samples of a structure that a demonstration saw, and its stations.

    The cloud is of the structure, with normals and areas; the views of it are by `TRULY`.
    """
    assert cloud.area_m2 is not None
    total, label, parts = views.total, labels_of(cloud), parts_of(cloud)
    whole = np.bincount(label, weights=cloud.area_m2)
    of_part = np.bincount(label[total], weights=cloud.area_m2[total], minlength=len(whole)) / whole
    named = [
        f"{100 * of_part[part]:.0f} % of part_{part} ({place_of(parts, int(part))})"
        for part in np.argsort(-of_part * whole, kind="stable")[:_PARTS]
        if of_part[part] > 0
    ]
    share = float(cloud.area_m2[total].sum() / cloud.area_m2.sum())
    stations = views.stations.positions[chosen_evenly(len(views.stations), _STATIONS)]
    summary = f"inspected {100 * share:.0f} % of its structure" + (f": {', '.join(named)}" if named else "")
    return Inspected(np.flatnonzero(total), stations, share, of_part, summary)


def agreement(source: Cloud, target: Cloud, registration: Registration) -> Agreement:
    """The counterpart on the target of each sample of the source, part by part."""
    registered, diagonal = in_source_frame(target, registration), diagonal_of(source.points)
    matching = matched(source, registered)
    moving, fixed = patches(source, registered, matching)
    there = aligned_parts(moving, fixed, blade_classes(source, registered, matching))
    counterpart = facing_nearest(there, fixed, diagonal)
    apart = np.linalg.norm(there.points - fixed.points[counterpart], axis=1)
    counterpart[(there.label < 0) & (apart > _GONE * diagonal)] = -1
    has = matching.source_class >= 0
    return Agreement(counterpart, len(has), int(has.sum()), float(parts_of(source).area[has].sum()))


def foresee(
    source: Cloud, target: Cloud, registration: Registration, agreed: Agreement, seen: Inspected,
    camera: Camera,
) -> Foreseen:  # fmt: skip
    """Expected coverage of a transfer of what a demonstration saw.

    The clouds have normals and areas, each in its own frame; the registration is of the target on the source.
    """
    assert source.area_m2 is not None
    area, index = source.area_m2[seen.sample], agreed.counterpart[seen.sample]
    paired, whole = index >= 0, float(area.sum())
    if not paired.any():
        return Foreseen(float("nan"), 100.0)
    need = np.bincount(index[paired], weights=area[paired], minlength=len(target))
    needs = np.flatnonzero(need)
    shown = in_sight(target, needs, registration.to_target(seen.stations), camera)
    coverage = float(need[needs[shown]].sum() / need.sum())
    return Foreseen(100 * coverage, 100 * float(area[~paired].sum()) / whole)


def in_sight(cloud: Cloud, index: Ints, stations: Floats, camera: Camera) -> Bools:
    """Which of the wanted samples (K,) are seen from any of the stations (S, 3), m, structure frame.

    The camera is turned freely: only its range counts. Each sample of the cloud, with normals and areas, is
    an opaque disc of its area.
    """
    visible = _in_sight(
        np.ascontiguousarray(cloud.points[index]),
        np.ascontiguousarray(cloud.outward[index]),
        np.ascontiguousarray(stations),
        (camera.min_range_m, camera.max_range_m),
        np.cos(np.radians(TRULY.max_incidence_deg)),
        _OWN_SURFACE * spacing(cloud),
        *_discs(cloud.points, cloud.outward, cloud.areas),
    )
    return np.asarray(visible, bool)


def _discs(points: Floats, normals: Floats, area_m2: Floats) -> tuple[Floats, Ints, Floats]:
    """Discs as rows of centre, normal and squared radius; the start of each bunch, and a ball round it."""
    low, size = points.min(axis=0), np.maximum(np.ptp(points, axis=0).max(), 1e-9)
    cell = ((points - low) / size * (_CELLS - 1e-6)).astype(np.int64) @ np.array([_CELLS**2, _CELLS, 1])
    order = np.argsort(cell, kind="stable")
    radius2 = area_m2 / 2  # of the circle round a square of that area
    discs = np.column_stack([points, normals, radius2])[order]
    start = np.flatnonzero(np.diff(cell[order], prepend=-1, append=-1))
    balls = np.empty((len(start) - 1, 4))
    for bunch, (first, last) in enumerate(pairwise(start)):
        own = discs[first:last]
        middle = (own[:, :3].min(axis=0) + own[:, :3].max(axis=0)) / 2
        reach = np.linalg.norm(own[:, :3] - middle, axis=1) + np.sqrt(own[:, 6])
        balls[bunch] = *middle, reach.max()
    return discs, start, balls


@njit(cache=True)
def _in_sight(
    points: Floats, normals: Floats, stations: Floats, ranges: tuple[float, float], least_cosine: float,
    near: float, discs: Floats, start: Ints, balls: Floats,
) -> Bools:  # fmt: skip
    visible = np.zeros(len(points), np.bool_)
    cosine = np.empty(len(stations))
    for row in range(len(points)):
        at, normal = points[row], normals[row]
        for station in range(len(stations)):
            ray = stations[station] - at
            length = np.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
            facing = (ray[0] * normal[0] + ray[1] * normal[1] + ray[2] * normal[2]) / max(length, 1e-12)
            cosine[station] = facing if ranges[0] <= length <= ranges[1] else -1.0
        for _ in range(len(stations)):  # the most frontal view first: it is rarely occluded
            best = np.argmax(cosine)
            if cosine[best] < least_cosine:
                break
            if _free(at, stations[best], near, discs, start, balls):
                visible[row] = True
                break
            cosine[best] = -1.0
    return visible


@njit(cache=True)
def _free(begin: Floats, end: Floats, near: float, discs: Floats, start: Ints, balls: Floats) -> bool:
    """Whether no disc crosses the line."""
    ax, ay, az = end[0] - begin[0], end[1] - begin[1], end[2] - begin[2]
    length = np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / length, ay / length, az / length
    for bunch in range(len(balls)):
        x, y, z = balls[bunch, 0] - begin[0], balls[bunch, 1] - begin[1], balls[bunch, 2] - begin[2]
        along, reach = x * ax + y * ay + z * az, balls[bunch, 3]
        if along < -reach or along > length + reach or x * x + y * y + z * z - along**2 > reach**2:
            continue
        for disc in range(start[bunch], start[bunch + 1]):
            across = ax * discs[disc, 3] + ay * discs[disc, 4] + az * discs[disc, 5]
            if abs(across) < 1e-9:
                continue
            x, y, z = discs[disc, 0] - begin[0], discs[disc, 1] - begin[1], discs[disc, 2] - begin[2]
            along = (x * discs[disc, 3] + y * discs[disc, 4] + z * discs[disc, 5]) / across
            if along < near or along > length:
                continue
            x, y, z = ax * along - x, ay * along - y, az * along - z
            if x * x + y * y + z * z < discs[disc, 6]:
                return False
    return True
