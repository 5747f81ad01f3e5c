"""Whether bytes are as they were written, steps those that rows own, and plans those that were released."""

import hashlib
import io
import json
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from upplied.catalog.reading import Reading
from upplied.catalog.schema import codec, plan_rows
from upplied.catalog.schema.rows import ADDED, Row
from upplied.catalog.schema.steps import checked, run_starts, unlike
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.chain import changed_entries, changed_rows, content_hashes, head_of
from upplied.catalog.store.contents import ContentStore
from upplied.catalog.store.delta import HASH_DIGITS, StepTable
from upplied.catalog.store.files import FileStore, explained
from upplied.catalog.store.opening import HASHED_KEY, Heads
from upplied.catalog.verbs import ordering
from upplied.catalog.verbs.queries import named
from upplied.catalog.verbs.roster import Roster
from upplied.errors import CatalogError, RefusedError

CHUNK = 1_000_000  # steps held in memory at once
COMPARED = 250_000  # steps that are compared at a time


def checked_steps(catalog: Reading, name: str, owners: pd.DataFrame) -> Iterator[pa.Table]:
    """The steps that the given rows own, in order, a bounded number at a time, `checked`."""
    owners = owners.sort_values([TABLES[name].names[0], "commit_id"])
    for _, chunk in owners.groupby(owners[f"n_{name}"].cumsum() // CHUNK):
        yield checked(name, stored_steps(catalog, name, chunk), stated(name, chunk))


def step_faults(catalog: Reading, name: str, rows: pa.Table) -> Iterator[tuple[str, str]]:
    """Steps that are missing, too many, out of order, or not those whose hash the row keeps, and whose."""
    key, count = TABLES[name].names[0], f"n_{name}"
    # As texts: a dictionary's would be sorted as they stand in it.
    types = {key: pa.string(), "commit_id": pa.string(), count: pa.int64(), f"{name}_sha256": pa.string()}
    owning = rows.filter(pc.greater(rows[count], 0)).select(list(types)).cast(pa.schema(types))
    owners = as_frame(owning).drop_duplicates([key, "commit_id"]).sort_values(["commit_id", key])
    number = owners[count].cumsum() // COMPARED
    number = number.groupby(owners["commit_id"]).transform("first")  # each commit is a file, read once
    for _, chunk in owners.groupby(number, sort=True):
        yield from unlike(name, stored_steps(catalog, name, chunk), stated(name, chunk))


def stored_steps(catalog: Reading, name: str, owners: pd.DataFrame) -> pa.Table:
    """What is stored of the steps of the given rows, in their order: all of it or not."""
    declared, table, commits = TABLES[name], catalog.tables[name], owners["commit_id"].unique()
    owner = [key := declared.names[0], "commit_id"]
    if not len(owners):
        return declared.schema.empty_table()
    dataset = table.dataset(commits=commits)
    there = 0 if dataset is None else explained(table.uri, dataset.count_rows)
    if 2 * owners[f"n_{name}"].sum() < there:  # of many rows few: some are decoded at a time
        ids = pa.array(list(owners[key]), pa.string())
        ends = pc.min_max(ids).as_py()
        where = (pc.field(key) >= ends["min"]) & (pc.field(key) <= ends["max"]) & pc.field(key).isin(ids)
        stored = pa.concat_tables(table.batches(declared.names, where, commits=commits))
    else:
        stored = table.read(commits=commits)
    starts = run_starts(stored, owner)
    place = pc.index_in(named(stored.take(pa.array(starts)), owner), named(owners, owner)).fill_null(-1)
    place = np.repeat(place.to_numpy(), np.diff(starts, append=len(stored)))
    seq, next_owner = stored["seq"].to_numpy(), np.diff(place, prepend=-1)
    if ((next_owner > 0) | ((next_owner == 0) & (np.diff(seq, prepend=-1) > 0) & (place >= 0))).all():
        return stored
    return stored.take(pa.array(np.lexsort((seq, place))[np.count_nonzero(place < 0) :]))


def stated(name: str, owners: pd.DataFrame) -> dict[tuple[str, str], tuple[int, str]]:
    """What rows say of the steps they own: how many, and their hash."""
    columns = (TABLES[name].names[0], "commit_id", f"n_{name}", f"{name}_sha256")
    ids, commits, counts, hashes = (pa.array(owners[column]).to_pylist() for column in columns)
    return dict(zip(zip(ids, commits, strict=True), zip(counts, hashes, strict=True), strict=True))


def as_frame(rows: pa.Table) -> pd.DataFrame:
    """Rows whose texts stay Arrow's: as Python's, each takes a hundred bytes more."""
    return rows.to_pandas(types_mapper={pa.string(): pd.ArrowDtype(pa.string())}.get)


HEAD_DIGITS = 20  # of a hash, where people read it
_NOT_ITS_OWN = {*ADDED, "planned_at"}  # of a row of plans: another when it becomes current again


def alterations(catalog: Reading, transfer_ids: Collection[str], now: ordering.Standing) -> dict[str, str]:
    """Why plans are not what was released, in words: waypoints, rows and releases are compared again."""
    released = {plan: now.why[plan] for plan in transfer_ids if now.of(plan) == "released"}
    if not released:
        return {}
    rows, hashes = stored_plans(catalog, released)
    roster, table = Roster(catalog.location), catalog.tables["decisions"]
    names = [row["decision_id"] for row in released.values()]
    changed = dict(changed_rows(table.declared, table.whole(pc.field("decision_id").isin(names))))
    faults = dict(step_faults(catalog, "waypoints", rows))
    for row in rows.select(["transfer_id", "waypoints_sha256"]).to_pylist():
        plan, decision = row["transfer_id"], released[row["transfer_id"]]
        if decision["decision_id"] in changed:
            faults[plan] = f"its release {changed[decision['decision_id']]}"
        elif wrong := roster.fault(decision, now.order):
            faults[plan] = f"its release does not count: {wrong}"
        elif decision["plan_sha256"] != row["waypoints_sha256"]:
            faults[plan] = "its waypoints are not those that were released"
        elif decision["plan_row_sha256"] and decision["plan_row_sha256"] != hashes[plan]:
            faults[plan] = "its row differs from the one that was released"
    return faults


def check_releasable(catalog: Reading, row: Row) -> None:
    """Refuse a plan that was never measured here, or whose row or steps are not as they were written."""
    what = f"release of {row['transfer_id']}"
    if plan_rows.is_foreign(row):
        raise RefusedError(what, *FOREIGN_PLAN, "plan it here, or import it again with --verify")
    catalog.path_of(row)
    stored, _ = stored_plans(catalog, [row["transfer_id"]])
    for _, wrong in changed_rows(catalog.tables["transfers"].declared, stored):
        raise RefusedError(what, f"its row {wrong}", "what is released is what was planned", "plan it again")


FOREIGN_PLAN = ("it was imported and not measured here", "what is flown was judged here")


def chain_heads(catalog: Reading) -> dict[str, str]:
    """The hash of the last row of each table whose rows follow each other: it proves those before it."""
    chained = {name: table.whole() for name, table in catalog.tables.items() if table.declared.is_chained}
    return {name: sha256 for name, rows in chained.items() if (sha256 := head_of(rows))}


def foreign_plans(catalog: Reading) -> list[str]:
    """The plans that were imported and not measured here."""
    rows = catalog.tables["transfers"].read(None, [*ordering.ORDERED, "imported_from"])
    rows = ordering.in_order(rows, newest=False)
    return [row["transfer_id"] for row in rows.to_pylist() if plan_rows.is_foreign(row)]


def stored_plans(catalog: Reading, transfer_ids: Collection[str]) -> tuple[pa.Table, dict[str, str]]:
    """The rows that stand for plans, with all their columns, and the hash of what each says."""
    ids = pa.array(sorted(transfer_ids), pa.string())
    rows = catalog.tables["transfers"].whole(pc.field("transfer_id").isin(ids))
    rows = ordering.in_order(rows, newest=False)
    own = rows.select([name for name in rows.column_names if name not in _NOT_ITS_OWN])
    return rows, dict(zip(rows["transfer_id"].to_pylist(), content_hashes(own), strict=True))


_PART = re.compile(r"part-([0-9a-f]{64})-[0-9a-f]{8}\.parquet")
_STEPS = re.compile(rf"[0-9]{{8}}-[0-9]{{6}}-[0-9]{{6}}-([0-9a-f]{{{HASH_DIGITS}}})\.parquet")
_CHANGED = "was changed after it was written; take it from a backup"

Fault = tuple[str, str]  # what, and what is wrong with it


@dataclass
class Folder:
    """The files of one kind that are kept by their content."""

    faults: dict[str, str] = field(default_factory=dict)  # hash -> what is wrong, empty where nothing is
    samples: dict[str, str] = field(default_factory=dict)  # hash -> that of the samples it names
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)  # of meshes: vertices and triangles


