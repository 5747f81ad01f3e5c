"""The steps of plans and demonstrations: one file for each commit, which the rows that own them name.

``steps/<table>/<commit id>.parquet`` is written before those rows and never changed: the name ends with its
hash. Nothing is to be merged. Catalogs of before schema version 3 have a Delta table, which is read as it
is.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from datetime import datetime
from functools import partial
from io import BytesIO

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pyarrow.parquet as pq

from upplied.catalog.schema.tables import Table
from upplied.catalog.store.delta import StoredTable
from upplied.catalog.store.files import FileStore, explained
from upplied.catalog.store.identity import Identity
from upplied.checks import check_id

_ROW_GROUP = 4096
_FEW = 16  # commits that are looked for one by one
_SUFFIX = ".parquet"
HASH_DIGITS = 32  # in the name of a commit, which is short enough for statistics


class StepTable(StoredTable):
    """The steps of the catalog at a root that rows of one table own."""

    def __init__(self, root: str, declared: Table, identity: Identity) -> None:
        super().__init__(root, declared, identity)
        self.files = FileStore(f"{root.rstrip('/')}/steps/{declared.name}")

    def keep(self, rows: pa.Table, moment: datetime) -> str:
        """Keep the steps of one commit, in order; returns its name when they are there to stay."""
        self._identity.made()
        sink = BytesIO()
        pq.write_table(rows.drop_columns("commit_id"), sink, row_group_size=_ROW_GROUP, compression="zstd")
        content = sink.getvalue()
        commit = f"{moment:%Y%m%d-%H%M%S-%f}-{hashlib.sha256(content).hexdigest()[:HASH_DIGITS]}"
        name = commit + _SUFFIX
        explained(self.files.path(name), lambda: self.files.write(name, content))
        return commit

    def dataset(
        self, version: int | None = None, commits: Collection[str] | None = None
    ) -> ds.Dataset | None:
        """The steps of all commits, or of some; None where there are none."""
        if version is not None:
            return super().dataset(version)
        names = set(explained(self.files.root, self.files.names) if commits is None else self._there(commits))
        files = self._dataset_of(sorted(name for name in names if name.endswith(_SUFFIX)))
        if commits is not None and len(names) == len({*commits}):
            return files
        older = super().dataset()
        if older is None or files is None:
            return files or older
        schema = pa.unify_schemas([files.schema, older.schema])
        return ds.dataset([files.replace_schema(schema), older.replace_schema(schema)])

    def _there(self, commits: Collection[str]) -> list[str]:
        names = [check_id(commit, "commit id") + _SUFFIX for commit in commits]
        if len(names) > _FEW:
            return sorted({*names} & {*explained(self.files.root, self.files.names)})
        return [name for name in names if explained(self.files.path(name), partial(self.files.has, name))]

    def _dataset_of(self, names: list[str]) -> ds.Dataset | None:
        """The files as one dataset; which commit each is of spares opening the others."""
        if not names:
            return None
        parquet, filesystem = ds.ParquetFileFormat(), self.files.filesystem()
        parts = [
            parquet.make_fragment(name, filesystem, pc.field("commit_id") == name.removesuffix(_SUFFIX))
            for name in names
        ]
        return ds.FileSystemDataset(parts, self.declared.schema, parquet, filesystem)
