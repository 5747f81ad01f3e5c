"""From a clone to a worker that runs its deployments, and somebody who is told how they end."""

from __future__ import annotations

import queue
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import prefect_api
import pytest
from flow_runs import listed, prefect, python, upplied

from upplied.catalog import open_catalog
from upplied.flows.automations import SILENCE_S
from upplied.flows.environment import ROOTS
from upplied.flows.server import Server, start, stop
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

pytestmark = [pytest.mark.server, pytest.mark.filterwarnings("default")]


@pytest.mark.slow
def test_an_automation_that_is_there_stays_with_what_it_has_heard(server, place):
    """In its place a new one would know nothing of the runs that died while nobody served."""
    process = python(
        server,
        place,
        """
from prefect import get_client
from upplied.flows.automations import SILENCE_S, apply, zombies
with get_client(sync_client=True) as client:
    # What remains is what is served: a shorter patience would crash runs of the tests that follow.
    for silence_s in (3 * SILENCE_S, 3 * SILENCE_S, SILENCE_S):
        apply(zombies(silence_s))
        (there,) = client.read_automations_by_name(zombies().name)
        print(there.id, int(there.trigger.within.total_seconds()))
""",
    )
    first, again, changed = (line.split() for line in process.stdout.splitlines())
    assert first == again, process.stderr
    assert changed[0] != first[0]
    assert int(changed[1]) == SILENCE_S


@pytest.fixture(scope="module")
def serving(server, place) -> Iterator[None]:
    """The README's commands: pools, deployments, and a worker."""
    open_catalog(place / "catalog").add_demonstrations([fly(member("cube-v1").structure, "sides")])
    for pool in ("local", "planners"):  # as `prefect work-pool create` does
        prefect_api.ask(server.api_url, "work_pools/", {"name": pool, "type": "process"}, server.password)
    deployed = prefect(server, "--no-prompt", "deploy", "--all")
    assert deployed.returncode == 0, deployed.stdout + deployed.stderr
    worker = start(
        "prefect",
        "worker",
        "start",
        "--pool",
        "local",
        environment=server.environment | {ROOTS: str(place)},
        log=subprocess.DEVNULL,
    )
    yield
    stop(worker)


def parameters(place) -> list[str]:
    return [f'catalog="{place}/catalog"', 'reports=""', 'presets=["baseline"]']


def fails(server, place, shared: float) -> None:
    """A run that the short way starts, and says how it ended."""
    hasty = 'resources={"timeout_s": 0.001, "workers": 1}'
    changes = f'changes={{"viewpoints": {{"shared": {shared}}}}}'
    failed = upplied(server, place, "fleet", "run", *parameters(place), hasty, changes)
    assert failed.returncode == 1
    assert "Failed: 0 ok, 0 refused, 2 failed" in failed.stdout, failed.stderr
    assert "took longer than 0.001 s" in failed.stdout


@pytest.mark.ci
def test_from_a_clone_to_a_scheduled_worker(server, place, serving):
    """A run on demand, one that fails and is told to whoever is named, and runs for the nights to come."""
    options = [word for parameter in parameters(place) for word in ("--param", parameter)]
    with receiver() as (address, received):
        notified = upplied(server, place, "fleet", "notify", f"http://{address}/hook")
        assert "Failed, Crashed" in notified.stdout
        ran = prefect(server, "deployment", "run", "transfer-fleet/transfer-fleet", "--watch", *options)
        assert ran.returncode == 0, ran.stdout + ran.stderr
        plans = open_catalog(place / "catalog").transfers(preset="baseline")
        assert set(plans["target_id"]) == {"box-random-1", "box-random-2"}
        assert (plans["status"] == "ok").all()
        fails(server, place, 0.2)
        notice = received.get(timeout=600)
        assert "transfer-fleet: Failed" in notice, "somebody was told of a run that went well"
        assert "took longer than 0.001 s" in notice
        assert "no notices" in upplied(server, place, "fleet", "notify", "").stdout
    assert scheduled(server) >= 1

    for wrong in ('presets=["best"]', "presets=best", "nonsense", 'nonsense=""'):
        refused = upplied(server, place, "fleet", "run", wrong)
        assert refused.returncode == 1
        assert wrong.partition("=")[0] in refused.stderr.replace("\n", " ")
        assert "Traceback" not in refused.stderr


@pytest.mark.slow
def test_a_run_that_fails_is_told_by_either_kind_of_block_and_planned_again(server, place, serving):
    with receiver() as (address, received):
        for number, url in enumerate((f"http://{address}/hook", f"json://{address}/apprise")):
            assert "Failed, Crashed" in upplied(server, place, "fleet", "notify", url).stdout
            fails(server, place, 0.3 + number / 10)
            notice = received.get(timeout=600)
            assert "transfer-fleet: Failed" in notice and "took longer than 0.001 s" in notice
        assert "no notices" in upplied(server, place, "fleet", "notify", "").stdout
        again = upplied(server, place, "fleet", "run", *parameters(place), "retry_failed=true")
        assert again.returncode == 0, again.stdout + again.stderr
        assert "Completed: 0 ok" in again.stdout or "Completed: 2 ok" in again.stdout
        outside = upplied(server, place, "fleet", "run", 'catalog="/srv/elsewhere"')
        assert outside.returncode == 1 and "outside the roots" in outside.stdout
        # A message may come twice: Prefect sends it again where the answer took long.
        while not received.empty():
            assert "took longer than 0.001 s" in received.get(), "somebody was told of a run that went well"
    plans = open_catalog(place / "catalog").transfers(preset="baseline")
    assert (plans["status"] == "ok").all()


@contextmanager
def receiver() -> Iterator[tuple[str, queue.Queue[str]]]:
    """Somebody who is told over HTTP: where, and what was said."""
    received: queue.Queue[str] = queue.Queue()

    class Hook(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            received.put(self.rfile.read(int(self.headers["Content-Length"])).decode())
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Hook) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"127.0.0.1:{server.server_port}", received
        server.shutdown()


def scheduled(server: Server, patience_s: float = 180) -> int:
    """How many runs the cron has scheduled; the scheduler looks once a minute."""
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        runs = [run for run in listed(server, "flow_runs") if run["state_type"] == "SCHEDULED"]
        if count := sum(run["auto_scheduled"] for run in runs):
            return count
        time.sleep(1)
    return 0
