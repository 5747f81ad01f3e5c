"""The application that people open: attacks get nothing, the login opens it, and pages follow the catalog."""

from __future__ import annotations

import base64
import http.client
import json
import socket
from collections.abc import Iterator
from typing import Any

import pytest
from web_catalog import KEY, catalog_with_plan

from upplied.catalog.database import Catalog
from upplied.web.guard import OWN_HEADERS, Login
from upplied.web.serving import Server

PLAN = KEY[:20]
PASSWORD = "upplied:a-long-password"


@pytest.fixture(scope="module")
def catalog(tmp_path_factory) -> Catalog:
    return catalog_with_plan(tmp_path_factory.mktemp("web"))


@pytest.fixture(scope="module")
def server(catalog) -> Iterator[Server]:
    with Server(catalog, login=Login(PASSWORD)).running() as service:
        yield service


def reply(server: Server, path: str, method: str = "GET", body: Any = None, **headers: str | None) -> Any:
    """Status, headers and text of the answer; a header that is None is left out."""
    sent = {"Host": f"127.0.0.1:{server.port}", "Authorization": f"Bearer {server.login.token}"}
    if method == "POST":
        sent["Content-Type"] = "application/json"
    own = {name.replace("_", "-"): value for name, value in headers.items()}
    line = http.client.HTTPConnection("127.0.0.1", server.port, timeout=120)
    line.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    content = json.dumps(body).encode() if isinstance(body, dict) else body
    length = {} if content is None else {"Content-Length": str(len(content))}
    for name, value in {**sent, **length, **own}.items():
        if value is not None:
            line.putheader(name, value.encode("latin-1"))
    line.endheaders(content)
    answer = line.getresponse()
    parts = answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
    line.close()
    return parts


PAGES = ("/", "/transfers/cube-sides-v1--cube-v1.html", "/structures/cube-v1.html", "/data/cube-v1.js")
POSTS = (f"/studio/{PLAN}/plan", f"/studio/{PLAN}/progress", "/decide", "/login")


