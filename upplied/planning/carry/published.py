"""The paper's viewpoints on the target: by an axis map, refined one by one (Alg. 2, lines 14 to 16)."""

from __future__ import annotations

import numpy as np

from upplied.config import Settings
from upplied.planning.carry.affine import aimed, published_map
from upplied.planning.carry.gauss_newton import gauss_newton
from upplied.planning.correspondence.pair import Pair
from upplied.planning.demonstration.inspection import Inspection
from upplied.planning.demonstration.repetition import Take
from upplied.records import Floats, Waypoints


def published(take: Take, settings: Settings) -> Waypoints:
    """The paper's way, and its baseline's: viewpoints carried by an axis map, refined one by one."""
    inspection, pair = take.inspection, take.pair
    viewpoints, fit = inspection.viewpoints, pair.fit_for(settings)
    carrier = published_map(settings.transfer.method, fit.source, fit.target)
    positions = carrier.points(viewpoints.positions)
    quats = carrier.orientations(viewpoints.quat_xyzw)
    if settings.refine.method == "gauss-newton":
        positions = gauss_newton(
            positions, viewpoints, fit.source, fit.target, fit.correspondences, settings.refine
        )
        before, now = _centres_of_view(inspection, pair, settings)
        quats = aimed(quats, positions, now, viewpoints.quat_xyzw, before - viewpoints.positions)
    return Waypoints(positions, quats, viewpoints.t_s, np.ones(len(viewpoints), bool))


def _centres_of_view(inspection: Inspection, pair: Pair, settings: Settings) -> tuple[Floats, Floats]:
    """Centre of what each viewpoint saw, and of its counterparts on the target, (K, 3) each; NaN for none."""
    fit = pair.fit_for(settings)
    known = fit.correspondences.target_index >= 0
    weight = inspection.viewpoints.seen[:, known].astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        weight /= weight.sum(axis=1, keepdims=True)
    return weight @ fit.source.points[known], weight @ fit.correspondences.target_points[known]