def fault_of(contents: dict[str, Folder], name: str, sha256: str) -> Fault:
    """The file of some content, or of the samples it names, and what is wrong with it, if anything."""
    folder = contents[name]
    wrong = folder.faults.get(sha256, "cannot be read: there is no such file")
    if not wrong and sha256 in folder.samples:
        return fault_of(contents, "samples", folder.samples[sha256])
    return f"{name}/{sha256}.parquet", wrong


def stored_contents(store: ContentStore[Any]) -> Folder:
    """Every file of a folder that is kept by its content, read once."""
    folder = Folder()
    for name in store.files.names():
        sha256 = name.removesuffix(".parquet")
        if not re.fullmatch(r"[0-9a-f]{64}\.parquet", name):
            continue  # a draft of a writer at work
        try:
            content = store.files.read(name)
            record = codec.decode(content, store.about.record_type, sha256)
        except FileNotFoundError:
            continue  # removed meanwhile
        except CatalogError:
            folder.faults[sha256] = "is damaged"
            continue
        except (OSError, pa.ArrowException) as error:
            folder.faults[sha256] = f"cannot be read: {error}"
            continue
        folder.faults[sha256] = "" if codec.is_as_written(content) else "is damaged: a byte was changed"
        if hasattr(record, "samples_sha256"):
            folder.samples[sha256] = record.samples_sha256
        if hasattr(record, "vertices"):
            folder.sizes[sha256] = len(record.vertices), len(record.triangles)
    return folder


