"""Reports from the catalog."""

from __future__ import annotations

from prefect import flow
from prefect.states import State

from . import tasks
from .lineage import asset, making
from .parameters import Location
from .roots import check_roots
from .states import ended, errors_in_words


@flow(name="publish-reports", flow_run_name="publish to {folder}")
@errors_in_words
def publish_reports(folder: Location = "reports", catalog: Location = "catalog") -> State:
    """Publish the catalog as plain Parquet, an HTML page and pictures.

    Args:
        folder: Where to; what it held is replaced.
        catalog: Folder or object-store URI.
    """
    check_roots(catalog=catalog, folder=folder)
    publish = making(tasks.publish_reports, asset(folder, "reports"), [asset(catalog, "transfers")])
    problems = publish(catalog, folder)
    return ended(f"published to {folder}", problems)
