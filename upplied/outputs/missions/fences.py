"""The fence and the rally points of a manifest, for the autopilot.

A fence consists of polygons on the ground without a top. A keep-out box has a top: a box under the mission's
path is omitted, with a note. A vehicle that lost its link may fly to a rally point instead of home.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from upplied.errors import RefusedError
from upplied.geometry.supposed_scene import scene_for
from upplied.outputs.missions.records import Fence, Mission, to_geodetic
from upplied.planning.airspace.rules import Airspace
from upplied.records import Floats, Structure, SupposedSurface

_RALLY_CLEARANCE_M = 1.0  # minimum distance of a rally point from the structure
_STEP_M = 0.5  # spacing of the points of the path that are tested against a box


def fenced(
    missions: Sequence[Mission], structure: Structure, supposed: SupposedSurface | None
) -> list[Mission]:
    """The sorties of a plan with the fence of their structure's surroundings."""
    around = structure.surroundings
    fences, passed = [], 0
    if len(around.geofence_m):
        fences.append(Fence(True, _corners(around.geofence_m, missions[0])))
    for low, high in around.keep_out_m:
        if any(_passes_over(mission, low, high) for mission in missions):
            passed += 1
        else:
            box = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
            fences.append(Fence(False, _corners(box, missions[0])))
    note = f"{passed} keep-out boxes are not in the fence, because the mission flies over them"
    rally, notes = _rally(missions[0], structure, supposed), (note,) if passed else ()
    return [replace(one, fences=tuple(fences), rally=rally, notes=(*one.notes, *notes)) for one in missions]


def _rally(mission: Mission, structure: Structure, supposed: SupposedSurface | None) -> Floats:
    """The rally points (R, 3) of a structure: latitude and longitude, deg, and height above home, m.

    One where a vehicle could not land, by the rules or under the structure, is refused.
    """
    points = np.asarray(structure.surroundings.rally_m, float)
    if not len(points):
        return points
    airspace = Airspace(scene_for(structure, supposed), _RALLY_CLEARANCE_M, structure.surroundings)
    covered = np.isfinite(airspace.scene.cast(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))[0])
    for number, (point, under) in enumerate(zip(points, covered.tolist(), strict=True), 1):
        if fault := airspace.why(point) or "the structure is above it" * under:
            reason = f"rally point {number} at {point.tolist()} m cannot be used: {fault}"
            raise RefusedError(mission.name, reason, "correct the rally points in the manifest")
    heights = points[:, 2:] - mission.home_local[2]
    return np.hstack([to_geodetic(points, mission.placement)[:, :2], heights])


def _corners(corners: Floats, mission: Mission) -> Floats:
    points = np.column_stack([corners, np.zeros(len(corners))])
    return to_geodetic(points, mission.placement)[:, :2]


def _passes_over(mission: Mission, low: Floats, high: Floats) -> bool:
    """Whether a leg, from home and back to it, has a point over the box."""
    path = np.vstack([mission.home_local, mission.local, mission.home_local])[:, :2]
    for start, end in pairwise(path):
        points = np.linspace(start, end, int(np.linalg.norm(end - start) / _STEP_M) + 2)
        if ((points >= low[:2]) & (points <= high[:2])).all(axis=1).any():
            return True
    return False
