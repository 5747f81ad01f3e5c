"""`upplied studio`: a plan in a browser, to be changed, judged at once, released or rejected."""

from __future__ import annotations

import webbrowser
from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.terminal import CatalogOption, complain, console, errors, opened_at

app = App(name="studio", help="Open a plan in the browser: change it, see it judged, release or reject it.")


@app.default
def studio(
    transfer: str,
    /,
    *,
    port: Annotated[int, Parameter(help="0: any that is free.")] = 0,
    open_: Annotated[
        bool, Parameter(name="--open", negative="--no-open", help="Open the browser as well.")
    ] = True,
    catalog: CatalogOption = "catalog",
) -> int:
    """Serve the page of one plan to this machine alone, until Ctrl-C.

    Parameters
    ----------
    transfer : str
        Its id, or how that begins.
    """
    from upplied.studio.server import Studio
    from upplied.studio.session import Session

    store, plan = opened_at(catalog, transfer)
    with errors.status("opening"):
        session = Session(store, plan)
    try:
        server = Studio(session.answer, port)
    except (OSError, OverflowError) as error:
        complain(f"error: port {port}: {error}. Say another: --port 0")
        return 2
    with server:
        console.print(f"{plan}: {server.address}", markup=False, soft_wrap=True, highlight=False)
        console.print("Ctrl-C ends it; whoever has this address can change and release the plan.")
        if open_:
            webbrowser.open(server.address)
        server.serve_forever()
    return 0
