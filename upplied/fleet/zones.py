"""The zones that are asked of a structure, as planned and as flown: met, missed or unattainable, and why."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from upplied.catalog import Catalog
from upplied.catalog.verbs import required
from upplied.config import CloudSettings, settings_for
from upplied.planning.airspace.rules import Airspace
from upplied.planning.demonstration.about import zone_of
from upplied.planning.measures.attainable import attainable
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_parts
from upplied.planning.visibility.path_views import TRULY
from upplied.proof.as_flown import looks_of
from upplied.proof.zones import Demand, Looked, ZoneVerdict, judged
from upplied.records import Camera, Cloud, Structure
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
    scene = scene_of(target)
    surface = surface_samples(target, scene, CloudSettings())
    skin = skin_parts(target, scene, surface).label
    plans, camera = _planned(catalog, target, surface, scene)
    flights = _flown(catalog, structure_id, surface)
    can = _attainable(target, surface, scene, camera)
    found = []
    for row in asked:
        demand = Demand(**{name: row[name] for name in Demand.__dataclass_fields__ if name in row})
        patches = zone_of(demand.where, target, surface, skin)
        assert patches is not None
        planned, flown = (judged(demand, patches, can, looks) for looks in (plans, flights))
        said = {name: row[name] for name in ("set", "version", "asked_by", "zone")}
        found.append({**said, **_said("planned", planned), **_said("flown", flown)})
    return found


def _said(what: str, verdict: ZoneVerdict) -> dict[str, Any]:
    return {what: verdict.status, f"{what}_pct": verdict.shown_pct, f"{what}_why": verdict.why}


def _planned(
    catalog: Catalog, target: Structure, surface: Cloud, scene: Scene
) -> tuple[list[Looked], Camera]:
    """How the plans of a structure see its samples, and the camera of the first."""
    force = catalog.in_force(structure=target.structure_id)
    newest = catalog.transfers(structure=target.structure_id, status="ok", preset="recommended")
    rows = force if len(force) else newest
    found, first = [], Camera()
    for at, row in enumerate(rows.to_dict("records")):
        camera = catalog.demonstration(str(row["demonstration_id"])).camera
        first = camera if at == 0 else first
        path = catalog.plan(str(row["transfer_id"])).trajectory
        if path is None:
            continue
        looks = looks_of(path, surface, camera, scene)
        found.append(Looked(looks.distance_m, looks.incidence_deg, 0.0, camera))
    return found, first


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
        camera = catalog.demonstration(str(row["demonstration_id"])).camera
        age = (now - row["flown_at"]).total_seconds() / _DAY_S
        found.append(Looked(distance[nearest], incidence[nearest], age, camera))
    return found


def _attainable(target: Structure, surface: Cloud, scene: Scene, camera: Camera) -> np.ndarray:
    route = settings_for("recommended").route
    airspace = Airspace(scene, route.clearance_m, target.surroundings, route.ground_clearance_m)
    return attainable(surface, airspace, camera, TRULY)
