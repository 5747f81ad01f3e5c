"""`upplied samples` and `quickstart`: a sample fleet, and all steps from logs to reports."""

from __future__ import annotations

import shlex
from pathlib import Path

from cyclopts import App

from upplied.cli.terminal import HERE, PRINTED, number, progress, say

PRESETS = ("paper", "recommended", "baseline")
samples = App(name="samples", help="Write a sample fleet to try.")


@samples.command
def write(folder: Path = Path("samples")) -> int:
    """Write meshes, their manifest and a simulated pilot's logs.

    Parameters
    ----------
    folder : Path
        Folder to write to; it is created if it is missing.
    """
    from upplied.outputs.sample_fleet import FILES, write_sample_fleet

    with progress("files", FILES) as advance:
        write_sample_fleet(folder, lambda _: advance())
    say(f"{folder / 'structures.toml'} and its logs")
    HERE.next_step(f"structures add {shlex.quote(str(folder / 'structures.toml'))}", "import the meshes")
    return 0


def quickstart(folder: Path = Path(".")) -> int:
    """Plan a sample fleet from log to report.

    Every demonstration is transferred to every structure of its kind.

    Parameters
    ----------
    folder : Path
        Folder for samples, catalog and reports.
    """
    from upplied import fleet, open_catalog
    from upplied.cli.pages import pairs_in
    from upplied.cli.transfer import run
    from upplied.fleet.ingest import find_logs
    from upplied.inputs.manifests import read_manifest
    from upplied.outputs.sample_fleet import FILES, write_sample_fleet

    samples, reports = folder / "samples", folder / "reports"
    say("1/4 Writing a sample fleet: meshes, a manifest and simulated logs")
    with progress("files", FILES) as advance:
        write_sample_fleet(samples, lambda _: advance())
    catalog = open_catalog(folder / "catalog")
    say("2/4 Importing structures and demonstrations")
    with progress("structures", len(read_manifest(samples / "structures.toml"))) as advance:
        fleet.ingest_structures(catalog, samples / "structures.toml", progress=lambda _: advance())
    logs = find_logs([samples])
    with progress("demonstrations", len(logs)) as advance:
        fleet.ingest_demonstrations(catalog, logs, progress=lambda _: advance())
    say("3/4 Planning every demonstration for every structure of its kind")
    result = run(catalog, fleet.decide(catalog, fleet.PlanRequest(PRESETS)), 0, 600.0)
    say("4/4 Publishing tables, pages and pictures")
    with progress("publishing", pairs_in(catalog)) as advance:
        fleet.publish(catalog, reports, progress=lambda _: advance())
    say(f"Plans: {result}")
    return show_results(folder / "catalog", str(reports))


def show_results(catalog: Path, reports: str) -> int:
    """Print the table of plans and what to open next; 1 where one of them failed."""
    from upplied import open_catalog

    transfers = open_catalog(catalog).transfers()
    rows = []
    for (demonstration, target), plans in transfers.groupby(["demonstration_id", "target_id"]):
        row, by = {"demonstration": demonstration, "structure": target}, plans.set_index("preset")
        for preset in PRESETS:
            shown = number(by["coverage_inspected_pct"].get(preset))
            row[f"{preset} %"] = by["status"].get(preset) if shown is None else shown
        rows.append(row | {f"Fréchet {preset}": by["frechet_z"].get(preset) for preset in PRESETS[:2]})
    PRINTED.show("inspected surface shown", rows)
    say(f"Open {reports}/index.html, or: pd.read_parquet('{reports}/transfers.parquet')")
    return int((transfers["status"] == "failed").any())
