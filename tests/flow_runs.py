"""What tests of flows ask for: Python and commands that know a server, and what the server lists."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import prefect_api

from upplied.flows.server import Server

ROOT = Path(__file__).parents[1]


def python(server: Server, place: Path, code: str) -> subprocess.CompletedProcess[str]:
    """Run Python that knows the server and the random members, in the folder of the catalog."""
    variables = server.environment | {"PREFECT_LOGGING_LEVEL": "WARNING", "PYTHONPATH": str(ROOT / "bench")}
    return subprocess.run(
        [sys.executable, "-c", code], env=variables, cwd=place, capture_output=True, text=True, check=False
    )


def prefect(server: Server, *command: str, timeout: float = 900) -> subprocess.CompletedProcess[str]:
    """A command of Prefect, in the folder of the project."""
    return _module("prefect", *command, server=server, place=ROOT, timeout=timeout)


def upplied(server: Server, place: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command of ours, in the folder of the catalog."""
    return _module("upplied", *words, server=server, place=place, timeout=300)


def _module(*command: str, server: Server, place: Path, timeout: float) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", *command],
        env=server.environment,
        cwd=place,
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout,
    )


def listed(server: Server, what: str) -> list[dict[str, Any]]:
    """All that the server lists of something."""
    return prefect_api.ask(server.api_url, f"{what}/filter", {}, server.password)
