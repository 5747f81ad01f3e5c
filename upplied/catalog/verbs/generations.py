"""Generations of published tables: what one holds, which may follow, and how it becomes the current one.

``published.json`` tells its catalog, how far that had come, and what each file was made from.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import uuid
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from upplied.catalog.schema.tables import TABLES
from upplied.errors import CatalogError
from upplied.files import sync_path

_NAME = re.compile(r"g\d{6,}")
_ABOUT = "published.json"


@dataclass
class Generation:
    """What one generation holds."""

    catalog: str = ""  # its name; empty where an older program made it
    versions: dict[str, int] = field(default_factory=dict)  # of the catalog's tables, at least
    rows: dict[str, int] = field(default_factory=dict)
    parts: dict[str, str] = field(default_factory=dict)  # file of a whole table -> what it was made from
    columns: str = ""  # hash of what the program knew of the tables; empty where an older one made it

    def has_same(self, name: str, before: Generation | None) -> bool:
        """Whether a table is, by its version, as it was published before; if so, it is noted as it was."""
        file = f"{name}.parquet"
        if (
            before is None
            or (before.catalog, before.columns) != (self.catalog, self.columns)
            or before.versions.get(name, -1) != self.versions[name]
            or file not in before.parts
        ):
            return False
        self.parts[file], self.rows[name] = before.parts[file], before.rows[name]
        return True


def check(place: Path, before: Generation, now: Generation, transfers: int) -> None:
    """Refuse to replace what must not be replaced."""
    remedy = "publish into another folder, or replace it with --force"
    if before.catalog and now.catalog and before.catalog != now.catalog:
        raise CatalogError(str(place), "holds the publication of another catalog", "", remedy)
    newer = [name for name, version in before.versions.items() if version > now.versions.get(name, -1)]
    if newer:
        fault = f"holds a newer publication: {', '.join(newer)} had come further than the catalog has now"
        raise CatalogError(str(place), fault, "an older state never replaces a newer one", remedy)
    if before.rows.get("transfers", 0) and not transfers:
        fault = f"holds {before.rows['transfers']} transfers, the catalog has none"
        raise CatalogError(str(place), fault, "a publication does not shrink to nothing", remedy)


class Before:
    """The files of the generation before in a folder of generations, for those that take its place."""

    def __init__(self, tables: Path, generation: Generation | None) -> None:
        self._generation, self._place = generation, (tables / "current").resolve()
        folders = os.walk(self._place) if generation is not None else ()
        # As texts, and a folder once: a large fleet has a thousand files.
        above = len(f"{self._place}/")
        self._files = {f"{folder}/{name}"[above:] for folder, _, names in folders for name in names}
        self._folders = set[str]()
        self._named = {file.rpartition("-")[0]: file for file in self._files if "-" in file}

    def linked(self, draft: Path, file: str, now: Generation) -> bool:
        """Whether a file was published before, made from the same, and now is in the draft as well."""
        parts = self._generation.parts if self._generation is not None else {}
        if file not in self._files or parts.get(file, "") != now.parts.get(file, ""):
            return False
        there, goal = f"{self._place}/{file}", f"{draft}/{file}"
        if (folder := os.path.dirname(goal)) not in self._folders:
            os.makedirs(folder, exist_ok=True)
            self._folders.add(folder)
        try:
            os.link(there, goal)
        except OSError:  # a disk without links
            shutil.copy2(there, goal)
        return True

    def like(self, file: str) -> Path | None:
        """The file of the same name but for the hash at its end, where there is one."""
        name = self._named.get(file.rpartition("-")[0])
        return self._place / name if name else None

    def is_as(self, now: Generation, parted: Iterable[str]) -> bool:
        """Whether it holds what a generation holds, and these files that are named by what they hold."""
        was = self._generation
        return (
            was is not None
            and was.catalog == now.catalog
            and now.parts.items() <= was.parts.items()
            and self._files == {_ABOUT, *now.parts, *parted}
        )


def switch(place: Path, draft: Path, now: Generation) -> None:
    """Make the draft the current generation, in one step once all of it is on the disk."""
    tables = place / "tables"
    with (draft / _ABOUT).open("w") as sink:
        json.dump(asdict(now), sink, indent=0, sort_keys=True)
        sink.flush()
        os.fsync(sink.fileno())
    for folder, _, _ in os.walk(draft):
        sync_path(Path(folder))
    name = f"g{max([int(path.name[1:]) for path in _generations(tables)], default=0) + 1:06d}"
    os.replace(draft, tables / name)
    _link(tables / "current", name)
    for table in TABLES:
        file = place / f"{table}.parquet"
        if not file.is_symlink():
            _link(file, f"tables/current/{file.name}")
    sync_path(tables)
    clean(tables)


def _link(path: Path, to: str) -> None:
    """Make or turn a link in one step."""
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.draft")
    os.symlink(to, draft)
    os.replace(draft, path)


def _generations(tables: Path) -> list[Path]:
    """The folders of generations, oldest first."""
    folders = [path for path in tables.glob("g*") if _NAME.fullmatch(path.name) and path.is_dir()]
    return sorted(folders, key=lambda path: int(path.name[1:]))


def clean(tables: Path) -> None:
    """Remove what stopped publishers left, and all generations but the current one and the one before."""
    for path in [*tables.glob(".*.draft"), *tables.parent.glob(".*.parquet.*.draft")]:
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)
    current = (tables / "current").resolve()
    names = _generations(tables)
    lasting = names[max(0, names.index(current) - 1) :] if current in names else names
    for path in names:
        if path not in lasting or (current in names and names.index(path) > names.index(current)):
            shutil.rmtree(path)  # older, or never switched to


def current(place: Path) -> Generation | None:
    """What is published there; None where nothing is, or an older program published it."""
    path = place / "tables" / "current" / _ABOUT
    try:
        known: Any = json.loads(path.read_text("utf-8"))
        versions, rows, parts = (dict(known[name]) for name in ("versions", "rows", "parts"))
        return Generation(str(known["catalog"]), versions, rows, parts, str(known.get("columns", "")))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        remedy = f"remove {path.parents[1]} and publish again"
        raise CatalogError(str(path), f"is damaged: {error}", "", remedy) from None