def foreign(port: int) -> list[dict[str, str]]:
    """What requests that another site's page, or name, sends say of themselves."""
    return [
        {"Host": "evil.example"},
        {"Host": f"evil.example:{port}"},
        {"Host": "127.0.0.1:1"},
        {"Host": "127.0.0.1"},
        {"Host": ""},
        {"Host": f"[::1:{port}"},
        {"Host": f"127.0.0.1.evil.example:{port}"},
        {"Host": f"evil.example@127.0.0.1.evil.example:{port}"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://["},
        {"Origin": f"https://127.0.0.1:{port}"},
        {"Origin": "http://127.0.0.1:1"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
        {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "no-cors", "Sec_Fetch_Dest": "image"},
        {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "navigate", "Sec_Fetch_Dest": "iframe"},
    ]


def test_no_other_name_and_no_page_of_another_site_is_answered_even_with_the_token(server):
    for bad in foreign(server.port):
        for path in PAGES:
            assert reply(server, path, **bad)[0] == 403, (path, bad)
        for path in POSTS:
            status, headers, content = reply(server, path, "POST", {"password": PASSWORD}, **bad)
            assert (status, "set-cookie" in headers) == (403, False), (path, bad)
            assert server.login.token.encode() not in content
    posted = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "navigate", "Sec_Fetch_Dest": "document"}
    assert reply(server, "/decide", "POST", {}, **posted)[0] == 403
    own = {"Origin": f"http://localhost:{server.port}", "Host": f"localhost:{server.port}"}
    assert reply(server, POSTS[1], "POST", {}, **own, Sec_Fetch_Site="same-origin")[0] == 200


def test_two_hosts_or_two_origins_are_refused(server):
    for extra in (b"Host: evil.example", b"Origin: http://evil.example"):
        own = f"127.0.0.1:{server.port}".encode()
        with socket.create_connection(("127.0.0.1", server.port), timeout=60) as line:
            line.sendall(
                b"GET / HTTP/1.1\r\nHost: "
                + own
                + b"\r\n"
                + extra
                + b"\r\nOrigin: http://"
                + own
                + b"\r\n\r\n"
            )
            assert line.recv(64).split()[1] in (b"400", b"403"), extra


def test_nobody_reads_or_changes_anything_without_the_login(server):
    token, guess = server.login.token, base64.b64encode(b"upplied:guess").decode()
    wrong = (None, "", "Bearer ", f"Bearer {token[:-1]}", f"Bearer {token}x", "Bearer \xff", "Basic !")
    for bad in (*wrong, f"Basic {guess}"):
        for path in (*PAGES, f"/missions/{PLAN}/csv", f"/missions/{PLAN}/brief", f"/studio/{PLAN}"):
            status, _, content = reply(server, path, Authorization=bad)
            assert status == 401 and b"cube-sides" not in content, (path, bad)
        for path in POSTS[:3]:
            assert reply(server, path, "POST", {}, Authorization=bad)[0] == 401, (path, bad)
    basic = "Basic " + base64.b64encode(PASSWORD.encode()).decode()
    assert reply(server, "/", Authorization=basic)[0] == 200
    assert reply(server, "/decide", "POST", {}, Authorization=basic)[0] == 401, "a browser sends it by itself"


@pytest.mark.ci
def test_a_cookie_reads_and_changes_nothing_and_a_wrong_password_gives_none(server):
    for wrong in ("guess", "", None, 7, ["a-long-password"], PASSWORD + "x"):
        status, headers, _ = reply(server, "/login", "POST", {"password": wrong}, Authorization=None)
        assert (status, "set-cookie" in headers) == (401, False)
    status, headers, content = reply(
        server, "/login", "POST", {"password": "a-long-password"}, Authorization=None
    )
    assert status == 200 and json.loads(content) == {"token": server.login.token}
    cookie = headers["set-cookie"]
    assert "HttpOnly" in cookie and "SameSite=strict" in cookie and server.login.token not in cookie
    value = cookie.split(";")[0]
    assert reply(server, "/", Authorization=None, Cookie=value)[0] == 200
    for path in POSTS[:3]:
        assert reply(server, path, "POST", {}, Authorization=None, Cookie=value)[0] == 401
    assert reply(server, "/", Authorization=None, Cookie=value[:-1] + "x")[0] == 401


def test_requests_that_are_none_are_refused_and_stop_nobody(server):
    path = POSTS[0]
    assert reply(server, path, "POST", b"{}", Content_Type="text/plain")[0] == 415
    assert reply(server, path, "POST", b"{}", Content_Length="99999999999")[0] == 413
    assert reply(server, path, "POST", b"{}", Content_Length=None)[0] in (400, 411, 413)
    for body in (b"", b"[]", b"{", b"\xff", b"[" * 100_000):
        assert reply(server, path, "POST", body)[0] in (400, 413), body[:9]
    for what in ("nothing", "judge", "decide"):
        assert json.loads(reply(server, f"/studio/{PLAN}/{what}", "POST", {})[2])["refused"]
    for plan in ("nothing", "..", "%2e%2e", "a" * 5000, "-"):
        status, _, content = reply(server, f"/studio/{plan}/plan", "POST", {})
        assert status in (200, 404, 405) and (status != 200 or json.loads(content)["refused"]), plan
    released = {"decision": "released", "id": PLAN}
    signed = {"id": PLAN, "by": "Ada"}
    for body in ({}, released, signed, signed | {"decision": "flown"}, released | {"id": 7, "by": "Ada"}):
        assert json.loads(reply(server, "/decide", "POST", body)[2])["refused"], body
    assert reply(server, "/", "PUT", b"")[0] == 405 == reply(server, "/decide")[0]


def test_nothing_but_pages_is_given_out(server):
    for path in (
        "/../session.py", "/%2e%2e/x", "/assets/../app.py", "/assets/%2e%2e%2fapp.py", "/assets/none.js",
        "/index.htm", "/transfers/", "/transfers", "/transfers/..%2f..%2fsecret.html", "/transfers/none.html",
        "/structures/%2fetc%2fpasswd.html", "/structures/none.html", "/data/none.js", "/data/none.html",
        "/pictures/none.png", "/demonstrations/none.html", "/transfers.parquet", "/studio/none",
        "/tables/x.html", "/thumbnails/none.png",
        f"/missions/{PLAN}/exe", "/missions/none/csv",
    ):  # fmt: skip
        status, _, content = reply(server, path)
        assert status == 404 and b"Traceback" not in content, path


def test_every_answer_is_strict_and_no_page_holds_a_script_or_the_token(server):
    for path in (*PAGES, "/assets/core.js", "/none/none", f"/studio/{PLAN}"):
        _, headers, content = reply(server, path)
        for name, value in OWN_HEADERS.items():
            if name != "Cache-Control" or not path.startswith("/assets"):
                assert headers[name.lower()] == value, (path, name)
        assert not [name for name in headers if name.startswith("access-control-")]
        assert server.login.token.encode() not in content and PASSWORD.encode() not in content
        assert b"<script>" not in content
    refused = reply(server, "/", Host="evil.example")[1]
    assert refused["x-frame-options"] == "DENY" and "script-src 'self'" in refused["content-security-policy"]
    assert "unsafe-eval" not in refused["content-security-policy"]


@pytest.mark.ci
def test_pages_follow_the_catalog_and_a_decision_is_stored(server, catalog):
    fleet = reply(server, "/")[2].decode()
    assert "cube-sides-v1--cube-v1" in fleet and '"live":true' in fleet
    page = reply(server, PAGES[1])[2].decode()
    assert PLAN in page and "Draft, not released yet" in page
    assert b"sha256" in reply(server, f"/transfers/{'cube-sides-v1--cube-v1'}.html")[2]
    assert reply(server, f"/missions/{PLAN}/csv")[0] == 409, "a draft left"
    decision = {"decision": "rejected", "id": PLAN, "by": "Ada", "note": "too near"}
    assert (
        json.loads(reply(server, "/decide", "POST", decision)[2])["message"]
        == f"Plan {PLAN} is rejected by Ada."
    )
    again = reply(server, PAGES[1])[2].decode()
    assert "Rejected by Ada" in again and "too near" in reply(server, PAGES[2])[2].decode()
    assert list(catalog.decisions()["by"]) == ["Ada"]
    late = {"decision": "released", "id": PLAN, "by": "Ben", "known": ""}
    assert "refused" in json.loads(reply(server, "/decide", "POST", late)[2])


def test_a_viewpoint_that_lies_nowhere_is_refused_and_not_allocated(server):
    plan = json.loads(reply(server, POSTS[0], "POST", {})[2])
    for bad in (1e12, -1e300, 1e6):
        views = [dict(each) for each in plan["viewpoints"]]
        views[3]["x_m"] = bad
        answer = json.loads(
            reply(server, f"/studio/{PLAN}/judge", "POST", {"base": 0, "viewpoints": views})[2]
        )
        assert "at most" in answer["refused"], bad
        request = {"base": 0, "viewpoints": views, "viewpoint": 3}
        aim = json.loads(reply(server, f"/studio/{PLAN}/aim", "POST", request)[2])
        assert "at most" in aim["refused"]
