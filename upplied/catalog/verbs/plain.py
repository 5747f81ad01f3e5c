"""Tables as plain Parquet files in a folder that is new, for datasets."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from upplied.catalog.schema.tables import TABLES
from upplied.catalog.verbs.published import write
from upplied.errors import CatalogError


def write_tables(folder: Path, parts: dict[str, Iterator[pa.Table]]) -> dict[str, int]:
    """Write tables as one Parquet file each; rows written, by table."""
    try:
        return {
            name: write(folder / f"{name}.parquet", TABLES[name], tables) for name, tables in parts.items()
        }
    except OSError as error:
        raise CatalogError(str(folder), f"cannot be written: {error}", "", "free space or rights") from None
