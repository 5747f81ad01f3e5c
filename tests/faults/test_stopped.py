"""A drill that is stopped, or killed, leaves nothing behind that runs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pytest
from processes import command, with_variable

from upplied.flows.server import end_with_parent

HERE = Path(__file__).parent
MARK = "UPPLIED_DRILL"  # what is started by a drill inherits it
#: The drills that start something, and a word of the last that each starts.
DRILLS = {
    "service": ("test_service_faults.py::test_a_killed_flow_is_marked_by_its_worker", "prefect.engine"),
    "writers": ("test_catalog_faults.py::test_nothing_acknowledged_is_lost", "multiprocessing.forkserver"),
    "planners": ("test_fleet_faults.py::test_a_killed_process_costs_little", "spawn_main"),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("drill", "sign"),
    [
        ("service", signal.SIGTERM),
        ("service", signal.SIGKILL),
        ("writers", signal.SIGINT),
        ("writers", signal.SIGKILL),
        ("planners", signal.SIGTERM),
        ("planners", signal.SIGKILL),
    ],
)
def test_a_stopped_drill_leaves_nothing_alive(tmp_path, drill, sign):
    name, last = DRILLS[drill]
    file, _, test = name.partition("::")
    mark = uuid.uuid4().hex
    words = [
        "-m",
        "pytest",
        HERE / file,
        "-k",
        test,
        "-p",
        "no:cacheprovider",
        "--basetemp",
        tmp_path / "drill",
    ]
    with (tmp_path / "said").open("wb") as output:
        running = subprocess.Popen(
            [sys.executable, *words],
            env=os.environ | {MARK: mark},
            stdout=output,
            stderr=output,
            start_new_session=True,
            preexec_fn=end_with_parent,
        )
    try:
        until(lambda: any(last in command(pid) for pid in with_variable(MARK, mark)), running, tmp_path)
        time.sleep(2)  # in the middle of its work
        assert running.poll() is None, (tmp_path / "said").read_text()
        running.send_signal(sign)
        running.wait(120)
        until(lambda: not with_variable(MARK, mark), None, tmp_path)
    finally:
        for pid in with_variable(MARK, mark):
            os.kill(pid, signal.SIGKILL)
        running.wait()


def until(reached, running: subprocess.Popen[bytes] | None, place: Path, patience_s: float = 240) -> None:
    deadline = time.monotonic() + patience_s
    while not reached():
        ended = running is not None and running.poll() is not None
        assert not ended and time.monotonic() < deadline, (place / "said").read_text()[-3000:]
        time.sleep(0.5)
