"""A zone that was named on one structure, carried to another of its kind by their correspondences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import Settings
from upplied.geometry.vectors import with_normals
from upplied.planning.correspondence.fit import Fit, certainty
from upplied.planning.correspondence.memo import Memo, no_memo
from upplied.planning.correspondence.pair import study_pair
from upplied.planning.demonstration.inspection import Faces, zone_of
from upplied.planning.geometry.clouds import spacing
from upplied.planning.surface.frames import frames_for, structure_in
from upplied.planning.surface.parts import labels_of
from upplied.planning.surface.skin import skin_parts
from upplied.records import Bools, Cloud, Record, Structure
from upplied.threads import one_thread

_NEIGHBOURS = 5  # carried samples nearest to one of the target: it is in the zone where most of them are
_REACH = 3.0  # spacings of the target's samples that the nearest of them may be off
_PART = 0.1  # share of the zone from which a part of the source counts; the largest always does


@dataclass(frozen=True, eq=False, repr=False)
class CarriedZone(Record):
    """A zone on the target."""

    patches: Bools  # (N,) samples of the target
    probability: float  # that they are the right part; NaN where that cannot be known
    lost_pct: float  # of the zone, what has no counterpart


def carried_zone(
    where: str,
    source: Structure,
    target: Structure,
    surface: Cloud,
    settings: Settings,
    memo: Memo = no_memo,
    faces: Faces | None = None,
) -> CarriedZone:
    """Find the samples of a target that correspond to a zone of a source.

    Parameters
    ----------
    where : str
        The zone on the source; see `about.zone_of`.
    source, target : Structure
        Of one kind, in their declared frames.
    surface : Cloud
        N samples of the target with normals, declared frame.
    settings : Settings
    memo : callable, optional
    faces : callable, optional
        Of labels; see `about.zone_of`.

    Raises
    ------
    SettingsError
        If the zone names no surface of the source.
    """
    here, there = frames_for(source, target, settings)
    with one_thread():
        pair = study_pair(structure_in(here, source), structure_in(there, target), settings, memo)
    fit = pair.surface
    skin = skin_parts(pair.source, pair.source_scene, fit.source).label
    zone = zone_of(where, pair.source, fit.source, skin, faces)
    assert zone is not None
    apart_m = spacing(fit.target)
    turned = there.from_declared(surface.points), surface.outward @ there.turn
    known = cKDTree(with_normals(fit.target.points, fit.target.outward, 2 * apart_m))
    nearest = known.query(with_normals(*turned, 2 * apart_m))[1]
    lost = zone & (fit.correspondences.target_index < 0)
    patches = np.asarray(_carried(fit, zone)[nearest], bool)
    return CarriedZone(patches, _probability(fit, zone), 100 * float(lost.sum() / zone.sum()))


def _carried(fit: Fit, zone: Bools) -> Bools:
    """Which of the target's samples (M,) the zone (N,) of the source's is carried to."""
    places = fit.correspondences.target_points
    known = np.isfinite(places).all(axis=1) & (fit.correspondences.target_index >= 0)
    if not (known & zone).any():
        return np.zeros(len(fit.target), bool)
    count = min(_NEIGHBOURS, int(known.sum()))
    off, nearest = cKDTree(places[known]).query(fit.target.points, k=range(1, count + 1))
    inside = zone[known][nearest].mean(axis=1) > 0.5
    return np.asarray(inside & (off[:, 0] <= _REACH * spacing(fit.target)), bool)


def _probability(fit: Fit, zone: Bools) -> float:
    """That the target's parts correspond to the parts of the zone: of the least certain one."""
    if fit.carried is None:
        return float("nan")
    share = np.bincount(labels_of(fit.source)[zone]) / zone.sum()
    parts = np.flatnonzero(share >= min(_PART, share.max())).tolist()
    partners = {part: fit.correspondences.target_parts(part).tolist() for part in parts}
    return min(certainty(fit, part, others) if others else 0.0 for part, others in partners.items())
