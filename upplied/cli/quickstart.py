"""`upplied quickstart`: the whole way once, on a sample fleet, without any server."""

from __future__ import annotations

from pathlib import Path

from cyclopts import App

from upplied.cli.terminal import console, progress

app = App(name="quickstart", help="Try the whole way once on a sample fleet.")


@app.default
def quickstart(folder: Path = Path(".")) -> int:
    """Make a sample fleet, carry every demonstration to every structure of its kind, and publish.

    Parameters
    ----------
    folder : Path
        Where samples, catalog and reports are written.
    """
    from upplied import fleet, open_catalog
    from upplied.cli.report import pairs_in
    from upplied.cli.transfer import run
    from upplied.fleet.ingest import find_logs
    from upplied.inputs.manifests import read_manifest
    from upplied.outputs.sample_fleet import FILES, write_sample_fleet

    samples, reports = folder / "samples", folder / "reports"
    console.print("1. A sample fleet: meshes, a manifest and a simulated pilot's logs")
    with progress("files", FILES) as advance:
        write_sample_fleet(samples, lambda _: advance())
    catalog = open_catalog(folder / "catalog")
    console.print("2. Into the catalog")
    with progress("structures", len(read_manifest(samples / "structures.toml"))) as advance:
        fleet.ingest_structures(catalog, samples / "structures.toml", progress=lambda _: advance())
    logs = find_logs([samples])
    with progress("demonstrations", len(logs)) as advance:
        fleet.ingest_demonstrations(catalog, logs, progress=lambda _: advance())
    console.print("3. Every demonstration to every target of its kind")
    presets = ("paper", "recommended", "baseline")
    result = run(catalog, fleet.decide(catalog, fleet.PlanRequest(presets)), 0, 600.0)
    console.print("4. Tables, pages and pictures")
    with progress("publishing", pairs_in(catalog)) as advance:
        fleet.publish(catalog, reports, progress=lambda _: advance())
    console.print(f"{result}. Open {reports / 'index.html'}", soft_wrap=True)
    return int(result.ok < result.total)
