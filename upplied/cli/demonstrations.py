"""`upplied demonstrations`: what the experts flew."""

from __future__ import annotations

from pathlib import Path

from cyclopts import App

from upplied.cli.terminal import (
    CatalogOption,
    JsonOption,
    WorkersOption,
    ingested_report,
    opened,
    progress,
    show,
)

app = App(name="demonstrations", help="The demonstrations of the catalog.")


@app.command
def add(*logs: Path, catalog: CatalogOption = "catalog", workers: WorkersOption = 0) -> int:
    """Read logs into the catalog.

    Parameters
    ----------
    logs : Path
        MCAP files, or folders of them.
    """
    from upplied import fleet

    with progress("reading logs", None) as advance:
        ingested = fleet.ingest_demonstrations(opened(catalog), logs, workers, lambda _: advance())
    return ingested_report(ingested)


@app.command(name="list")
def list_(*, catalog: CatalogOption = "catalog", json: JsonOption = False) -> int:
    """List the demonstrations of the catalog."""
    table = opened(catalog).demonstrations()
    show("demonstrations", table[["demonstration_id", "structure_id"]].to_dict("records"), json)
    return 0
