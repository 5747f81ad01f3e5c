"""`upplied demonstrations`: what the experts flew."""

from __future__ import annotations

from pathlib import Path

from cyclopts import App

from upplied.cli.terminal import (
    CatalogOption,
    JsonOption,
    WorkersOption,
    ingested_report,
    next_step,
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
    from upplied.fleet.ingest import find_logs

    found = find_logs(logs)
    with progress("reading logs", len(found)) as advance:
        ingested = fleet.ingest_demonstrations(opened(catalog), found, workers, lambda _: advance())
    code = ingested_report(ingested)
    names = [item.name for item in ingested if item.status in ("added", "unchanged")]
    if not code and names:
        next_step(f"transfer {names[0]}", "carry it to every other structure of its kind", catalog)
    return code


@app.command(name="list")
def list_(*, catalog: CatalogOption = "catalog", json: JsonOption = False) -> int:
    """List the demonstrations of the catalog."""
    table = opened(catalog).demonstrations()
    show("demonstrations", table[["demonstration_id", "structure_id"]].to_dict("records"), json)
    return 0
