"""The web application on a port: pages of the fleet, structures, plans and flights, and the studio.

The pages are those of a report folder, built from the current catalog. A signed-in person can also review,
release, reject, export and edit; without a login only the page for signing in is served.
"""

import asyncio
import json
import secrets
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from upplied.catalog import Catalog
from upplied.errors import CatalogError, UppliedError
from upplied.outputs import pages
from upplied.outputs.site import ENDINGS
from upplied.web.guard import LOOPBACK, Guard, Login
from upplied.web.live import Decisions, LivePages, warm
from upplied.web.session import Sessions

HOST = "127.0.0.1"
_MOST_BYTES = 4 << 20  # of a request
_WAIT_S = 30.0  # for a request that comes in pieces
_WRONG_S = 1.0  # before a wrong password is refused
_TYPES = {".js": "text/javascript", ".css": "text/css", ".png": "image/png", ".html": "text/html"}
_FRESH = {"Cache-Control": "max-age=3600"}  # files of the package
_SHOWN = {"brief": ("inline", "text/html")}  # missions that a browser shows rather than stores


class Web:
    def __init__(self, catalog: Catalog, login: Login) -> None:
        self.login, self.catalog = login, catalog
        self.live, self.sessions, self.decisions = LivePages(catalog), Sessions(catalog), Decisions(catalog)
        self.assets = pages.live_assets()
        routes = [
            Route("/login", self.sign_in, methods=["POST"]),
            Route("/assets/{name}", self.asset),
            Route("/", self.page),
            Route("/index.html", self.page),
            Route("/{room}/{name}", self.page),
            Route("/studio/{plan}/{what}", self.studio, methods=["POST"]),
            Route("/missions/{plan}/{kind}", self.mission),
            Route("/decide", self.decide, methods=["POST"]),
        ]
        self.app = Starlette(routes=routes, exception_handlers=_HANDLERS)

    async def sign_in(self, request: Request) -> Response:
        content = await _json(request)
        if not self.login.accepts(content.get("password")):
            await asyncio.sleep(_WRONG_S)
            return JSONResponse({"refused": "Wrong password."}, 401)
        return self.login.give_cookie(JSONResponse({"token": self.login.token}))

    async def asset(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in self.assets:
            raise HTTPException(404, "This page does not exist.")
        kind = _TYPES[f".{name.rsplit('.', 1)[1]}"]
        return Response(self.assets[name], media_type=kind, headers=_FRESH)

    async def page(self, request: Request) -> Response:
        room, name = request.path_params.get("room", ""), request.path_params.get("name", "index.html")
        stem, dot, ending = name.rpartition(".")
        if room == "studio":
            stem = name
        elif ENDINGS.get(room) != dot + ending:
            raise HTTPException(404, "This page does not exist.")
        if not self.login.may_read(request):
            return HTMLResponse(pages.login_page(), 401)
        if room == "studio":
            plan = await run_in_threadpool(self.catalog.find_transfer, stem)
            return HTMLResponse(pages.studio_page(plan))
        content = await run_in_threadpool(self.live.page, room, stem if room else "")
        return Response(content, media_type=_TYPES[dot + ending])

    async def mission(self, request: Request) -> Response:
        if not self.login.may_read(request):
            return HTMLResponse(pages.login_page(), 401)
        plan, kind = request.path_params["plan"], request.path_params["kind"]
        name, content = await run_in_threadpool(self.live.mission, plan, kind)
        shown, media_type = _SHOWN.get(kind, ("attachment", "application/octet-stream"))
        headers = {"Content-Disposition": f'{shown}; filename="{name}"'}
        return Response(content, media_type=media_type, headers=headers)

    async def studio(self, request: Request) -> Response:
        return await self._answer(request, partial(self.sessions.answer, **request.path_params))

    async def decide(self, request: Request) -> Response:
        return await self._answer(request, self.decisions.decide)

    async def _answer(self, request: Request, act: Callable[[Mapping[str, Any]], dict[str, Any]]) -> Response:
        if not self.login.may_change(request):
            return JSONResponse({"refused": "Sign in first."}, 401)
        content = await _json(request)
        try:
            answer = await run_in_threadpool(act, content)
        except UppliedError as error:
            answer = {"refused": str(error)}
        return Response(json.dumps(pages.finite(answer), allow_nan=False), media_type="application/json")


async def _json(request: Request) -> dict[str, Any]:
    """The JSON object of a request, of a bounded size, within a bounded time."""
    if request.headers.get("Content-Type", "").split(";")[0].strip() != "application/json":
        raise HTTPException(415, "Requests are JSON.")
    length = request.headers.get("Content-Length", "")
    if not length.isdecimal() or not 0 < int(length) <= _MOST_BYTES:
        raise HTTPException(413, f"A request has 1 to {_MOST_BYTES} bytes.")
    try:
        content = json.loads(await asyncio.wait_for(request.body(), _WAIT_S))
    except TimeoutError:
        raise HTTPException(408, "The request did not come in time.") from None
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise HTTPException(400, "The request is not a JSON object.")
    return content


async def _refused(request: Request, error: Exception) -> Response:
    """A refusal in words: a page for a browser, JSON for its scripts."""
    status, text = 404 if isinstance(error, CatalogError) else 409, str(error)
    if isinstance(error, HTTPException):
        status, text = error.status_code, error.detail
    if request.method == "GET" and status in (404, 409):
        return HTMLResponse(pages.message_page(text), status)
    return JSONResponse({"refused": text}, status)


async def _fault(request: Request, error: Exception) -> Response:
    return JSONResponse({"refused": "The program failed. Its log says more."}, 500)


_HANDLERS = {HTTPException: _refused, UppliedError: _refused, Exception: _fault}


class Server:
    """A server of a catalog's pages at host and port (0: any free one; an `OSError` if it is taken).

    `login` is that of the service, by default one of this run, whose token is in `address`; `names` are
    allowed in requests, by default those of this machine, with this port; `bound` is an open file that is
    bound to the port, instead of host and port.
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
    def running(self) -> "Iterator[Server]":
        thread = threading.Thread(target=self.run, daemon=True)
        thread.start()
        try:
            yield self
        finally:
            self._server.should_exit = True
            thread.join(10)
