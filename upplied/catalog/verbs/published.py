"""The plain Parquet that a run publishes: current rows only, for any program, one generation at a time.

``tables/`` holds generations and ``current``, a link that is switched in one step; ``transfers.parquet``
and the others lead through it. What did not change is linked from the generation before, which stays for
its readers. ``published.json`` tells its catalog, how far that had come, and how the files are cut.
"""

import json
import os
import re
import shutil
import uuid
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from upplied.catalog.database import Catalog
from upplied.catalog.schema.tables import SCHEMA_VERSION, TABLES, Table
from upplied.catalog.store.chain import decoded
from upplied.catalog.store.files import locked
from upplied.catalog.verbs import parted
from upplied.config import digest
from upplied.errors import CatalogError
from upplied.files import sync_path

_ROW_GROUP = 16_384
#: What a publication says depends on these, too: a newer program knows more columns.
_COLUMNS = digest([SCHEMA_VERSION, {name: table.names for name, table in TABLES.items()}])
_GENERATION = re.compile(r"g\d{6,}")
_ABOUT = "published.json"


def export_tables(catalog: Catalog, folder: str | os.PathLike[str], force: bool = False) -> dict[str, int]:
    """Publish the current rows of every table as Parquet: ``transfers.parquet`` and so on.

    Parameters
    ----------
    catalog : Catalog
    folder : path
        Made where it does not exist.
    force : bool
        Also replace a publication that is newer, of another catalog, or would shrink to nothing.

    Returns
    -------
    dict
        Rows published, by table.

    Raises
    ------
    CatalogError
        If the folder cannot be written, holds what must not be replaced, or a trajectory is damaged.
        What was published still is.

    Notes
    -----
    Transfers are the newest plan of each demonstration, target and preset, but the one in force where a
    person released one; the others stay in the catalog. Waypoints and poses are those of the published
    rows. The rows that name steps are read before the steps, so no trajectory is published without its
    points.
    """
    catalog.identity.required()
    place = local_folder(folder)
    with locked(place):
        return publish_generation(catalog, place, force)


def local_folder(folder: str | os.PathLike[str]) -> Path:
    """A folder to publish into; object stores are refused."""
    text = os.fspath(folder)
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", text):
        remedy = "publish into a folder and copy it there, as with: aws s3 sync"
        raise CatalogError(text, "is no folder", "reports are published into a folder", remedy)
    return Path(text)


def published_tables(folder: str | os.PathLike[str]) -> dict[str, Path]:
    """Where the tables of the current generation lie: paths that stay as they are while others publish.

    Raises
    ------
    CatalogError
        If nothing is published there.
    """
    place = Path(folder) / "tables" / "current"
    if not place.exists():
        raise CatalogError(str(folder), "nothing is published there")
    place = place.resolve()
    return {name: path for name in TABLES if (path := place / f"{name}.parquet").exists()}


def publish_generation(catalog: Catalog, place: Path, force: bool) -> dict[str, int]:
    """As `export_tables`, by who holds the lock of the folder."""
    before, now = current(place), Generation(catalog.identity.required(), columns=_COLUMNS)
    was = Before(tables := place / "tables", before)
    for name, table in catalog.tables.items():  # before the rows are read: they are at least as new
        now.versions[name], now.added[name] = table.newest()
    if was.is_newest(now):
        return {name: before.rows[name] for name in TABLES if name in before.rows}
    plans, same = parted.plans_of(catalog, was, now)
    frames = {"demonstrations": catalog.demonstrations(), "structures": catalog.structures()}
    now.rows = {name: sum(weights.values()) for name, weights in now.weights.items()}
    if not force:
        check(place, before, now, now.rows["transfers"])
    files = parted.files_of(now, plans, frames)
    draft = tables / f".{uuid.uuid4().hex[:8]}.draft"
    try:
        clean(tables)
        draft.mkdir(parents=True)
        for name in [table for table in TABLES if table not in files]:
            file = f"{name}.parquet"
            if now.has_same(name, before) and was.linked(draft, file):
                now.rows[name] = before.rows[name]
                continue
            reader = "declared_settings" if name == "settings" else name
            frame = frames[name] if name in frames else getattr(catalog, reader)()
            rows = pa.Table.from_pandas(frame, TABLES[name].schema, preserve_index=False)
            now.rows[name] = write(draft / file, TABLES[name], [rows])
        for file in same:
            was.linked(draft, file)
        for name, by_file in files.items():
            new = {file: rows for file, rows in sorted(by_file.items()) if not was.linked(draft, file)}
            for file, steps in parted.rows_of(catalog, was, name, new):
                write(draft / file, TABLES[name], [steps])
        now.rows["poses"] = int(frames["demonstrations"]["n_poses"].sum())
        switch(place, draft, now)
    except OSError as error:
        remedy = "free space or rights; what was there still is"
        raise CatalogError(str(place), f"cannot be written: {error}", "", remedy) from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return {name: now.rows[name] for name in TABLES if name in now.rows}


