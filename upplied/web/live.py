"""The pages of a report folder made when they are opened, from what the catalog holds now."""

from __future__ import annotations

import io
import tempfile
import threading
import zipfile
from functools import lru_cache
from pathlib import Path

import numpy as np

from upplied.catalog import Catalog
from upplied.config import settings_for
from upplied.errors import CatalogError
from upplied.findings.queries import kind_map
from upplied.geometry.scene import Scene
from upplied.outputs.findings_page import findings_html
from upplied.outputs.foremost import first_pairs
from upplied.outputs.missions import FORMATS
from upplied.outputs.page_html import fleet_html, pair_html, passport_html, structure_html
from upplied.outputs.pages import structure_script
from upplied.outputs.publish import PAGES, TITLE
from upplied.outputs.render import brief_transfer, export_transfer
from upplied.outputs.reports import Reader
from upplied.proof.pictured import pictured
from upplied.records import Camera, Cloud, Trajectory
from upplied.web.requests import Decisions


def warm() -> None:
    """Load what the first page of a plan needs, the ray caster and compiled functions, on one triangle."""
    corners = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 1.0]])
    scene, still = Scene(corners, np.array([[0, 1, 2]])), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    path, front = Trajectory(np.arange(2.0), np.zeros((2, 3)), still), np.array([[-1.0, 0.0, 0.0]])
    pictured(path, Cloud(corners[:1], front), Camera(), scene, settings_for("recommended").inspection)


class LivePages:
    """What a browser asks for, one request after the other; what was read stays until the catalog changes.

    Parameters
    ----------
    catalog : Catalog
    """

    def __init__(self, catalog: Catalog) -> None:
        self.catalog = catalog
        self._lock = threading.RLock()
        self._versions: dict[str, int] | None = None

    def page(self, room: str, name: str = "") -> str | bytes:
        """A page, a structure's script or a picture, as it lies in a report folder under this name.

        Raises
        ------
        CatalogError
            If there is nothing of that name.
        """
        with self._lock:
            tables = {name: table.delta() for name, table in self.catalog.tables.items()}
            versions = {name: -1 if delta is None else delta.version() for name, delta in tables.items()}
            if self._versions != versions:
                self._versions, self._reader = versions, Reader(self.catalog)
                pairs, self._count = first_pairs(self.catalog, PAGES)
                self._pairs = {pair.name: pair for pair in pairs}
                self._content = lru_cache(64)(self._new_content)
                self._thumbnail = lru_cache(2000)(self._reader.thumbnail)
            if room == "thumbnails":
                return self._thumbnail(name)
            return self._content(room, name)

    def mission(self, transfer_id: str, kind: str) -> tuple[str, bytes]:
        """Name and content of a mission with the usual options, through the gate, or of the pilot's brief.

        Several sorties come as one archive.

        Raises
        ------
        UppliedError
            If the plan does not pass the gate.
        """
        plan = self.catalog.find_transfer(transfer_id)
        with self._lock, tempfile.TemporaryDirectory() as folder:
            if kind == "brief":
                paths: tuple[Path, ...] = (
                    brief_transfer(self.catalog, plan, "qgc-plan", Path(folder, f"{plan}.html")),
                )
            elif kind in FORMATS:
                goal = Path(folder, f"{plan}{FORMATS[kind]}")
                paths = tuple(export_transfer(self.catalog, plan, kind, goal).paths)
            else:
                raise CatalogError(kind[:40], "is not a mission format", ", ".join(FORMATS))
            if len(paths) == 1:
                return paths[0].name, paths[0].read_bytes()
            archive = io.BytesIO()
            with zipfile.ZipFile(archive, "w") as together:
                for path in paths:
                    together.write(path, path.name)
            return f"{plan}.zip", archive.getvalue()

    def _new_content(self, room: str, name: str) -> str | bytes:
        reader, pairs = self._reader, list(self._pairs.values())
        if room == "":
            kinds = set(self.catalog.findings()["kind"])
            return fleet_html(reader, pairs, TITLE, self._count, live=True, mapped=kinds)
        if room == "findings":
            return findings_html(*kind_map(self.catalog, name), "../", live=True)
        if room == "data":
            return structure_script(reader.structure_data(name))
        if room == "structures":
            return structure_html(reader, name, pairs, live=True)
        if room == "demonstrations":
            return passport_html(reader, name, pairs, live=True)
        if name not in self._pairs:
            raise CatalogError(name[:150], "does not exist")
        pair = self._pairs[name]
        if room == "pictures":
            return reader.picture(pair)
        plan = str(pair.main["transfer_id"])
        missions = {kind: f"../missions/{plan}/{kind}" for kind in ("brief", *FORMATS)}
        released = pair.main.get("state") == "released"
        known = Decisions(self.catalog).last(plan)
        return pair_html(reader, pair, missions if released else {}, live=True, known=known)
