"""Prefect's server behind a guard: it answers to its own name, and to no page of another site.

Started by ``upplied serve``, with the factory `create_app`. Without the guard every page that a browser
of this machine opens could ask the server to run something.
"""

from __future__ import annotations

import os
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from upplied import guard

HOSTS = "UPPLIED_HOSTS"  # names that the server is reached by besides this machine's, separated by commas
POLICY = {"Content-Security-Policy": "frame-ancestors 'none'", "Referrer-Policy": "same-origin"}
HEADERS = [(name.lower().encode(), value.encode()) for name, value in (guard.HEADERS | POLICY).items()]

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]


class Guard:
    """ASGI middleware: what is asked under another name, or by another site's page, is refused.

    Parameters
    ----------
    app : ASGI application
    hosts : collection of str
        Names that requests may use in their ``Host``.
    """

    def __init__(self, app: Callable[..., Awaitable[None]], hosts: frozenset[str]) -> None:
        self.app, self.hosts = app, hosts

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
        elif reason := refusal(dict(scope["headers"]), self.hosts):
            await refuse(scope["type"], reason, send)
        else:
            await self.app(scope, receive, with_headers(send))


def refusal(headers: dict[bytes, bytes], hosts: frozenset[str]) -> str:
    """Why a request is refused; empty where it is not."""
    asked, origin = headers.get(b"host", b"").decode("latin-1"), headers.get(b"origin")
    why = guard.refusal(asked, None if origin is None else origin.decode("latin-1"), hosts)
    return f"{why} ({HOSTS})" if why and why != guard.OTHER_SITE else why


async def refuse(kind: str, reason: str, send: Send) -> None:
    """Answer 403, or do not open the socket."""
    if kind == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": reason})
        return
    body = reason.encode()
    length = (b"content-length", str(len(body)).encode())
    await send({"type": "http.response.start", "status": 403, "headers": [length, *HEADERS]})
    await send({"type": "http.response.body", "body": body})


def with_headers(send: Send) -> Send:
    """The same, with the security headers on every answer, and none that opens it to other sites."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            given = message.get("headers", ())
            kept = [each for each in given if not each[0].lower().startswith(b"access-control-")]
            message["headers"] = [*kept, *HEADERS]
        await send(message)

    return sending


def allowed_hosts() -> frozenset[str]:
    """The names of this machine's loopback, and those that the environment declares."""
    named = os.environ.get(HOSTS, "").split(",")
    return frozenset(guard.LOOPBACK) | {name.strip().lower() for name in named if name.strip()}


def create_app() -> Guard:
    """Prefect's application with the guard before it."""
    from prefect.server.api import server

    from . import notices  # noqa: F401  the server sends by our own kind of block, too

    # Around it and not in it: its own services ask the same application, by a name of theirs.
    return Guard(server.create_app(final=True), allowed_hosts())
