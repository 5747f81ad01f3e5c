"""The data of a fleet's pages, read from the catalog; each expensive part once."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from upplied import __version__
from upplied.catalog import Catalog
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs.recipes import settings_of
from upplied.config import digest, settings_for
from upplied.errors import UppliedError
from upplied.geometry.scene import Scene, scene_of
from upplied.geometry.supposed_scene import scene_for
from upplied.outputs import display, figures, pair_page
from upplied.outputs.brief import fly_data, path_drawn
from upplied.outputs.display import DisplayMesh, display_mesh, display_states, packed
from upplied.outputs.missions import gate
from upplied.outputs.page_data import passport_data, structure_facts
from upplied.outputs.pair_page import profile
from upplied.outputs.pairs import Pair, shown_status
from upplied.outputs.verdicts import Flights, flown_data, flown_sentence, seen_as_flown
from upplied.outputs.zones import zones
from upplied.proof.inspected import pictured
from upplied.records import SURFACE_STATES, Camera, Cloud, Floats, Ints, Plan, Structure, SurfaceStates

_INSPECTED = [SURFACE_STATES.index(name) for name in ("shown", "missed", "unattainable")]
_FINEST = {"gsd_mm": "resolution (mm/px)", "blur_px": "motion blur (px)", "sharp_s": "time in sharp view (s)"}
_NONE = 255  # code of surface that no sharp picture shows
_MOST_PCT = 99.0  # of the values; larger ones have the last colour


class Reader:
    """Reads a catalog for reports and caches the last few structures."""

    def __init__(self, catalog: Catalog) -> None:
        self.catalog = catalog
        self._flights = Flights(catalog)
        self.structure = lru_cache(4)(catalog.structure)
        self.demonstration = lru_cache(32)(catalog.demonstration)
        self._mesh = lru_cache(4)(self._mesh_of)
        self._hashes = lru_cache(2)(self._hashes_of)
        self.structure_data = lru_cache(4)(
            lambda name: display.structure_data(self.structure(name), self._mesh(name))
        )
        self._flown = lru_cache(32)(self._flown_of)
        self.refused: dict[str, list[str]] = {}  # pairs whose plan does not pass the gate, and why
        self._zones: dict[str, list[dict[str, Any]]] = {}  # of the last target
        self._near: dict[str, Ints] = {}  # of the last target

    def sha256(self, table: str, name: str) -> str:
        """Hash of a structure or demonstration as stored now; empty if unknown."""
        return self._hashes(table).get(name, "")

    def pair_data(self, pair: Pair, picture: str = "", sorties: bool = True) -> dict[str, Any]:
        """The content of a plan's page; `picture` is the address of its PNG.

        Without `sorties` the mission and the quality of its pictures are omitted, which take a second.
        """
        shown = {**pair.plans, **({} if pair.draft is None else {pair_page.DRAFTED: pair.draft})}
        plans = {preset: plan_of(self.catalog, row) for preset, row in shown.items()}
        paths = {
            preset: self._path_data(pair, row, plans[preset])
            for preset, row in shown.items()
            if plans[preset].trajectory is not None
        }
        main = next(plans[preset] for preset, row in shown.items() if row is pair.main)
        demonstration = dict(self._flown(pair.demonstration_id))
        if main.inspected is not None:
            demonstration["states"] = packed(display_states(self._mesh(pair.source_id), main.inspected))
        camera, target = self.demonstration(pair.demonstration_id).camera, self.structure(pair.target_id)
        more: dict[str, Any] = {"zones": self.zones(pair.target_id), "quality": []}
        if not sorties:
            more["mission"] = path_drawn(main, target, camera)
        else:
            more["mission"] = fly_data(pair.main, main, target, camera)
            scene, mesh = scene_for(target, main.supposed), self._mesh(pair.target_id)
            settings = str(pair.main.get("settings_json") or "{}")
            more["quality"] = quality_data(main, camera, scene, mesh, settings)
        return pair_page.pair_data(pair, demonstration, paths, picture) | more

    def _path_data(self, pair: Pair, row: Any, plan: Plan) -> dict[str, Any]:
        assert plan.trajectory is not None and plan.is_viewpoint is not None
        scene = scene_for(self.structure(pair.target_id), plan.supposed)
        camera, origin = self.demonstration(pair.demonstration_id).camera, self._origin(pair.target_id)
        along = profile(plan.trajectory, scene, camera)
        states = None if plan.surface is None else self._display(plan.surface, pair.target_id)
        broken = self._broken(row, plan)
        if broken:
            self.refused[pair.name] = broken
        viewpoints = plan.trajectory.take(np.flatnonzero(plan.is_viewpoint))
        data = pair_page.planned_data(along, viewpoints, origin, states)
        data |= {"gate": broken, "overruled": self.overruled(row)}
        flight = self._flights.of(row)
        if flight is not None:
            path = profile(self.catalog.flown(flight["flight_sha256"]), scene, camera)
            data["flown"] = flown_data(flight, row, pair_page.path_data(path, origin))
            seen = self._seen_as_flown(plan, flight)
            if seen is not None:
                data["flown"]["states"] = packed(seen)
        return data

    def structure_page(self, structure_id: str, pairs: Sequence[Pair], picture: str = "") -> dict[str, Any]:
        """The content of a structure's page; `picture` is the address of a PNG."""
        structure, zones = self.structure(structure_id), self.zones(structure_id)
        return structure_facts(self.catalog, structure, pairs, zones) | {"picture": picture}

    def display_mesh(self, structure: Structure) -> DisplayMesh:
        """The mesh of a structure as browsers show it; cached if it is the stored version."""
        now = self.sha256("structures", structure.structure_id)
        return self._mesh(structure.structure_id) if now == structure.sha256 else display_mesh(structure)

    def zones(self, structure_id: str) -> list[dict[str, Any]]:
        """The result for each required zone of a structure."""
        if structure_id not in self._zones:
            try:
                rows = zones(self.catalog, structure_id)
            except UppliedError as error:  # such as a landmark that this structure does not have
                unknown = dict.fromkeys(("planned", "flown"), "not judged") | {"planned_why": str(error)}
                rows = [{"zone": "all", "set": "", "asked_by": "", "version": 0, "flown_why": "", **unknown}]
            self._zones = {structure_id: rows}  # pairs come target by target
        return self._zones[structure_id]

    def overruled(self, row: Any) -> list[str]:
        """The rules of the gate that a person overruled for a plan, in words."""
        return self._overruled.get(str(row["transfer_id"]), [])

    @cached_property
    def _overruled(self) -> dict[str, list[str]]:
        by_plan: dict[str, list[str]] = {}
        for row in self.catalog.overruled().to_dict("records"):
            exit_words = f"{row['way']} {row['format'] or ''}".strip()
            words = f"{exit_words}, {row['added_at']:%Y-%m-%d %H:%M} UTC: {row['found']}"
            by_plan.setdefault(str(row["transfer_id"]), []).append(words)
        return by_plan

    def _broken(self, row: Any, plan: Plan) -> list[str]:
        """Rules of the gate that a plan to be flown breaks, in words."""
        if shown_status(row) != "ok" or row["preset"] != "recommended" or plan.trajectory is None:
            return []
        limit_m = pair_page.safety_m(row.get("settings_json"))
        limits = gate.Limits() if limit_m is None else gate.Limits(clearance_m=limit_m)
        steps = gate.planned(plan.trajectory.positions, plan.trajectory.t_s)
        return [*map(str, gate.breaches(steps, self.structure(plan.target_id), limits, plan.supposed))]

    def flown(self, row: Any) -> str:
        """The result of the last flight of a plan, in words; empty without a flight."""
        return flown_sentence(self._flights.of(row), row)

    def picture(self, pair: Pair, width: int = 1000) -> bytes:
        """PNG of the demonstration and of the plan that is flown."""
        plan = plan_of(self.catalog, pair.main)
        source, target = self.structure(pair.source_id), self.structure(pair.target_id)
        demonstration = self.demonstration(pair.demonstration_id)
        return figures.transfer_png(source, target, demonstration, plan, width=width)

    def thumbnail(self, structure_id: str) -> bytes:
        """A small PNG of a structure, for the page of the fleet."""
        return figures.thumbnail_png(self._mesh(structure_id))

    def passport(self, demonstration_id: str, planned: str = "") -> dict[str, Any]:
        """The content of a demonstration's page: its passport and a picture.

        The picture shows the inspected surface that is stored with the plan of ID `planned`, if any.
        """
        flown = self.demonstration(demonstration_id)
        inspected = self.catalog.inspected(planned) if planned else None
        picture = figures.demonstration_png(self.structure(flown.structure_id), flown, inspected)
        return passport_data(flown, picture)

    def _seen_as_flown(self, plan: Plan, flight: Row) -> np.ndarray | None:
        """The state of each triangle as flown; None if it is unknown for the same samples."""
        if plan.surface is None or not flight["looks_sha256"]:
            return None
        looks = self.catalog.looks.get(flight["looks_sha256"])
        if not np.array_equal(self.catalog.surfaces.points(looks.samples_sha256), plan.surface.points):
            return None
        return self._display(seen_as_flown(plan.surface, looks), plan.target_id)

    def _display(self, surface: SurfaceStates, target_id: str) -> np.ndarray:
        mesh = self._mesh(target_id)
        if not len(surface.points):
            return display_states(mesh, surface)
        normals = b"" if surface.normals is None else surface.normals.tobytes()
        samples = digest([target_id, surface.points.tobytes().hex(), normals.hex()])
        if samples not in self._near:
            self._near = {samples: display.nearest_samples(mesh, surface)}
        return display_states(mesh, surface, self._near[samples])

    def _hashes_of(self, table: str) -> dict[str, str]:
        rows = getattr(self.catalog, table)()
        return dict(zip(rows[f"{table[:-1]}_id"], rows["sha256"], strict=True)) if len(rows) else {}

    def _mesh_of(self, structure_id: str) -> DisplayMesh:
        """Cached: the simplification of a million triangles takes twenty seconds."""
        key = digest(["display", __version__, self.sha256("structures", structure_id)])
        mesh: DisplayMesh = self.catalog.cache(
            "display", DisplayMesh, key, lambda: display_mesh(self.structure(structure_id))
        )
        return mesh

    def _origin(self, structure_id: str) -> Floats:
        return np.array(self.structure_data(structure_id)["origin"])

    def _flown_of(self, demonstration_id: str) -> dict[str, Any]:
        flown = self.demonstration(demonstration_id)
        along = profile(flown.trajectory, scene_of(self.structure(flown.structure_id)), flown.camera)
        return pair_page.demonstration_data(flown, along, self._origin(flown.structure_id))


