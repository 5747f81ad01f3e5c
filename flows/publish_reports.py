"""Reports from the catalog."""

from __future__ import annotations

from prefect import flow

from flows import tasks
from flows.parameters import Location


@flow(name="publish-reports", flow_run_name="publish to {folder}")
def publish_reports(folder: Location = "reports", catalog: Location = "catalog") -> None:
    """Publish the catalog as plain Parquet, an HTML page and pictures.

    Args:
        folder: Where to; what it held is replaced.
        catalog: Folder or object-store URI.
    """
    tasks.publish_reports(catalog, folder)
