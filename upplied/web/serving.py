"""The application on a port of this machine, until it is stopped."""

from __future__ import annotations

import secrets
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import uvicorn

from upplied.catalog import Catalog
from upplied.web.app import Web
from upplied.web.guard import LOOPBACK, Guard, Login
from upplied.web.requests import warm

HOST = "127.0.0.1"


class Server:
    """A server of a catalog's pages.

    Parameters
    ----------
    catalog : Catalog
    port : int
        0: any free port.
    host : str
        Address to bind.
    login : Login, optional
        Of the service; by default one of this run, whose token is in `address`.
    names : frozenset of str, optional
        Allowed names in requests; by default those of this machine, with this port.
    bound : int
        An open file that is bound to the port, instead of host and port.

    Raises
    ------
    OSError
        If the port is taken.
    """

    def __init__(
        self,
        catalog: Catalog,
        port: int = 0,
        host: str = HOST,
        login: Login | None = None,
        names: frozenset[str] | None = None,
        bound: int = -1,
    ) -> None:
        self._password = secrets.token_urlsafe(32)
        self.login = login or Login(self._password)
        self._socket = socket.create_server((host, port)) if bound < 0 else socket.socket(fileno=bound)
        self.port = int(self._socket.getsockname()[1])
        own = self.port if names is None else None
        app = Guard(Web(catalog, self.login).app, names or frozenset(LOOPBACK), own, own=True)
        config = uvicorn.Config(app, log_level="error", access_log=False, server_header=False, ws="none")
        self._server = uvicorn.Server(config)

    def address(self, page: str = "") -> str:
        """The address to open; the part after ``#`` signs in and is not sent to any server."""
        return f"http://{HOST}:{self.port}/{page}#{self._password}"

    def run(self) -> None:
        """Answer until Ctrl-C; modules for the first page are loaded in the background."""
        threading.Thread(target=warm, daemon=True).start()
        self._server.run(sockets=[self._socket])

    @contextmanager
    def running(self) -> Iterator[Server]:
        """Answer as long as the block lasts."""
        thread = threading.Thread(target=self.run, daemon=True)
        thread.start()
        try:
            yield self
        finally:
            self._server.should_exit = True
            thread.join(10)


def serve_pages(
    catalog: Catalog, port: int, host: str, password: str, names: frozenset[str], bound: int = -1
) -> None:
    """Serve the pages of a fleet's service until Ctrl-C."""
    Server(catalog, port, host, Login(password), names, bound).run()
