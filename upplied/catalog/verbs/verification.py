"""Checks of everything that a catalog holds against what its rows say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pandas as pd
import pyarrow as pa

from upplied.catalog.schema.columns import Column
from upplied.catalog.schema.plan_rows import settings_text
from upplied.catalog.schema.steps import unlike
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.surfaces import SURFACES
from upplied.catalog.verbs.owned import stored_steps
from upplied.catalog.verbs.recipes import settings_of
from upplied.catalog.verbs.standing import DERIVED
from upplied.errors import CatalogError, UppliedError

if TYPE_CHECKING:
    from upplied.catalog.database import Catalog

_NAMED = 5  # ids that a finding names; it counts the others
_CONTENTS = ("settings_json", "settings_sha256", *SURFACES)
#: What of every plan is held at once; all else is looked at some rows at a time.
_OF_PLANS = [
    *("transfer_id", "demonstration_id", "source_id", "target_id"),
    *("commit_id", "n_waypoints", "waypoints_sha256", *_CONTENTS),
]


@dataclass(frozen=True)
class Finding:
    """One thing that is not as it should be."""

    what: str
    found: str

    def __str__(self) -> str:
        return f"{self.what}: {self.found}"


def verify(catalog: Catalog) -> list[Finding]:
    """Check every row, count, reference and hash; an empty list means that all is well.

    Rows are those of every version, not of the current ones alone. Only what is committed counts:
    points that a stopped writer left behind are no finding.
    """
    plans = catalog.tables["transfers"]
    reads: dict[str, Callable[[], pd.DataFrame]] = {
        "structures": lambda: catalog.structures(every=True),
        "demonstrations": lambda: catalog.demonstrations(every=True),
        "transfers": lambda: plans.narrow(_OF_PLANS).to_pandas(),
        "flights": catalog.flights,
        "decisions": catalog.decisions,
        "overruled": catalog.overruled,
    }
    catalog.identity.required()
    found: list[Finding] = []
    frames: dict[str, pd.DataFrame] = {}
    for name, read in reads.items():
        try:
            frames[name] = read()
        except CatalogError as error:
            found.append(_unreadable(error))
    if found:  # what refers to a table that cannot be read cannot be judged
        return found
    for name, frame in frames.items():
        if name == "transfers":  # of which there may be a million, of kilobytes each
            columns = [column for column in plans.declared.names if column not in DERIVED]
            found += _read(broken_values(name, (rows.to_pandas() for rows in plans.batches(columns))))
        else:
            found += broken_values(name, [frame])
    found += _references(frames)
    found += _meshes(catalog, frames["structures"])
    found += _contents(catalog, frames["transfers"])
    found += _settings(frames["transfers"])
    found += _read(_steps(catalog, "poses", frames["demonstrations"]))
    found += _read(_steps(catalog, "waypoints", frames["transfers"]))
    return found


def _unreadable(error: CatalogError) -> Finding:
    return Finding(error.what, f"{error.found}; {error.remedy}" if error.remedy else error.found)


def _read(findings: Iterable[Finding]) -> Iterator[Finding]:
    """Findings as far as their table can be read, and where it cannot."""
    try:
        yield from findings
    except CatalogError as error:
        yield _unreadable(error)


def broken_values(name: str, parts: Iterable[pd.DataFrame]) -> Iterator[Finding]:
    """Values of the rows of a table, some at a time, against the constraints of their columns."""
    broken: dict[str, tuple[str, Column, list[pd.Series]]] = {}  # column -> first value, and what has such
    for frame in parts:
        for column in TABLES[name].columns:
            if column.name not in frame:
                continue
            bad = _broken(column, frame[column.name])
            if bad.any():
                first = str(frame[column.name][bad].iloc[0])
                broken.setdefault(column.name, (first, column, []))[2].append(frame[frame.columns[0]][bad])
    for first, column, keys in broken.values():
        found = f"{first!r} is not {column.constraint}, in {_some(pd.concat(keys))}"
        yield Finding(f"{name}.{column.name}", found)


def _broken(column: Column, values: pd.Series) -> pd.Series:
    missing = values.isna() | (values == "" if pa.types.is_string(column.type) else False)
    bad = missing if column.required else missing & False
    if column.allowed:
        bad = bad | ~(values.isin(column.allowed) | missing)
    if column.low is not None:
        bad = bad | (values < column.low)
    if column.high is not None:
        bad = bad | (values > column.high)
    return bad


def _references(frames: dict[str, pd.DataFrame]) -> Iterator[Finding]:
    """Names of structures and demonstrations that are not there."""
    known = {
        "structures": set(frames["structures"]["structure_id"]),
        "demonstrations": set(frames["demonstrations"]["demonstration_id"]),
        "transfers": set(frames["transfers"]["transfer_id"]),
    }
    for table, column, to in (
        ("demonstrations", "structure_id", "structures"),
        ("transfers", "demonstration_id", "demonstrations"),
        ("transfers", "source_id", "structures"),
        ("transfers", "target_id", "structures"),
        *((table, "transfer_id", "transfers") for table in ("flights", "decisions", "overruled")),
    ):
        lost = frames[table][~frames[table][column].isin(known[to])]
        for name, rows in lost.groupby(column, observed=True):
            yield Finding(f"{table}.{column}", f"{name} is not in {to}; named by {_some(rows.iloc[:, 0])}")


def _meshes(catalog: Catalog, structures: pd.DataFrame) -> Iterator[Finding]:
    for sha256, rows in structures.groupby("mesh_sha256"):
        try:
            mesh = catalog.meshes.get(sha256)
        except CatalogError as error:
            yield Finding(error.what, f"{error.found}; the mesh of {_some(rows['structure_id'])}")
            continue
        counts = (len(mesh.vertices), len(mesh.triangles))
        wrong = rows[(rows["n_vertices"] != counts[0]) | (rows["n_triangles"] != counts[1])]
        if len(wrong):
            yield Finding(
                f"mesh {sha256}", f"has {counts} parts, not as said of {_some(wrong['structure_id'])}"
            )


def _contents(catalog: Catalog, transfers: pd.DataFrame) -> Iterator[Finding]:
    """What plans see and what was flown, each read and compared with its hash."""
    flights = catalog.flights()
    for read, named in (
        *(
            (catalog.surfaces.get, transfers.groupby(column, observed=True)["transfer_id"])
            for column in SURFACES
        ),
        (catalog.flown, flights.groupby("flight_sha256")["transfer_id"]),
        (catalog.looks.get, flights.groupby("looks_sha256")["transfer_id"]),
    ):
        for sha256, owners in named:
            try:
                if sha256:
                    read(sha256)
            except CatalogError as error:
                yield Finding(error.what, f"{error.found}; of {_some(owners)}")


def _settings(transfers: pd.DataFrame) -> Iterator[Finding]:
    """Settings that do not match their hash, where this program knows all of them."""
    for (text, sha256), rows in transfers.groupby(["settings_json", "settings_sha256"], observed=True):
        try:
            settings = settings_of(text)
        except (UppliedError, ValueError) as error:
            yield Finding(
                f"settings {sha256[:12]}", f"cannot be read: {error}; of {_some(rows['transfer_id'])}"
            )
            continue
        if settings.sha256 != sha256 and settings_text(settings) == text:
            yield Finding(f"settings {sha256[:12]}", f"do not match it; of {_some(rows['transfer_id'])}")


def _steps(catalog: Catalog, name: str, owners: pd.DataFrame) -> Iterator[Finding]:
    """Steps that are missing, too many, out of order, or not those whose hash the row keeps."""
    key, count = TABLES[name].names[0], f"n_{name}"
    owners = owners[owners[count] > 0].drop_duplicates([key, "commit_id"])
    for chunk, steps in stored_steps(catalog, name, owners):
        grouped = steps.group_by([key, "commit_id"]).aggregate([([], "count_all")])
        counts = {(row[key], row["commit_id"]): row["count_all"] for row in grouped.to_pylist()}
        rows = list(chunk[[key, "commit_id", count, f"{name}_sha256"]].itertuples(index=False, name=None))
        miscounted = set()
        for row_id, commit, said, _ in rows:
            if (there := counts.get((row_id, commit), 0)) != said:
                miscounted.add(row_id)
                yield Finding(f"{name} of {row_id}", f"{there} steps, the row says {said}")
        hashes = {(row_id, commit): sha256 for row_id, commit, _, sha256 in rows}
        for row_id, wrong in unlike(name, steps, hashes):
            if row_id not in miscounted:
                yield Finding(f"{name} of {row_id}", wrong)


def _some(names: pd.Series) -> str:
    listed = [str(name) for name in names.unique()]
    more = f" and {len(listed) - _NAMED} more" if len(listed) > _NAMED else ""
    return ", ".join(listed[:_NAMED]) + more
