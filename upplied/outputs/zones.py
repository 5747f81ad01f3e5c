"""The required zones of a structure, as planned, as flown and by a mission: met, missed or unattainable."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from upplied.catalog import Catalog
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs.belonging import Zones
from upplied.geometry.polylines import cumulated, leg_lengths
from upplied.outputs.missions.gate import ZONE
from upplied.outputs.missions.records import Mission
from upplied.outputs.pairs import stamp
from upplied.proof.required_zones import RequiredZones
from upplied.proof.zones import Looked
from upplied.records import Camera, Cloud, Floats, Plan, Structure, Trajectory

_DAY_S = 86_400.0
_ON_THE_SPOT_S = 0.1  # assumed duration of a turn on the spot; no result depends on it


def zones(catalog: Catalog, structure_id: str) -> list[dict[str, Any]]:
    """Every required zone of a structure with its result.

    Planned is that of the plans in force together (or of the newest ok plan of `recommended`), flown that of
    all stored looks, ``last_seen`` the time of the newest. A zone without surface is ``not judged``.
    """
    target = catalog.structure(structure_id)
    required_zones = Zones(catalog).of(target.kind, structure_id)
    if not required_zones:
        return []
    force = catalog.in_force(structure=structure_id)
    newest = catalog.transfers(structure=structure_id, status="ok", preset="recommended")
    rows = (force if len(force) else newest).to_dict("records")
    cameras = [catalog.demonstration(str(row["demonstration_id"])).camera for row in rows]
    plans = [catalog.plan(str(row["transfer_id"])) for row in rows]
    supposed = next((plan.supposed for plan in plans if plan.supposed is not None), None)
    known = supposed, [*cameras, Camera()][0], required_zones, catalog.faces_labelled
    requirements = RequiredZones(catalog.structure, catalog.cache, target, *known)
    shown = [
        requirements.planned(plan, camera)
        for plan, camera in zip(plans, cameras, strict=True)
        if plan.trajectory is not None
    ]
    flights = [row for row in flown_rows(catalog, structure_id) if row["looks_sha256"]]
    flown_looks = looked(catalog, flights, requirements.surface)
    both = zip(requirements.judged(*shown), requirements.judged(*flown_looks), strict=True)
    named = ("set", "version", "asked_by", "zone", "on", "probability")
    return [
        {name: planned[name] for name in named}
        | _result("planned", planned)
        | _result("flown", flown)
        | {"last_seen": stamp(max((flights[at]["flown_at"] for at in flown["seen_by"]), default=None))}
        for planned, flown in both
    ]


def _result(what: str, row: Row) -> dict[str, Any]:
    return {what: row["status"], f"{what}_pct": row["pct"], f"{what}_why": row["why"]}


def flown_rows(catalog: Catalog, structure_id: str) -> list[Row]:
    """The real flights of a structure."""
    rows: list[Row] = catalog.flights(structure=structure_id, kind="flown").to_dict("records")
    return rows


def looked(catalog: Catalog, flights: Sequence[Row], surface: Cloud) -> list[Looked]:
    """The views of the samples from each flight, by its stored looks at the nearest patch."""
    now = catalog.clock.now()
    patches, index = [], {}
    for row in flights:
        if not row["looks_sha256"]:
            continue
        looks = catalog.looks.get(row["looks_sha256"]).certain
        if looks.samples_sha256 not in index:
            points = catalog.surfaces.points(looks.samples_sha256)
            index[looks.samples_sha256] = cKDTree(points).query(surface.points)[1], len(points)
        nearest, count = index[looks.samples_sha256]
        values = [looks.distance_m, looks.incidence_deg]
        if looks.frontal_distance_m is not None and looks.frontal_incidence_deg is not None:
            values += [looks.frontal_distance_m, looks.frontal_incidence_deg]
        every = np.full((len(values), count), np.nan)
        every[:, looks.patch] = values
        near, level, *frontal = every[:, nearest]
        pictures = np.zeros(count, np.int64)
        pictures[looks.patch] = 1 if looks.pictures is None else looks.pictures
        camera = catalog.demonstration(str(row["demonstration_id"])).camera
        age = (now - row["flown_at"]).total_seconds() / _DAY_S
        more = ((frontal[0], frontal[1]),) if frontal else ()
        patches.append(Looked(near, level, age, camera, pictures[nearest], more))
    return patches


@dataclass(frozen=True, eq=False)
class MissionZones:
    """The zones of a structure, judged for the missions of one plan, or for changes of it."""

    catalog: Catalog
    plan: Plan
    structure: Structure
    camera: Camera

    @cached_property
    def required(self) -> list[dict[str, Any]]:
        """Every required zone of the structure."""
        return Zones(self.catalog).of(self.structure.kind, self.structure.structure_id)

    @cached_property
    def requirements(self) -> RequiredZones:
        """The same with the surface that each names."""
        known = self.catalog.structure, self.catalog.cache
        plan, faces = self.plan, self.catalog.faces_labelled
        return RequiredZones(*known, self.structure, plan.supposed, self.camera, self.required, faces)

    def judged(self, missions: Sequence[Mission] = (), plan: Plan | None = None) -> list[dict[str, Any]]:
        """The result of each zone for these sorties together, or for a plan if there are none."""
        if not self.required:
            return []
        flown = [self.requirements.along(path, self.camera, at_s) for path, at_s in map(_flown, missions)]
        return self.requirements.judged(*flown or [self.requirements.planned(plan or self.plan, self.camera)])

    def notes(self, missions: Sequence[Mission] = ()) -> tuple[str, ...]:
        """The results as notes of a mission."""
        texts = []
        for row in self.judged(missions):
            share = "" if row["pct"] != row["pct"] else f", {row['pct']:.1f} % shown"
            why = f": {row['why']}" if row["why"] else ""
            texts.append(f"{ZONE} {row['zone']} ({row['set']} {row['version']}): {row['status']}{share}{why}")
        return tuple(texts)


def _flown(mission: Mission) -> tuple[Trajectory, Floats]:
    """The inspection path of a mission as written, and the times of its photos."""
    part = np.flatnonzero(mission.inspect)
    positions = mission.local[part]
    leg = leg_lengths(positions)
    t_s = cumulated(np.maximum(leg / np.maximum(mission.speed_mps[part][1:], 1e-3), _ON_THE_SPOT_S))
    fov = None if mission.fov_deg is None else mission.fov_deg[part]
    path = Trajectory(t_s, positions, mission.quat_xyzw[part], fov_deg=fov)
    if not mission.photo_distance_m:
        return path, t_s[mission.photo[part]]
    along = cumulated(leg)
    return path, np.interp(np.arange(0.0, along[-1], mission.photo_distance_m), along, t_s)
