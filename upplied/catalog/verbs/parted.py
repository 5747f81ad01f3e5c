"""Published tables of many small files: plans and steps by kind, and by target, each named by what it holds.

What a changed file has in common with the one before is taken from there: a change costs what changed.
"""

from __future__ import annotations

import hashlib
import re
import zlib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from itertools import accumulate, groupby, pairwise
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from upplied.catalog.database import Catalog
from upplied.catalog.schema.steps import checked
from upplied.catalog.schema.tables import MOMENT, SCHEMA_VERSION, TABLES, Table
from upplied.catalog.store.chain import decoded
from upplied.catalog.verbs import custody, queries
from upplied.catalog.verbs.ordering import DERIVED, PAIR
from upplied.catalog.verbs.queries import NAMED
from upplied.checks import check_id
from upplied.config import digest

if TYPE_CHECKING:
    from upplied.catalog.verbs.published import Before, Generation

Files = dict[str, pd.DataFrame]  # by name: what names the rows in it, or owns them
Weights = dict[str, int]  # of each kind: rows, or steps, by which its files are cut
Named = tuple[pd.DataFrame, Collection[str]]  # what names rows, and files that hold no such rows

_PLANS = 256  # of a file, about: what a changed plan makes us write again
_STEPS = 4000
_FILES = 1024  # of a kind at most: as many as one still lists, links and opens at once
_LOT = 50_000  # plans that are read at a time
_NAME = re.compile(r"(transfers|waypoints)\.parquet/([^/]+)/(\d{4})-of-(\d{4})-[0-9a-f]{16}\.parquet")
#: Tables whose rows change what plans are told of, and the column that names these.
_OF_TARGETS = {"transfers": "target_id", "structures": "structure_id", "decisions": "target_id"}
#: Of a plan: what names its row, what its steps are found by, and what is decided about it.
_OF_PLANS = (*NAMED, "kind", "target_id", "n_waypoints", "waypoints_sha256", *DERIVED)


def plans_of(catalog: Catalog, was: Before, now: Generation) -> Named:
    """Plans, all or those in files that may change, by pair, and the files that stay; `now` gets weights."""
    whole = was.generation.weights and len(was.files) == was.generation.files
    if whole and now.has_same("demonstrations", was.generation):
        with suppress(OSError, pa.ArrowException):  # a file of before that cannot be read
            if (changed := _changed_plans(catalog, was, now)) is not None:
                return changed
    rows = catalog.foremost(_OF_PLANS)
    now.weights = {name: _weights(name, rows) for name in ("transfers", "waypoints")}
    return rows, ()


def _weights(name: str, rows: pd.DataFrame) -> Weights:
    kinds = rows.groupby("kind")
    counts = kinds.size() if name == "transfers" else kinds[f"n_{name}"].sum()
    return {str(kind): int(count) for kind, count in counts.items()}


def _changed_plans(catalog: Catalog, was: Before, now: Generation) -> Named | None:
    """Plans in the files of changed targets; None where that is most of them, or files are cut anew."""
    before, targets = was.generation, _changed_targets(catalog, was.generation)
    if targets is None:
        return None
    places = {file: named.groups() for file in was.files if (named := _NAME.fullmatch(file))}
    counts = {(name, kind): int(count) for name, kind, _, count in places.values()}
    # The number of a file follows from its targets: with the same rest by the least count they are the same.
    least = {kind: min(counts.get((name, kind), 1) for name in before.weights) for _, kind in counts}
    rests = {kind: {zlib.crc32(target.encode()) % n for target in targets} for kind, n in least.items()}
    changed = [f for f, (_, kind, at, _) in places.items() if (int(at) - 1) % least[kind] in rests[kind]]
    if 2 * len(changed) > len(places):
        return None
    table = catalog.tables["transfers"]
    ids = table.read(pc.field("target_id").isin(pa.array(targets, pa.string())), ["transfer_id"])[0]
    new, none = catalog.foremost(_OF_PLANS, ids.to_pylist()), table.declared.schema.empty_table()
    parts = [pq.read_table(was.like(f), columns=list(new)) for f in changed if f.startswith("transfers.")]
    old = queries.frame(pa.concat_tables([none.select(list(new)), *parts]))
    gone = old["target_id"].isin(targets)
    for name, weights in before.weights.items():
        sums = Counter(weights)
        sums.subtract(_weights(name, old[gone]))
        sums.update(_weights(name, new))
        if any(_count(name, weight) != counts.get((name, kind), 1) for kind, weight in sums.items()):
            return None
        now.weights[name] = dict(sums)
    both = [rows for rows in (old[~gone], new) if len(rows)] or [new]
    return pd.concat(both).sort_values(PAIR, ignore_index=True), places.keys() - changed


