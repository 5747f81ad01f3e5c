"""What readers may skip a data file by."""

from __future__ import annotations

import json
from datetime import datetime, timedelta

import pyarrow as pa
import pyarrow.compute as pc

_LONGEST_STATISTIC = 64


def statistics(rows: pa.Table) -> str:
    """What readers may skip the file by: the range of each column, and its nulls.

    Long texts have no range; moments are stated to the millisecond, so theirs is a little wider. A
    column that is filtered by must have one (ids are short enough): pyarrow takes a missing range
    for nulls.
    """
    low, high = {}, {}
    for name in rows.column_names:
        if pa.types.is_nested(rows.schema.field(name).type):
            continue  # of a newer program; we have none
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
