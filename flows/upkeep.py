"""What the catalog becomes without new files: published for people, and kept small and checked."""

from __future__ import annotations

from typing import Annotated

from prefect import flow
from prefect.states import Completed, Failed, State
from pydantic import Field

from upplied.catalog import compact, open_catalog, vacuum, verify

from . import tasks
from .environment import check_roots
from .parameters import Location
from .states import ended, errors_in_words, maintenance_artifact


@flow(name="publish-reports", flow_run_name="publish to {folder}")
@errors_in_words
def publish_reports(folder: Location = "reports", catalog: Location = "catalog") -> State:
    """Publish the catalog as plain Parquet, an HTML page and pictures.

    Args:
        folder: Where to; what it held is replaced.
        catalog: Folder or object-store URI.
    """
    check_roots(catalog=catalog, folder=folder)
    return ended(f"published to {folder}", tasks.publish(catalog, folder))


@flow(name="maintain-catalog", flow_run_name="maintain {catalog}")
@errors_in_words
def maintain_catalog(catalog: Location = "catalog", keep_days: Annotated[float, Field(ge=1)] = 30.0) -> State:
    """Merge small files, remove what nobody can ask for any more, and check every reference and hash.

    Args:
        catalog: Folder or object-store URI.
        keep_days: Versions younger than this can still be asked for.
    """
    check_roots(catalog=catalog)
    store = open_catalog(catalog)
    merged = tasks.stored("compact", compact)(store)
    tasks.stored("vacuum", vacuum)(store, keep_days)
    findings = [str(finding) for finding in tasks.stored("verify", verify)(store)]
    summary = maintenance_artifact(merged, findings)
    return Failed(message=summary) if findings else Completed(message=summary)
