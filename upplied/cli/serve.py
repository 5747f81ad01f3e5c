"""`upplied studio`, `report`, `serve`, `deploy`, `watch` and `fleet`: pages, and a fleet by Prefect."""

from __future__ import annotations

import os
import webbrowser
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter
from cyclopts.validators import Number

from upplied.cli.options import Texts, Words
from upplied.cli.terminal import HERE, Where, complain, errors, progress, say
from upplied.extras import extra, required

if TYPE_CHECKING:
    from upplied.catalog import Catalog

fleet = App(name="fleet", help="The fleet's deployments in Prefect.")

_PORT = Number(gte=0, lte=65534)
_PORT_HELP = "Port of Prefect, 0 for any; the pages use the next one."
PortOption = Annotated[int, Parameter("--port", env_var="UPPLIED_PORT", help=_PORT_HELP, validator=_PORT)]
RootOption = Annotated[Texts, Parameter("--root", help="Further folder or URI for runs; repeatable.")]
FlightsOption = Annotated[bool, Parameter(help="The logs are flights of plans: start ingest-flights.")]
Part = Literal["server", "worker", "reports"]
PartOption = Annotated[Part | None, Parameter("--only", help="Run one part only, for systemd or compose.")]
FileOption = Annotated[Path | None, Parameter(help="One HTML file with everything inside, for mail.")]
OneDemonstration = Annotated[str | None, Parameter(help="Only this demonstration in the single file.")]
PagesOption = Annotated[int, Parameter(help="Maximum number of pages; plans that need attention come first.")]
ForceOption = Annotated[bool, Parameter(help="Replace a newer publication, or one of another catalog.")]
PagesPort = Annotated[int, Parameter(help="Port on this machine; 0 takes any free one.")]
FollowOption = Annotated[bool, Parameter(negative="--no-watch", help="Follow the run until it ends.")]
EveryOption = Annotated[bool, Parameter(help="Report successful runs as well.")]
Open = Annotated[bool, Parameter("--open", negative="--no-open", help="Open the browser as well.")]


def report(
    folder: str | None = None,
    *,
    self_contained: FileOption = None,
    demonstration: OneDemonstration = None,
    target: Annotated[str | None, Parameter(help="Only this structure in the single file.")] = None,
    pages: PagesOption = 10_000,
    force: ForceOption = False,
    where: Where = HERE,
) -> int:
    """Publish the catalog as Parquet, HTML pages and pictures, or as one file for mail.

    Parameters
    ----------
    folder : str
        Folder to write, by default `reports`; only changed files are written.
    """
    from upplied.findings.queries import kind_map
    from upplied.outputs.publish import publish, publish_file

    store = where.opened()
    problems: tuple[str, ...] = ()
    if folder is not None or self_contained is None:
        with progress("publishing", min(pages, pairs_in(store))) as advance:
            written = partial(publish, pages=pages, force=force, map_of=kind_map)
            published = written(store, folder or "reports", progress=lambda _: advance())
        say(str(published.index))
        problems = published.problems
    if self_contained is not None:
        with errors.status("drawing pages"):
            say(publish_file(store, self_contained, demonstration_id=demonstration, target_id=target))
    if not problems:
        where.next_step("fly TRANSFER", "simulate a plan in wind; its ID is on its page")
    for problem in problems:
        complain(f"problem: {problem}")
    return int(bool(problems))


def pairs_in(catalog: Catalog) -> int:
    return len(catalog.transfers(columns=["demonstration_id", "target_id"]).drop_duplicates())


def studio(transfer: str = "", /, *, port: PagesPort = 0, open_: Open = True, where: Where = HERE) -> int:
    """Open the fleet, or one plan, in the browser: look, edit, release or reject.

    The pages are served to this machine alone, until Ctrl-C.

    Parameters
    ----------
    transfer : str
        ID of a plan to edit, or the beginning of one; without it the fleet opens.
    """
    store = where.opened()
    store.identity.required()
    page = f"studio/{store.find_transfer(transfer)}" if transfer else ""
    with extra("export"):
        from upplied.web.serving import Server
    try:
        server = Server(store, port)
    except (OSError, OverflowError) as error:
        complain(f"error: port {port}: {error}. Choose another: --port 0")
        return 2
    address = server.address(page)
    say(f"Open {address}")
    say("Ctrl-C stops it. Anyone with this address can edit and release plans.")
    if open_:
        webbrowser.open(address)
    server.run()
    return 0


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
def run(*parameters: Words, watch: FollowOption = True, port: PortOption = 4200) -> int:
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
def notify(url: str, *, every_run: EveryOption = False, port: PortOption = 4200) -> int:
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
