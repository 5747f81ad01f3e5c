"""The studio's server: one page and its requests, on loopback, to whoever holds the token of this run.

Requests are answered under the names of this machine alone, and to no page of another site; those that
read or change anything carry the token, which the address that is printed holds behind its ``#``, where no
server, log or other site sees it. Nothing is loaded from elsewhere.
"""

from __future__ import annotations

import hmac
import json
import secrets
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from upplied import guard
from upplied.outputs.pages import finite, studio_files

HOST = "127.0.0.1"
_MOST_BYTES = 4 << 20  # of a request
_WAIT_S = 30.0  # for a request that comes in pieces
_HEADERS = guard.HEADERS | {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self'; frame-ancestors 'none'; form-action 'none'; "
    "base-uri 'none'",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}

Answer = Callable[[str, Mapping[str, Any]], dict[str, Any]]  # of a request's name and what it says


class Studio(ThreadingHTTPServer):
    """The server; `address` is what a person opens.

    Parameters
    ----------
    answer : callable
        As `Session.answer`.
    port : int
        0: any that is free.
    """

    daemon_threads = True
    allow_reuse_address = False

    def __init__(self, answer: Answer, port: int = 0) -> None:
        self.answer = answer
        self.token = secrets.token_urlsafe(32)
        self.files = studio_files()
        super().__init__((HOST, port), _Handler)

    @property
    def address(self) -> str:
        """With the token, which a browser keeps to itself."""
        return f"http://{HOST}:{self.server_port}/#{self.token}"


class _Handler(BaseHTTPRequestHandler):
    server: Studio
    timeout = _WAIT_S
    server_version, sys_version = "upplied", ""

    def do_GET(self) -> None:
        """A file of the page."""
        if self._refused():
            return
        name = "index.html" if self.path == "/" else self.path.removeprefix("/")
        if name not in self.server.files:
            self._send(HTTPStatus.NOT_FOUND, "text/plain", b"There is no such page.")
            return
        kind, text = self.server.files[name]
        self._send(HTTPStatus.OK, kind, text.encode())

    def do_POST(self) -> None:
        """A request of the page, as JSON, and its answer."""
        if self._refused():
            return
        given = self.headers.get("Authorization", "").removeprefix("Bearer ")
        if not hmac.compare_digest(given.encode("latin-1", "replace"), self.server.token.encode()):
            self._told(HTTPStatus.UNAUTHORIZED, "open the address that the command printed")
            return
        if self.headers.get_content_type() != "application/json":
            self._told(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "requests are JSON")
            return
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or not 0 < int(length) <= _MOST_BYTES:
            self._told(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a request has 1 to {_MOST_BYTES} bytes")
            return
        try:
            said = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError):
            said = None
        if not isinstance(said, dict):
            self._told(HTTPStatus.BAD_REQUEST, "the request is no JSON object")
            return
        found = self.server.answer(self.path.removeprefix("/api/"), said)
        self._send(HTTPStatus.OK, "application/json", _json(found))

    def log_message(self, *_: object) -> None:
        """The address of a request is nobody's business."""

    def _refused(self) -> bool:
        """Whether it comes under another name, or from another site; then it is answered so."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        why = guard.refusal(host, origin, guard.LOOPBACK, self.server.server_port)
        if not why and self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            why = guard.OTHER_SITE
        if why:
            self._told(HTTPStatus.FORBIDDEN, why)
        return bool(why)

    def _told(self, status: HTTPStatus, why: str) -> None:
        self._send(status, "application/json", _json({"refused": why}))

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.close_connection = True
        self.send_response(status)
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


def _json(value: Any) -> bytes:
    return json.dumps(finite(value), allow_nan=False).encode()
