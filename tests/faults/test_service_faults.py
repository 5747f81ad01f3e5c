"""The service of `make serve`: a power cut, an overlapping night, a log that lands."""

from __future__ import annotations

import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import prefect_api
import processes
import pytest

from upplied.catalog import Catalog, open_catalog
from upplied.flows.server import Server, end_with_parent, free_port, private_server
from upplied.outputs.logs import write_log
from upplied.samples.fleet import member, random_member
from upplied.samples.pilot import fly

ROOT = Path(__file__).parents[2]

pytestmark = [pytest.mark.slow, pytest.mark.server]


BOXES = 80  # enough that a fast machine is not through before somebody has looked and killed
PLANS = 2 * BOXES


@dataclass(frozen=True)
class Run:
    """A flow run as the server tells of it; moments in s."""

    run_id: str
    flow: str
    state: str
    said: str
    due: float
    began: float
    ended: float


class Service:
    """A fleet in a folder of its own, served by the units of docs/operating.md."""

    def __init__(self, place: Path, cron: str, published: bool) -> None:
        self.place, self.port = place, free_port()
        text = (ROOT / "prefect.yaml").read_text()
        text, nights = re.subn(r"30 2 \* \* \*", cron, text)
        if not published:  # pages and pictures of a fleet cost more than its plans
            text, given = re.subn("# parameters: .*", 'parameters: {reports: ""}', text)
            assert given == 1
        assert nights == 1
        (place / "prefect.yaml").write_text(text)
        self.catalog: Catalog = open_catalog(place / "catalog")
        cube = member("cube-v1").structure
        self.catalog.add_structures([cube, *(random_member("box", n).structure for n in range(1, BOXES + 1))])

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
        self.wait(lambda: b"started!" in log.read_bytes(), 240)

    @property
    def home(self) -> Path:
        return self.place / ".cache" / "prefect"

    def wait(self, reached: Callable[[], object], patience_s: float) -> None:
        deadline = time.monotonic() + patience_s
        while not reached():
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
def service(place: Path, cron: str, published: bool = False) -> Iterator[Service]:
    served = Service(place, cron, published)
    served.start()
    try:
        yield served
    finally:
        served.stop()


def finished(served: Service, flow: str, state: str = "COMPLETED") -> int:
    return sum(run.flow == flow and run.state == state for run in served.runs())


def test_a_run_outlives_its_server(tmp_path):
    """The server is killed and stays away for a minute: nothing but the server is started again."""
    with service(tmp_path, "* * * * *") as served:
        served.catalog.add_demonstrations([fly(member("cube-v1").structure, "sides")])
        served.wait(lambda: len(served.catalog.transfers()) > 0, 300)
        (running,) = [run for run in served.runs() if run.state == "RUNNING"]
        kept = len(served.catalog.transfers())
        served.kill("uvicorn", away_s=60)
        served.wait(lambda: finished(served, "transfer-fleet"), 600)
        runs = served.runs()
    (ended,) = [run for run in runs if run.run_id == running.run_id]
    rows = served.catalog.transfers(every=True)
    assert kept < PLANS, "it was killed too late to show anything"
    assert ended.state == "COMPLETED", runs
    assert ended.said.startswith(f"{(rows['status'] == 'ok').sum()} ok"), runs
    assert "CRASHED" not in {run.state for run in runs}, runs
    assert len(rows) == len(rows["key"].unique()) == PLANS
    assert set(rows["run_id"]) == {running.run_id}, "another run planned what this one lost"


def test_a_killed_worker_is_started_again_and_nothing_that_was_kept_is_planned_twice(tmp_path):
    with service(tmp_path, "* * * * *") as served:
        served.catalog.add_demonstrations([fly(member("cube-v1").structure, "sides")])
        served.wait(lambda: len(served.catalog.transfers()) > 0, 300)
        kept = len(served.catalog.transfers())
        served.kill("worker start")
        served.wait(lambda: len(served.catalog.transfers()) == PLANS, 600)
        served.wait(lambda: finished(served, "transfer-fleet"), 600)
        runs = served.runs()
    rows = served.catalog.transfers(every=True)
    assert kept < PLANS, "it was killed too late to show anything"
    assert len(rows) == len(rows["key"].unique()) == PLANS, runs
    assert len(set(rows["run_id"])) <= 2, "the second run should plan what the first left, and no third"
    assert not planners_in(tmp_path), "planners outlived the service"


def test_a_killed_flow_is_marked_by_its_worker_and_the_next_night_goes_on(tmp_path):
    with service(tmp_path, "* * * * *") as served:
        served.catalog.add_demonstrations([fly(member("cube-v1").structure, "sides")])
        served.wait(lambda: len(served.catalog.transfers()) > 0, 300)
        (running,) = [run for run in served.runs() if run.state == "RUNNING"]
        served.kill("prefect.engine")
        served.wait(lambda: finished(served, "transfer-fleet", "CRASHED"), 120)
        kept = len(served.catalog.transfers())
        served.wait(lambda: finished(served, "transfer-fleet"), 600)
        (crashed,) = [run for run in served.runs() if run.state == "CRASHED"]
    rows = served.catalog.transfers(every=True)
    assert crashed.run_id == running.run_id
    assert "-9" in crashed.said
    assert kept < PLANS, "it was killed too late to show anything"
    assert len(rows) == len(rows["key"].unique()) == PLANS
    assert rows.groupby("run_id").size()[running.run_id] == kept


