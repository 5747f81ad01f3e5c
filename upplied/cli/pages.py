"""`upplied studio` and `report`: the pages of a catalog, in a browser or as files."""

from __future__ import annotations

import webbrowser
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from upplied import fleet
from upplied.cli.terminal import HERE, Where, complain, errors, progress, say
from upplied.extras import extra

if TYPE_CHECKING:
    from upplied.catalog import Catalog

FileOption = Annotated[Path | None, Parameter(help="One HTML file with everything inside, for mail.")]
OneDemonstration = Annotated[str | None, Parameter(help="Only this demonstration in the single file.")]
PagesOption = Annotated[int, Parameter(help="Maximum number of pages; plans that need attention come first.")]
ForceOption = Annotated[bool, Parameter(help="Replace a newer publication, or one of another catalog.")]
PortOption = Annotated[int, Parameter(help="Port on this machine; 0 takes any free one.")]
OpenOption = Annotated[bool, Parameter("--open", negative="--no-open", help="Open the browser as well.")]


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
    from upplied.outputs.publish import publish_file

    store = where.opened()
    problems: tuple[str, ...] = ()
    if folder is not None or self_contained is None:
        with progress("publishing", min(pages, pairs_in(store))) as advance:
            publish = partial(fleet.publish, pages=pages, force=force, map_of=kind_map)
            published = publish(store, folder or "reports", progress=lambda _: advance())
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
    """How many pairs of a demonstration and a target there are."""
    return len(catalog.transfers(columns=["demonstration_id", "target_id"]).drop_duplicates())


def studio(
    transfer: str = "", /, *, port: PortOption = 0, open_: OpenOption = True, where: Where = HERE
) -> int:
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
