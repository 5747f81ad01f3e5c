"""A Prefect server of our own: on a loopback port, with its own home, stopped when we leave."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from flows.environment import ROOT, environment

START_UP_S = 180.0  # a fresh database takes 12 s on a quiet machine


class ServerError(Exception):
    """The server did not come up; the text holds what it said last."""


class Server:
    """A running server: the environment its clients need, and how to wait for it and start it again.

    Raises
    ------
    ServerError
        If the port is taken.
    """

    def __init__(self, home: Path, port: int = 0) -> None:
        port = port or free_port()
        if _answers(port):  # it would be taken for ours
            raise ServerError(f"Something listens on port {port} already. Stop it, or set UPPLIED_PORT.")
        home.mkdir(parents=True, exist_ok=True)
        self.api_url = f"http://127.0.0.1:{port}/api"
        self.environment = environment(home, self.api_url)
        # The page that the server hands out calls the address in its settings, not the one of --port.
        self._address = {"PREFECT_SERVER_API_HOST": "127.0.0.1", "PREFECT_SERVER_API_PORT": str(port)}
        self.log = home / "server.log"
        self.log.write_bytes(b"")
        self.process = self._start()

    def restart(self) -> None:
        """Start it again after it ended, at the same address and with the same memory.

        Raises
        ------
        ServerError
            If it does not come up.
        """
        stop(self.process)  # what is left of it
        self.process = self._start()
        self.wait()

    def _start(self) -> subprocess.Popen[bytes]:
        with self.log.open("ab") as log:
            return start("server", "start", environment=self.environment | self._address, log=log)

    def wait(self) -> None:
        """Wait until the server answers.

        Raises
        ------
        ServerError
            If it ends, or does not answer in time.
        """
        deadline = time.monotonic() + START_UP_S
        while time.monotonic() < deadline:
            if self.process.poll() is not None:
                raise ServerError(f"the Prefect server ended at its start:\n{self._last_lines()}")
            try:
                with urllib.request.urlopen(f"{self.api_url}/health", timeout=5):
                    return
            except OSError:
                time.sleep(0.2)
        raise ServerError(f"the Prefect server did not answer in {START_UP_S:g} s:\n{self._last_lines()}")

    def _last_lines(self, count: int = 15) -> str:
        return "\n".join(self.log.read_text(errors="replace").splitlines()[-count:])


@contextmanager
def private_server(home: Path, port: int = 0) -> Iterator[Server]:
    """Run a server as long as the block lasts; it starts while the caller goes on.

    Parameters
    ----------
    home : path
        Folder of the server's database and log; created when missing.
    port : int
        Port on 127.0.0.1; 0 takes a free one.
    """
    server = Server(home, port)
    try:
        yield server
    finally:
        stop(server.process)


def start(
    *command: str, environment: dict[str, str], log: IO[bytes] | int | None = None
) -> subprocess.Popen[bytes]:
    """Start a command of Prefect in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "prefect", *command],
        env=environment,
        cwd=ROOT,
        stdout=log,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )


def free_port() -> int:
    """A port on 127.0.0.1 that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def stop(process: subprocess.Popen[bytes], patience_s: float = 15.0) -> None:
    """End a process we started together with its children: politely first."""
    for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        if process.poll() is not None:
            break
        _signal_group(process, sign)
        try:
            process.wait(patience_s)
        except subprocess.TimeoutExpired:
            continue
    _signal_group(process, signal.SIGKILL)  # a child that outlived its parent


def _signal_group(process: subprocess.Popen[bytes], sign: signal.Signals) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, sign)
