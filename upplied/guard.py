"""What every server asks of a request, and says with every answer: no other name, no other site."""

from __future__ import annotations

from collections.abc import Collection
from urllib.parse import urlsplit

OTHER_SITE = "pages of another site are not answered"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
#: Beside these each server has a policy of its own for what its pages load.
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
}


def refusal(host: str, origin: str | None, names: Collection[str], port: int | None = None) -> str:
    """Why a request is refused; empty where it is not.

    Parameters
    ----------
    host : str
        Its ``Host`` header.
    origin : str, optional
        Its ``Origin`` header, where it has one.
    names : collection of str
        That the server is reached by.
    port : int, optional
        Where no proxy stands before it, that might speak TLS: the port that requests name.
    """
    if host_name(host) not in names or (port is not None and not host.endswith(f":{port}")):
        return "this server does not answer to that name"
    site = host.lower() if port is None else f"http://{host.lower()}"
    if origin is not None and (_authority(origin) if port is None else origin.lower()) != site:
        return OTHER_SITE
    return ""


def host_name(host: str) -> str:
    """The name in a ``Host`` header, without its port; empty where it is none."""
    try:
        parts = urlsplit(f"//{host}")
        _ = parts.port  # an error where it is no number
        return parts.hostname or ""
    except ValueError:
        return ""


def _authority(origin: str) -> str:
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:  # no address at all
        return ""
