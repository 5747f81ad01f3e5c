"""Tables as pandas frames with their units, and the moments by which they are asked."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds

from upplied.errors import SettingsError

if TYPE_CHECKING:
    import pandas as pd

When = datetime | str


class Units(dict[str, str]):
    """The unit of each column; never changed, so that pandas, which copies it at every step, need not."""

    def __deepcopy__(self, memo: object) -> Units:
        return self


def frame(table: pa.Table) -> pd.DataFrame:
    """A DataFrame; the unit of each column is in ``frame.attrs["units"]``."""
    rows = table.to_pandas()
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema if field.metadata}
    rows.attrs["units"] = Units(units)
    return rows


def decoded(table: pa.Table) -> pa.Table:
    """A table whose dictionaries are plain columns again."""
    for at, field in enumerate(table.schema):
        if pa.types.is_dictionary(field.type):
            plain = field.with_type(field.type.value_type)
            table = table.set_column(at, plain, table.column(at).cast(plain.type))
    return table


def moment(when: When) -> pd.Timestamp:
    """A moment in UTC; a text without a zone is UTC."""
    import pandas as pd

    try:
        stamp = pd.Timestamp(when)
    except ValueError:
        raise SettingsError(
            f"moment {when!r}", "cannot be read", "like 2026-11-21 or 2026-11-21T02:00:00Z"
        ) from None
    return stamp.tz_localize("UTC") if stamp.tzinfo is None else stamp.tz_convert("UTC")


def until(column: str, as_of: When | None) -> ds.Expression | None:
    """The rows until a moment, by a column of times; all where none is asked for."""
    return None if as_of is None else pc.field(column) <= pa.scalar(moment(as_of), pa.timestamp("us", "UTC"))