def test_overlapping_nights_are_prevented_and_missed_ones_do_not_pile_up(tmp_path):
    with service(tmp_path, "* * * * *") as served:
        served.catalog.add_demonstrations([fly(member("cube-v1").structure, "sides")])
        run_now(served)
        served.wait(lambda: any(run.state == "RUNNING" for run in served.runs()), 120)
        run_now(served)
        served.wait(lambda: finished(served, "transfer-fleet", "CANCELLED"), 120)
        served.wait(lambda: finished(served, "transfer-fleet"), 300)
        before = {run.run_id for run in served.runs()}
        served.stop()
        stopped = time.time()
        time.sleep(200)  # three nights at least are missed
        served.catalog.add_structures(
            [random_member("box", n).structure for n in (BOXES + 1, BOXES + 2, BOXES + 3)]
        )
        started = time.time()
        served.start()
        served.wait(lambda: len(served.catalog.transfers()) == PLANS + 6, 400)
        served.wait(lambda: not unfinished(served), 300)
        every = served.runs()
    runs = [run for run in every if run.run_id not in before]
    missed = [run for run in runs if stopped < run.due < started]
    assert len(missed) >= 3, "Prefect did not remember the nights that were missed, so nothing was shown"
    worked = [run for run in runs if run.state == "COMPLETED" and not run.said.startswith("0 ok, 0 refused")]
    assert len(worked) == 1, runs
    assert {run.state for run in runs} <= {"COMPLETED", "CANCELLED"}, runs
    flown = sorted((run.began, run.ended) for run in every if run.state == "COMPLETED")
    assert all(ended <= began for (_, ended), (began, _) in pairwise(flown)), "two ran at once"


def run_now(served: Service) -> None:
    done = served.python("-m", "prefect", "deployment", "run", "transfer-fleet/transfer-fleet")
    assert done.returncode == 0, done.stdout + done.stderr


def state_of(served: Service, run: Run) -> str:
    return next((it.state for it in served.runs() if it.run_id == run.run_id), "")


def unfinished(served: Service) -> list[Run]:
    return [run for run in served.runs() if run.state in ("PENDING", "RUNNING")]


def test_a_log_that_lands_is_read_and_transferred(tmp_path):
    with service(tmp_path, "30 2 * * *", published=True) as served:
        inbox = tmp_path / "inbox"
        inbox.mkdir()
        watcher = subprocess.Popen(
            [sys.executable, "-m", "upplied", "watch", str(inbox)],
            env=os.environ | {"UPPLIED_HOME": str(tmp_path)},
            cwd=tmp_path,
            preexec_fn=end_with_parent,
        )
        try:
            cube = member("cube-v1").structure
            write_log(inbox / "flight.mcap", fly(cube, "sides"), cube)
            served.wait(lambda: finished(served, "transfer-fleet"), 900)
        finally:
            watcher.kill()
            watcher.wait()
        assert finished(served, "ingest-demonstrations") == 1
        assert finished(served, "transfer-fleet") == 1
    plans = served.catalog.transfers()
    assert len(plans) == PLANS
    assert set(plans["status"]) <= {"ok", "refused"}
    assert len(list((tmp_path / "reports" / "transfers").glob("*.html"))) == BOXES


def test_after_a_power_cut_the_next_night_starts_by_itself(tmp_path):
    with service(tmp_path, "* * * * *") as served:
        served.catalog.add_demonstrations([fly(member("cube-v1").structure, "sides")])
        served.wait(lambda: len(served.catalog.transfers()) > 0, 300)  # the run of this minute is at work
        (running,) = [run for run in served.runs() if run.state == "RUNNING"]
        served.cut_the_power()
        kept = len(served.catalog.transfers())
        restarted = time.time()
        served.start()
        served.wait(lambda: finished(served, "transfer-fleet"), 900)
        night = min(run.began for run in served.runs() if run.state == "COMPLETED")
        served.wait(lambda: state_of(served, running) == "CRASHED", 400)  # by the automation
        overlapping = finished(served, "transfer-fleet", "CANCELLED")
    rows = served.catalog.transfers(every=True)
    assert night - restarted < 600, "the slot was not free again, however long the planning then took"
    assert kept < PLANS, "the power was cut too late to show anything"
    assert len(rows) == len(rows["key"].unique()) == PLANS
    assert overlapping >= 1, "runs that found the slot taken were not cancelled"


def test_runs_of_long_ago_are_forgotten_and_those_of_yesterday_are_not(tmp_path):
    """Only Prefect's history: what was planned stays in the catalog."""

    def ask(server: Server, path: str, body: dict[str, Any]) -> Any:
        deadline = time.monotonic() + 60
        while True:
            try:
                return prefect_api.ask(server.api_url, path, body, server.password)
            except AssertionError as refusal:  # 503 while its database is busy, which a client tries again
                if "503" not in str(refusal) or time.monotonic() > deadline:
                    raise
                time.sleep(1)

    with private_server(tmp_path) as server:
        server.wait()
        flow = ask(server, "flows/", {"name": "transfer-fleet"})["id"]
        ended = {"flow_id": flow, "state": {"type": "COMPLETED"}}
        old, young = (ask(server, "flow_runs/", {**ended, "name": name})["id"] for name in ("old", "young"))
    with sqlite3.connect(tmp_path / "prefect.db") as database:
        for run, days in ((old, 31), (young, 29)):
            then = (datetime.now(UTC) - timedelta(days=days)).strftime("%Y-%m-%d %H:%M:%S.%f")
            changed = database.execute("update flow_run set end_time = ? where id = ?", (then, run))
            assert changed.rowcount == 1
    database.close()
    with private_server(tmp_path) as server:
        server.wait()
        deadline = time.monotonic() + 180
        while len(left := ask(server, "flow_runs/filter", {})) > 1 and time.monotonic() < deadline:
            time.sleep(1)
    assert [run["name"] for run in left] == ["young"]
