"""What the pages of a fleet are made of, read from the catalog; each expensive part once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import pandas as pd

from upplied import __version__
from upplied.catalog.database import Catalog
from upplied.config import digest
from upplied.errors import UppliedError
from upplied.outputs import figures
from upplied.outputs.along import profile
from upplied.outputs.display import (
    DisplayMesh,
    display_mesh,
    display_states,
    nearest_samples,
    packed,
    structure_data,
)
from upplied.outputs.flown import Flights, Flown, flown_data, flown_sentence, seen_as_flown
from upplied.outputs.fly import fly_data
from upplied.outputs.missions import gate
from upplied.outputs.missions.reading import planned
from upplied.outputs.pair_page import (
    DRAFTED,
    demonstration_data,
    pair_data,
    path_data,
    planned_data,
    safety_m,
)
from upplied.outputs.pairs import Pair, number, shown_status
from upplied.outputs.passport_page import passport_data
from upplied.outputs.picture_quality import quality_data
from upplied.outputs.source import Source
from upplied.outputs.structure_page import structure_facts
from upplied.outputs.zones import zones
from upplied.records import Floats, Ints, Measures, Plan, Structure, SurfaceStates, Trajectory
from upplied.records.plans import SupposedSurface
from upplied.scene import scene_of
from upplied.supposed_scene import scene_for

_POSE = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]


class Reader:
    """Reads a source for reports and keeps the last few structures at hand."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self._flights = Flights(source)
        self.structure = lru_cache(4)(source.structure)
        self.demonstration = lru_cache(32)(source.demonstration)
        self._mesh = lru_cache(4)(self._mesh_of)
        self._hashes = lru_cache(2)(self._hashes_of)
        self._data = lru_cache(4)(self._data_of)
        self._flown = lru_cache(32)(self._flown_of)
        self.refused: dict[str, list[str]] = {}  # pairs whose plan does not pass the gate, and why
        self._zones: dict[str, list[dict[str, Any]]] = {}  # of the last target
        self._near: dict[str, Ints] = {}  # of the last target

    def sha256(self, table: str, name: str) -> str:
        """Hash of a structure or demonstration as it stands now; empty where it is not known."""
        return self._hashes(table).get(name, "")

    def structure_data(self, structure_id: str) -> dict[str, Any]:
        """What a page needs to draw a structure."""
        return self._data(structure_id)

    def pair_data(self, pair: Pair, picture: str = "", sorties: bool = True) -> dict[str, Any]:
        """What a plan's page shows; `picture` is where a PNG of it lies.

        Without `sorties` the mission that follows from the plan and the quality of its pictures are left
        out, which take a second to make.
        """
        origin = np.array(self._data(pair.target_id)["origin"])
        paths = {}
        shown = {**pair.plans, **({} if pair.draft is None else {DRAFTED: pair.draft})}
        for preset, row in shown.items():
            if row["status"] == "ok":
                steps = self.source.waypoints(str(row["transfer_id"]))
                if len(steps):
                    states = self._states(row, pair.target_id)
                    supposed = self.source.supposed(str(row["transfer_id"]))
                    scene = scene_for(self.structure(pair.target_id), supposed)
                    broken = self._broken(row, steps, pair.target_id, supposed)
                    camera = self.demonstration(pair.demonstration_id).camera
                    path = profile(trajectory_of(steps), scene, camera)
                    paths[preset] = planned_data(path, viewpoints_of(steps), origin, states)
                    if broken:
                        self.refused[pair.name] = broken
                    paths[preset] |= {"gate": broken, "overruled": self.overruled(row)}
                    flown = self._flights.of(row)
                    if flown is not None:
                        along = profile(flown.trajectory, scene, camera)
                        paths[preset]["flown"] = flown_data(flown, row, path_data(along, origin))
                        seen = self._seen_as_flown(row, flown, pair.target_id)
                        if seen is not None:
                            paths[preset]["flown"]["states"] = packed(seen)
        zones = self.zones(pair.target_id)
        demonstration = dict(self._flown(pair.demonstration_id))
        inspected = self.source.inspected(str(pair.main["transfer_id"]))
        if inspected is not None:
            states = display_states(self._mesh(pair.source_id), inspected)
            demonstration["states"] = packed(states)
        mission: dict[str, Any] = {}
        quality: list[dict[str, Any]] = []
        if sorties:
            camera = self.demonstration(pair.demonstration_id).camera
            plan, target = plan_of(self.source, pair.main), self.structure(pair.target_id)
            mission = fly_data(pair.main, plan, target, camera, origin)
            scene, mesh = scene_for(target, plan.supposed), self._mesh(pair.target_id)
            quality = quality_data(plan, camera, scene, mesh, str(pair.main.get("settings_json") or "{}"))
        more = {"zones": zones, "mission": mission, "quality": quality}
        return pair_data(pair, demonstration, paths, picture) | more

    def structure_page(self, structure_id: str, pairs: Sequence[Pair], picture: str = "") -> dict[str, Any]:
        """What the page of a structure shows; `picture` is where a PNG of it lies."""
        own = [pair for pair in pairs if pair.target_id == structure_id]
        zones = self.zones(structure_id)
        return structure_facts(self.source, self.structure(structure_id), own, zones) | {"picture": picture}

    def display_mesh(self, structure: Structure) -> DisplayMesh:
        """The mesh of a structure as browsers show it; kept where it is the version that stands now."""
        now = self.sha256("structures", structure.structure_id)
        return self._mesh(structure.structure_id) if now == structure.sha256 else display_mesh(structure)

    def zones(self, structure_id: str) -> list[dict[str, Any]]:
        """The result for each required zone of a structure; none where none is required."""
        if not isinstance(self.source, Catalog):
            return []
        if structure_id not in self._zones:
            try:
                rows = zones(self.source, structure_id)
            except UppliedError as error:  # such as a landmark that this structure does not have
                unknown = dict.fromkeys(("planned", "flown"), "not judged") | {"planned_why": str(error)}
                rows = [{"zone": "all", "set": "", "asked_by": "", "version": 0, "flown_why": "", **unknown}]
            self._zones = {structure_id: rows}  # pairs come target by target
        return self._zones[structure_id]

    def overruled(self, row: Any) -> list[str]:
        """Which rules of the gate a person overruled for a plan, in words."""
        return self._overruled.get(str(row["transfer_id"]), [])

    @cached_property
    def _overruled(self) -> dict[str, list[str]]:
        by_plan: dict[str, list[str]] = {}
        if hasattr(self.source, "overruled"):
            for row in self.source.overruled().to_dict("records"):
                exit_words = f"{row['way']} {row['format'] or ''}".strip()
                words = f"{exit_words}, {row['added_at']:%Y-%m-%d %H:%M} UTC: {row['found']}"
                by_plan.setdefault(str(row["transfer_id"]), []).append(words)
        return by_plan

    def _broken(
        self, row: Any, steps: pd.DataFrame, target_id: str, supposed: SupposedSurface | None
    ) -> list[str]:
        """What the gate finds in the steps of a plan to be flown, in words; its row said nothing of it."""
        if shown_status(row) != "ok" or row["preset"] != "recommended":
            return []
        path = trajectory_of(steps)
        limit_m = safety_m(row.get("settings_json"))
        limits = gate.Limits() if limit_m is None else gate.Limits(clearance_m=limit_m)
        structure = self.structure(target_id)
        breaches = gate.breaches(planned(path.positions, path.t_s), structure, limits, supposed)
        return [str(breach) for breach in breaches]

    def flown(self, row: Any) -> str:
        """What came of flying a plan in simulation, in words; empty where nobody did."""
        return flown_sentence(self._flights.of(row), row)

    def picture(self, pair: Pair, width: int = 1000) -> bytes:
        """PNG of the demonstration and of the plan that is flown."""
        plan = plan_of(self.source, pair.main)
        source, target = self.structure(pair.source_id), self.structure(pair.target_id)
        demonstration = self.demonstration(pair.demonstration_id)
        return figures.transfer_png(source, target, demonstration, plan, width=width)

    def thumbnail(self, structure_id: str) -> bytes:
        """A small PNG of a structure, for the page of the fleet."""
        return figures.thumbnail_png(self._mesh(structure_id))

    def passport(self, demonstration_id: str, planned: str = "") -> dict[str, Any]:
        """What the page of a demonstration shows: its passport, and a picture inside.

        The picture shows the inspected surface where a plan, `planned` by its ID, knows it.
        """
        flown = self.demonstration(demonstration_id)
        inspected = self.source.inspected(planned) if planned else None
        picture = figures.demonstration_png(self.structure(flown.structure_id), flown, inspected)
        return passport_data(flown, picture)

    def _seen_as_flown(self, row: Any, flown: Flown, target_id: str) -> np.ndarray | None:
        """The state of each triangle as it was flown; None where that is not known of the same samples."""
        store, surface = getattr(self.source, "looks", None), self.source.surface(str(row["transfer_id"]))
        if store is None or surface is None or not flown.looks_sha256:
            return None
        looks = store.get(flown.looks_sha256)
        samples = self.source.surfaces.points(looks.samples_sha256)  # type: ignore[attr-defined]
        if not np.array_equal(samples, surface.points):
            return None
        return self._display(seen_as_flown(surface, looks), target_id)

    def _states(self, row: Any, target_id: str) -> np.ndarray | None:
        surface = self.source.surface(str(row["transfer_id"]))
        return None if surface is None else self._display(surface, target_id)

    def _display(self, surface: SurfaceStates, target_id: str) -> np.ndarray:
        mesh = self._mesh(target_id)
        if not len(surface.points):
            return display_states(mesh, surface)
        normals = b"" if surface.normals is None else surface.normals.tobytes()
        samples = digest([target_id, surface.points.tobytes().hex(), normals.hex()])
        if samples not in self._near:
            self._near = {samples: nearest_samples(mesh, surface)}
        return display_states(mesh, surface, self._near[samples])

    def _hashes_of(self, table: str) -> dict[str, str]:
        rows = getattr(self.source, table)()
        return dict(zip(rows[f"{table[:-1]}_id"], rows["sha256"], strict=True)) if len(rows) else {}

    def _mesh_of(self, structure_id: str) -> DisplayMesh:
        """From the source's cache where it has one: simplifying a million triangles takes twenty seconds."""
        cache, sha256 = getattr(self.source, "cache", None), self.sha256("structures", structure_id)
        if cache is None or not sha256:
            return display_mesh(self.structure(structure_id))
        mesh: DisplayMesh = cache(
            "display",
            DisplayMesh,
            digest(["display", __version__, sha256]),
            lambda: display_mesh(self.structure(structure_id)),
        )
        return mesh

    def _data_of(self, structure_id: str) -> dict[str, Any]:
        return structure_data(self.structure(structure_id), self._mesh(structure_id))

    def _flown_of(self, demonstration_id: str) -> dict[str, Any]:
        flown = self.demonstration(demonstration_id)
        origin = np.array(self._data(flown.structure_id)["origin"])
        scene = scene_of(self.structure(flown.structure_id))
        return demonstration_data(flown, profile(flown.trajectory, scene, flown.camera), origin)


