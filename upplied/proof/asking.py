"""The zones that are asked of one structure: where they are on it, and what looks at it make of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from upplied.config import CloudSettings, focal_px, settings_for
from upplied.errors import SettingsError, UppliedError
from upplied.geometry.scene import Scene, scene_of
from upplied.geometry.supposed_scene import scene_for
from upplied.planning.airspace.rules import Airspace
from upplied.planning.correspondence.memo import Memo
from upplied.planning.demonstration.about import Faces, zone_of
from upplied.planning.measures.attainable import attainable
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_parts
from upplied.planning.visibility.observations import TRULY
from upplied.proof.carried_zone import carried_zone
from upplied.proof.looks import looks_of
from upplied.proof.zones import Demand, Looked, as_asked, judged
from upplied.records import (
    Bools,
    Camera,
    Floats,
    Ints,
    Plan,
    Record,
    Structure,
    SupposedSurface,
    Trajectory,
)
from upplied.records.required import RequiredSurface


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
    supposed : SupposedSurface or None
        What was never scanned of it, of which a safe camera keeps clear.
    camera : Camera
        That is asked what a safe one could see.
    asked : list of dict
        Of each zone its name, set and version, who asks, and its demand.
    faces : callable, optional
        Of labels; see `planning.demonstration.about.zone_of`.
    """

    def __init__(
        self,
        structure: Callable[[str], Structure],
        memo: Memo,
        target: Structure,
        supposed: SupposedSurface | None,
        camera: Camera,
        asked: list[dict[str, Any]],
        faces: Faces | None = None,
    ) -> None:
        self._structure, self._memo, self._faces = structure, memo, faces
        self.target, self.camera, self._asked = target, camera, asked
        self.scene = scene_for(target, supposed)
        self.surface = surface_samples(target, scene_of(target), CloudSettings())

    def patches(self, where: str) -> Bools:
        """The samples (N,) that a place names.

        Raises
        ------
        SettingsError
            If it names none.
        """
        found = zone_of(where, self.target, self.surface, self._skin, self._faces)
        if found is None:
            raise SettingsError("the zone", "names no place", "landmarks, parts, boxes or balls")
        return found

    def planned(self, plan: Plan, camera: Camera) -> Looked:
        """How a plan that has a path sees the samples; a picture is taken at each viewpoint."""
        path = plan.trajectory
        assert path is not None
        flags = np.zeros(len(path), bool) if plan.is_viewpoint is None else plan.is_viewpoint
        return self._looked(path, camera, path.t_s[flags], scene_for(self.target, plan.supposed))

    def along(self, path: Trajectory, camera: Camera, picture_s: Floats) -> Looked:
        """How a path sees the samples: the nearest look, and the most frontal from as near as zones ask."""
        return self._looked(path, camera, picture_s, self.scene)

    def _looked(self, path: Trajectory, camera: Camera, picture_s: Floats, scene: Scene) -> Looked:
        asked = {demand.gsd_mm for demand, _ in self._demands if demand.gsd_mm is not None}
        focal = focal_px(camera.width_px, camera.hfov_deg) if camera.width_px else 0.0
        within_m = [1e-3 * gsd_mm * focal for gsd_mm in sorted(asked)] if focal else []
        found = looks_of(path, self.surface, camera, scene, None, picture_s, within_m)
        return Looked(found.distance_m, found.incidence_deg, 0.0, camera, found.pictures, found.frontal)

    def judged(self, *looks: Looked) -> list[dict[str, Any]]:
        """Of each zone its name and set, its status, the share that is shown and why it is not met.

        One that names nothing here is ``not judged``.
        """
        found = []
        for row, (demand, zone) in zip(self._asked, self._demands, strict=True):
            said = {name: row[name] for name in ("set", "version", "asked_by", "zone")}
            if isinstance(zone, str):
                unknown = dict.fromkeys(("probability", "pct"), float("nan"))
                found.append(said | unknown | {"on": demand.on, "status": "not judged", "why": zone})
                continue
            verdict = judged(demand, zone.patches, self._attainable, looks)
            said |= {"on": demand.on if zone.carried else "", "probability": zone.probability}
            why = "; ".join(filter(None, (verdict.why, zone.said)))
            found.append(said | {"status": verdict.status, "pct": verdict.shown_pct, "why": why})
        return found

    def required(self) -> tuple[RequiredSurface, tuple[str, ...]]:
        """All zones as one surface, each sample with the most that is asked of it.

        Returns
        -------
        tuple
            The surface, and the zones that name none here, in words.
        """
        surface, untold = self.surface, []
        zone = np.zeros(len(surface), bool)
        gsd_m, incidence = np.full(len(surface), np.inf), np.full(len(surface), 90.0)
        for demand, named in self._demands:
            if isinstance(named, str):
                untold.append(f"zone {demand.zone} is not planned for: {named}")
                continue
            patches = named.patches
            zone |= patches
            if demand.gsd_mm is not None:
                gsd_m[patches] = np.minimum(gsd_m[patches], 1e-3 * demand.gsd_mm)
            if demand.incidence_deg is not None:
                incidence[patches] = np.minimum(incidence[patches], demand.incidence_deg)
        return RequiredSurface(surface.points, surface.outward, zone, gsd_m, incidence), tuple(untold)

    def missed(self, *looks: Looked) -> list[tuple[dict[str, Any], Demand, Bools]]:
        """Of each zone that is known here what names it, its demand, and the samples (N,) not shown so."""
        return [
            (row, demand, zone.patches & ~as_asked(demand, len(self.surface), looks))
            for row, (demand, zone) in zip(self._asked, self._demands, strict=True)
            if not isinstance(zone, str)
        ]

    @cached_property
    def _demands(self) -> list[tuple[Demand, _Zone | str]]:
        """What is asked, each with its zone, or why it names none here, such as an unknown landmark."""
        known, found = Demand.__dataclass_fields__, list[tuple[Demand, _Zone | str]]()
        for row in self._asked:
            demand = Demand(**{name: row[name] for name in known if name in row})
            try:
                found.append((demand, self._zone(demand)))
            except UppliedError as error:
                found.append((demand, str(error)))
        return found

    def _zone(self, demand: Demand) -> _Zone:
        """The samples of a zone, carried from the structure that it is on where that is another one."""
        if demand.on in ("", self.target.structure_id):
            return _Zone(self.patches(demand.where))
        source = self._structure(demand.on)
        settings = settings_for("recommended")
        known = settings, self._memo, self._faces
        found = carried_zone(demand.where, source, self.target, self.surface, *known)
        said = f"carried from {demand.on}"
        said += f" with probability {found.probability:.2f}" if np.isfinite(found.probability) else ""
        said += f", {found.lost_pct:.0f} % of it has no counterpart" if found.lost_pct >= 1 else ""
        return _Zone(found.patches, True, found.probability, said)

    @cached_property
    def _skin(self) -> Ints:
        return skin_parts(self.target, scene_of(self.target), self.surface).label

    @cached_property
    def _attainable(self) -> Bools:
        route = settings_for("recommended").route
        around = self.target.surroundings
        airspace = Airspace(self.scene, route.clearance_m, around, route.ground_clearance_m)
        return attainable(self.surface, airspace, self.camera, TRULY)
