"""What ends a worker process ends one job, and nothing of it reaches the jobs beside it."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import forked
import pytest
from cases import slow_after
from processes import ended

from upplied.fleet import workers as fleet_workers
from upplied.fleet.workers import JobKilled, Limits, Workers, WorkersBroken
from upplied.flows.server import end_with_parent


@pytest.fixture(autouse=True)
def as_the_program_starts_them(monkeypatch):
    monkeypatch.setattr(fleet_workers, "_Context", forked.AS_IT_IS)


def hang() -> None:
    time.sleep(600)


def exhaust() -> int:
    """A little more than a worker may have, and far less than the machine would give."""
    return len(bytearray(5 * 2**30))


def crash_natively() -> None:
    ctypes.string_at(0)


def end_abruptly() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def refuse() -> None:
    raise ValueError("an ordinary error")


def slow_square(number: int) -> int:
    time.sleep(0.05)
    return number * number


@pytest.mark.parametrize(
    ("culprit", "timeout_s", "reason"),
    [
        (hang, 6, "took longer than 6 s"),
        (exhaust, 120, "needed more memory than the 4 GiB"),
        (crash_natively, 120, "ended by SIGSEGV"),
        (end_abruptly, 120, "ended by SIGKILL"),
    ],
)
def test_a_lost_process_costs_its_own_job_alone(culprit, timeout_s, reason):
    with (
        Workers(2, limits=Limits(timeout_s, memory_gib=4)) as workers,
        ThreadPoolExecutor(4) as threads,
    ):
        lost = threads.submit(workers.run, culprit)
        handles = [threads.submit(workers.run, slow_square, n) for n in range(12)]
        assert [job.result() for job in handles] == [n * n for n in range(12)]
        with pytest.raises(JobKilled, match=reason):
            lost.result()


@pytest.mark.ci
@pytest.mark.parametrize("patience_s", slow_after(2, [0.0, 0.002, 0.5]))
def test_a_process_that_dies_between_two_jobs_costs_neither(patience_s):
    with Workers(1) as workers:
        pid = workers.run(os.getpid)
        for number in range(3):
            os.kill(pid, signal.SIGKILL)
            time.sleep(patience_s)  # at once it is still dying when the next job is handed to it
            assert workers.run(slow_square, number) == number**2
            before, pid = pid, workers.run(os.getpid)
            assert pid != before


def wait_for_another(folder: str) -> None:
    """A start-up that ends when two processes are in it."""
    Path(folder, str(os.getpid())).touch()
    deadline = time.monotonic() + 60
    while len(list(Path(folder).iterdir())) < 2:
        assert time.monotonic() < deadline, "nobody else starts"
        time.sleep(0.01)


def test_processes_start_beside_each_other(tmp_path):
    with Workers(2, wait_for_another, (str(tmp_path),)) as workers, ThreadPoolExecutor(2) as threads:
        assert sorted(threads.map(workers.run, [slow_square] * 2, [2, 3])) == [4, 9]
    assert len(list(tmp_path.iterdir())) == 2, "one gave up, and another was started in its place"


def test_an_error_of_the_job_itself_comes_back_as_it_was_raised():
    with Workers(1) as workers:
        with pytest.raises(ValueError, match="ordinary"):
            workers.run(refuse)
        before = workers.run(os.getpid)
        assert workers.run(os.getpid) == before, "an ordinary error must not cost the process"


def test_a_worker_computes_on_one_thread_and_the_parent_keeps_its_environment():
    before = dict(os.environ)
    with Workers(1) as workers:
        assert workers.run(os.getenv, "OMP_NUM_THREADS") == "1"
    assert dict(os.environ) == before


def fail_to_set_up() -> None:
    raise OSError("no such library")


@pytest.mark.ci
def test_where_no_worker_starts_the_run_ends_and_no_job_is_blamed():
    with Workers(1, fail_to_set_up) as workers, pytest.raises(WorkersBroken, match="do not start"):
        workers.run(slow_square, 2)


PARENT = """
import os, time
from upplied.fleet.workers import Workers
workers = Workers(1)  # no guard: a worker does not run the script again
print(workers.run(os.getpid), flush=True)
workers.run(time.sleep, 600)
"""


def test_workers_end_with_a_killed_parent(tmp_path: Path):
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    parent = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, text=True, preexec_fn=end_with_parent
    )
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    deadline = time.monotonic() + 120
    while not ended(child) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert ended(child), f"worker {child} outlived its parent"
