"""The pages of a report folder, built from the catalog on request."""

from __future__ import annotations

import io
import threading
import zipfile
from functools import lru_cache

import numpy as np

from upplied.catalog import Catalog
from upplied.config import CloudSettings, settings_for
from upplied.errors import CatalogError
from upplied.findings.queries import kind_map
from upplied.geometry.scene import Scene
from upplied.outputs.missions import FORMATS
from upplied.outputs.pairs import Pair
from upplied.outputs.publish import PAGES
from upplied.outputs.render import mission_files
from upplied.outputs.site import Site
from upplied.planning.surface.samples import surface_samples
from upplied.proof.inspected import pictured
from upplied.records import Camera, Cloud, Structure, Trajectory
from upplied.web.requests import Decisions


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
        """A page, a structure's script or a picture, as in a report folder.

        Raises
        ------
        CatalogError
            If there is nothing of that name.
        """
        with self._lock:
            tables = {name: table.delta() for name, table in self.catalog.tables.items()}
            versions = {name: -1 if delta is None else delta.version() for name, delta in tables.items()}
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

        Raises
        ------
        UppliedError
            If the plan does not pass the gate.
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
    """Addresses of the missions of a pair whose plan is released."""
    plan = pair.main
    kinds = ("brief", *FORMATS) if plan.get("state") == "released" else ()
    return {kind: f"../missions/{plan['transfer_id']}/{kind}" for kind in kinds}
