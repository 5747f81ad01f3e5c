"""The catalog kept small and checked, once a week."""

from __future__ import annotations

from typing import Annotated

from prefect import flow
from prefect.states import Completed, Failed, State
from pydantic import Field

from . import tasks
from .artifacts import maintenance_artifact
from .parameters import Location
from .roots import check_roots
from .states import errors_in_words


@flow(name="maintain-catalog", flow_run_name="maintain {catalog}")
@errors_in_words
def maintain_catalog(catalog: Location = "catalog", keep_days: Annotated[float, Field(ge=1)] = 30.0) -> State:
    """Merge small files, remove what nobody can ask for any more, and check every reference and hash.

    Args:
        catalog: Folder or object-store URI.
        keep_days: Versions younger than this can still be asked for.
    """
    check_roots(catalog=catalog)
    merged = tasks.compact(catalog)
    tasks.vacuum(catalog, keep_days)
    findings = tasks.verify(catalog)
    summary = maintenance_artifact(merged, findings)
    return Failed(message=summary) if findings else Completed(message=summary)
