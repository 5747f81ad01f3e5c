"""`upplied fleet`: the short way to the deployment that Prefect runs every night."""

from __future__ import annotations

from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.serve import PortOption, connected
from upplied.cli.terminal import complain, say

app = App(name="fleet", help="The fleet's deployments in Prefect.")


@app.command
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
    from upplied.flows.client import NotAccepted, run_now

    try:
        ended = run_now(parameters, watch, say)
    except NotAccepted as error:
        complain(f"error: {variables['PREFECT_API_URL']}: {error}")
        return 1
    return int(not ended)


@app.command
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
    from upplied.flows.notices import tell

    say(tell(url, every_run))
    return 0
