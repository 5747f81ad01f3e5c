"""What tests ask a Prefect server by HTTP: with its password and a token, as its own page does."""

from __future__ import annotations

import base64
import json
import urllib.request
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.error import HTTPError

from upplied.flows.environment import profile

CLIENT = "tests"


def headers(password: str = "", origin: str = "", host: str = "") -> dict[str, str]:
    """What a request says of itself."""
    content = {"Content-Type": "application/json"}
    if password:
        content["Authorization"] = "Basic " + base64.b64encode(password.encode()).decode()
    return content | ({"Origin": origin} if origin else {}) | ({"Host": host} if host else {})


def send(
    method: str, url: str, body: Any = None, own: Mapping[str, str] | None = None
) -> tuple[int, dict[str, str], bytes]:
    """Status, headers and body of the answer, be it a refusal."""
    content = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, content, dict(own or headers()), method=method)
    try:
        with urllib.request.urlopen(request, timeout=120) as answer:
            return answer.status, {k.lower(): v for k, v in answer.headers.items()}, answer.read()
    except HTTPError as refusal:
        return refusal.code, {k.lower(): v for k, v in refusal.headers.items()}, refusal.read()


def token(api_url: str, password: str) -> dict[str, str]:
    """The headers of somebody who has signed in and may change something."""
    own = headers(password)
    status, _, content = send("GET", f"{api_url}/csrf-token?client={CLIENT}", own=own)
    assert status == 200, content
    return own | {"Prefect-Csrf-Token": json.loads(content)["token"], "Prefect-Csrf-Client": CLIENT}


def ask(api_url: str, path: str, body: Any, password: str) -> Any:
    """What the server's own interface answers."""
    status, _, content = send("POST", f"{api_url}/{path}", body, token(api_url, password))
    assert status < 300, (status, content)
    return json.loads(content)


def password_in(folder: Path) -> str:
    """The password of the server whose home this is."""
    return profile(folder)["PREFECT_API_AUTH_STRING"]
