"""A folder that `exporting` wrote into a catalog, once all of it was checked; a second time adds nothing."""

import os
from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from upplied.catalog.database import Catalog
from upplied.catalog.schema import codec, plan_rows, rows
from upplied.catalog.schema.rows import Row
from upplied.catalog.schema.steps import run_starts, unlike
from upplied.catalog.schema.tables import TABLES, in_schema, upgraded
from upplied.catalog.store.contents import CONTENTS, NAMED_CONTENTS, States, file_name
from upplied.catalog.verbs.exporting import DATASET, EXCHANGED, check_files
from upplied.catalog.verbs.ordering import by_commit
from upplied.catalog.verbs.recipes import Recipe, settings_of, siblings_of
from upplied.catalog.verbs.verification import Values
from upplied.checks import check_id
from upplied.errors import CatalogError
from upplied.records import Demonstration, Measures, Plan, Structure

_SAME = 2e-3  # of a measure computed again on another machine: a sample in a thousand may turn
_IDS = {"structure_id", "kind", "demonstration_id", "source_id", "target_id", "transfer_id", "key"}


def import_dataset(
    catalog: Catalog,
    folder: str | os.PathLike[str],
    replace: bool = False,
    measured: Callable[[Recipe, Plan], Measures] | None = None,
) -> dict[str, int]:
    """Take the content of an exported folder into a catalog, after checking all of it.

    Parameters
    ----------
    catalog : Catalog
    folder : path
    replace : bool
        Let structures and demonstrations that are here under the same names with another content
        become newer versions; otherwise that is an error.
    measured : callable
        Computes the measures of a plan anew, from what it was made from; one that says other ones is an
        error. Without it nothing proves the measures of a dataset, and `imported_from` tells so.

    Returns
    -------
    dict
        Rows added, by table; zeros where everything was known.

    Raises
    ------
    CatalogError
        If the folder is not whole, does not match its hashes, or contradicts itself or the
        catalog. Nothing is added then.
    """
    place = Path(folder)
    dataset, listed = check_files(place)
    tables = {name: _read(place, name) for name in EXCHANGED}
    for name in ("structures", "demonstrations", "transfers"):
        values = Values(name)
        values.look_at(tables[name])
        for finding in values.findings():
            raise CatalogError(f"{place}: {finding.what}", finding.found)
        for column in _IDS & set(tables[name].column_names):
            for value in tables[name][column].unique().to_pylist():
                check_id(value, f"{place}: {name}.{column}")
    steps = {name: _by_owner(tables[name]) for name in ("poses", "waypoints")}
    mesh, poses = partial(_stored, place, listed, "meshes"), partial(_steps, place, steps["poses"], "poses")
    structures = [rows.structure_of(row, mesh(row["mesh_sha256"])) for row in by_commit(tables["structures"])]
    flown = by_commit(tables["demonstrations"])
    demonstrations = [rows.demonstration_of(row, poses(row)) for row in flown]
    plans = tables["transfers"].to_pylist()
    for row in plans:
        if plan_rows.transfer_id(row["key"]) != row["transfer_id"]:
            raise CatalogError(f"{place}: plan {row['transfer_id']}", "does not match its key")
        if row["n_waypoints"]:
            _steps(place, steps["waypoints"], "waypoints", row)
        row["imported_from"] = f"{dataset}, {plan_rows.AS_IT_SAYS}"
    if measured is not None:
        anew = _measured_anew(place, plans, steps["waypoints"], structures, demonstrations, measured)
        for row, but_for in anew:
            row["imported_from"] = f"{dataset}, measures computed again{but_for}"
    new_structures = _unknown(catalog.create(), "structures", structures, replace)
    new_demonstrations = _unknown(catalog, "demonstrations", demonstrations, replace)
    for row in plans:
        for kind, table, column in NAMED_CONTENTS:
            if table == "transfers" and row[column]:
                row[column] = _taken(catalog, place, listed, kind, row[column])
    return {
        "structures": catalog.add_structures(new_structures),
        "demonstrations": catalog.add_demonstrations(new_demonstrations),
        "transfers": catalog.adopt_plans(plans, steps["waypoints"]),
    }


