"""Prediction of the result of a transfer, without planning.

Each part of the source is aligned with its counterpart, as in planning before the displacement field. The
flight is scaled like the boxes, and each sample of the inspected surface is tested for visibility from any
station of that path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.geometry.polylines import chosen_evenly
from upplied.planning.correspondence.correspondences import facing_nearest
from upplied.planning.correspondence.naming import place_of
from upplied.planning.correspondence.part_alignment import aligned_parts, matched, patches
from upplied.planning.geometry.clouds import diagonal_of, in_source_frame
from upplied.planning.surface.parts import labels_of, parts_of
from upplied.planning.visibility.observations import Views
from upplied.recommend.sight import in_sight
from upplied.records import Camera, Cloud, Floats, Ints, Record, Registration

FORESIGHT_VERSION = 2  # increased with every change of a record of this module

_STATIONS = 60  # along a flight
_GONE = 0.05  # of the diagonal: beyond it a sample of an unmatched part has no counterpart
_PARTS = 3  # inspected parts that are named


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

    Parameters
    ----------
    cloud : Cloud
        Of the structure, with normals and areas.
    views : Views
        Of that cloud, by `upplied.planning.visibility.observations.TRULY`.
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
    places = chosen_evenly(len(views.stations), _STATIONS)
    return Inspected(
        sample=np.flatnonzero(total),
        stations=views.stations.positions[places],
        share=share,
        parts=of_part,
        summary=f"inspected {100 * share:.0f} % of its structure"
        + (f": {', '.join(named)}" if named else ""),
    )


def agreement(source: Cloud, target: Cloud, registration: Registration) -> Agreement:
    """The counterpart on the target of each sample of the source, part by part."""
    registered, diagonal = in_source_frame(target, registration), diagonal_m(source)
    matching = matched(source, registered)
    moving, fixed = patches(source, registered, matching)
    there = aligned_parts(moving, fixed)
    counterpart = facing_nearest(there, fixed, diagonal)
    apart = np.linalg.norm(there.points - fixed.points[counterpart], axis=1)
    counterpart[(there.label < 0) & (apart > _GONE * diagonal)] = -1
    has = matching.source_class >= 0
    return Agreement(counterpart, len(has), int(has.sum()), float(parts_of(source).area[has].sum()))


def foresee(
    source: Cloud,
    target: Cloud,
    registration: Registration,
    agreed: Agreement,
    seen: Inspected,
    camera: Camera,
) -> Foreseen:
    """Expected coverage of a transfer.

    Parameters
    ----------
    source, target : Cloud
        With normals and areas, each in its own frame.
    registration : Registration
        Of the target on the demonstration's structure.
    agreed : Agreement
        Of the two.
    seen : Inspected
        By the demonstration.
    camera : Camera
    """
    assert source.area_m2 is not None
    area, index = source.area_m2[seen.sample], agreed.counterpart[seen.sample]
    paired, whole = index >= 0, float(area.sum())
    if not paired.any():
        return Foreseen(float("nan"), 100.0)
    need = np.bincount(index[paired], weights=area[paired], minlength=len(target))
    wanted = np.flatnonzero(need)
    shown = in_sight(target, wanted, registration.to_target(seen.stations), camera)
    return Foreseen(
        100 * float(need[wanted[shown]].sum() / need.sum()), 100 * float(area[~paired].sum()) / whole
    )


def diagonal_m(cloud: Cloud) -> float:
    """Length of a structure's diagonal, from its samples, m."""
    return diagonal_of(cloud.points)
