"""The service of `make serve`: a power cut, an overlapping night, a log that lands."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from flows.environment import ROOT
from flows.server import free_port
from upplied.catalog import Catalog, open_catalog
from upplied.outputs.logs import write_log
from upplied.samples.fleet import member, random_member
from upplied.samples.pilot import fly

pytestmark = [pytest.mark.slow, pytest.mark.server]

RUNS = """
import json
from prefect import get_client
with get_client(sync_client=True) as client:
    flows = {it.id: it.name for it in client.read_flows()}
    runs = [{"id": str(run.id), "flow": flows[run.flow_id], "state": run.state.type.value,
             "auto": run.auto_scheduled} for run in client.read_flow_runs()]
print(json.dumps([run for run in runs if run["state"] != "SCHEDULED"]))
"""


class Service:
    """A copy of the flows in a folder of its own, served from there."""

    def __init__(self, place: Path, cron: str) -> None:
        self.place, self.port = place, free_port()
        shutil.copytree(ROOT / "flows", place / "flows", ignore=shutil.ignore_patterns("__pycache__"))
        text = (ROOT / "prefect.yaml").read_text()
        assert '"30 2 * * *"' in text
        (place / "prefect.yaml").write_text(text.replace("30 2 * * *", cron))
        self.catalog: Catalog = open_catalog(place / "catalog")
        cube = member("cube-v1").structure
        self.catalog.add_structures([cube, *(random_member("box", n).structure for n in range(1, 9))])

    def start(self) -> None:
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PREFECT")}
        environment |= {"UPPLIED_PORT": str(self.port), "PYTHONPATH": str(self.place)}
        with (self.place / "serve.log").open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "flows.serve"],
                env=environment,
                cwd=self.place,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self.wait(lambda: b"Run now" in (self.place / "serve.log").read_bytes(), 180)

    def wait(self, reached: Callable[[], object], patience_s: float) -> None:
        deadline = time.monotonic() + patience_s
        while not reached():
            if self.process.poll() is not None or time.monotonic() > deadline:
                pytest.fail((self.place / "serve.log").read_text()[-3000:] + f"\n{self.runs()}")
            time.sleep(2)

    def runs(self) -> list[dict[str, str]]:
        done = self.python("-c", RUNS)
        return json.loads(done.stdout) if done.returncode == 0 else []

    def python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        variables = {"PREFECT_API_URL": f"http://127.0.0.1:{self.port}/api", "PYTHONPATH": str(self.place)}
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
        for pid in [*descendants(self.process.pid), self.process.pid]:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        self.process.wait()

    def stop(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(60)
            except subprocess.TimeoutExpired:
                self.cut_the_power()


def descendants(pid: int) -> list[int]:
    found = []
    for thread in Path(f"/proc/{pid}/task").iterdir():
        for child in (thread / "children").read_text().split():
            found += [*descendants(int(child)), int(child)]
    return found


@contextmanager
def service(place: Path, cron: str) -> Iterator[Service]:
    served = Service(place, cron)
    served.start()
    try:
        yield served
    finally:
        served.stop()


def finished(served: Service, flow: str, state: str = "COMPLETED") -> int:
    return sum(run["flow"] == flow and run["state"] == state for run in served.runs())


def test_a_log_that_lands_is_read_and_transferred(tmp_path):
    with service(tmp_path, "30 2 * * *") as served:
        inbox = tmp_path / "inbox"
        inbox.mkdir()
        variables = {"PREFECT_API_URL": f"http://127.0.0.1:{served.port}/api", "PYTHONPATH": str(tmp_path)}
        watcher = subprocess.Popen(
            [sys.executable, "-m", "flows.watch", str(inbox)], env=os.environ | variables, cwd=tmp_path
        )
        try:
            cube = member("cube-v1").structure
            write_log(inbox / "flight.mcap", fly(cube, "sides"), cube)
            served.wait(lambda: finished(served, "transfer-fleet"), 300)
        finally:
            watcher.kill()
            watcher.wait()
        assert finished(served, "ingest-demonstrations") == 1
        assert finished(served, "transfer-fleet") == 1
    plans = served.catalog.transfers()
    assert len(plans) == 16
    assert set(plans["status"]) <= {"ok", "refused"}


def test_after_a_power_cut_the_next_night_starts_by_itself(tmp_path):
    with service(tmp_path, "* * * * *") as served:
        served.catalog.add_demonstrations([fly(member("cube-v1").structure, "sides")])
        served.wait(lambda: len(served.catalog.transfers()) > 0, 300)  # the run of this minute is at work
        (running,) = [run for run in served.runs() if run["state"] == "RUNNING"]
        served.cut_the_power()
        kept = len(served.catalog.transfers())
        (tmp_path / "serve.log").unlink()
        began = time.monotonic()
        served.start()
        served.wait(lambda: finished(served, "transfer-fleet"), 900)
        took = time.monotonic() - began
        crashed = [run for run in served.runs() if run["id"] == running["id"]]
        overlapping = finished(served, "transfer-fleet", "CANCELLED")
    rows = served.catalog.transfers(every=True)
    assert took < 600
    assert kept < 16, "the power was cut too late to show anything"
    assert len(rows) == len(rows["key"].unique()) == 16
    assert crashed[0]["state"] in ("CRASHED", "RUNNING")  # marked within ten heartbeats
    assert overlapping >= 1, "runs that found the slot taken were not cancelled"