def plan_of(source: Source, row: Any) -> Plan:
    """The plan of a row of the table of transfers, with what it sees of its target where that is known."""
    done = row["status"] == "ok"
    steps = source.waypoints(str(row["transfer_id"])) if done else pd.DataFrame()
    given = {name: number(row, name) for name in Measures.__dataclass_fields__}
    return Plan(
        demonstration_id=str(row["demonstration_id"]),
        source_id=str(row["source_id"]),
        target_id=str(row["target_id"]),
        kind=str(row["kind"]),
        preset=str(row["preset"]),
        status=str(row["status"]),
        reason=str(row.get("reason") or ""),
        trajectory=trajectory_of(steps) if len(steps) else None,
        is_viewpoint=steps["is_viewpoint"].to_numpy(bool) if len(steps) else None,
        flyable=bool(row.get("flyable")),
        not_flyable=str(row.get("not_flyable") or ""),
        parts_told_by=str(row.get("parts_told_by") or ""),
        measures=Measures(**{name: value for name, value in given.items() if value is not None}),
        surface=source.surface(str(row["transfer_id"])) if done else None,
        inspected=source.inspected(str(row["transfer_id"])),
        supposed=source.supposed(str(row["transfer_id"])),
        photos_sha256=str(row.get("photos_sha256") or ""),
    )


def trajectory_of(steps: pd.DataFrame) -> Trajectory:
    """The trajectory of a table of waypoints."""
    values = steps[_POSE].to_numpy(float)
    zoomed = "hfov_deg" in steps and bool(
        steps["hfov_deg"].notna().all()
    )  # rows of before have no such column
    fov_deg = steps[["hfov_deg", "vfov_deg"]].to_numpy(float) if zoomed else None
    return Trajectory(steps["t_s"].to_numpy(float), values[:, :3], values[:, 3:], fov_deg)


def viewpoints_of(steps: pd.DataFrame) -> Floats:
    """Position and quaternion (K, 7) of the viewpoints among waypoints."""
    return steps.loc[steps["is_viewpoint"].to_numpy(bool), _POSE].to_numpy(float)
