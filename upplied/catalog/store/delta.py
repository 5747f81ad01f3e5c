"""One Delta table: whole commits of rows, only appended, many writers, and readers that see one moment."""

import hashlib
from collections.abc import Collection, Iterator
from contextlib import closing, nullcontext
from datetime import datetime
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TypeAlias

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pyarrow.parquet as pq
from deltalake import CommitProperties, DeltaTable, Transaction
from deltalake.exceptions import CommitFailedError

from upplied.catalog.schema.tables import BEFORE_SHA256, ROW_SHA256, Table, in_schema, needed, upgraded
from upplied.catalog.store.chain import ROW_GROUP, STATED, encoded, new_file, sealed
from upplied.catalog.store.files import FileStore, explained, turn
from upplied.catalog.store.opening import Clock, Identity, OpenTable
from upplied.checks import check_id
from upplied.errors import CatalogError
from upplied.files import sync_path

Columns = list[str] | None
Where: TypeAlias = ds.Expression | None
Version = int | None
Commits = Collection[str] | None  # of steps: the rows of these alone, others may lack

_ORDER = "upplied.rows"  # the transaction that numbers rows advance


class StoredTable(OpenTable):
    """The rows of one table of a catalog."""

    def __init__(self, root: str, declared: Table, identity: Identity | None = None) -> None:
        super().__init__(root, declared, identity)
        self._turn = Path(root) / "heads" / f"{declared.name}.turn"
        self._clock = Clock(root)
        self._dataset: tuple[int, ds.Dataset] | None = None
        self._columns_added = False
        self._names: dict[str, pa.ChunkedArray] = {}  # of rows, by data file

    def dataset(self, version: Version = None, commits: Commits = None) -> ds.Dataset | None:
        """The rows of a version, else the newest; None without any. Of `commits` alone, others may lack."""
        with self._lock:
            if (delta := self._refreshed()) is None:
                return None
            if version is not None:
                what = f"{self.uri} version {version}"
                if not 0 <= version <= delta.version():
                    raise CatalogError(what, "does not exist", f"0 to {delta.version()}")
                return explained(what, lambda: self.rows_of(DeltaTable(self.uri, version)))
            if self._dataset is None or self._dataset[0] != delta.version():
                self._dataset = (delta.version(), self.rows_of(delta))
            return self._dataset[1]

    def read(
        self, where: Where = None, columns: Columns = None, version: Version = None, commits: Commits = None
    ) -> pa.Table:
        """The rows that fit, in the declared columns and types; those an older program lacked are null."""
        columns, dataset = columns or self.declared.names, self.dataset(version, commits)
        if dataset is None:
            return self._selected(None, columns)
        rows = explained(self.uri, partial(dataset.to_table, self._present(dataset, columns), where))
        return self._selected(rows, columns)

    def narrow(self, columns: list[str], where: Where = None, version: Version = None) -> pa.Table:
        """As `read`, for questions over every row: texts that repeat are kept once (dictionaries)."""
        parts = [encoded(rows) for rows in self.batches(columns, where, version)]
        return pa.concat_tables(parts).unify_dictionaries()

    def batches(
        self, columns: Columns, where: Where = None, version: Version = None, commits: Commits = None
    ) -> Iterator[pa.Table]:
        """As `read`, some rows at a time, the first none; of None, what only a newer program knows too."""
        dataset = self.dataset(version, commits)
        yield self._selected(None, columns)
        if dataset is None:
            return
        # A row of plans takes kilobytes: few are read ahead. With threads up to a gibibyte is decoded ahead
        # of whoever asks (Acero's backpressure starts there), whatever the readahead says; and with buffers
        # filled beforehand, which spares round trips to an object store, as long as nobody asks.
        scanner = dataset.scanner(
            columns=self._present(dataset, columns),
            fragment_scan_options=ds.ParquetFragmentScanOptions(pre_buffer=not self._files.local),
            filter=where,
            batch_size=ROW_GROUP,
            batch_readahead=1,
            fragment_readahead=1,
            use_threads=False,
        )
        with closing(scanner.to_batches()) as batches:
            while (batch := explained(self.uri, partial(next, batches, None))) is not None:
                yield self._selected(pa.table(batch), columns)

    def _present(self, dataset: ds.Dataset, columns: Columns) -> Columns:
        names = None if columns is None else needed(self.declared, columns)
        return names and [name for name in names if name in dataset.schema.names]

    def _selected(self, rows: pa.Table | None, columns: Columns) -> pa.Table:
        """Some columns of rows of any schema in the declared types, or of None all; of None, no rows."""
        names, declared = columns or self.declared.names, self.declared.schema
        schema = pa.schema([declared.field(name) for name in needed(self.declared, names)])
        known = schema.empty_table() if rows is None else upgraded(self.declared, in_schema(rows, schema))
        known = known.select(names)
        if rows is not None and columns is None:
            for field in (one for one in rows.schema if one.name not in names):
                known = known.append_column(field, rows[field.name])
        return known

    def whole(self, where: Where = None) -> pa.Table:
        """The rows that fit, with the columns that only a newer program knows as well."""
        return pa.concat_tables(self.batches(None, where), promote_options="default")

    def named(self, names: pa.Array) -> pa.Array:
        """Those of some names of rows, of the first column, that are stored; each data file is read once."""
        with self._lock:  # a dataset would state the range of every column of every file, which costs more
            delta = self._refreshed()
            files = [] if delta is None else [uri.rsplit("/", 1)[-1] for uri in delta.file_uris()]
            lacking = {*files} - {*self._names}
            new = {name: explained(self.uri, partial(self._names_in, name)) for name in lacking}
            self._names = {name: new.get(name, self._names.get(name)) for name in files}
            return names.filter(pc.is_in(names, pa.chunked_array(self._names.values(), pa.string())))

    def _names_in(self, file: str) -> pa.ChunkedArray:
        with pq.ParquetFile(file, filesystem=self._files.filesystem()) as parquet:
            return parquet.read(self.declared.names[:1], use_threads=False)[0]

    def append(self, rows: pa.Table) -> int:
        """Commit rows, numbered and timed, all or none; returns the version that has them, there to stay."""
        if not self._columns_added:
            self._insist(self._ready)
            self._columns_added = True

        # Those who write take turns where the disk lets them: who loses numbers and writes its file again.
        def once() -> int:
            with turn(self._turn) if self._files.local else nullcontext():
                return self._append_next(rows)

        return self._insist(once)

    def beside(self) -> "StoredTable":
        """The same table, opened anew: for who works on it while others write through this one."""
        return StoredTable(self._root, self.declared, self._identity)

    def newest(self) -> tuple[int, int]:
        """The version, and when the last rows were added (microseconds); -1 where there are none."""
        delta = self.delta()
        added = None if delta is None else delta.transaction_version(_ORDER)
        return -1 if delta is None else delta.version(), -1 if added is None else added

    def _append_next(self, rows: pa.Table) -> int:
        """Commit rows as the next in order; all writers advance one transaction: of two alike one fails."""
        with self._lock:
            delta = self._refreshed()
            assert delta is not None
            last = delta.transaction_version(_ORDER)
            now = max(int(self._clock.now().timestamp() * 1e6), -1 if last is None else last + 1)
            numbered = rows
            for name, value in (("commit_version", delta.version() + 1), ("added_at", now)):
                at, field = rows.schema.get_field_index(name), self.declared.schema.field(name)
                stamp = pa.array([value], pa.int64()).cast(field.type)[0]
                numbered = numbered.set_column(at, field, pa.repeat(stamp, len(rows)))
            followed = None
            if self.declared.is_chained:  # all of each row where none has a hash yet
                stored = self.rows_of(delta)
                followed = stored.to_table([ROW_SHA256, BEFORE_SHA256, "commit_version"])
                if not pc.any(pc.greater(followed[0], "")).as_py():
                    followed = self._selected(stored.to_table(), None)
            numbered = sealed(numbered, followed)
            added = new_file(self._files, numbered, self.declared.sought)
            properties = {"rows": str(len(rows)), STATED: self._unstated(delta.version())}
            turns = [Transaction(_ORDER, now)]
            commit = CommitProperties(properties, max_commit_retries=30, app_transactions=turns)
            try:
                delta.create_write_transaction([added], "append", rows.schema, commit_properties=commit)
            except CommitFailedError:
                self._files.remove(added.path)
                raise
            if self._names:  # which asks for all of them
                self._names[added.path] = numbered[0]
            version = delta.version() + 1
            while added.path.encode() not in self._log.read(entry := f"{version:020}.json"):
                version += 1  # somebody merged files meanwhile
            if self._files.local:
                sync_path(Path(self._log.path(entry)))
                sync_path(Path(self._log.root))
            self._heads.note(version, self._unstated(version))
            return version

    def rows_of(self, delta: DeltaTable) -> ds.Dataset:
        """The rows of a version; with delta-rs's own file system one process in seven aborted at its exit."""
        return delta.to_pyarrow_dataset(filesystem=self._files.filesystem())

    def rows_in(self, delta: DeltaTable, names: list[str]) -> ds.Dataset:
        """The rows of some data files of a version, without the ranges that a whole dataset costs."""
        return ds.dataset(names, pa.schema(delta.schema().to_arrow()), "parquet", self._files.filesystem())


