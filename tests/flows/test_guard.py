"""No page of another site gets anything from the server, and nobody without its password."""

from __future__ import annotations

import asyncio
import json
import os
import stat
import subprocess
import sys

import prefect_api
import pytest

from upplied.flows.server import Server, ServerError
from upplied.web.guard import Guard, refusal

pytestmark = [pytest.mark.ci, pytest.mark.server, pytest.mark.filterwarnings("default")]

EVIL = "http://evil.example"


def create(server: Server, headers: dict[str, str]) -> int:
    """The status that an attempt to create something gets."""
    body = {"name": "evil", "type": "process"}
    return prefect_api.send("POST", f"{server.api_url}/work_pools/", body, headers)[0]


def test_a_page_of_another_site_can_do_nothing(server):
    url = f"{server.api_url}/deployments/name/transfer-fleet/transfer-fleet"
    request = {"Access-Control-Request-Method": "POST", "Access-Control-Request-Headers": "content-type"}
    for origin in (EVIL, "null", "http://127.0.0.1:9"):
        status, headers, _ = prefect_api.send("OPTIONS", url, own={"Origin": origin, **request})
        assert status == 403
        assert not [name for name in headers if name.startswith("access-control-allow")]
        # Even with what only those who have signed in have.
        own = prefect_api.token(server.api_url, server.password) | {"Origin": origin}
        assert create(server, own) == 403
        status, headers, _ = prefect_api.send("GET", url, own=own)
        assert (status, headers.get("access-control-allow-origin")) == (403, None)


def test_a_name_that_another_site_points_here_is_not_answered(server):
    """A page whose own name is made to mean 127.0.0.1 is of the same origin as what it asks."""
    headers = prefect_api.token(server.api_url, server.password)
    assert create(server, headers | {"Host": "evil.example", "Origin": EVIL}) == 403
    status, _, content = prefect_api.send("GET", server.api_url + "/health", own={"Host": "evil.example"})
    assert (status, b"UPPLIED_HOSTS" in content) == (403, True)


def test_nobody_is_answered_without_the_password_nor_changes_anything_without_a_token(server):
    assert create(server, prefect_api.headers()) == 403  # no token
    assert create(server, prefect_api.headers("upplied:guess")) in (401, 403)
    token = prefect_api.token(server.api_url, server.password)
    unsigned = {name: value for name, value in token.items() if name != "Authorization"}
    assert create(server, unsigned) == 401
    assert create(server, prefect_api.headers(server.password)) == 403, "the token was not asked for"
    status, _, content = prefect_api.send(
        "POST", f"{server.api_url}/work_pools/filter", {}, {**unsigned, "Authorization": "Basic !"}
    )
    assert (status, b"evil" in content) == (401, False)
    pools = prefect_api.ask(server.api_url, "work_pools/filter", {}, server.password)
    assert "evil" not in {pool["name"] for pool in pools}


def test_the_servers_own_page_opens_and_may_not_be_framed(server):
    page = server.api_url.removesuffix("/api")
    status, headers, content = prefect_api.send("GET", f"{page}/", own={"Accept": "text/html"})
    assert (status, b"<html" in content.lower()) == (200, True)
    assert headers["x-frame-options"] == "DENY"
    settings = json.loads(prefect_api.send("GET", f"{page}/ui-settings")[2])
    assert (settings["auth"], settings["csrf_enabled"]) == ("BASIC", True)


def test_events_are_taken_from_those_who_have_signed_in_alone(server):
    """An event starts runs with parameters of its own, and browsers open sockets to anywhere."""
    code = """
import asyncio, json, sys, websockets
async def attempt(origin, word):
    try:
        async with websockets.connect(sys.argv[1], subprotocols=["prefect"], origin=origin) as socket:
            await socket.send(json.dumps({"type": "auth", "token": word}))
            answer = json.loads(await socket.recv())
            return answer.get("type", "")
    except Exception as error:
        return type(error).__name__
for origin, word in ((None, sys.argv[2]), (None, "guess"), ("http://evil.example", sys.argv[2])):
    print(asyncio.run(attempt(origin, word)))
"""
    url = server.api_url.replace("http", "ws") + "/events/in"
    process = subprocess.run(
        [sys.executable, "-c", code, url, server.password], capture_output=True, text=True, check=True
    )
    allowed, *refused = process.stdout.split()
    assert allowed == "auth_success", process.stdout + process.stderr
    assert "auth_success" not in refused


def test_the_password_is_made_once_and_read_by_its_owner_alone(server, tmp_path):
    home = server.environment["PREFECT_HOME"]
    for name in ("profiles.toml", "password.txt", "prefect.db"):
        assert stat.S_IMODE(os.stat(os.path.join(home, name)).st_mode) == 0o600, name
    assert stat.S_IMODE(os.stat(home).st_mode) == 0o700
    assert len(server.password.split(":")[1]) >= 40
    assert server.password not in server.environment.values()
    from upplied.flows.environment import sign_in

    first = sign_in(tmp_path, "http://127.0.0.1:1/api")
    assert sign_in(tmp_path, "http://127.0.0.1:2/api") == first != server.password
    assert prefect_api.password_in(tmp_path) == first


def test_two_services_do_not_work_in_one_folder(server, tmp_path):
    home = server.log.parent
    before = server.log.read_bytes()
    with pytest.raises(ServerError, match="Another service"), Server(home):
        pass
    assert server.log.read_bytes()[: len(before)] == before, "its log was truncated"


def test_what_a_guard_refuses():
    hosts = frozenset({"127.0.0.1", "localhost", "::1", "fleet.example"})
    fine = ({b"host": b"127.0.0.1:4200"}, {b"host": b"[::1]:4200"}, {b"host": b"LOCALHOST"})
    assert [refusal([*headers.items()], hosts) for headers in fine] == ["", "", ""]
    behind_a_proxy = {b"host": b"fleet.example", b"origin": b"https://fleet.example"}
    assert refusal([*behind_a_proxy.items()], hosts) == ""
    assert refusal([(b"host", b"127.0.0.1"), (b"host", b"evil.example")], hosts)
    for headers in (
        {},
        {b"host": b""},
        {b"host": b"[::1"},
        {b"host": b"127.0.0.1.evil.example"},
        {b"host": b"127.0.0.1:4200.evil.example"},
        {b"host": b"evil.example@127.0.0.1.evil.example"},
        {b"host": b"127.0.0.1:4200", b"origin": b"null"},
        {b"host": b"127.0.0.1:4200", b"origin": b"http://["},
        {b"host": b"127.0.0.1:4200", b"origin": b"http://127.0.0.1:4201"},
    ):
        assert refusal([*headers.items()], hosts), headers


def test_no_answer_is_opened_to_other_sites():
    """Prefect opens some of its errors to every site."""
    sent: list[dict] = []

    async def answer(scope, receive, send) -> None:
        opened = [(b"Access-Control-Allow-Origin", b"*"), (b"content-type", b"text/plain")]
        await send({"type": "http.response.start", "status": 403, "headers": opened})

    async def take(message) -> None:
        sent.append(message)

    scope = {"type": "http", "headers": [(b"host", b"localhost")]}
    asyncio.run(Guard(answer, frozenset({"localhost"}))(scope, None, take))
    names = [name.lower() for name, _ in sent[0]["headers"]]
    assert b"content-type" in names and b"x-frame-options" in names
    assert b"access-control-allow-origin" not in names