def _changed_targets(catalog: Catalog, before: Generation) -> list[str] | None:
    """Targets of which more is known than what is published; None where that is of another history."""
    targets = set[str]()
    for name, column in _OF_TARGETS.items():
        last = pa.scalar(before.added[name], pa.int64()).cast(MOMENT)
        rows = catalog.tables[name].read(pc.field("added_at") >= last, ["added_at", column])
        known = pc.equal(rows["added_at"], last)
        if before.added[name] >= 0 and not pc.any(known).as_py():
            return None
        targets.update(rows.filter(pc.invert(known))[column].to_pylist())
    return sorted(targets)


def files_of(now: Generation, plans: pd.DataFrame, frames: dict[str, pd.DataFrame]) -> dict[str, Files]:
    """Of each table that is many files, those that may be new, by what names their rows or owns them."""
    kinds = dict(zip(frames["structures"]["structure_id"], frames["structures"]["kind"], strict=True))
    flown = frames["demonstrations"].rename(columns={"structure_id": "target_id"})
    flown["kind"] = flown["target_id"].map(kinds).fillna("unknown")
    # All else that a row of plans says follows from its commit.
    return {
        "transfers": _files("transfers", plans, [*NAMED[:3], *DERIVED], now.weights["transfers"]),
        "waypoints": _step_files("waypoints", plans, now.weights["waypoints"]),
        "poses": _step_files("poses", flown, _weights("poses", flown)),
    }


def _step_files(name: str, owners: pd.DataFrame, weights: Weights) -> Files:
    key, count = TABLES[name].names[0], f"n_{name}"
    owners = owners.loc[owners[count] > 0, [key, "commit_id", f"{name}_sha256", count, "kind", "target_id"]]
    order = pc.sort_indices(pa.array(owners[key], pa.string())).to_numpy()  # of each there is one row
    return _files(name, owners.iloc[order], [key, "commit_id"], weights)


def _count(name: str, weight: int) -> int:
    """Into how many files a kind of such weight is cut: a power of two."""
    files = -(-weight // (_PLANS if name == "transfers" else _STEPS))
    return min(1 << max(files - 1, 0).bit_length(), _FILES)


def _files(name: str, rows: pd.DataFrame, columns: list[str], weights: Weights) -> Files:
    """Rows by file, in so many files as all rows weigh; each is named by some columns of its rows."""
    rows.attrs.clear()  # which pandas copies with every choice of rows
    made_of = digest([SCHEMA_VERSION, TABLES[name].names])
    texts, files = queries.named(rows, columns), Files()
    for kind, at in rows.groupby("kind").indices.items():
        folder = f"{name}.parquet/{check_id(str(kind), 'kind')}"
        count = _count(name, weights[kind])
        number, targets = pd.factorize(rows["target_id"].iloc[at])
        bucket = np.array([zlib.crc32(target.encode()) % count for target in targets.tolist()])[number]
        order = np.argsort(bucket, kind="stable")
        lines, bucket = texts.take(pa.array(at[order])).to_pylist(), bucket[order]
        for first, end in pairwise([0, *(np.flatnonzero(np.diff(bucket)) + 1), len(order)]):
            sha256 = hashlib.sha256("\n".join([made_of, *lines[first:end]]).encode()).hexdigest()
            file = f"{folder}/{bucket[first] + 1:04}-of-{count:04}-{sha256[:16]}.parquet"
            files[file] = rows.iloc[at[order[first:end]]]
    return files if any(weights.values()) else {f"{name}.parquet/none-{made_of[:16]}.parquet": rows[:0]}


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
    numbered = zip((total // most for total in accumulate(weights)), files, strict=True)
    for _, lot in groupby(numbered, itemgetter(0)):
        yield [file for _, file in lot]


def _before(was: Before, file: str, declared: Table) -> pa.Table:
    """What was in the file of before; nothing where there was none, or one of other columns."""
    path = was.like(file)
    with suppress(OSError, pa.ArrowException):  # one that cannot be read is made without it
        if path is not None and pq.read_schema(path).names == declared.names:
            return pq.read_table(path).cast(declared.schema)
    return declared.schema.empty_table()
