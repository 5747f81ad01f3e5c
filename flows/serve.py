"""`make serve`: a Prefect server with the deployments and a worker, until Ctrl-C."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

from flows.environment import ROOT
from flows.server import Server, ServerError, private_server, start, stop

POOLS = ("local", "planners")  # of the runs themselves; of their shards, where several machines plan


def main() -> int:
    """Start what a fleet needs, in the order it needs it, and stop it again in the reverse."""
    port = int(os.environ.get("UPPLIED_PORT", "4200"))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # as systemd stops it: through the same exits
    try:
        with private_server(ROOT / ".cache" / "prefect", port) as server:
            server.wait()
            prepare(server)
            worker = start("worker", "start", "--pool", POOLS[0], environment=server.environment)
            try:
                say(f"Prefect: http://127.0.0.1:{port}  (PREFECT_API_URL={server.api_url})")
                say("Run now:  upplied fleet run        Stop: Ctrl-C")
                return watch(server, worker)
            finally:
                stop(worker)
    except ServerError as error:
        say(str(error))
        return 1
    except KeyboardInterrupt:
        return 0


def prepare(server: Server) -> None:
    """The work pools, the deployments of prefect.yaml, and what Prefect does by itself.

    Raises
    ------
    ServerError
        If Prefect refuses them.
    """
    commands = (
        *(("prefect", "work-pool", "create", pool, "--type", "process", "--overwrite") for pool in POOLS),
        ("prefect", "--no-prompt", "deploy", "--all"),
        ("flows.automations",),
    )
    for command in commands:
        done = subprocess.run(
            [sys.executable, "-m", *command],
            env=server.environment,
            cwd=ROOT,
            check=False,
            capture_output=True,
            text=True,
        )
        if done.returncode:
            raise ServerError(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")


def watch(server: Server, worker: subprocess.Popen[bytes]) -> int:
    """Wait until one of the two ends, which neither should."""
    while True:
        for name, process in (("server", server.process), ("worker", worker)):
            if process.poll() is not None:
                say(f"the {name} ended with code {process.returncode}")
                return 1
        time.sleep(1)


def say(text: str) -> None:
    """A line for the operator."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
