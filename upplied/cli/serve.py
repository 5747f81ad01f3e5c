"""`upplied serve`, `deploy`, `watch` and `fleet`: a fleet by Prefect, from any folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter
from cyclopts.validators import Number

from upplied.cli.options import Texts
from upplied.cli.terminal import complain, say
from upplied.extras import required

fleet = App(name="fleet", help="The fleet's deployments in Prefect.")

_PORT = Number(gte=0, lte=65534)
_PORT_HELP = "Port of Prefect, 0 for any; the pages use the next one."
PortOption = Annotated[int, Parameter("--port", env_var="UPPLIED_PORT", help=_PORT_HELP, validator=_PORT)]
RootOption = Annotated[Texts, Parameter("--root", help="Further folder or URI for runs; repeatable.")]
FlightsOption = Annotated[bool, Parameter(help="The logs are flights of plans: start ingest-flights.")]
Part = Literal["server", "worker", "reports"]
PartOption = Annotated[Part | None, Parameter("--only", help="Run one part only, for systemd or compose.")]


def serve(*, port: PortOption = 4200, root: RootOption = (), only: PartOption = None) -> int:
    """Run the fleet service of this folder: Prefect, a worker and the pages, until Ctrl-C."""
    required("prefect", "fleet")
    from upplied.flows import serve as service
    from upplied.flows.server import ServerError

    try:
        return service.only(only, port, root) if only else service.serve(port, root)
    except ServerError as error:
        complain(error)
        return 1


def deploy(*, port: PortOption = 4200) -> int:
    """Apply the deployments to the Prefect server: prefect.yaml of this folder, or the program's own."""
    if not (variables := connected(port)):
        return 1
    from upplied.flows import serve
    from upplied.flows.server import ServerError

    try:
        serve.deploy(variables)
    except ServerError as error:
        complain(error)
        return 1
    return 0


def watch(folder: Path, *, flights: FlightsOption = False, port: PortOption = 4200) -> int:
    """Report each new log in a folder to Prefect, which starts ingest-demonstrations for it.

    Parameters
    ----------
    folder : Path
        Folder to watch with its subfolders; existing logs are reported too.
    """
    if not folder.is_dir():
        complain(f"error: {folder} is not a folder")
        return 2
    if not connected(port):
        return 1
    from upplied.flows.watch import FLOWN, LANDED
    from upplied.flows.watch import watch as tell

    tell(folder, FLOWN if flights else LANDED)
    return 0


@fleet.command
def run(
    *parameters: Annotated[str, Parameter(allow_leading_hyphen=False)],
    watch: Annotated[bool, Parameter(negative="--no-watch", help="Follow the run until it ends.")] = True,
    port: PortOption = 4200,
) -> int:
    """Run transfer-fleet now, on the server at PREFECT_API_URL, else the one of `upplied serve`.

    Parameters
    ----------
    parameters : str
        Parameters of the flow, as NAME=VALUE with the value in JSON.
    """
    if not (variables := connected(port)):
        return 1
    from upplied.flows.pool import NotAccepted, run_now

    try:
        ended = run_now(parameters, watch, say)
    except NotAccepted as error:
        complain(f"error: {variables['PREFECT_API_URL']}: {error}")
        return 1
    return int(not ended)


@fleet.command
def notify(
    url: str,
    *,
    every_run: Annotated[bool, Parameter(help="Report successful runs as well.")] = False,
    port: PortOption = 4200,
) -> int:
    """Send a message whenever a run fails, is lost or leaves failures; a new address replaces the old one.

    Parameters
    ----------
    url : str
        Address: a webhook (http://...), Slack (https://hooks.slack.com/...), or any Apprise address,
        as mailto://user:password@smtp.example.org?to=ops@example.org. Empty: no more messages.
    """
    if not connected(port):
        return 1
    from upplied.flows.automations import tell

    say(tell(url, every_run))
    return 0


def connected(port: int) -> dict[str, str]:
    """The variables of the server, set for Prefect; empty, after a message, if no server answers."""
    required("prefect", "fleet")
    from upplied.flows import environment
    from upplied.flows.server import answers

    variables = environment.client(port)
    os.environ.update(variables)  # before Prefect is loaded, which reads it once
    if answers(address := variables["PREFECT_API_URL"]):
        return variables
    remedy = "Start one (`upplied serve`), or set PREFECT_API_URL to the address of yours."
    complain(f"error: no Prefect server answers at {address}. {remedy}")
    return {}
