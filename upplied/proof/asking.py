"""The zones that are asked of one structure: where they are on it, and what looks at it make of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from upplied.config import CloudSettings, settings_for
from upplied.errors import SettingsError
from upplied.planning.airspace.rules import Airspace
from upplied.planning.correspondence.pair import Memo
from upplied.planning.demonstration.about import zone_of
from upplied.planning.demonstration.carried_zone import carried_zone
from upplied.planning.measures.attainable import attainable
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_parts
from upplied.planning.visibility.path_views import TRULY
from upplied.proof.as_flown import looks_of
from upplied.proof.zones import Demand, Looked, judged
from upplied.records import Bools, Camera, Cloud, Ints, Plan, Record, Structure
from upplied.scene import Scene


@dataclass(frozen=True, eq=False, repr=False)
class _Zone(Record):
    patches: Bools  # (N,)
    carried: bool = False
    probability: float = 1.0
    said: str = ""  # where it was carried from


class Asking:
    """The zones that are asked of a structure, and what looks at it make of them.

    Parameters
    ----------
    structure : callable
        The structure of an id, that zones are carried from.
    memo : Memo
        Remembers how structures correspond.
    target : Structure
    scene : Scene
    camera : Camera
        That is asked what a safe one could see.
    asked : list of dict
        Of each zone its name, set and version, who asks, and its demand.
    """

    def __init__(
        self,
        structure: Callable[[str], Structure],
        memo: Memo,
        target: Structure,
        scene: Scene,
        camera: Camera,
        asked: list[dict[str, Any]],
    ) -> None:
        self._structure, self._memo = structure, memo
        self.target, self.scene, self.camera, self._asked = target, scene, camera, asked
        self.surface = surface_samples(target, scene, CloudSettings())

    @property
    def seen_by(self) -> tuple[Cloud, Camera, Scene]:
        """What `planned_looks` asks for besides a plan."""
        return self.surface, self.camera, self.scene

    def patches(self, where: str) -> Bools:
        """The samples (N,) that a place names.

        Raises
        ------
        SettingsError
            If it names none.
        """
        found = zone_of(where, self.target, self.surface, self._skin)
        if found is None:
            raise SettingsError("the zone", "names no place", "landmarks, parts, boxes or balls")
        return found

    def judged(self, *looks: Looked) -> list[dict[str, Any]]:
        """Of each zone its name and set, its status, the share that is shown and why it is not met."""
        found = []
        for row, (demand, zone) in zip(self._asked, self._demands, strict=True):
            verdict = judged(demand, zone.patches, self._attainable, looks)
            said = {name: row[name] for name in ("set", "version", "asked_by", "zone")}
            said |= {"on": demand.on if zone.carried else "", "probability": zone.probability}
            why = "; ".join(filter(None, (verdict.why, zone.said)))
            found.append(said | {"status": verdict.status, "pct": verdict.shown_pct, "why": why})
        return found

    @cached_property
    def _demands(self) -> list[tuple[Demand, _Zone]]:
        known = Demand.__dataclass_fields__
        demands = [Demand(**{name: row[name] for name in known if name in row}) for row in self._asked]
        return [(demand, self._zone(demand)) for demand in demands]

    def _zone(self, demand: Demand) -> _Zone:
        """The samples of a zone, carried from the structure that it is on where that is another one."""
        if demand.on in ("", self.target.structure_id):
            return _Zone(self.patches(demand.where))
        source = self._structure(demand.on)
        settings = settings_for("recommended")
        found = carried_zone(demand.where, source, self.target, self.surface, settings, self._memo)
        said = f"carried from {demand.on}"
        said += f" with probability {found.probability:.2f}" if np.isfinite(found.probability) else ""
        said += f", {found.lost_pct:.0f} % of it has no counterpart" if found.lost_pct >= 1 else ""
        return _Zone(found.patches, True, found.probability, said)

    @cached_property
    def _skin(self) -> Ints:
        return skin_parts(self.target, self.scene, self.surface).label

    @cached_property
    def _attainable(self) -> Bools:
        route = settings_for("recommended").route
        around = self.target.surroundings
        airspace = Airspace(self.scene, route.clearance_m, around, route.ground_clearance_m)
        return attainable(self.surface, airspace, self.camera, TRULY)


def planned_looks(plan: Plan, surface: Cloud, camera: Camera, scene: Scene) -> Looked:
    """How a plan that has a path sees the samples of its target; a picture is taken at each viewpoint."""
    path = plan.trajectory
    assert path is not None
    flags = np.zeros(len(path), bool) if plan.is_viewpoint is None else plan.is_viewpoint
    looks = looks_of(path, surface, camera, scene, None, path.t_s[flags])
    return Looked(looks.distance_m, looks.incidence_deg, 0.0, camera, looks.pictures)