def changed_files(catalog: Reading) -> Iterator[Fault]:
    """Files of the tables, retired ones too, of their logs and the identity, that are not as written."""
    if not catalog.identity.is_as_written():
        yield f"{catalog.location}/catalog.json", _CHANGED
    for table in catalog.tables.values():
        files, log, delta = FileStore(table.uri), FileStore(f"{table.uri}/_delta_log"), table.delta()
        yield from _changed(files, _PART)
        if isinstance(table, StepTable):
            yield from _changed(table.files, _STEPS)
        if delta is not None and delta.metadata().configuration.get(HASHED_KEY) == "0":
            for name in pa.table(delta.get_add_actions())["path"].to_pylist():
                if not _PART.fullmatch(name):
                    yield files.path(name), "was put in by another program"
        for name, wrong in changed_entries(log, Heads(catalog.location, table.declared.name).stated()):
            yield log.path(name), wrong
        yield from _last_checkpoint(log)


def _changed(files: FileStore, named: re.Pattern[str]) -> Iterator[Fault]:
    for name in files.names():
        if match := named.fullmatch(name):
            try:
                if not hashlib.sha256(files.read(name)).hexdigest().startswith(match[1]):
                    yield files.path(name), _CHANGED
            except FileNotFoundError:
                continue  # removed meanwhile
            except (OSError, pa.ArrowException) as error:
                yield files.path(name), f"cannot be read: {error}"


def _last_checkpoint(log: FileStore) -> Iterator[Fault]:
    """The note of the last checkpoint, where it does not describe that one."""
    if not log.has("_last_checkpoint"):
        return
    content = log.read("_last_checkpoint")
    try:
        version = json.loads(content)["version"]
        checkpoint = log.read(f"{version:020}.checkpoint.parquet")
        rows = pq.read_table(io.BytesIO(checkpoint), columns=["add"])["add"]
        note = {"version": version, "size": len(rows), "sizeInBytes": len(checkpoint)}
        note["numOfAddFiles"] = len(rows) - rows.null_count
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException):
        note = {}
    if json.dumps(note, separators=(",", ":")).encode() != content.removesuffix(b"\n"):
        yield log.path("_last_checkpoint"), _CHANGED
