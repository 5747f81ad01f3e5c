"""The fence of a manifest in what an autopilot enforces: polygons on the ground, of any height.

A keep-out box has a top, a fence has none: a box that the mission passes over is left out, and said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from upplied.outputs.missions.geodesy import to_geodetic
from upplied.outputs.missions.records import Fence, Mission
from upplied.records import Floats, Structure

INCLUSION, EXCLUSION = 5001, 5002  # MAV_CMD_NAV_FENCE_POLYGON_VERTEX_...
_STEP_M = 0.5  # of the path, at which it is looked whether it passes over a box


def fenced(missions: Sequence[Mission], structure: Structure) -> list[Mission]:
    """The sorties of a plan with one fence: that of their structure's surroundings."""
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
    note = f"keep-out boxes that are not in the fence, which has no height: {passed} are passed over"
    notes = (note,) if passed else ()
    return [replace(one, fences=tuple(fences), notes=(*one.notes, *notes)) for one in missions]


def _corners(corners: Floats, mission: Mission) -> Floats:
    points = np.column_stack([corners, np.zeros(len(corners))])
    return to_geodetic(points, mission.placement)[:, :2]


def _passes_over(mission: Mission, low: Floats, high: Floats) -> bool:
    """Whether a leg, from home and back to it, has a point over the box."""
    path = np.vstack([mission.home_local, mission.local, mission.home_local])[:, :2]
    for start, end in pairwise(path):
        count = int(np.linalg.norm(end - start) / _STEP_M) + 2
        points = np.linspace(start, end, count)
        if ((points >= low[:2]) & (points <= high[:2])).all(axis=1).any():
            return True
    return False


def fence_text(mission: Mission) -> str:
    """The fence as QGC WPL 110, as Mission Planner and MAVProxy load one: a row for each corner."""
    rows = [
        (INCLUSION if fence.inside else EXCLUSION, len(fence.corners), lat, lon)
        for fence in mission.fences
        for lat, lon in fence.corners
    ]
    lines = [
        "\t".join(
            [f"{at}\t0\t3\t{command}", *(f"{value:.8f}" for value in (count, 0, 0, 0, lat, lon, 0)), "1"]
        )
        for at, (command, count, lat, lon) in enumerate(rows)
    ]
    return "\n".join(["QGC WPL 110", *lines]) + "\n"