_ROW_GROUP = 4096
_FEW = 16  # commits that are looked for one by one
_SUFFIX = ".parquet"
HASH_DIGITS = 32  # in the name of a commit, which is short enough for statistics


class StepTable(StoredTable):
    """The steps of the catalog at a root that rows of one table own: one file for each commit.

    ``steps/<table>/<commit id>.parquet`` is written before the rows that name it and never changed: the name
    ends with its hash. Catalogs of before schema version 3 have a Delta table, which is read as it is.
    """

    def __init__(self, root: str, declared: Table, identity: Identity) -> None:
        super().__init__(root, declared, identity)
        self.files = FileStore(f"{root.rstrip('/')}/steps/{declared.name}")

    def keep(self, rows: pa.Table, moment: datetime) -> str:
        """Keep the steps of one commit, in order; returns its name when they are there to stay."""
        self._identity.name()
        sink = BytesIO()
        pq.write_table(rows.drop_columns("commit_id"), sink, row_group_size=_ROW_GROUP, compression="zstd")
        content = sink.getvalue()
        commit = f"{moment:%Y%m%d-%H%M%S-%f}-{hashlib.sha256(content).hexdigest()[:HASH_DIGITS]}"
        name = commit + _SUFFIX
        explained(self.files.path(name), lambda: self.files.write(name, content))
        return commit

    def dataset(self, version: Version = None, commits: Commits = None) -> ds.Dataset | None:
        """The steps of all commits, or of some; None where there are none."""
        if version is not None:
            return super().dataset(version)
        paths = [check_id(commit, "commit id") + _SUFFIX for commit in commits or ()]
        if commits is None or len(paths) > _FEW:
            names = {*explained(self.files.root, self.files.names)}
            names &= names if commits is None else {*paths}
        else:
            names = {one for one in paths if explained(self.files.path(one), partial(self.files.has, one))}
        parquet, filesystem, own = ds.ParquetFileFormat(), self.files.filesystem(), pc.field("commit_id")
        parts = [  # which commit each is of spares opening the others
            parquet.make_fragment(name, filesystem, own == name.removesuffix(_SUFFIX))
            for name in sorted(names)
            if name.endswith(_SUFFIX)
        ]
        schema = self.declared.schema
        files = ds.FileSystemDataset(parts, schema, parquet, filesystem) if parts else None
        if commits is not None and len(names) == len({*commits}):
            return files
        older = super().dataset()
        if older is None or files is None:
            return files or older
        schema = pa.unify_schemas([files.schema, older.schema])
        return ds.dataset([files.replace_schema(schema), older.replace_schema(schema)])
