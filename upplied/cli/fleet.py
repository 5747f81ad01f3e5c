"""`upplied fleet`: the short way to the deployment that Prefect runs every night."""

from __future__ import annotations

import subprocess
import sys
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
    """Run transfer-fleet now; needs a server and a worker (`make serve`).

    Parameters
    ----------
    parameters : str
        Of the flow, as NAME=VALUE with the value in JSON.
    """
    command = [sys.executable, "-m", "prefect", "deployment", "run", DEPLOYMENT]
    for parameter in parameters:
        command += ["--param", parameter]
    code = subprocess.run([*command, *(["--watch"] if watch else [])], check=False).returncode
    if code:
        errors.print(
            "The run did not succeed. Is a server there (`make serve`), and PREFECT_API_URL its address?"
        )
    return int(code != 0)
