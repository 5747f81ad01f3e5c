"""What people open: plain tables for any program, pages and pictures for the eye."""

from __future__ import annotations

from pathlib import Path

from upplied.catalog.database import Catalog
from upplied.catalog.published import export_tables
from upplied.outputs.publish import Published
from upplied.outputs.publish import publish as publish_pages


def publish(catalog: Catalog, folder: str | Path) -> Published:
    """Write the tables as Parquet, then the pages and pictures; what did not change is left alone.

    Parameters
    ----------
    catalog : Catalog
    folder : path
        Made where it does not exist. ``index.html`` is what a person opens.
    """
    export_tables(catalog, folder)
    return publish_pages(catalog, folder)
