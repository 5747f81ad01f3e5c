"""The zones that are asked of a structure, as planned and as flown: met, missed or unattainable, and why."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from upplied.catalog import Catalog
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs import required
from upplied.config import CloudSettings, settings_for
from upplied.errors import SettingsError
from upplied.planning.airspace.rules import Airspace
from upplied.planning.demonstration.about import zone_of
from upplied.planning.demonstration.carried_zone import carried_zone
from upplied.planning.measures.attainable import attainable
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_parts
from upplied.planning.visibility.path_views import TRULY
from upplied.proof.as_flown import looks_of
from upplied.proof.zones import Demand, Looked, judged
from upplied.records import Bools, Camera, Cloud, Ints, Plan, Record, Structure
from upplied.scene import Scene, scene_of

_DAY_S = 86_400.0


def zones(catalog: Catalog, structure_id: str) -> list[dict[str, Any]]:
    """Every zone that is asked of a structure with what became of it.

    Planned is what the plans in force show together (the newest of `recommended` that is ok, where none
    is in force); flown is what all flights showed, by the looks that are kept of them.

    Raises
    ------
    SettingsError
        If a zone names no surface of the structure.
    """
    target = catalog.structure(structure_id)
    asked = required.zones_of(catalog, target.kind, structure_id)
    if not asked:
        return []
    rows = _plans(catalog, structure_id)
    cameras = [catalog.demonstration(str(row["demonstration_id"])).camera for row in rows]
    asking = Asking(catalog, target, scene_of(target), cameras[0] if cameras else Camera(), asked)
    plans = [catalog.plan(str(row["transfer_id"])) for row in rows]
    shown = [
        planned_looks(plan, asking.surface, camera, asking.scene)
        for plan, camera in zip(plans, cameras, strict=True)
        if plan.trajectory is not None
    ]
    flights = _flown(catalog, structure_id, asking.surface)
    both = zip(asking.judged(*shown), asking.judged(*flights), strict=True)
    return [
        {name: planned[name] for name in _NAMED}
        | {_named("planned", name): planned[name] for name in _VERDICT}
        | {_named("flown", name): flown[name] for name in _VERDICT}
        for planned, flown in both
    ]


_NAMED = ("set", "version", "asked_by", "zone", "on", "probability")
_VERDICT = ("status", "pct", "why")


def _named(what: str, name: str) -> str:
    return what if name == "status" else f"{what}_{name}"


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
    catalog : Catalog
        Holds the structures that zones are carried from.
    target : Structure
    scene : Scene
    camera : Camera
        That is asked what a safe one could see.
    asked : list of dict
        From `upplied.catalog.verbs.required.zones_of`.
    """

    def __init__(
        self, catalog: Catalog, target: Structure, scene: Scene, camera: Camera, asked: list[Row]
    ) -> None:
        self._catalog = catalog
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

    def judged(self, *looks: Looked) -> list[Row]:
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
        source = self._catalog.structure(demand.on)
        settings = settings_for("recommended")
        memo = self._catalog.cache
        found = carried_zone(demand.where, source, self.target, self.surface, settings, memo)
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


def _plans(catalog: Catalog, structure_id: str) -> list[Row]:
    """The plans of a structure that count: those in force, else the newest."""
    force = catalog.in_force(structure=structure_id)
    newest = catalog.transfers(structure=structure_id, status="ok", preset="recommended")
    rows = (force if len(force) else newest).to_dict("records")
    return [{str(name): value for name, value in row.items()} for row in rows]


def planned_looks(plan: Plan, surface: Cloud, camera: Camera, scene: Scene) -> Looked:
    """How a plan that has a path sees the samples of its target; a picture is taken at each viewpoint."""
    path = plan.trajectory
    assert path is not None
    flags = np.zeros(len(path), bool) if plan.is_viewpoint is None else plan.is_viewpoint
    looks = looks_of(path, surface, camera, scene, None, path.t_s[flags])
    return Looked(looks.distance_m, looks.incidence_deg, 0.0, camera, looks.pictures)


def _flown(catalog: Catalog, structure_id: str, surface: Cloud) -> list[Looked]:
    """How each flight saw the samples: by the kept looks at the nearest patch that faces the same way."""
    now = catalog.clock.now()
    found, index = [], {}
    for row in catalog.flights(structure=structure_id, kind="flown").to_dict("records"):
        if not row["looks_sha256"]:
            continue
        looks = catalog.looks.get(row["looks_sha256"])
        if looks.samples_sha256 not in index:
            points = catalog.surfaces.points(looks.samples_sha256)
            index[looks.samples_sha256] = cKDTree(points).query(surface.points)[1], len(points)
        nearest, count = index[looks.samples_sha256]
        distance, incidence = np.full(count, np.nan), np.full(count, np.nan)
        distance[looks.patch], incidence[looks.patch] = looks.distance_m, looks.incidence_deg
        pictures = np.zeros(count, np.int64)
        pictures[looks.patch] = 1 if looks.pictures is None else looks.pictures
        camera = catalog.demonstration(str(row["demonstration_id"])).camera
        age = (now - row["flown_at"]).total_seconds() / _DAY_S
        found.append(Looked(distance[nearest], incidence[nearest], age, camera, pictures[nearest]))
    return found
