"""`upplied studio`: the fleet, its structures and plans in a browser; plans can be edited and decided."""

from __future__ import annotations

import webbrowser
from typing import Annotated

from cyclopts import Parameter

from upplied.cli.terminal import HERE, Where, complain, say
from upplied.extras import extra

PortOption = Annotated[int, Parameter(help="Port on this machine; 0 takes any free one.")]
OpenOption = Annotated[bool, Parameter("--open", negative="--no-open", help="Open the browser as well.")]


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
