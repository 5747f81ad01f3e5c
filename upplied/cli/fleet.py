"""`upplied fleet`: the short way to the deployment that Prefect runs every night."""

from __future__ import annotations

import os
import subprocess
import sys
import urllib.error
import urllib.request
from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.terminal import errors

app = App(name="fleet", help="The fleet's deployments in Prefect.")

DEPLOYMENT = "transfer-fleet/transfer-fleet"


@app.command
def run(
    *parameters: Annotated[str, Parameter(allow_leading_hyphen=False)],
    watch: Annotated[bool, Parameter(negative="--no-watch", help="Wait for the end and follow it.")] = True,
) -> int:
    """Run transfer-fleet now, on the server at PREFECT_API_URL, else the one of `make serve`.

    Parameters
    ----------
    parameters : str
        Of the flow, as NAME=VALUE with the value in JSON.
    """
    served_here = f"http://127.0.0.1:{os.environ.get('UPPLIED_PORT', '4200')}/api"
    environment = {"PREFECT_API_URL": served_here, "DO_NOT_TRACK": "1"} | os.environ
    address = environment["PREFECT_API_URL"]
    if not answers(address):
        errors.print(
            f"error: no Prefect server answers at {address}. "
            "Start one (`make serve`), or set PREFECT_API_URL to the address of yours.",
            markup=False,
        )
        return 1
    command = [sys.executable, "-m", "prefect", "deployment", "run", DEPLOYMENT]
    for parameter in parameters:
        command += ["--param", parameter]
    ran = subprocess.run([*command, *(["--watch"] if watch else [])], env=environment, check=False)
    return int(ran.returncode != 0)


def answers(address: str) -> bool:
    """Whether a Prefect server is there; Prefect's own commands would start one that knows no deployment."""
    try:
        with urllib.request.urlopen(f"{address.rstrip('/')}/health", timeout=10):
            return True
    except urllib.error.HTTPError:
        return True  # it wants a name first, which Prefect's settings may hold
    except (OSError, ValueError):
        return False
