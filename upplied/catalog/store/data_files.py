"""Data files, written here (delta-rs panics on a full disk) before a commit names them."""

from __future__ import annotations

import hashlib
import json
import secrets
import time
from collections.abc import Sequence
from datetime import datetime, timedelta
from io import BytesIO

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from deltalake.transaction import AddAction

from upplied.catalog.store.files import FileStore

ROW_GROUP = 16_384
_LONGEST_STATISTIC = 64
_NAMES = ("transfer_id", "key", "waypoints_sha256")  # hardly one twice


def new_file(files: FileStore, rows: pa.Table, sought: Sequence[str]) -> AddAction:
    """Write a data file that no commit names yet; readers may skip it by the columns that are sought."""
    sink = BytesIO()
    # Without Arrow's own schema, which is as large as a hundred rows; texts may be dictionaries.
    pq.write_table(rows, sink, row_group_size=ROW_GROUP, compression="zstd", store_schema=False)
    name = f"part-{hashlib.sha256(sink.getbuffer()).hexdigest()}-{secrets.token_hex(4)}.parquet"
    files.write(name, sink.getvalue())
    return AddAction(
        name, sink.tell(), {}, int(time.time() * 1000), True, statistics(decoded(rows.select(sought)))
    )


def statistics(rows: pa.Table) -> str:
    """What readers may skip a file by: the range of each column, and its nulls; long texts have no range.

    A column that is filtered by must have one: pyarrow takes a missing range for nulls.
    """
    low, high = {}, {}
    for name in rows.column_names:
        ends = pc.min_max(rows[name]).as_py()
        least, most = ends["min"], ends["max"]
        if most is None or len(str(most)) > _LONGEST_STATISTIC or most != most:
            continue
        if isinstance(most, datetime):
            most += timedelta(milliseconds=1)
            least, most = (when.isoformat(timespec="milliseconds") for when in (least, most))
        low[name], high[name] = least, most
    nulls = {name: rows[name].null_count for name in rows.column_names}
    return json.dumps({"numRecords": len(rows), "minValues": low, "maxValues": high, "nullCount": nulls})


def encoded(rows: pa.Table) -> pa.Table:
    """Rows with repeated texts as dictionaries; copied, since columns as read keep ten times their bytes."""
    for at, field in enumerate(rows.schema):
        if pa.types.is_string(field.type) and field.name not in _NAMES:
            rows = rows.set_column(at, field.name, rows.column(at).dictionary_encode())
    return rows.take(pa.array(np.arange(len(rows))))


def decoded(rows: pa.Table) -> pa.Table:
    """Rows whose dictionaries are plain columns again."""
    for at, field in enumerate(rows.schema):
        if pa.types.is_dictionary(field.type):
            plain = field.with_type(field.type.value_type)
            rows = rows.set_column(at, plain, rows.column(at).cast(plain.type))
    return rows
