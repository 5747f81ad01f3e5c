"""Checked contents of requests from our pages, and decisions about plans."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.catalog.verbs.ordering import unit_of
from upplied.checks import check_id
from upplied.errors import InputError
from upplied.fleet.editing import Editing
from upplied.outputs.display import packed
from upplied.outputs.zones import MissionZones
from upplied.records import Floats, Plan


class Decisions:
    """Decisions about the plans of a catalog."""

    def __init__(self, catalog: Catalog) -> None:
        self.catalog = catalog

    def last(self, transfer_id: str) -> str:
        """The last decision about the pair of a plan; empty if there is none."""
        rows = self.catalog.transfers(every=True, ids=[transfer_id]).to_dict("records")
        return self.catalog.standing().last.get(unit_of(rows[-1]), "") if rows else ""

    def decide(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Review, release or reject a plan.

        A release names the last decision on its page, ``known``; it is refused if there is a newer one.

        Raises
        ------
        UppliedError
            If the request cannot be read, or the decision is refused.
        """
        by, note = signed(request)
        decision, plan = request.get("decision"), self.catalog.find_transfer(str(request.get("id", "")))
        release = partial(self.catalog.release, after=str(request.get("known", "")))
        review, reject = self.catalog.review, self.catalog.reject
        acts: dict[str, Callable[..., object]] = {"reviewed": review, "released": release, "rejected": reject}
        if not isinstance(decision, str) or decision not in acts:
            raise InputError("the decision", f"is {str(decision)[:40]!r}", "reviewed, released or rejected")
        acts[decision](plan, by, note)
        message = f"Plan {plan} is {decision} by {by}."
        return {"id": plan, "message": message, "known": self.last(plan)}


def signed(request: Mapping[str, Any]) -> tuple[str, str]:
    """The name and the note in a request; a request without a name is refused."""
    by, note = request.get("by", ""), request.get("note", "")
    if not isinstance(by, str) or not isinstance(note, str) or not by.strip():
        raise InputError("the decision", "has no name", "who decides", "write your name")
    return by.strip(), note


def text_of(request: Mapping[str, Any], name: str) -> str:
    """The text of this name."""
    value = request.get(name)
    if not isinstance(value, str):
        raise InputError(name, "is not a text")
    return value


class ZoneRequests:
    """Requests about zones of the target of one open plan; coordinates are relative to `origin`, m."""

    def __init__(self, catalog: Catalog, editing: Editing, origin: Floats) -> None:
        self._catalog, self._editing, self._origin = catalog, editing, origin

    def drawn(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """The samples of a described zone, for drawing."""
        patches = self._zones.requirements.patches(text_of(request, "where"))
        points = (self._editing.surface.points[patches] - self._origin).astype(np.float32)
        return {"points": packed(points), "share_pct": 100 * float(patches.mean())}

    def require(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Require a zone of the structure, as the next version of a set with its earlier zones."""
        by, note = signed(request)
        name, target = check_id(text_of(request, "set"), "name of requirements"), self._editing.target
        zone = request.get("zone")
        if not isinstance(zone, Mapping):
            raise InputError("the zone", "is not described", "a name, a place and the required quality")
        self._zones.requirements.patches(str(zone.get("where", "")))  # one that names no surface is refused
        table = self._catalog.requirements()
        own = (table["scope"] == "structure") & (table["owner"] == target.structure_id)
        before = table[own & (table["name"] == name)]
        zones = [] if before.empty else json.loads(before.iloc[-1]["zones_json"])
        zones = [each for each in zones if each["zone"] != zone.get("zone")] + [dict(zone)]
        self._catalog.require("structure", target.structure_id, name, zones, by, note)
        del self._zones  # those of the next request are read again
        count = f"{len(zones)} zone{'s' if len(zones) > 1 else ''}"
        return {"message": f"Set {name} of {target.structure_id} now requires {count}."}

    def judged(self, plan: Plan) -> list[dict[str, Any]]:
        """The result of each required zone for a plan."""
        return self._zones.judged(plan=plan)

    @cached_property
    def _zones(self) -> MissionZones:
        editing = self._editing
        plan, camera = editing.stored.plan, editing.recipe.demonstration.camera
        return MissionZones(self._catalog, plan, editing.target, camera)
