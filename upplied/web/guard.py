"""The guard of every server, for requests and the headers of answers, and the login of our pages.

A page of another site can make a browser send requests to loopback: those under another name than the
server's own, or from another site's page, are refused unread. The login's cookie allows reading alone, since
browsers send it to every port of a machine: changes need a token, which only open pages of this port have.
"""

import base64
import binascii
import hmac
import os
import secrets
from collections.abc import Collection, Sequence
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

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


class Guard:
    """ASGI middleware that refuses requests under another name and from pages of another site.

    `names` and `port` as for `refusal`. With `own`, for our pages, the policy is strict, and requests must
    come from one of them.
    """

    def __init__(
        self, app: ASGIApp, names: Collection[str], port: int | None = None, own: bool = False
    ) -> None:
        self.app, self.names, self.port, self.own = app, names, port, own
        self.headers = OWN_HEADERS if own else FOREIGN_HEADERS

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = self._strict(message.get("headers", ()))
            await send(message)

        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
        elif reason := self._refusal(scope):
            socket = scope["type"] == "websocket"
            answer = WebSocketClose(1008, reason) if socket else PlainTextResponse(reason, 403, self.headers)
            await answer(scope, receive, send)
        else:
            await self.app(scope, receive, with_headers)

    def _refusal(self, scope: Scope) -> str:
        reason = refusal(scope["headers"], self.names, self.port)
        return reason or (foreign_page(scope["headers"], scope.get("method", "")) if self.own else "")

    def _strict(self, raw: Sequence[tuple[bytes, bytes]]) -> list[tuple[bytes, bytes]]:
        """Headers of an answer with ours, and without those that allow other sites."""
        headers = MutableHeaders(raw=[(name.lower(), value) for name, value in raw])
        for name in {name for name in headers if name.startswith("access-control-")}:
            del headers[name]
        for name, value in self.headers.items():
            if name != "Cache-Control" or name not in headers:
                headers[name] = value
        return headers.raw


def refusal(headers: Sequence[tuple[bytes, bytes]], names: Collection[str], port: int | None = None) -> str:
    """Why a request is refused by its ``Host`` and ``Origin``; empty if it is not.

    `names` are those of the server; `port` is required in the ``Host`` if there is no proxy before it.
    """
    values = Headers(raw=list(headers)).getlist
    host = values("host")[0].lower() if len(values("host")) == 1 else ""
    if _address(f"//{host}")[0] not in names or (port is not None and not host.endswith(f":{port}")):
        return OTHER_NAME
    # Behind a proxy the scheme is not known.
    sites = [_address(one)[1] if port is None else one.lower() for one in values("origin")]
    return OTHER_SITE if set(sites) - {host if port is None else f"http://{host}"} else ""


def foreign_page(headers: Sequence[tuple[bytes, bytes]], method: str) -> str:
    """Why a request is refused by the headers of its page's origin; empty if it is not.

    Links on other pages may be followed: such a request only reads, visibly, and carries no cookie of ours.
    """
    values = Headers(raw=list(headers)).getlist
    if all(each in ("none", "same-origin") for each in values("sec-fetch-site")):
        return ""
    goal = [*values("sec-fetch-mode"), *values("sec-fetch-dest")]
    return "" if method == "GET" and goal == ["navigate", "document"] else OTHER_SITE


def allowed_names() -> frozenset[str]:
    named = os.environ.get(HOSTS, "").split(",")
    return frozenset(LOOPBACK) | {name.strip().lower() for name in named if name.strip()}


def _address(url: str) -> tuple[str, str]:
    """The host of an address, by its name alone and with its port; empty if it is invalid."""
    try:
        parts = urlsplit(url)
        _ = parts.port  # raises ValueError if it is not a number
        return parts.hostname or "", parts.netloc.lower()
    except ValueError:
        return "", ""


class Login:
    """Permissions to read and to change; `password` is ``NAME:PASSWORD``, or a token alone."""

    def __init__(self, password: str) -> None:
        self._password = password
        self.token, self._cookie = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        self._name = f"upplied_{secrets.token_hex(4)}"  # two servers of one machine share their cookies

    def accepts(self, password: object) -> bool:
        if not isinstance(password, str):
            return False
        known = (self._password, self._password.partition(":")[2] or self._password)
        return any(_equal(password, each) for each in known)

    def may_read(self, request: Request) -> bool:
        cookie = request.cookies.get(self._name, "")
        return _equal(cookie, self._cookie) or self.may_change(request) or self.accepts(_basic(request))

    def may_change(self, request: Request) -> bool:
        scheme, _, token = request.headers.get("Authorization", "").partition(" ")
        return scheme == "Bearer" and _equal(token, self.token)

    def give_cookie(self, answer: Response) -> Response:
        answer.set_cookie(self._name, self._cookie, httponly=True, samesite="strict", path="/")
        return answer


def _equal(word: str, known: str) -> bool:
    return hmac.compare_digest(word.encode("utf-8", "replace"), known.encode())


def _basic(request: Request) -> str:
    """``NAME:PASSWORD`` of HTTP's Basic scheme, for programs; empty if there is none."""
    scheme, _, encoded = request.headers.get("Authorization", "").partition(" ")
    try:
        return base64.b64decode(encoded, validate=True).decode() if scheme == "Basic" else ""
    except (binascii.Error, ValueError):
        return ""
