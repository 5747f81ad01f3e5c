"""A Prefect server of our own: on a loopback port, with its own home, stopped when we leave."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import IO, Any, TypeVar

import httpx
import psutil

from .environment import environment, home, sign_in

T = TypeVar("T")

PRIVATE = 0o077  # what a server writes is read by its user alone
START_UP_S = 600.0  # a fresh database takes 12 s on a quiet machine, minutes on a busy one


class ServerError(Exception):
    """The server did not come up; the text holds what it said last."""


class Server(AbstractContextManager["Server"]):
    """A server and its clients' environment, until the block ends; port 0 takes a free one of 127.0.0.1.

    Refused where port or folder is another service's.
    """

    def __init__(self, folder: Path, port: int = 0) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._alone = alone(folder)
        try:
            own = socket.create_server(("127.0.0.1", port))
        except OSError:
            self._alone.close()
            remedy = "Stop it, or set UPPLIED_PORT."
            raise ServerError(f"Something listens on port {port} already. {remedy}") from None
        self.port = int(own.getsockname()[1])
        self.api_url = f"http://127.0.0.1:{self.port}/api"
        self.password = sign_in(folder, self.api_url)
        self.environment = environment(folder, self.api_url)
        self.log = folder / "server.log"
        variables, words = self.environment | address(self.port), command("--fd", str(own.fileno()))
        with own, self.log.open("wb") as log:
            holding = (self._alone, own)
            self.process = start(*words, environment=variables, log=log, holding=holding, umask=PRIVATE)

    def wait(self) -> None:
        """Wait until the server answers; one that ends, or does not answer in time, is an error."""
        up = waited_for(lambda: answers(self.api_url) or self.process.poll() is not None, every_s=0.2)
        if self.process.poll() is not None or not up:
            last = "\n".join(self.log.read_text(errors="replace").splitlines()[-15:])
            what = f"did not answer in {START_UP_S:g} s" if not up else "ended at its start"
            raise ServerError(f"the Prefect server {what}:\n{last}")

    def __exit__(self, *_: object) -> None:
        stop(self.process)
        self._alone.close()  # lets another work in the folder


def waited_for(act: Callable[[], T], every_s: float = 1.0) -> T:
    """What an act returns, once that is something, or the time of a start is over."""
    deadline = time.monotonic() + START_UP_S
    while not (result := act()) and time.monotonic() < deadline:
        time.sleep(every_s)
    return result


def command(*place: str) -> tuple[str, ...]:
    """What runs the server at a place, as uvicorn has it: Prefect's application behind our guard."""
    app = ("--factory", f"{__package__}.server:create_app")
    return ("uvicorn", *app, *place, "--log-level", "warning", "--no-access-log")


def create_app() -> Any:
    """Prefect's application behind the guard of our own pages: else any page could have it run something."""
    from prefect.server.api import server

    from upplied.web.guard import Guard, allowed_names

    from . import automations  # noqa: F401  the server sends by our own kind of block, too

    # Around it and not in it: its own services ask the same application, by a name of theirs.
    return Guard(server.create_app(final=True), allowed_names())


def address(port: int) -> dict[str, str]:
    """What the server is told of itself: the page that it hands out calls this address."""
    return {"PREFECT_SERVER_API_HOST": "127.0.0.1", "PREFECT_SERVER_API_PORT": str(port)}


def alone(folder: Path) -> IO[bytes]:
    """An open file that says that nobody else works in a folder: two servers would write one database."""
    import fcntl

    file = (folder / "lock").open("ab")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise ServerError(f"Another service runs in {folder}. Stop it, or work in another folder.") from None
    return file


def answers(api_url: str) -> bool:
    """Whether a Prefect server is there; Prefect's own commands would start one that knows no deployment."""
    try:  # any answer will do: it may want a name first, which Prefect's settings may hold
        httpx.get(f"{api_url.rstrip('/')}/health", timeout=10)
    except (httpx.HTTPError, httpx.InvalidURL):
        return False
    return True


def start(
    *words: str,
    environment: dict[str, str],
    log: IO[bytes] | int | None = None,
    holding: Sequence[IO[bytes] | socket.socket] = (),
    umask: int = -1,
) -> subprocess.Popen[bytes]:
    """Start a module of Python's, in a process group of its own; on Linux it ends when this one is killed.

    What is in `holding` stays open, and so locked or bound, as long as it lives; `umask` -1: as ours.
    """
    return subprocess.Popen(
        [sys.executable, "-m", *words],
        env=environment,
        cwd=home(),
        stdout=log,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        pass_fds=[file.fileno() for file in holding],
        umask=umask,
        preexec_fn=end_with_parent if sys.platform == "linux" else None,
    )


_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None
_PR_SET_PDEATHSIG = 1


def end_with_parent() -> None:
    """In the child, before it begins: a parent that is killed stops nobody, so the kernel does."""
    if _LIBC is not None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def stop(
    process: subprocess.Popen[bytes], patience_s: float = 15.0, known: Sequence[psutil.Process] = ()
) -> None:
    """End a process we started together with all that came of it: politely first.

    A worker's runs are sessions of their own, which no signal to its group reaches; `known` are those of
    one that ended.
    """
    seen = {*known}
    for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        if process.poll() is not None:
            break
        seen |= {*offspring(process.pid)}
        _signal_group(process, sign)
        try:
            process.wait(patience_s)
        except subprocess.TimeoutExpired:
            continue
    _signal_group(process, signal.SIGKILL)  # a child that outlived its parent
    deadline = time.monotonic() + patience_s
    while (left := [*filter(_lives, seen)]) and time.monotonic() < deadline:
        time.sleep(0.1)
    for each in left:
        with suppress(psutil.Error):
            each.kill()


def offspring(pid: int) -> list[psutil.Process]:
    """What came of a process."""
    with suppress(psutil.Error):
        return list(psutil.Process(pid).children(recursive=True))
    return []


def _lives(process: psutil.Process) -> bool:
    """Whether a process goes on; one that has ended may wait for a parent that is gone to ask how."""
    with suppress(psutil.Error):
        return bool(process.is_running() and process.status() != psutil.STATUS_ZOMBIE)
    return False


def _signal_group(process: subprocess.Popen[bytes], sign: signal.Signals) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, sign)