def write(path: Path, declared: Table, parts: Iterable[pa.Table]) -> int:
    """Write a table as a Parquet file that is on the disk when this returns; its rows."""
    about = {"schema_version": str(SCHEMA_VERSION), "table": declared.name, "meaning": declared.meaning}
    schema, count = declared.schema.with_metadata(about), 0
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        with pq.ParquetWriter(file, schema, compression="zstd") as writer:
            for rows in parts:
                for at in range(0, len(rows), _ROW_GROUP):  # decoded so many at a time
                    writer.write_table(decoded(rows.slice(at, _ROW_GROUP)).select(schema.names).cast(schema))
                count += len(rows)
        file.flush()
        os.fsync(file.fileno())
    return count


@dataclass
class Generation:
    """What one generation holds."""

    catalog: str = ""  # its name; empty where an older program made it
    versions: dict[str, int] = field(default_factory=dict)  # of the catalog's tables, at least
    rows: dict[str, int] = field(default_factory=dict)
    columns: str = ""  # hash of what the program knew of the tables; empty where an older one made it
    added: dict[str, int] = field(default_factory=dict)  # which rows were each table's last, at least
    weights: dict[str, dict[str, int]] = field(default_factory=dict)  # table -> kind -> rows or steps
    files: int = 0

    def has_same(self, name: str, before: "Generation") -> bool:
        """Whether a table has the rows that were published before, and this program says the same of them."""
        now, then = ((one.catalog, one.columns, one.added.get(name)) for one in (self, before))
        return now == then


def check(place: Path, before: Generation, now: Generation, transfers: int) -> None:
    """Refuse to replace what must not be replaced."""
    remedy = "publish into another folder, or replace it with --force"
    if before.catalog and now.catalog and before.catalog != now.catalog:
        raise CatalogError(str(place), "holds the publication of another catalog", "", remedy)
    if newer := [name for name, version in before.versions.items() if version > now.versions.get(name, -1)]:
        fault = f"holds a newer publication: {', '.join(newer)} had come further than the catalog has now"
        raise CatalogError(str(place), fault, "an older state never replaces a newer one", remedy)
    if before.rows.get("transfers", 0) and not transfers:
        fault = f"holds {before.rows['transfers']} transfers, the catalog has none"
        raise CatalogError(str(place), fault, "a publication does not shrink to nothing", remedy)


class Before:
    """The files of the generation before in a folder of generations, for those that take its place."""

    def __init__(self, tables: Path, generation: Generation) -> None:
        self.generation, self._place = generation, (tables / "current").resolve()
        # As texts, and a folder once: a large fleet has a thousand files.
        above, folders = len(f"{self._place}/"), os.walk(self._place)
        self.files = {f"{folder}/{name}"[above:] for folder, _, names in folders for name in names}
        self._folders = set[str]()
        self._named = {file.rpartition("-")[0]: file for file in self.files if "-" in file}

    def linked(self, draft: Path, file: str) -> bool:
        """Whether a file of this name was published before, and now is in the draft as well."""
        if file not in self.files:
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

    def is_newest(self, now: Generation) -> bool:
        """Whether it has all rows that there are, and all its files are there."""
        every = len(self.files) == self.generation.files
        return every and all(now.has_same(name, self.generation) for name in now.added)


def switch(place: Path, draft: Path, now: Generation) -> None:
    """Make the draft the current generation, in one step once all of it is on the disk."""
    tables, folders = place / "tables", list(os.walk(draft))
    now.files = 1 + sum(len(files) for _, _, files in folders)
    with (draft / _ABOUT).open("w") as sink:
        older = {"parts": dict[str, str]()}  # in which a program before looks for what is the same: nothing
        json.dump({**asdict(now), **older}, sink, indent=0, sort_keys=True)
        sink.flush()
        os.fsync(sink.fileno())
    for folder, _, _ in folders:
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
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}.draft")
    os.symlink(to, draft)
    os.replace(draft, path)


def _generations(tables: Path) -> list[Path]:
    folders = [path for path in tables.glob("g*") if _GENERATION.fullmatch(path.name) and path.is_dir()]
    return sorted(folders, key=lambda path: int(path.name[1:]))


def clean(tables: Path) -> None:
    """Remove what stopped publishers left, and all generations but the current one and the one before."""
    for path in [*tables.glob(".*.draft"), *tables.parent.glob(".*.parquet.*.draft")]:
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)
    names = _generations(tables)
    if (current := (tables / "current").resolve()) in names:
        at = names.index(current)
        for path in [*names[: max(0, at - 1)], *names[at + 1 :]]:  # older, or never switched to
            shutil.rmtree(path)


def current(place: Path) -> Generation:
    """What is published there; nothing where nothing is, or an older program published it."""
    path = place / "tables" / "current" / _ABOUT
    try:
        known: Any = json.loads(path.read_text("utf-8"))
        versions, rows = (dict(known[name]) for name in ("versions", "rows"))
        added, weights = (dict(known.get(name, {})) for name in ("added", "weights"))
        about = str(known.get("columns", "")), added, weights, int(known.get("files", 0))
        return Generation(str(known["catalog"]), versions, rows, *about)
    except FileNotFoundError:
        return Generation()
    except (OSError, ValueError, KeyError, TypeError) as error:
        remedy = f"remove {path.parents[1]} and publish again"
        raise CatalogError(str(path), f"is damaged: {error}", "", remedy) from None
