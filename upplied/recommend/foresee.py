"""How well a demonstration would transfer, foreseen from what is known of the pair, without planning.

Each part of the source is laid on its partner, as planning does before it lets the surfaces drift.
The flight is carried as the boxes are, and each piece of surface that it should see is asked
whether any place on that way would show it.
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

FORESIGHT_VERSION = 2  # raised with every change that alters a record of this module

_STATIONS = 60  # places along a flight
_GONE = 0.05  # of the diagonal: beyond it a sample of a part without partner has no counterpart
_PARTS = 3  # inspected parts that are named


@dataclass(frozen=True, eq=False, repr=False)
class Inspected(Record):
    """What a demonstration saw of its structure."""

    sample: Ints  # (K,) of the structure's N samples, those that it saw
    stations: Floats  # (S, 3) m, places along the flight, structure frame
    share: float  # of the structure's surface
    parts: Floats  # (P,) share of each part that was seen
    summary: str  # the parts in words


@dataclass(frozen=True, eq=False, repr=False)
class Agreement(Record):
    """How much of one structure corresponds to another, as a whole."""

    counterpart: Ints  # (N,) for each sample of the source one of the target's; -1: none
    parts: int  # of the source
    parts_matched: int
    area_matched: float  # share of the source's surface on them


@dataclass(frozen=True, eq=False, repr=False)
class Foreseen(Record):
    """What is expected of a transfer."""

    coverage_seen_pct: float  # of what was inspected and has a counterpart; NaN where nothing has
    without_pct: float  # share of what was inspected that has no counterpart


def inspected(cloud: Cloud, views: Views) -> Inspected:
    """What of a structure's samples a demonstration saw, and from where.

    Parameters
    ----------
    cloud : Cloud
        Of the structure, with normals and areas.
    views : Views
        Of that cloud, as `upplied.planning.visibility.observations.TRULY` sees it.
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
    """What on the target corresponds to each sample of the source, part on part."""
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
