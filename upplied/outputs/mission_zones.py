"""What becomes of the zones that must be seen of a structure when a mission is flown as it is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.catalog.verbs.required import zones_of
from upplied.geometry.polylines import cumulated, leg_lengths
from upplied.outputs.missions.gate import ZONE
from upplied.outputs.missions.records import Mission
from upplied.proof.asking import Asking
from upplied.proof.zones import Looked
from upplied.records import Camera, Floats, Plan, Structure, Trajectory

_ON_THE_SPOT_S = 0.1  # that a turn of the camera is taken to last: nothing is judged by the time


@dataclass(frozen=True, eq=False)
class MissionZones:
    """The zones of a structure, judged for the missions that one plan becomes.

    Parameters
    ----------
    catalog : Catalog
    plan : Plan
    structure : Structure
    camera : Camera
    """

    catalog: Catalog
    plan: Plan
    structure: Structure
    camera: Camera

    @cached_property
    def required(self) -> list[dict[str, Any]]:
        """Every zone that is required of the structure."""
        return zones_of(self.catalog, self.structure.kind, self.structure.structure_id)

    def judged(self, missions: Sequence[Mission] = ()) -> list[dict[str, Any]]:
        """What becomes of each zone by these sorties together, or by the plan where there are none."""
        if not self.required:
            return []
        known = self.catalog.structure, self.catalog.cache
        plan, faces = self.plan, self.catalog.faces_labelled
        asking = Asking(*known, self.structure, plan.supposed, self.camera, self.required, faces)
        return asking.judged(*self._looks(asking, missions))

    def notes(self, missions: Sequence[Mission] = ()) -> tuple[str, ...]:
        """The same as notes of a mission."""
        return tuple(map(_words, self.judged(missions)))

    def _looks(self, asking: Asking, missions: Sequence[Mission]) -> list[Looked]:
        if not missions:
            return [asking.planned(self.plan, self.camera)]
        flown = map(_flown, missions)
        return [asking.along(path, self.camera, pictures) for path, pictures in flown]


def _flown(mission: Mission) -> tuple[Trajectory, Floats]:
    """The inspection of a mission as it is written, and when it takes its pictures."""
    part = np.flatnonzero(mission.inspect)
    positions = mission.local[part]
    leg = leg_lengths(positions)
    took = np.maximum(leg / np.maximum(mission.speed_mps[part][1:], 1e-3), _ON_THE_SPOT_S)
    t_s = cumulated(took)
    fov = None if mission.fov_deg is None else mission.fov_deg[part]
    path = Trajectory(t_s, positions, mission.quat_xyzw[part], fov_deg=fov)
    if not mission.photo_distance_m:
        return path, t_s[mission.photo[part]]
    along = cumulated(leg)
    return path, np.interp(np.arange(0.0, along[-1], mission.photo_distance_m), along, t_s)


def _words(row: dict[str, Any]) -> str:
    share = "" if row["pct"] != row["pct"] else f", {row['pct']:.1f} % shown"
    why = f": {row['why']}" if row["why"] else ""
    return f"{ZONE} {row['zone']} ({row['set']} {row['version']}): {row['status']}{share}{why}"
