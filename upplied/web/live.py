"""The pages of a report folder, built from the catalog on request, and checked decisions about plans."""

import io
import json
import threading
import zipfile
from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.catalog.verbs.ordering import unit_of
from upplied.checks import check_id
from upplied.config import CloudSettings, settings_for
from upplied.errors import CatalogError, InputError
from upplied.findings.queries import kind_map
from upplied.fleet.editing import Editing
from upplied.geometry.scene import Scene
from upplied.outputs.display import packed
from upplied.outputs.missions import FORMATS
from upplied.outputs.pairs import Pair
from upplied.outputs.publish import PAGES
from upplied.outputs.render import mission_files
from upplied.outputs.site import Site
from upplied.outputs.zones import MissionZones
from upplied.planning.surface.samples import surface_samples
from upplied.proof.inspected import pictured
from upplied.records import Camera, Cloud, Floats, Plan, Structure, Trajectory


class Decisions:
    def __init__(self, catalog: Catalog) -> None:
        self.catalog = catalog

    def last(self, transfer_id: str) -> str:
        rows = self.catalog.transfers(every=True, ids=[transfer_id]).to_dict("records")
        return self.catalog.standing().last.get(unit_of(rows[-1]), "") if rows else ""

    def decide(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Review, release or reject a plan, or say why not in an `UppliedError`.

        A release names the last decision on its page, ``known``; it is refused if there is a newer one.
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
    by, note = request.get("by", ""), request.get("note", "")
    if not isinstance(by, str) or not isinstance(note, str) or not by.strip():
        raise InputError("the decision", "has no name", "who decides", "write your name")
    return by.strip(), note


def text_of(request: Mapping[str, Any], name: str) -> str:
    value = request.get(name)
    if not isinstance(value, str):
        raise InputError(name, "is not a text")
    return value


class ZoneRequests:
    """Requests about zones of the target of one open plan; coordinates are relative to `origin`, m."""

    def __init__(self, catalog: Catalog, editing: Editing, origin: Floats) -> None:
        self._catalog, self._editing, self._origin = catalog, editing, origin

    def drawn(self, request: Mapping[str, Any]) -> dict[str, Any]:
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
        return self._zones.judged(plan=plan)

    @cached_property
    def _zones(self) -> MissionZones:
        plan, camera = self._editing.stored.plan, self._editing.recipe.demonstration.camera
        return MissionZones(self._catalog, plan, self._editing.target, camera)


def warm() -> None:
    """Load the ray caster and compiled functions for the first page of a plan, with one triangle."""
    corners = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 1.0]])
    structure = Structure("warm", "warm", corners, np.array([[0, 1, 2]]))
    scene, still = Scene(corners, structure.triangles), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    path, front = Trajectory(np.arange(2.0), np.zeros((2, 3)), still), np.array([[-1.0, 0.0, 0.0]])
    pictured(path, Cloud(corners[:1], front), Camera(), scene, settings_for("recommended").inspection)
    surface_samples(structure, scene, CloudSettings(surface_samples=100))  # for the roadmap of transit legs


class LivePages:
    """Answers the requests of browsers one by one; results are cached until the catalog changes."""

    def __init__(self, catalog: Catalog) -> None:
        self.catalog = catalog
        self._lock = threading.RLock()
        self._versions: dict[str, int] | None = None

    def page(self, room: str, name: str = "") -> str | bytes:
        """A page, a structure's script or a picture, as in a report folder; else a `CatalogError`."""
        with self._lock:
            deltas = {name: table.delta() for name, table in self.catalog.tables.items()}
            versions = {name: -1 if delta is None else delta.version() for name, delta in deltas.items()}
            if self._versions != versions:
                self._versions, site = versions, Site(self.catalog, PAGES, kind_map, live=True)
                site.mapped = sorted(set(self.catalog.findings()["kind"]))
                site.missions = {pair.name: _missions(pair) for pair in site.pairs}
                site.decision = Decisions(self.catalog).last
                self._content = lru_cache(64)(site.content)
                self._thumbnail = lru_cache(2000)(site.content)
            return (self._thumbnail if room == "thumbnails" else self._content)(room, name)

    def mission(self, transfer_id: str, kind: str) -> tuple[str, bytes]:
        """Name and content of a mission with the usual options, through the gate, or of the pilot's brief.

        Several sorties come as one archive.
        """
        plan = self.catalog.find_transfer(transfer_id)
        if kind not in ("brief", *FORMATS):
            raise CatalogError(kind[:40], "is not a mission format", ", ".join(FORMATS))
        with self._lock:
            files = mission_files(self.catalog, plan, kind)
        if len(files) == 1:
            return files[0]
        archive = io.BytesIO()
        with zipfile.ZipFile(archive, "w") as together:
            for name, content in files:
                together.writestr(name, content)
        return f"{plan}.zip", archive.getvalue()


def _missions(pair: Pair) -> dict[str, str]:
    plan = pair.main
    kinds = ("brief", *FORMATS) if plan.get("state") == "released" else ()
    return {kind: f"../missions/{plan['transfer_id']}/{kind}" for kind in kinds}
