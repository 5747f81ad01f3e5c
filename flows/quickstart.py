"""`make quickstart`: the real flows on a sample fleet, against a private Prefect server."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import TYPE_CHECKING

from rich.console import Console

from upplied.cli.quickstart import PRESETS, show_results
from upplied.cli.terminal import progress

from .environment import home
from .server import Server, ServerError

if TYPE_CHECKING:
    from prefect.states import State

SAMPLES, CATALOG, REPORTS = "samples", "catalog", "reports"


def main() -> int:
    """Make the fleet while the server starts, then run the flows in a process that knows the server."""
    began = time.monotonic()
    console = Console(highlight=False)
    console.print("[bold]1/4[/] A sample fleet and a private Prefect server")
    try:
        with Server(home() / ".cache" / "quickstart-prefect") as server:
            from upplied.outputs.sample_fleet import write_sample_fleet  # while the server starts

            with progress("meshes and logs", None) as advance:
                write_sample_fleet(home() / SAMPLES, lambda _: advance())
            server.wait()
            code = subprocess.run(
                [sys.executable, "-m", "upplied.flows.quickstart", "--flows"],
                env=server.environment | {"PREFECT_LOGGING_LEVEL": "WARNING"},
                cwd=home(),
                check=False,
            ).returncode
    except ServerError as error:
        console.print(str(error), markup=False)
        return 1
    if code in (0, 1):
        console.print(f"Done in {time.monotonic() - began:.0f} s.")
    return code


def run_flows() -> int:
    """The four flows, one after the other, and what came of them."""
    from .ingest import ingest_demonstrations, ingest_structures
    from .transfer_fleet import transfer_fleet

    console = Console(highlight=False)
    console.print("[bold]2/4[/] Structures and demonstrations into the catalog")
    structures = ingest_structures(f"{SAMPLES}/structures.toml", CATALOG, return_state=True)
    good = say(console, "structures", structures)
    good &= say(console, "demonstrations", ingest_demonstrations([SAMPLES], CATALOG, return_state=True))
    console.print("[bold]3/4[/] Every demonstration to every structure of its kind")
    good &= say(console, "plans", transfer_fleet(CATALOG, REPORTS, presets=list(PRESETS), return_state=True))
    console.print("[bold]4/4[/] Results")
    return show_results(home() / CATALOG, REPORTS) or int(not good)


def say(console: Console, what: str, state: State) -> bool:
    """Print the result of a flow in a line; whether it completed."""
    console.print(f"    {what}: {state.message}", markup=False)
    return state.is_completed()


if __name__ == "__main__":
    sys.exit(run_flows() if sys.argv[1:] == ["--flows"] else main())
