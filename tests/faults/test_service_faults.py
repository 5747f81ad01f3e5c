"""The service of `make serve`: a power cut, an overlapping night, a log that lands."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from typing import Any

import pandas as pd
import prefect_api
import pytest
from random_members import random_member
from served_fleet import BOXES, PLANS, QUICK, finished, planners_in, run_now, service, state_of, unfinished

from upplied.catalog import published_tables
from upplied.flows.server import Server, end_with_parent
from upplied.outputs.logs import write_log
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

pytestmark = [pytest.mark.slow, pytest.mark.server]

FEW = 12  # boxes of a fleet where nobody is killed


def test_a_run_outlives_its_server(tmp_path):
    """The server is killed and stays away for a minute: nothing but the server is started again."""
    with service(tmp_path, "* * * * *") as served:
        served.catalog.add_demonstrations([fly(member("cube-v1").structure, "sides")])
        served.wait(lambda: len(served.catalog.transfers()) > 0, 300)
        (running,) = [run for run in served.runs() if run.state == "RUNNING"]
        before = len(served.catalog.transfers())
        served.kill("uvicorn", away_s=60)
        served.wait(lambda: finished(served, "transfer-fleet"), 600)
        runs = served.runs()
    (ended,) = [run for run in runs if run.run_id == running.run_id]
    rows = served.catalog.transfers(every=True)
    assert before < PLANS, "it was killed too late to show anything"
    assert ended.state == "COMPLETED", runs
    assert ended.message.startswith(f"{(rows['status'] == 'ok').sum()} ok"), runs
    assert "CRASHED" not in {run.state for run in runs}, runs
    assert len(rows) == len(rows["key"].unique()) == PLANS
    assert set(rows["run_id"]) == {running.run_id}, "another run planned what this one lost"


def test_a_killed_worker_is_started_again_and_nothing_that_was_kept_is_planned_twice(tmp_path):
    with service(tmp_path, "* * * * *", presets=QUICK) as served:
        served.catalog.add_demonstrations([fly(member("cube-v1").structure, "sides")])
        served.wait(lambda: len(served.catalog.transfers()) > 0, 300)
        before = len(served.catalog.transfers())
        served.kill("worker start")
        served.wait(lambda: len(served.catalog.transfers()) == PLANS, 600)
        served.wait(lambda: finished(served, "transfer-fleet"), 600)
        runs = served.runs()
    rows = served.catalog.transfers(every=True)
    assert before < PLANS, "it was killed too late to show anything"
    assert len(rows) == len(rows["key"].unique()) == PLANS, runs
    assert len(set(rows["run_id"])) <= 2, "the second run should plan what the first left, and no third"
    assert not planners_in(tmp_path), "planners outlived the service"


def test_a_killed_flow_is_marked_by_its_worker_and_the_next_night_goes_on(tmp_path):
    with service(tmp_path, "* * * * *", presets=QUICK) as served:
        served.catalog.add_demonstrations([fly(member("cube-v1").structure, "sides")])
        served.wait(lambda: len(served.catalog.transfers()) > 0, 300)
        (running,) = [run for run in served.runs() if run.state == "RUNNING"]
        served.kill("prefect.engine")
        served.wait(lambda: finished(served, "transfer-fleet", "CRASHED"), 120)
        before = len(served.catalog.transfers())
        served.wait(lambda: finished(served, "transfer-fleet"), 600)
        (crashed,) = [run for run in served.runs() if run.state == "CRASHED"]
    rows = served.catalog.transfers(every=True)
    assert crashed.run_id == running.run_id
    assert "-9" in crashed.message
    assert before < PLANS, "it was killed too late to show anything"
    assert len(rows) == len(rows["key"].unique()) == PLANS
    assert rows.groupby("run_id").size()[running.run_id] == before


def test_overlapping_nights_are_prevented_and_missed_ones_do_not_pile_up(tmp_path):
    with service(tmp_path, "* * * * *", presets=QUICK) as served:
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
        due = {run.run_id for run in served.runs()}  # of the nights: more come while these end
        served.wait(lambda: not due & {run.run_id for run in unfinished(served)}, 300)
        every = [run for run in served.runs() if run.run_id in due]
    runs = [run for run in every if run.run_id not in before]
    missed = [run for run in runs if stopped < run.due < started]
    assert len(missed) >= 3, "Prefect did not remember the nights that were missed, so nothing was shown"
    worked = [
        run for run in runs if run.state == "COMPLETED" and not run.message.startswith("0 ok, 0 refused")
    ]
    assert len(worked) == 1, runs
    assert {run.state for run in runs} <= {"COMPLETED", "CANCELLED"}, runs
    flown = sorted((run.began, run.ended) for run in every if run.state == "COMPLETED")
    assert all(ended <= began for (_, ended), (began, _) in pairwise(flown)), "two ran at once"


def test_a_log_that_lands_is_read_and_transferred(tmp_path):
    with service(tmp_path, "30 2 * * *", published=True, presets=QUICK, boxes=FEW) as served:
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
    assert len(plans) == 2 * FEW
    assert set(plans["status"]) <= {"ok", "refused"}
    assert len(list((tmp_path / "reports" / "transfers").glob("*.html"))) == FEW


def test_after_a_power_cut_the_next_night_starts_by_itself_and_publishes(tmp_path):
    with service(tmp_path, "* * * * *", published=True, presets=QUICK) as served:
        served.catalog.add_demonstrations([fly(member("cube-v1").structure, "sides")])
        served.wait(lambda: len(served.catalog.transfers()) > 0, 300)  # the run of this minute is at work
        (running,) = [run for run in served.runs() if run.state == "RUNNING"]
        served.cut_the_power()
        before = len(served.catalog.transfers())
        restarted = time.time()
        served.start()
        served.wait(lambda: finished(served, "transfer-fleet"), 900)
        night = min(run.began for run in served.runs() if run.state == "COMPLETED")
        served.wait(lambda: state_of(served, running) == "CRASHED", 400)  # by the automation
        overlapping = finished(served, "transfer-fleet", "CANCELLED")
    rows = served.catalog.transfers(every=True)
    assert night - restarted < 600, "the slot was not free again, however long the planning then took"
    assert before < PLANS, "the power was cut too late to show anything"
    assert len(rows) == len(rows["key"].unique()) == PLANS
    assert overlapping >= 1, "runs that found the slot taken were not cancelled"
    tables = {name: pd.read_parquet(path) for name, path in published_tables(tmp_path / "reports").items()}
    assert set(tables["transfers"]["transfer_id"]) == set(rows["transfer_id"])
    steps = tables["waypoints"]["transfer_id"].value_counts()
    counts = tables["transfers"].set_index("transfer_id")["n_waypoints"]
    assert (steps.reindex(counts.index, fill_value=0) == counts).all()
    assert len(list((tmp_path / "reports" / "transfers").glob("*.html"))) == BOXES


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

    with Server(tmp_path) as server:
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
    with Server(tmp_path) as server:
        server.wait()
        deadline = time.monotonic() + 180
        while len(left := ask(server, "flow_runs/filter", {})) > 1 and time.monotonic() < deadline:
            time.sleep(1)
    assert [run["name"] for run in left] == ["young"]
