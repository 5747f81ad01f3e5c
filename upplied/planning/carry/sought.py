"""Which points of the target answer for what the demonstration saw, and from how near it saw that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from upplied.planning.visibility.path_views import Views
from upplied.planning.visibility.view_quality import nearest
from upplied.records import Bools, Cloud, Correspondences, Floats, Record


@dataclass(frozen=True, eq=False, repr=False)
class Sought(Record):
    """What a target path should see, since the demonstration saw its counterpart."""

    cloud: Cloud  # N points of the target
    need: Floats  # (N,) how much demonstrated surface each answers for: m^2, or points; 0: none
    standoff_m: Floats  # (N,) from how near the demonstration saw that surface, carried; NaN where need is 0
    without_pct: float  # share of what the demonstration saw that has no counterpart: in no coverage


def sought(
    source: Cloud,
    target: Cloud,
    correspondences: Correspondences,
    demonstrated: Views,
    carry: Floats | None = None,
) -> Sought:
    """Which target points answer for what the demonstration saw, and for how much of it.

    Parameters
    ----------
    source, target : Cloud
        Both of one sort: the paper's voxel clouds, where every point counts 1, or surface samples,
        which count by the demonstrated area.
    correspondences : Correspondences
        From `source` to `target`; points without a counterpart are left out and reported.
    demonstrated : Views
        Of `source`.
    carry : array, shape (3, 3), optional
        How a line of sight is carried to the target where stand-offs scale with the structure.
    """
    weight = np.ones(len(source)) if source.area_m2 is None else source.area_m2
    seen = demonstrated.total
    paired = seen & (correspondences.target_index >= 0)
    index, number = correspondences.target_index[paired], len(target)
    need: Floats = np.bincount(index, weights=weight[paired], minlength=number).astype(float)
    jacobian = np.eye(3) if carry is None else carry
    near = nearest(
        np.ascontiguousarray(demonstrated.stations.positions @ jacobian.T),
        np.ascontiguousarray((source.points @ jacobian.T).T),
        demonstrated.seen,
    )
    with np.errstate(invalid="ignore"):
        standoff = np.bincount(index, weights=(weight * near)[paired], minlength=number) / need
    all_seen = float(weight[seen].sum())
    without = 100 * float(weight[seen & ~paired].sum()) / all_seen if all_seen else 0.0
    return Sought(target, need, standoff, without)


def together(parts: Sequence[Sought]) -> Sought:
    """What several flights over one target should see, each adding its need."""
    if len(parts) == 1:
        return parts[0]
    needs = np.array([part.need for part in parts])
    need = needs.sum(axis=0)
    distances = np.where(needs > 0, [part.standoff_m for part in parts], 0.0)
    with np.errstate(invalid="ignore"):
        standoff = (distances * needs).sum(axis=0) / need
    without = float(np.average([part.without_pct for part in parts], weights=needs.sum(axis=1) + 1e-12))
    return Sought(parts[0].cloud, need, standoff, without)


def coverage(sought: Sought, seen: Bools) -> float:
    """Share, in percent, of the demonstrated surface whose counterpart is in `seen` (N,); NaN if none was."""
    whole = float(sought.need.sum())
    missed = float(sought.need[~seen].sum())  # exactly 0, and so exactly 100 %, where nothing is missed
    return 100 * (1 - missed / whole) if whole > 0 else float("nan")
