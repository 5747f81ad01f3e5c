"""The login of our pages: a password, then a cookie and a token.

The cookie allows reading. Browsers send cookies to every port of a machine, so it allows no change: changes
need a token, which only pages of this port have, as long as their tab is open.
"""

from __future__ import annotations

import base64
import binascii
import hmac
import secrets

from starlette.requests import Request
from starlette.responses import Response


class Login:
    """Permissions to read and to change; `password` is ``NAME:PASSWORD``, or a token alone."""

    def __init__(self, password: str) -> None:
        self._password = password
        self.token, self._cookie = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        self._name = f"upplied_{secrets.token_hex(4)}"  # two servers of one machine share their cookies

    def accepts(self, password: object) -> bool:
        """Whether this is the password, with or without its name."""
        if not isinstance(password, str):
            return False
        known = (self._password, self._password.partition(":")[2] or self._password)
        return any(_equal(password, each) for each in known)

    def may_read(self, request: Request) -> bool:
        """Whether a request comes from somebody who signed in."""
        cookie = request.cookies.get(self._name, "")
        return _equal(cookie, self._cookie) or self.may_change(request) or self.accepts(_basic(request))

    def may_change(self, request: Request) -> bool:
        """Whether a request comes from a page of ours on which somebody signed in."""
        scheme, _, token = request.headers.get("Authorization", "").partition(" ")
        return scheme == "Bearer" and _equal(token, self.token)

    def give_cookie(self, answer: Response) -> Response:
        """An answer with the cookie that lets a browser read."""
        answer.set_cookie(self._name, self._cookie, httponly=True, samesite="strict", path="/")
        return answer


def _equal(given: str, known: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "replace"), known.encode())


def _basic(request: Request) -> str:
    """``NAME:PASSWORD`` of HTTP's Basic scheme, for programs; empty if there is none."""
    scheme, _, encoded = request.headers.get("Authorization", "").partition(" ")
    try:
        return base64.b64decode(encoded, validate=True).decode() if scheme == "Basic" else ""
    except (binascii.Error, ValueError):
        return ""
