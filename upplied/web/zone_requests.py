"""Zones of the structure that is open in the studio: drawn, required, and judged for a plan."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.catalog.verbs import required
from upplied.checks import check_id
from upplied.errors import InputError
from upplied.fleet.editing import Editing
from upplied.outputs.display import packed
from upplied.proof.asking import Asking
from upplied.records import Floats, Plan
from upplied.web.requests import signed, text_of


class ZoneRequests:
    """Requests about zones of the target of one plan.

    Parameters
    ----------
    catalog : Catalog
    editing : Editing
        The plan, opened.
    origin : array, shape (3,), m
        What coordinates of the page are relative to.
    """

    def __init__(self, catalog: Catalog, editing: Editing, origin: Floats) -> None:
        self._catalog, self._editing, self._origin = catalog, editing, origin

    def drawn(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """The samples of a zone that is described, to be drawn."""
        patches = self._asking.patches(text_of(request, "where"))
        points = (self._editing.surface.points[patches] - self._origin).astype(np.float32)
        return {"points": packed(points), "share_pct": 100 * float(patches.mean())}

    def require(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Require a zone of the structure: the next version of a set, with the zones that it had."""
        by, note = signed(request)
        name, target = check_id(text_of(request, "set"), "name of requirements"), self._editing.target
        zone = request.get("zone")
        if not isinstance(zone, Mapping):
            raise InputError("the zone", "is not described", "a name, a place and the required quality")
        self._asking.patches(str(zone.get("where", "")))  # one that names no surface is refused
        table = self._catalog.requirements()
        own = (table["scope"] == "structure") & (table["owner"] == target.structure_id)
        before = table[own & (table["name"] == name)]
        zones = [] if before.empty else json.loads(before.iloc[-1]["zones_json"])
        zones = [each for each in zones if each["zone"] != zone.get("zone")] + [dict(zone)]
        self._catalog.require("structure", target.structure_id, name, zones, by, note)
        for cached in ("_asking", "_required"):
            self.__dict__.pop(cached, None)
        count = f"{len(zones)} zone{'s' if len(zones) > 1 else ''}"
        return {"message": f"Set {name} of {target.structure_id} now requires {count}."}

    def judged(self, plan: Plan) -> list[dict[str, Any]]:
        """What becomes of each required zone by a plan."""
        if not self._required:
            return []
        return list(self._asking.judged(self._asking.planned(plan, self._asking.camera)))

    @cached_property
    def _required(self) -> list[dict[str, Any]]:
        target = self._editing.target
        return list(required.zones_of(self._catalog, target.kind, target.structure_id))

    @cached_property
    def _asking(self) -> Asking:
        editing, camera = self._editing, self._editing.recipe.demonstration.camera
        known = editing.stored.plan.supposed, camera, self._required, self._catalog.faces_labelled
        return Asking(self._catalog.structure, self._catalog.cache, editing.target, *known)
