"""Checks of everything that a catalog holds against what its rows say."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pyarrow as pa

from upplied.catalog.schema.columns import Column
from upplied.catalog.schema.plan_rows import settings_text
from upplied.catalog.schema.steps import unlike
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.surfaces import SURFACES
from upplied.catalog.verbs.owned import owned_steps
from upplied.catalog.verbs.recipes import settings_of
from upplied.errors import CatalogError, UppliedError

if TYPE_CHECKING:
    from upplied.catalog.database import Catalog

_NAMED = 5  # ids that a finding names; it counts the others


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
    frames = {
        "structures": catalog.structures(every=True),
        "demonstrations": catalog.demonstrations(every=True),
        "transfers": catalog.transfers(every=True),
        "flights": catalog.flights(),
        "decisions": catalog.decisions(),
        "overruled": catalog.overruled(),
    }
    found: list[Finding] = []
    for name, frame in frames.items():
        found += broken_values(name, frame)
    found += _references(frames)
    found += _meshes(catalog, frames["structures"])
    found += _contents(catalog, frames["transfers"])
    found += _settings(frames["transfers"])
    found += _steps(catalog, "poses", frames["demonstrations"])
    found += _steps(catalog, "waypoints", frames["transfers"])
    return found


def broken_values(name: str, frame: pd.DataFrame) -> Iterator[Finding]:
    """Values against the constraints of their columns."""
    key = frame[frame.columns[0]]
    for column in TABLES[name].columns:
        bad = _broken(column, frame[column.name])
        if bad.any():
            first = str(frame[column.name][bad].iloc[0])
            yield Finding(
                f"{name}.{column.name}", f"{first!r} is not {column.constraint}, in {_some(key[bad])}"
            )


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
        for name, rows in lost.groupby(column):
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
        *((catalog.surfaces.get, transfers.groupby(column)["transfer_id"]) for column in SURFACES),
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
    for (text, sha256), rows in transfers.groupby(["settings_json", "settings_sha256"]):
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
    counts = _counts(catalog, name)
    there = [
        counts.get((row_id, commit), 0)
        for row_id, commit in zip(owners[key], owners["commit_id"], strict=True)
    ]
    wrong = owners[np.array(there, int) != owners[count].to_numpy()]
    for row_id, commit, said in wrong[[key, "commit_id", count]].itertuples(index=False):
        yield Finding(f"{name} of {row_id}", f"{counts.get((row_id, commit), 0)} steps, the row says {said}")
    whole = owners.drop(wrong.index).sort_values(key)
    hashes = dict(zip(zip(whole[key], whole["commit_id"], strict=True), whole[f"{name}_sha256"], strict=True))
    for steps in owned_steps(catalog, name, whole):
        for row_id, wrong_here in unlike(name, steps, hashes):
            yield Finding(f"{name} of {row_id}", wrong_here)


def _counts(catalog: Catalog, name: str) -> Counter[tuple[str, str]]:
    """How many steps each owner and commit has; read in batches, since there may be many."""
    key = TABLES[name].names[0]
    counts: Counter[tuple[str, str]] = Counter()
    for rows in catalog.tables[name].batches([key, "commit_id"]):
        grouped = rows.group_by([key, "commit_id"]).aggregate([([], "count_all")])
        for row in grouped.to_pylist():
            counts[row[key], row["commit_id"]] += row["count_all"]
    return counts


def _some(names: pd.Series) -> str:
    listed = [str(name) for name in names.unique()]
    more = f" and {len(listed) - _NAMED} more" if len(listed) > _NAMED else ""
    return ", ".join(listed[:_NAMED]) + more
