"""Published tables of many small files: plans and steps by kind, and by target, each named by what it holds.

What a changed file has in common with the one before is taken from there: a change costs what changed.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import accumulate, groupby, pairwise
from operator import itemgetter

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from upplied.catalog.database import Catalog
from upplied.catalog.schema.steps import checked
from upplied.catalog.schema.tables import SCHEMA_VERSION, TABLES, Table
from upplied.catalog.store.chain import decoded
from upplied.catalog.verbs import custody, queries
from upplied.catalog.verbs.generations import Before
from upplied.catalog.verbs.ordering import DERIVED
from upplied.catalog.verbs.queries import NAMED
from upplied.checks import check_id
from upplied.config import digest
from upplied.records import Floats, Ints

Files = dict[str, pd.DataFrame]  # by name: what names the rows in it, or owns them

_PLANS = 256  # of a file, about: what a changed plan makes us write again
_STEPS = 4000
_FILES = 1024  # of a kind at most: as many as one still lists, links and opens at once
_LOT = 50_000  # plans that are read at a time


@dataclass(frozen=True)
class Parted:
    """Rows, and which of them each file holds, in its order."""

    rows: pd.DataFrame  # what names the rows of a table, or owns them
    files: dict[str, Ints]  # their places, by the name of the file

    def of(self, files: Iterable[str]) -> Files:
        """The rows of some files."""
        return {file: self.rows.iloc[self.files[file]] for file in files}


def plan_files(plans: pd.DataFrame) -> Parted:
    """The files of `transfers`."""
    columns = [*NAMED[:3], *DERIVED]  # all else that a row says follows from its commit
    return _files("transfers", plans, columns, np.ones(len(plans)), _PLANS)


def step_files(name: str, owners: pd.DataFrame) -> Parted:
    """The files of `waypoints` or `poses`, of these owners, each with its `kind` and `target_id`."""
    key = TABLES[name].names[0]
    names = [key, "commit_id", f"{name}_sha256", f"n_{name}"]
    order = pc.sort_indices(pa.array(owners[key], pa.string())).to_numpy()  # of each there is one row
    owners = owners[[*names, "kind", "target_id"]].iloc[order]
    return _files(name, owners, names[:2], owners[f"n_{name}"].to_numpy(), _STEPS)


def _files(name: str, rows: pd.DataFrame, columns: list[str], weight: Floats, most: int) -> Parted:
    """Rows by file, so that each file has about so much weight; it is named by some columns of its rows."""
    rows.attrs.clear()  # which pandas copies with every choice of rows
    made_of = digest([SCHEMA_VERSION, TABLES[name].names])
    texts = queries.named(rows, columns)
    files: dict[str, Ints] = {}
    for kind, at in rows.groupby("kind").indices.items():
        folder = f"{name}.parquet/{check_id(str(kind), 'kind')}"
        count = 1
        while count < _FILES and weight[at].sum() > count * most:
            count *= 2
        number, targets = pd.factorize(rows["target_id"].iloc[at])
        bucket = np.array([zlib.crc32(target.encode()) % count for target in targets.tolist()])[number]
        order = np.argsort(bucket, kind="stable")
        held, bucket = texts.take(pa.array(at[order])).to_pylist(), bucket[order]
        ends = [*(np.flatnonzero(np.diff(bucket)) + 1), len(order)]
        for first, end in pairwise([0, *ends]):
            sha256 = hashlib.sha256("\n".join([made_of, *held[first:end]]).encode()).hexdigest()
            file = f"{folder}/{bucket[first] + 1:04}-of-{count:04}-{sha256[:16]}.parquet"
            files[file] = at[order[first:end]]
    nothing = {f"{name}.parquet/none-{made_of[:16]}.parquet": np.empty(0, np.int64)}
    return Parted(rows, files or nothing)


def rows_of(catalog: Catalog, was: Before, name: str, files: Files) -> Iterator[tuple[str, pa.Table]]:
    """All that each of some files holds, in its order."""
    return _plans(catalog, was, files) if name == "transfers" else _steps(catalog, was, name, files)


def _plans(catalog: Catalog, was: Before, files: Files) -> Iterator[tuple[str, pa.Table]]:
    table, whole = catalog.tables["transfers"], sum(map(len, files.values()))
    for lot in _lots(files, map(len, files.values()), _LOT):
        old = {file: _before(was, file, TABLES["transfers"]) for file in lot}
        names = {file: [queries.named(rows, NAMED) for rows in (files[file], old[file])] for file in lot}
        place = {file: np.array(pc.index_in(*both).fill_null(-1)) for file, both in names.items()}
        lacking = pd.concat([files[file][place[file] < 0] for file in lot])
        known = list(lacking.columns)
        rest = pa.schema([field for field in table.declared.schema if field.name not in known])
        new = decoded(queries.completed(table, lacking, rest.names, whole)).cast(rest)
        first = 0
        for file in lot:
            own, at = files[file], place[file]
            count = int((at < 0).sum())
            both = pa.concat_tables([old[file].select(rest.names).cast(rest), new.slice(first, count)])
            at[at < 0] = len(old[file]) + np.arange(count)
            first += count
            rows = both.take(pa.array(at))
            for column in known:
                field = table.declared.schema.field(column)
                rows = rows.append_column(field, pa.Array.from_pandas(own[column], type=field.type))
            yield file, rows.select(table.declared.names)


def _steps(catalog: Catalog, was: Before, name: str, files: Files) -> Iterator[tuple[str, pa.Table]]:
    declared, key = TABLES[name], TABLES[name].names[0]
    owner = [key, "commit_id"]
    for lot in _lots(files, (own[f"n_{name}"].sum() for own in files.values()), custody.CHUNK):
        still, lacking = [], []
        for at, file in enumerate(lot):
            old, owners = _before(was, file, declared), queries.named(files[file], owner)
            still.append(old.filter(pc.is_in(queries.named(old, owner), owners)))
            known = pc.is_in(owners, queries.named(still[at], owner)).to_numpy(zero_copy_only=False)
            lacking.append(files[file][~known].assign(file=at))
        own = pd.concat(lacking).sort_values(owner)
        steps = checked(name, custody.stored_steps(catalog, name, own), custody.stated(name, own))
        number = np.repeat(own["file"].to_numpy(), own[f"n_{name}"])
        steps = steps.take(pa.array(np.argsort(number, kind="stable")))
        ends = np.cumsum(np.bincount(number, minlength=len(lot)))
        for file, old, first, end in zip(lot, still, [0, *ends], ends, strict=False):
            new = steps.slice(first, end - first)
            if len(old):
                order = [(column, "ascending") for column in (*owner, "seq")]
                both = pa.concat_tables([old, new]).sort_by(order)
                new = checked(name, both, custody.stated(name, files[file]))
            yield file, new


def _lots(files: Files, weights: Iterable[float], most: int) -> Iterator[list[str]]:
    """Some files at a time, of about so much weight."""
    numbered = zip((held // most for held in accumulate(weights)), files, strict=True)
    for _, lot in groupby(numbered, itemgetter(0)):
        yield [file for _, file in lot]


def _before(was: Before, file: str, declared: Table) -> pa.Table:
    """What was in the file of before; nothing where there was none, or one of other columns."""
    path = was.like(file)
    if path is None or pq.read_schema(path).names != declared.names:
        return declared.schema.empty_table()
    return pq.read_table(path).cast(declared.schema)