def _measured_anew(
    place: Path,
    plans: list[Row],
    waypoints: dict[tuple[str, str], pa.Table],
    structures: list[Structure],
    demonstrations: list[Demonstration],
    measured: Callable[[Recipe, Plan], Measures],
) -> Iterator[tuple[Row, str]]:
    """Compare the measures of every plan with what its trajectory gives; each with those it does not tell."""
    known = {item.structure_id: item for item in structures}
    flights = {item.demonstration_id: item for item in demonstrations}
    for row in plans:
        if not row["n_waypoints"]:
            continue
        flown = flights[row["demonstration_id"]]
        source, target = known[row["source_id"]], known[row["target_id"]]
        what = f"{place}: plan {row['transfer_id']}"
        hashes = tuple(row[f"{name}_sha256"] for name in ("demonstration", "source", "target"))
        if hashes != (flown.sha256, source.sha256, target.sha256):
            raise CatalogError(what, "cannot be measured again: the dataset has other versions of its inputs")
        settings = settings_of(row["settings_json"])
        plan = plan_rows.plan_of(row, waypoints[row["transfer_id"], row["commit_id"]])
        known_siblings = [(name, sha256) for name, sha256 in siblings_of(row) if name in known]
        siblings = tuple(known[name] for name, sha256 in known_siblings if known[name].sha256 == sha256)
        if plan.parts_told_by and plan.parts_told_by not in {one.structure_id for one in siblings}:
            lacking = f"the dataset has no {plan.parts_told_by} as it labelled its parts"
            raise CatalogError(what, f"cannot be measured again: {lacking}")
        again = measured(Recipe(row, flown, source, target, settings, siblings), plan)
        left = []
        for item in fields(Measures):
            says, is_so = getattr(plan.measures, item.name), getattr(again, item.name)
            if np.isnan(is_so) and not np.isnan(says):
                left.append(item.name)
            elif not np.isclose(says, is_so, _SAME, _SAME, equal_nan=True):
                raise CatalogError(what, f"{item.name} is stated as {says:g}, and is {is_so:g}")
        yield row, f", but for {', '.join(left)}" if left else ""


def _read(place: Path, name: str) -> pa.Table:
    what = str(place / f"{name}.parquet")
    try:
        exported = pq.read_table(what)
        there = {*exported.schema.names, "commit_version", "added_at"}  # which older rows are filled with
        if lacking := [c.name for c in TABLES[name].columns if c.required and c.name not in there]:
            raise CatalogError(what, f"has not the declared columns: no {', '.join(lacking)}")
        return upgraded(TABLES[name], in_schema(exported, TABLES[name].schema))
    except (OSError, pa.ArrowException) as error:
        raise CatalogError(what, f"has not the declared columns: {error}") from None


def _by_owner(steps: pa.Table) -> dict[tuple[str, str], pa.Table]:
    owner = [steps.schema.names[0], "commit_id"]
    ordered = steps.sort_by([(name, "ascending") for name in (*owner, "seq")])
    starts = run_starts(ordered, owner)
    ids, commits = (ordered[name].take(pa.array(starts)).to_pylist() for name in owner)
    parts = map(ordered.slice, starts.tolist(), np.diff(starts, append=len(ordered)).tolist())
    return dict(zip(zip(ids, commits, strict=True), parts, strict=True))


def _steps(place: Path, owned: dict[tuple[str, str], pa.Table], name: str, row: Row) -> pa.Table:
    owner = row[TABLES[name].names[0]], row["commit_id"]
    steps = owned.get(owner, TABLES[name].schema.empty_table())
    if any(unlike(name, steps, {owner: (row[f"n_{name}"], row[f"{name}_sha256"])})):
        raise CatalogError(f"{place}: {name} of {owner[0]}", "do not match their row")
    return steps


def _stored(place: Path, listed: set[str], kind: str, sha256: str) -> Any:
    name = f"{kind}/{file_name(sha256)}"
    if name not in listed:  # and so was not checked
        rule, remedy = f"what plans name is in {DATASET}", "export the dataset again"
        raise CatalogError(str(place / name), "is missing, or not listed", rule, remedy)
    try:
        return codec.decode((place / name).read_bytes(), CONTENTS[kind].record_type, sha256)
    except CatalogError as error:
        raise CatalogError(str(place / name), error.finding) from None


def _taken(catalog: Catalog, place: Path, listed: set[str], kind: str, sha256: str) -> str:
    """Take in what a plan names; its hash, or nothing where it is a surface that the folder has not."""
    if kind == "surfaces" and f"{kind}/{file_name(sha256)}" not in listed:
        return ""
    record = _stored(place, listed, kind, sha256)
    if isinstance(record, States):
        _taken(catalog, place, listed, "samples", record.samples_sha256)
    return catalog.contents[kind].put(record)


def _unknown(catalog: Catalog, name: str, records: list[Any], replace: bool) -> list[Any]:
    """Those that no version here says the same as; the others are left as they are."""
    key = TABLES[name].names[0]
    every = catalog.structures(every=True) if name == "structures" else catalog.demonstrations(every=True)
    known, names = set(every[[key, "sha256"]].itertuples(index=False, name=None)), set(every[key])
    new = [record for record in records if (getattr(record, key), record.sha256) not in known]
    clashes = sorted(getattr(record, key) for record in new if getattr(record, key) in names)
    if clashes and not replace:
        what, remedy = f"{name} {', '.join(clashes[:5])}", "import with replace: newer versions of them"
        raise CatalogError(what, "are in the catalog with another content", "", remedy)
    return new
