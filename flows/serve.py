"""`make serve`: a Prefect server with the deployments and a worker, until Ctrl-C."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from typing import NoReturn

from flows.environment import ROOT
from flows.pages import ADDRESS, FOLDER, served
from flows.server import Server, ServerError, private_server, start, stop

POOLS = ("local", "planners")  # of the runs themselves; of their shards, where several machines plan
SHORT_S = 10.0  # what lives no longer than this does not work here, and is not started again


class Worker:
    """The worker that starts a process for each run."""

    def __init__(self, environment: dict[str, str]) -> None:
        self._environment = environment
        self.process = self._start()

    def restart(self) -> None:
        """Start it again after it ended; a run that it left behind sees to itself."""
        self.process = self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        return start("worker", "start", "--pool", POOLS[0], environment=self._environment)


def main() -> int:
    """Start what a fleet needs, in the order it needs it, and stop it again in the reverse."""
    port = int(os.environ.get("UPPLIED_PORT", "4200"))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # as systemd stops it: through the same exits
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored by what a script started with &
    try:
        with private_server(ROOT / ".cache" / "prefect", port) as server:
            server.wait()
            prepare(server)
            with served(FOLDER, port + 1) as reports:
                worker = Worker(server.environment | {ADDRESS: reports})
                try:
                    say(f"Prefect: http://127.0.0.1:{port}  (PREFECT_API_URL={server.api_url})")
                    say(f"Reports: {reports}")
                    say("Run now:  upplied fleet run        Stop: Ctrl-C")
                    attend(server, worker)
                finally:
                    stop(worker.process)
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


def attend(server: Server, worker: Worker) -> NoReturn:
    """Start again whichever of the two ends, and nothing else: a run goes on without its server for a while.

    Raises
    ------
    ServerError
        If one ends as soon as it was started: that is no accident.
    """
    began = dict.fromkeys((server, worker), time.monotonic())
    while True:
        for name, kept in (("server", server), ("worker", worker)):
            code = kept.process.poll()
            if code is None:
                continue
            if time.monotonic() - began[kept] < SHORT_S:
                raise ServerError(f"the {name} ended with code {code} as soon as it was started")
            say(f"the {name} ended with code {code}; it is started again")
            kept.restart()
            began[kept] = time.monotonic()
        time.sleep(1)


def say(text: str) -> None:
    """A line for the operator."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
