"""The catalog kept small and checked, once a week."""

from __future__ import annotations

from typing import Annotated

from prefect import flow
from prefect.states import Completed, Failed, State
from pydantic import Field

from flows import tasks
from flows.artifacts import maintenance_artifact
from flows.parameters import Location


@flow(name="maintain-catalog", flow_run_name="maintain {catalog}")
def maintain_catalog(catalog: Location = "catalog", keep_days: Annotated[float, Field(ge=1)] = 30.0) -> State:
    """Merge small files, remove what nobody can ask for any more, and check every reference and hash.

    Args:
        catalog: Folder or object-store URI.
        keep_days: Versions younger than this can still be asked for.
    """
    merged = tasks.compact(catalog)
    tasks.vacuum(catalog, keep_days)
    findings = tasks.verify(catalog)
    summary = maintenance_artifact(merged, findings)
    return Failed(message=summary) if findings else Completed(message=summary)
