"""A fleet served in a folder of its own by the units of docs/operating.md: what drills watch and kill."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import prefect_api
import processes
import pytest
from ports import free_port
from random_members import random_member

from upplied.catalog import Catalog, open_catalog
from upplied.flows.server import START_UP_S, end_with_parent
from upplied.samples.fleet import member

ROOT = Path(__file__).parents[1]

BOXES = 40  # enough that a fast machine is not through before somebody has looked and killed
PLANS = 2 * BOXES  # of two presets
QUICK = ("baseline", "paper")  # where it does not matter what is planned: a third of the work


@dataclass(frozen=True)
class Run:
    """A flow run as the server tells of it; moments in s."""

    run_id: str
    flow: str
    state: str
    message: str
    due: float
    began: float
    ended: float


class Service:
    """A fleet in a folder of its own, served by the units of docs/operating.md."""

    def __init__(self, place: Path, cron: str, published: bool, presets: Sequence[str], boxes: int) -> None:
        self.place, self.port = place, free_port()
        text = (ROOT / "prefect.yaml").read_text()
        text, nights = re.subn(r"30 2 \* \* \*", cron, text)
        changed = {} if published else {"reports": ""}  # pages cost more than plans
        changed |= {"presets": list(presets)} if presets else {}
        text, number = re.subn("# parameters: .*", f"parameters: {json.dumps(changed)}", text)
        assert number == 1
        assert nights == 1
        (place / "prefect.yaml").write_text(text)
        self.catalog: Catalog = open_catalog(place / "catalog")
        cube = member("cube-v1").structure
        self.catalog.add_structures([cube, *(random_member("box", n).structure for n in range(1, boxes + 1))])

    def start(self) -> None:
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PREFECT")}
        environment |= {"UPPLIED_PORT": str(self.port), "UPPLIED_HOME": str(self.place)}
        log = self.place / "upplied-worker.log"
        log.write_bytes(b"")
        self.process = subprocess.Popen(
            [
                sys.executable,
                ROOT / "tests" / "supervisor.py",
                self.place,
                "upplied-server",
                "upplied-worker",
            ],
            env=environment,
            start_new_session=True,
            preexec_fn=end_with_parent,
        )
        self.wait(lambda: b"started!" in log.read_bytes(), 2 * START_UP_S)

    def planned(self) -> int:
        return len(self.catalog.transfers(columns=["transfer_id"]))

    @property
    def home(self) -> Path:
        return self.place / ".cache" / "prefect"

    def wait(self, reached: Callable[[], object], patience_s: float) -> None:
        """Wait for so long at most since the last plan came: a busy machine is slow, which is no fault."""
        planned, deadline = self.planned(), time.monotonic() + patience_s
        while not reached():
            if (now := self.planned()) > planned:
                planned, deadline = now, time.monotonic() + patience_s
            if self.process.poll() is not None or time.monotonic() > deadline:
                logs = [path.read_text()[-2000:] for path in self.place.glob("upplied-*.log")]
                pytest.fail("\n".join(logs) + f"\n{self.runs()}")
            time.sleep(2)

    def ask(self, what: str) -> list[dict[str, Any]]:
        """All that the server's own interface lists of something; nothing where it does not answer."""
        url = f"http://127.0.0.1:{self.port}/api"
        try:
            return prefect_api.ask(url, f"{what}/filter", {}, prefect_api.password_in(self.home))
        except (OSError, AssertionError):
            return []

    def runs(self) -> list[Run]:
        """Runs that have begun, or were cancelled before."""
        flows = {flow["id"]: flow["name"] for flow in self.ask("flows")}
        listed = [run for run in self.ask("flow_runs") if run["state_type"] != "SCHEDULED"]
        return [
            Run(
                run["id"],
                flows.get(run["flow_id"], ""),  # a server that is coming up answers the one and not the other
                run["state_type"],
                run["state"]["message"] or "",
                moment(run["expected_start_time"]),
                moment(run["start_time"]),
                moment(run["end_time"]),
            )
            for run in listed
        ]

    def python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        variables = {"PREFECT_HOME": str(self.home), "UPPLIED_HOME": str(self.place)}
        return subprocess.run(
            [sys.executable, *arguments],
            env=os.environ | variables,
            cwd=self.place,
            capture_output=True,
            text=True,
            check=False,
        )

    def cut_the_power(self) -> None:
        """Everything at once, without a word."""
        processes.cut_the_power(self.process.pid)
        self.process.wait()

    def kill(self, command: str, away_s: float = 0.0) -> None:
        """End what runs this command, and nothing that came of it; nobody starts it again for a while."""
        running = {pid: processes.command(pid) for pid in processes.descendants(self.process.pid)}
        victims = [pid for pid, line in running.items() if command in line]
        assert victims, f"no {command} among {running.values()}"
        self.process.send_signal(signal.SIGSTOP)
        for pid in victims:
            os.kill(pid, signal.SIGKILL)
        time.sleep(away_s)
        self.process.send_signal(signal.SIGCONT)

    def stop(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(60)
            except subprocess.TimeoutExpired:
                self.cut_the_power()


def moment(text: str | None) -> float:
    return datetime.fromisoformat(text).timestamp() if text else 0.0


def planners_in(place: Path) -> list[int]:
    return [pid for pid in processes.at_work_in(place) if "spawn_main" in processes.command(pid)]


@contextmanager
def service(
    place: Path, cron: str, published: bool = False, presets: Sequence[str] = (), boxes: int = BOXES
) -> Iterator[Service]:
    served = Service(place, cron, published, presets, boxes)
    served.start()
    try:
        yield served
    finally:
        served.stop()


def finished(served: Service, flow: str, state: str = "COMPLETED") -> int:
    return sum(run.flow == flow and run.state == state for run in served.runs())


def run_now(served: Service) -> None:
    process = served.python("-m", "prefect", "deployment", "run", "transfer-fleet/transfer-fleet")
    assert process.returncode == 0, process.stdout + process.stderr


def state_of(served: Service, run: Run) -> str:
    return next((it.state for it in served.runs() if it.run_id == run.run_id), "")


def unfinished(served: Service) -> list[Run]:
    return [run for run in served.runs() if run.state in ("PENDING", "RUNNING")]
