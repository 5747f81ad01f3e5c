"""The guard of every server: it filters requests and sets the headers of answers.

A page of another site can make a browser of this machine send requests to loopback. Requests under another
name than the server's own, or from another site's page, are therefore refused before they are read.
"""

from __future__ import annotations

import os
from collections.abc import Awaitable, Callable, Collection, MutableMapping, Sequence
from typing import Any
from urllib.parse import urlsplit

HOSTS = "UPPLIED_HOSTS"  # names of the server besides this machine's, separated by commas
OTHER_SITE = "requests from pages of another site are refused"
OTHER_NAME = f"this server does not answer to that name ({HOSTS} lists its names)"
LOOPBACK = ("127.0.0.1", "localhost", "::1")

_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
}
#: For Prefect's pages, which have their own scripts and styles.
FOREIGN_HEADERS = _HEADERS | {
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Referrer-Policy": "same-origin",
}
#: For our pages, which load only their own files and send nothing to other sites.
OWN_HEADERS = _HEADERS | {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self'; frame-ancestors 'none'; form-action 'none'; "
    "base-uri 'none'; object-src 'none'",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Message, Receive, Send], Awaitable[None]]
Headers = Sequence[tuple[bytes, bytes]]


class Guard:
    """ASGI middleware that refuses requests under another name and from pages of another site.

    Parameters
    ----------
    app : ASGI application
    names : collection of str
        Allowed names in the ``Host`` of requests.
    port : int, optional
        Required port in it, if there is no proxy before the server.
    own : bool
        For our pages: their policy is strict, and requests must come from one of them.
    """

    def __init__(
        self, app: Application, names: Collection[str], port: int | None = None, own: bool = False
    ) -> None:
        self.app, self.names, self.port, self.own = app, names, port, own
        headers = OWN_HEADERS if own else FOREIGN_HEADERS
        self.headers = [(name.lower().encode(), value.encode()) for name, value in headers.items()]

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
        elif reason := self._refusal(scope):
            await self._refuse(scope["type"], reason, send)
        else:
            await self.app(scope, receive, self._with_headers(send))

    def _refusal(self, scope: Message) -> str:
        reason = refusal(scope["headers"], self.names, self.port)
        return reason or (foreign_page(scope["headers"], scope.get("method", "")) if self.own else "")

    async def _refuse(self, kind: str, reason: str, send: Send) -> None:
        """Answer 403, or do not open the socket."""
        if kind == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": reason})
            return
        body = reason.encode()
        length = (b"content-length", str(len(body)).encode())
        await send({"type": "http.response.start", "status": 403, "headers": [length, *self.headers]})
        await send({"type": "http.response.body", "body": body})

    def _with_headers(self, send: Send) -> Send:
        """`send` with our headers on every answer, and without headers that allow other sites."""
        ours = {name for name, _ in self.headers} - {b"cache-control"}

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = message.get("headers", ())
                rest = [
                    each
                    for each in given
                    if (name := each[0].lower()) not in ours and not name.startswith(b"access-control-")
                ]
                stored = any(name.lower() == b"cache-control" for name, _ in rest)
                message["headers"] = [*rest, *(h for h in self.headers if not stored or h[0] in ours)]
            await send(message)

        return sending


def refusal(headers: Headers, names: Collection[str], port: int | None = None) -> str:
    """Why a request is refused by its ``Host`` and ``Origin``; empty if it is not.

    Parameters
    ----------
    headers : sequence of (bytes, bytes)
        As in ASGI.
    names : collection of str
        Names of the server.
    port : int, optional
        Required port, if there is no proxy (perhaps with TLS) before the server.
    """
    hosts, origins = _values(headers, b"host"), _values(headers, b"origin")
    host = hosts[0] if len(hosts) == 1 else ""
    if host_name(host) not in names or (port is not None and not host.endswith(f":{port}")):
        return OTHER_NAME
    site = host.lower() if port is None else f"http://{host.lower()}"
    return OTHER_SITE if any(_site(origin, port) != site for origin in origins) else ""


def foreign_page(headers: Headers, method: str) -> str:
    """Why a request is refused by the headers of its page's origin; empty if it is not.

    Links on other pages may be followed: such a request only reads, is visible in the address bar, and
    carries no cookie of ours.
    """
    site = _values(headers, b"sec-fetch-site")
    if all(each in ("none", "same-origin") for each in site):
        return ""
    goal = [*_values(headers, b"sec-fetch-mode"), *_values(headers, b"sec-fetch-dest")]
    return "" if method == "GET" and goal == ["navigate", "document"] else OTHER_SITE


def allowed_names() -> frozenset[str]:
    """The names of this machine's loopback, and those that the environment declares."""
    named = os.environ.get(HOSTS, "").split(",")
    return frozenset(LOOPBACK) | {name.strip().lower() for name in named if name.strip()}


def host_name(host: str) -> str:
    """The name in a ``Host`` header, without its port; empty if it is invalid."""
    try:
        parts = urlsplit(f"//{host}")
        _ = parts.port  # raises ValueError if it is not a number
        return parts.hostname or ""
    except ValueError:
        return ""


def _values(headers: Headers, name: bytes) -> list[str]:
    return [value.decode("latin-1") for each, value in headers if each.lower() == name]


def _site(origin: str, port: int | None) -> str:
    if port is not None:
        return origin.lower()
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:  # not an address
        return ""
