"""A part of a catalog as a folder that stands for itself (`dataset_files`); `importing` takes it in.

Trajectories also as text files of TUM's format, which ``evo`` reads, a line ``t x y z qx qy qz qw``: s, m,
camera frame (x forward) to structure frame; and how to split them for learning, as episodes: each with what
it is to do and how it did.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from upplied.catalog.database import Catalog
from upplied.catalog.schema import codec
from upplied.catalog.schema.rows import Row
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.contents import NAMED_CONTENTS, States, file_name
from upplied.catalog.store.files import replace_file
from upplied.catalog.verbs.custody import checked_steps
from upplied.catalog.verbs.dataset_files import describe, names_of, new_folder, with_path
from upplied.catalog.verbs.published import write
from upplied.errors import CatalogError, InputError
from upplied.records import Trajectory

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}-v[1-9][0-9]*")


def export_dataset(
    catalog: Catalog,
    folder: str | os.PathLike[str],
    name: str,
    transfers: pd.DataFrame | Sequence[str],
    licence: str,
    attribution: str = "",
) -> dict[str, int]:
    """Write some plans, with all they refer to, as a folder that stands for itself.

    Parameters
    ----------
    catalog : Catalog
    folder : path
        New, or empty.
    name : str
        With its version, as ``airliners-v1``.
    transfers : DataFrame or sequence of str
        Rows of `Catalog.transfers`, or names of plans.
    licence : str
        Under which the data may be used, as an SPDX name (``CC-BY-4.0``) or in words.
    attribution : str
        Whom to name.

    Returns
    -------
    dict
        Rows written, by table.
    """
    place = new_folder(folder)
    if not _NAME.fullmatch(name):
        raise InputError(f"dataset name {name[:80]!r}", "is not a name with a version", "like airliners-v1")
    if not licence.strip():
        raise InputError(f"dataset {name}", "has no licence", "say one, like CC-BY-4.0")
    names, every = set(names_of(transfers)), catalog.transfers(every=True)
    missing = sorted(names - set(every["transfer_id"]))
    if missing or not names:
        what = f"transfers {', '.join(missing[:5]) or '(none)'}"
        raise CatalogError(what, "are not in the catalog", "at least one that is")
    plans = every[every["transfer_id"].isin(names)]
    demonstrations = _only(catalog.demonstrations(every=True), "demonstration_id", plans["demonstration_id"])
    wanted = {*plans["source_id"], *plans["target_id"], *demonstrations["structure_id"]}
    wanted |= {*plans["parts_told_by"].dropna()} - {""}
    structures = _only(catalog.structures(every=True), "structure_id", wanted)
    tables = {
        "structures": iter([_table("structures", structures)]),
        "demonstrations": iter([_table("demonstrations", demonstrations)]),
        "poses": checked_steps(catalog, "poses", demonstrations),
        "transfers": iter([_table("transfers", plans)]),
        "waypoints": checked_steps(catalog, "waypoints", plans[plans["n_waypoints"] > 0]),
    }
    try:
        counts = {name: write(place / f"{name}.parquet", TABLES[name], rows) for name, rows in tables.items()}
    except OSError as error:
        raise CatalogError(str(place), f"cannot be written: {error}", "", "free space or rights") from None
    rows = {"structures": structures, "transfers": plans}
    for kind, table, column in NAMED_CONTENTS:
        for sha256 in sorted({*rows[table][column]} - {""}) if table in rows else ():
            _put(catalog, place, kind, sha256)
    write_splits(catalog, place, plans.to_dict("records"))
    describe(place, {"name": name, "licence": licence, "attribution": attribution, "rows": counts})
    return counts


def _put(catalog: Catalog, place: Path, kind: str, sha256: str) -> None:
    """Write what is kept by its content, and the samples that it names."""
    path = place / kind / file_name(sha256)
    if not path.exists():
        record = catalog.contents[kind].get(sha256)
        replace_file(path, codec.encode(record))
        if isinstance(record, States):
            _put(catalog, place, "samples", record.samples_sha256)


def _only(frame: pd.DataFrame, column: str, names: Any) -> pd.DataFrame:
    """The newest version of each, retired or not."""
    return frame[frame[column].isin(set(names))].drop_duplicates(column, keep="last")


def _table(name: str, frame: pd.DataFrame) -> pa.Table:
    return pa.Table.from_pandas(frame, TABLES[name].schema, preserve_index=False)


SHARES = {"train": 0.8, "validation": 0.1, "test": 0.1}


def export_tum(
    catalog: Catalog, folder: str | os.PathLike[str], transfers: pd.DataFrame | Sequence[str]
) -> dict[str, int]:
    """Write plans, and every demonstration in use, as one text file each, with ``splits.json``.

    Parameters are those of `export_dataset`; plans without a trajectory are left out. Returns the number of
    plans and demonstrations.
    """
    place = new_folder(folder)
    rows = with_path(catalog, transfers)
    flights = list(catalog.demonstrations()["demonstration_id"])
    if not rows and not flights:
        raise InputError("trajectories", "there are none", "at least one plan or demonstration")
    for row in rows:
        path = catalog.path_of(row)
        _write(place / "plans" / f"{row['transfer_id']}.txt", path.t_s, path)
    for name in flights:
        flown = catalog.demonstration(name)
        _write(place / "demonstrations" / f"{name}.txt", flown.t_ns * 1e-9, flown.trajectory)
    write_splits(catalog, place, rows)
    return {"plans": len(rows), "demonstrations": len(flights)}


def _write(path: Path, t_s: Any, steps: Trajectory) -> None:
    text = StringIO()
    np.savetxt(text, np.column_stack([t_s, steps.positions, steps.quat_xyzw]), fmt="%.9f")
    replace_file(path, text.getvalue().encode())


def write_splits(
    catalog: Catalog,
    place: Path,
    rows: Iterable[Mapping[str, Any]],
    demonstrations: Iterable[str] | None = None,
    episodes: Sequence[Mapping[str, Any]] = (),
) -> None:
    """Write ``splits.json``: which structures, plans, demonstrations and episodes are for training.

    By structure: none on two sides, each kind on all where it has enough members; by kind: one after the
    other left out.
    """
    kinds, flights = kinds_of(catalog), catalog.demonstrations()
    on = dict(zip(flights["demonstration_id"], flights["structure_id"], strict=True))
    on = on if demonstrations is None else {name: on[name] for name in demonstrations}
    plans = {str(row["transfer_id"]): str(row["target_id"]) for row in rows}
    owned = {"plans": plans, "demonstrations": on}  # by name, with their structures

    def parted(side_of: Mapping[str, str], held: Mapping[str, Mapping[str, str]], column: str) -> Any:
        """What of structures with each value there is, by the value; episodes by a column of theirs."""
        values = SHARES if column == "split" else sorted(set(side_of.values()))
        sides: dict[str, dict[str, list[Any]]] = {}
        for value in values:
            sides[value] = {
                name: sorted(k for k, at in where.items() if side_of.get(at) == value)
                for name, where in held.items()
            }
            if episodes:
                sides[value]["episodes"] = [e["episode_index"] for e in episodes if e[column] == value]
        return sides

    every = {"structures": {name: name for name in kinds}, **owned}
    splits = {
        "by_structure": parted(split_of(kinds), every, "split"),
        "by_kind": parted(kinds, owned, "kind"),
    }
    replace_file(place / "splits.json", (json.dumps(splits, indent=1) + "\n").encode())


def kinds_of(catalog: Catalog) -> dict[str, str]:
    """The kind of each structure in the fleet."""
    structures = catalog.structures()
    return dict(zip(structures["structure_id"], structures["kind"], strict=True))


def split_of(kinds: Mapping[str, str]) -> dict[str, str]:
    """The side of each structure, the same on every machine: by the hash of its name, kind by kind."""
    sides: dict[str, str] = {}
    for kind in sorted(set(kinds.values())):
        names = [name for name in kinds if kinds[name] == kind]
        names.sort(key=lambda name: hashlib.sha256(name.encode()).hexdigest())
        held_out = round(len(names) * SHARES["test"]) or int(len(names) >= 3)
        validated = round(len(names) * SHARES["validation"]) or int(len(names) >= 3)
        for at, name in enumerate(names):
            beyond = "validation" if at < held_out + validated else "train"
            sides[name] = "test" if at < held_out else beyond
    return sides


_PART_PCT = 10  # share of what was inspected from which on a part is named in the task
_FIGURES = ("hfov_deg", "vfov_deg", "path_length_m", "duration_s")
# Of plans alone, words and figures.
_WORDS = [
    "transfer_id", "preset", "state", "not_flyable", "code_version", "method_version", "sources_sha256",
    "libraries", "source_sha256", "target_sha256", "settings_sha256",
]  # fmt: skip
_MEASURED = [
    "coverage_inspected_pct", "coverage_seen_pct", "coverage_attainable_pct", "min_clearance_m", "frechet_z",
    "gsd_mm_p95", "standoff_kept_pct", "acceptance_probability", "counterpart_probability",
    "never_scanned_m2",
]  # fmt: skip


@dataclass(frozen=True)
class Episode:
    """A plan, or an unbroken stretch of a demonstration, and what is said of it."""

    path: Trajectory
    task: str
    about: Mapping[str, Any]  # columns of its row
    split: str


def of_plans(
    catalog: Catalog, rows: Sequence[Row], flown: Mapping[str, Row], side: Mapping[str, str]
) -> Iterator[Episode]:
    ids = [str(row["transfer_id"]) for row in rows]
    now = catalog.transfers(every=True, ids=ids, columns=["transfer_id", "state"])  # by what people decided
    states = dict(zip(now["transfer_id"], now["state"], strict=True))
    for row in sorted(rows, key=lambda row: str(row["transfer_id"])):
        target, name = str(row["target_id"]), str(row["demonstration_id"])
        about = _facts(flown.get(name, {}), "plan", name, row["source_id"], target, row["kind"])
        about |= {key: row[key] for key in (*_WORDS, *_MEASURED, "path_length_m", "duration_s")}
        about["state"] = states[row["transfer_id"]]
        about["demonstration_sha256"] = row["demonstration_sha256"]
        task = _task(about, row["counterparts"])
        yield Episode(catalog.path_of(row), task, about, side.get(target, "train"))


def of_demonstrations(
    catalog: Catalog, flown: Mapping[str, Row], rows: Sequence[Row], side: Mapping[str, str], fps: int
) -> Iterator[Episode]:
    """What was recorded; nothing is made up for a gap, and what is shorter than two frames is left out."""
    kinds, parts = kinds_of(catalog), {row["demonstration_id"]: row["counterparts"] for row in rows}
    for name, row in sorted(flown.items()):
        record, place = catalog.demonstration(name), str(row["structure_id"])
        about = _facts(row, "demonstration", name, place, place, kinds.get(place, ""))
        about |= dict.fromkeys(_WORDS, "") | dict.fromkeys(_MEASURED, math.nan)
        task = _task(about, parts.get(name, ""), row["about"])
        for begin, end in pairwise([0, *(int(at) for at in record.breaks), len(record.t_ns)]):
            t_s = (record.t_ns[begin:end] - record.t_ns[begin]) * 1e-9
            if len(t_s) and t_s[-1] * fps >= 1:
                path = replace(record.trajectory.take(slice(begin, end)), t_s=t_s)
                yield Episode(path, task, about, side.get(place, "train"))


def _facts(row: Row, origin: str, name: str, source: str, structure: str, kind: str) -> dict[str, Any]:
    """What episodes of plans and of demonstrations both say; the camera is the demonstration's."""
    return {
        "origin": origin,
        "demonstration_id": name,
        "source_id": source,
        "structure_id": structure,
        "kind": kind,
        "operator": str(row.get("operator") or ""),
        **{key: float(row.get(key, math.nan)) for key in _FIGURES},
        "demonstration_sha256": str(row.get("sha256") or ""),
    }


def _task(facts: Mapping[str, Any], counterparts: str, about: str = "") -> str:
    """What is to be done, in words: of a demonstration and of all plans that follow from it the same."""
    known = json.loads(counterparts or "[]")
    named = [one["part"].partition(" (")[2].rstrip(")") for one in known if one["inspected_pct"] >= _PART_PCT]
    parts = " and ".join(f"({place})" for place in named if place)
    what = f"its {'parts' if ' and ' in parts else 'part'} {parts}" if parts else about
    kind, name = facts["kind"].replace("_", " ") or "structure", facts["demonstration_id"]
    return f"Fly the camera round the {kind} and inspect {what or 'what the expert did'}, as {name} shows."