def plan_of(catalog: Catalog, row: Any) -> Plan:
    """The plan of a row of `transfers`, with the states of its surface if stored."""
    name = str(row["transfer_id"])
    surface = catalog.surface(name) if row["status"] == "ok" else None
    return replace(catalog.plan(name), surface=surface, inspected=catalog.inspected(name))


def quality_data(
    plan: Plan, camera: Camera, scene: Scene, mesh: DisplayMesh, settings_json: str
) -> list[dict[str, Any]]:
    """Quantities of the finest sharp picture of each triangle, or point of a cloud, for a page.

    Each has a ``name`` with its unit, ``codes`` of one byte, 255 where the surface is not inspected or no
    picture is sharp, and ``step``, by which a code becomes a value. Empty where the surface is not known.
    """
    surface, path = plan.surface, plan.trajectory
    if surface is None or surface.normals is None or path is None or not len(surface.points):
        return []
    try:
        rule = settings_of(settings_json).inspection
    except (ValueError, KeyError, UppliedError):  # of a program that knew other settings
        rule = settings_for("recommended").inspection
    shown = pictured(path, Cloud(surface.points, surface.normals), camera, scene, rule)
    nearest = display.nearest_samples(mesh, surface)
    nearest = nearest if nearest.ndim == 1 else nearest[:, 0]
    inspected, quantities = np.isin(surface.state, _INSPECTED), []
    for key, name in _FINEST.items():
        values = np.where(inspected, shown[key], np.nan)[nearest]
        known = np.isfinite(values)
        most = float(np.percentile(values[known], _MOST_PCT)) if known.any() else 0.0
        step = max(most, 1e-9) / (_NONE - 1)
        codes = np.full(len(values), _NONE, np.uint8)
        codes[known] = np.clip(np.round(values[known] / step), 0, _NONE - 1).astype(np.uint8)
        quantities.append({"name": name, "step": step, "codes": packed(codes)})
    return quantities
