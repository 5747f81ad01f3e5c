"""A target that misbehaves, and a run that is killed: the rest is planned, and nothing twice."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import patch

import pytest
from processes import children, command
from random_members import random_member

from upplied import fleet, open_catalog
from upplied.catalog import Catalog
from upplied.fleet import planner
from upplied.fleet.planner import Outcome
from upplied.flows.server import end_with_parent
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

REQUEST = fleet.PlanRequest(("baseline",))
CULPRITS = {
    "box-random-1": "took longer than 60 s",
    "box-random-2": "needed more memory than the 4 GiB",
    "box-random-3": "its process was ended by SIGSEGV",
    "box-random-4": "its process was ended by SIGKILL",
    "box-random-5": "ZeroDivisionError",
}

really_plan = planner.plan_job


def misbehave(job: fleet.Job) -> Outcome:
    """Planning as it is, but for some targets; runs in the worker process."""
    if job.target_id == "box-random-1":
        time.sleep(600)
    if job.target_id == "box-random-2":
        bytearray(5 * 2**30)  # a worker may have 4
    if job.target_id == "box-random-3":
        ctypes.string_at(0)
    if job.target_id == "box-random-4":
        os.kill(os.getpid(), signal.SIGKILL)
    if job.target_id == "box-random-5":
        with patch.object(planner, "plan_transfer", lambda *_: 1 / 0):
            return really_plan(job)
    return really_plan(job)


def boxes(location: Path, count: int) -> Catalog:
    catalog = open_catalog(location)
    cube = member("cube-v1").structure
    catalog.add_structures([cube, *(random_member("box", seed).structure for seed in range(1, count + 1))])
    catalog.add_demonstrations([fly(cube, "sides")])
    return catalog


@pytest.mark.slow
def test_culprits_are_rows_with_a_reason_and_the_rest_is_planned(tmp_path):
    catalog = boxes(tmp_path / "catalog", 8)
    resources = fleet.Resources(2, fleet.Limits(timeout_s=60, memory_gib=4))
    jobs = fleet.decide(catalog, REQUEST).jobs
    result = fleet.transfer(catalog, jobs, "bad night", resources, plan=misbehave)
    plans = catalog.transfers().set_index("target_id")
    for target, reason in CULPRITS.items():
        assert plans.loc[target, "status"] == "failed"
        assert reason in plans.loc[target, "reason"]
        assert "Traceback" not in plans.loc[target, "reason"]
    assert (plans.drop(index=list(CULPRITS))["status"] == "ok").all()
    assert (result.ok, result.failed) == (3, 5)

    assert fleet.decide(catalog, REQUEST).jobs == []  # what failed waits for a person, or for other inputs
    again = fleet.decide(catalog, fleet.PlanRequest(("baseline",), retry_failed=True))
    assert again.reasons == {"failed before": 5}
    assert fleet.transfer(catalog, again.jobs, "good night", resources).ok == 5
    plans = catalog.transfers()
    assert (len(plans), set(plans["status"])) == (8, {"ok"})


RUN = """
import sys
from upplied import fleet, open_catalog
from upplied.fleet import run
run.EVERY_S = 0.0
if __name__ == "__main__":
    catalog = open_catalog(sys.argv[1])
    jobs = fleet.decide(catalog, fleet.PlanRequest(("baseline",))).jobs
    said = lambda outcome: print(outcome.job.target_id, flush=True)
    fleet.transfer(catalog, jobs, sys.argv[2], fleet.Resources(2), said)
"""


def start(script: Path, catalog: Catalog, run_id: str) -> subprocess.Popen[str]:
    command = [sys.executable, str(script), str(catalog.location), run_id]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=end_with_parent)


def planners_of(process: subprocess.Popen[str]) -> list[int]:
    return [pid for pid in children(process.pid) if "spawn_main" in command(pid)]


@pytest.mark.slow
@pytest.mark.parametrize("victim", ["run", "worker"])
def test_a_killed_process_costs_little_and_the_next_run_goes_on(tmp_path, victim):
    catalog = boxes(tmp_path / "catalog", 10)
    script = tmp_path / "run.py"
    script.write_text(RUN)
    process = start(script, catalog, "first")
    assert process.stdout is not None
    finished = [process.stdout.readline().strip() for _ in range(3)]
    if victim == "run":
        process.kill()
    else:
        victim_pid = planners_of(process)[0]
        os.kill(victim_pid, signal.SIGKILL)
        finished += [process.stdout.readline().strip() for _ in range(4)]
        assert victim_pid not in planners_of(process)
        assert len(planners_of(process)) == 2, "the lost process was not replaced"
    process.communicate(timeout=120)
    rows = catalog.transfers(every=True)
    assert set(finished) <= set(rows["target_id"])
    if victim == "worker":
        assert process.returncode == 0
        assert len(rows) == 10
        failed = rows[rows["status"] == "failed"]
        assert len(failed) <= 1
        assert failed["reason"].str.contains("SIGKILL").all()
        return
    assert process.returncode == -signal.SIGKILL
    before = len(rows)
    assert 3 <= before < 10
    assert len(fleet.decide(catalog, REQUEST).jobs) == 10 - before

    again = start(script, catalog, "second")
    output, _ = again.communicate(timeout=120)
    assert again.returncode == 0
    assert len(output.split()) == 10 - before  # nothing that was kept is planned again
    rows = catalog.transfers(every=True)
    assert len(rows) == len(rows["key"].unique()) == 10
    assert rows.groupby("run_id").size().to_dict() == {"first": before, "second": 10 - before}
    for row in rows.itertuples():
        assert len(catalog.waypoints(row.transfer_id)) == row.n_waypoints
