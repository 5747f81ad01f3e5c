"""What tests of flows ask for: Python and commands that know a server, and what the server lists."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from threading import Timer
from typing import Any

import prefect_api

from upplied.flows.server import Server, end_with_parent

ROOT = Path(__file__).parents[1]
PATIENCE_S = 900.0

# Runs code after code, each as a script of its own, with what it says in files; what was imported stays.
READER = """
import json, os, sys, traceback
ends = os.fdopen(os.dup(1), "w")
for line in sys.stdin:
    code, *files = json.loads(line)
    for number, name in enumerate(files, 1):
        file = os.open(name, os.O_WRONLY)
        os.dup2(file, number)
        os.close(file)
    status = 0
    try:
        exec(compile(code, "<string>", "exec"), {"__name__": "__main__"})
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        status = 1
    sys.stdout.flush()
    sys.stderr.flush()
    print(status, file=ends, flush=True)
"""


class Session:
    """A process that knows a server, in a folder: Prefect is imported once for all that is run in it."""

    def __init__(self, environment: dict[str, str], place: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", READER], env=environment, cwd=place, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, preexec_fn=end_with_parent,
        )  # fmt: skip

    def run(self, code: str) -> subprocess.CompletedProcess[str]:
        """What a code said, and how it ended."""
        timer = Timer(PATIENCE_S, self._process.kill)
        timer.start()
        with tempfile.NamedTemporaryFile() as out, tempfile.NamedTemporaryFile() as err:
            print(json.dumps([code, out.name, err.name]), file=self._process.stdin, flush=True)
            status = self._process.stdout.readline()
            timer.cancel()
            outputs = (file.read().decode() for file in (out, err))
            return subprocess.CompletedProcess(code, int(status or -1), *outputs)

    def close(self) -> None:
        """End it, whatever it still has to tell the server."""
        self._process.kill()
        self._process.communicate()


# Workers of its fleets are forked from a process that has imported all that they need.
FORKED = f"""
import sys
sys.path.append({str(Path(__file__).parent)!r})
import forked
forked.prepare()
forked.workers._Context = forked.Context
"""
_sessions: dict[tuple[Path, tuple[tuple[str, str], ...]], Session] = {}


def _session(place: Path, environment: dict[str, str]) -> Session:
    """The process of a folder and environment."""
    name = place, tuple(sorted(environment.items()))
    if name not in _sessions:
        _sessions[name] = Session(environment, place)
        assert _sessions[name].run(FORKED).returncode == 0
    return _sessions[name]


def close_sessions() -> None:
    """End all of them, before their server is."""
    while _sessions:
        _sessions.popitem()[1].close()


def python(server: Server, place: Path, code: str) -> subprocess.CompletedProcess[str]:
    """Run Python that knows the server and the random members, in the folder of the catalog."""
    variables = server.environment | {"PREFECT_LOGGING_LEVEL": "WARNING", "PYTHONPATH": str(ROOT / "bench")}
    return _session(place, variables).run(code)


def prefect(server: Server, *command: str, timeout: float = PATIENCE_S) -> subprocess.CompletedProcess[str]:
    """A command of Prefect, in the folder of the project."""
    return subprocess.run(
        [sys.executable, "-m", "prefect", *command],
        env=server.environment, cwd=ROOT, capture_output=True, text=True, check=False, timeout=timeout,
    )  # fmt: skip


def upplied(server: Server, place: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command of ours, in the folder of the catalog."""
    code = f"import sys; from upplied.cli import main; sys.exit(main({list(words)!r}))"
    return _session(place, server.environment).run(code)


def listed(server: Server, what: str) -> list[dict[str, Any]]:
    """All that the server lists of something."""
    return prefect_api.ask(server.api_url, f"{what}/filter", {}, server.password)
