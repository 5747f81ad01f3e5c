"""`upplied structures`: what the fleet consists of."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

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

app = App(name="structures", help="The structures of the catalog.")


@app.command
def add(
    manifest: Path,
    /,
    *,
    prune: Annotated[bool, Parameter(negative="", help="Retire what the manifest no longer names.")] = False,
    catalog: CatalogOption = "catalog",
    workers: WorkersOption = 0,
) -> int:
    """Read the meshes that a manifest names into the catalog.

    Parameters
    ----------
    manifest : Path
        `structures.toml` or a CSV: id, kind, path, units, up, forward, ...
    """
    from upplied import fleet
    from upplied.inputs.manifests import read_manifest

    store = opened(catalog)
    with progress("reading structures", len(read_manifest(manifest))) as advance:
        ingested = fleet.ingest_structures(store, manifest, workers, lambda _: advance(), prune)
    code = ingested_report(ingested)
    if not code and len(store.demonstrations()):
        next_step("plan", "carry the demonstrations to what is new or changed", catalog)
    elif not code:
        next_step("demonstrations add LOG.mcap", "take in what an expert flew", catalog)
    return code


@app.command(name="list")
def list_(*, catalog: CatalogOption = "catalog", json: JsonOption = False) -> int:
    """List the structures of the catalog."""
    table = opened(catalog).structures()
    show("structures", table[["structure_id", "kind"]].to_dict("records"), json)
    return 0


@app.command
def check(
    file: Path,
    /,
    *,
    id: Annotated[str | None, Parameter(help="Of a manifest: tell all of this one structure.")] = None,
    png: Annotated[Path | None, Parameter(help="Picture of the one; else NAME-check.png here.")] = None,
    json: JsonOption = False,
    workers: WorkersOption = 0,
) -> int:
    """Say what is wrong with a mesh, or with what a manifest names; nothing is kept in the catalog.

    Parameters
    ----------
    file : Path
        A manifest (`structures.toml` or a CSV), or a mesh or point cloud.
    """
    from upplied import fleet
    from upplied.cli.health import check_entry, check_mesh
    from upplied.inputs.manifests import read_manifest

    if file.suffix.lower() not in (".toml", ".csv"):
        return check_mesh(file, png)
    if id is not None:
        return check_entry(file, id, png)

    with progress("checking structures", len(read_manifest(file))) as advance:
        found = fleet.check_structures(file, workers, lambda _: advance())
    show("structures", [vars(item) for item in found], json)
    return int(any(item.status == "failed" for item in found))
