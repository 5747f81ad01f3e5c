"""What stands round the flows and needs no server: pages, shares, settings, the watcher."""

from __future__ import annotations

import errno
import importlib
import math
import os
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from ports import free_port
from processes import ended

from upplied import fleet
from upplied.cli import main
from upplied.config import settings_for
from upplied.errors import CatalogError, InputError, SettingsError
from upplied.fleet import planner
from upplied.flows import engines, pool, states, tasks, watch
from upplied.flows.environment import ROOTS, SETTINGS, check_roots, environment, home, profile
from upplied.flows.server import Server, ServerError, offspring, stop
from upplied.flows.states import errors_in_words

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.filterwarnings("default")


def test_a_task_that_comes_after_the_end_of_its_run_leaves_nothing_behind(tmp_path):
    """A cluster whose connection to a run broke still works on its shards, which that run took away."""
    terms = {"catalog": str(tmp_path / "catalog"), "run_id": "night", "engine": "pool"}
    terms["limits"] = {"timeout_s": 60.0, "memory_gib": None}
    with pytest.raises(CatalogError, match="cannot be read"):
        tasks.plan_elsewhere.fn("boxes", "night/00000.jobs", terms)
    assert not (tmp_path / "catalog").exists()


def test_artifacts_link_to_the_pages_where_a_server_shows_them(tmp_path, monkeypatch):
    """A browser opens no file from a page that came over HTTP."""
    monkeypatch.setenv(states.ADDRESS, "http://127.0.0.1:4201/")
    link = states.address(str(home() / "reports"), "transfers/a--b.html")
    assert link == "http://127.0.0.1:4201/transfers/a--b.html"
    elsewhere = states.address(str(tmp_path), "index.html")
    assert elsewhere == (tmp_path / "index.html").as_uri(), "this folder is not the one that is shown"


@pytest.mark.parametrize("targets", [1, 30, 200, 1000, 10_000])
@pytest.mark.parametrize("machines", [1, 2, 5])
def test_every_machine_has_its_share_of_a_fleet(targets, machines):
    size = pool.shard_targets(targets, machines)
    shards = math.ceil(targets / size)
    assert shards >= min(machines, targets), "a machine is left without work"
    assert size >= min(targets // machines, 64), "starting a shard would cost more than planning it"
    assert shards <= 8 * machines


def test_env_example_says_what_the_flows_are_given():
    lines = [line for line in (ROOT / ".env.example").read_text().splitlines() if line and line[0] != "#"]
    variables = dict(line.split("=", 1) for line in lines)
    assert SETTINGS.items() <= variables.items()
    assert set(variables) - set(SETTINGS) == {"PREFECT_API_URL", "PREFECT_HOME", "UPPLIED_HOME"}


def test_env_example_names_this_clone_wherever_a_worker_runs():
    """A worker starts its runs in folders of their own, where a relative path is another one."""
    code = "set -a; source .env.example; cd /; echo $UPPLIED_HOME; echo $PREFECT_HOME"
    output = subprocess.run(["bash", "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert output.splitlines() == [str(ROOT), str(ROOT / ".cache" / "prefect")]


def test_a_foreign_prefect_setting_does_not_leak_in(monkeypatch, tmp_path):
    monkeypatch.setenv("PREFECT_API_KEY", "of somebody else")
    assert "PREFECT_API_KEY" not in environment(tmp_path, "http://127.0.0.1:1/api")


def test_every_deployment_names_a_flow_of_its_own_name():
    declared = yaml.safe_load((ROOT / "prefect.yaml").read_text())["deployments"]
    for deployment in declared:
        module, name = deployment["entrypoint"].rsplit(".", 1)
        assert importlib.import_module(module).__dict__[name].name == deployment["name"]
        assert name == deployment["name"].replace("-", "_")
    nightly = declared[0]
    assert nightly["name"] == "transfer-fleet"
    assert nightly["concurrency_limit"]["collision_strategy"] == "CANCEL_NEW"


def test_a_port_that_is_taken_is_told_and_its_owner_not_taken_for_ours(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as somebody:
        port = somebody.getsockname()[1]
        with pytest.raises(ServerError, match=f"port {port} already"), Server(tmp_path, port):
            pass


@pytest.mark.parametrize(
    ("folder", "code", "message"), [("nowhere", 2, "is not a folder"), (".", 1, "no Prefect server")]
)
def test_a_watcher_that_cannot_tell_anybody_says_so(folder, code, message, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PREFECT_API_URL", f"http://127.0.0.1:{free_port()}/api")
    assert main(["watch", folder]) == code
    assert message in capsys.readouterr().err


def test_a_log_is_told_when_it_has_come_whole_and_again_when_it_was_changed(tmp_path):
    """A copy may stall for longer than anybody waits; what a link to nothing names never comes."""
    now = 0.0
    landing = watch.Landing(tmp_path, lambda: now)

    def after(seconds: float) -> list[str]:
        nonlocal now
        now += seconds
        return [path.name for path in landing.landed()]

    whole = watch.MAGIC + b"\0" * 100 + watch.MAGIC
    (tmp_path / "dangling.mcap").symlink_to("/nowhere/flight.mcap")
    (tmp_path / "copied.mcap").write_bytes(whole[:60])
    (tmp_path / "whole.mcap").write_bytes(whole)
    assert after(0) == []
    assert after(watch.QUIET_S) == ["whole.mcap"]
    assert after(5 * watch.QUIET_S) == [], "a copy that stalled was told"
    (tmp_path / "copied.mcap").write_bytes(whole)
    assert after(1) == []
    assert after(watch.QUIET_S) == ["copied.mcap"]
    assert after(watch.PATIENCE_S) == []
    (tmp_path / "whole.mcap").write_bytes(whole + whole)
    (tmp_path / "broken.mcap").write_bytes(b"never a log")
    assert after(1) == []
    assert after(watch.QUIET_S) == ["whole.mcap"]
    assert after(watch.PATIENCE_S) == ["broken.mcap"], "what is broken is for ingest to tell, sooner or later"


def test_flights_of_every_kind_are_told_a_folder_of_photos_as_one(tmp_path):
    now = 0.0
    landing = watch.Landing(tmp_path, lambda: now)
    (tmp_path / "photos").mkdir()
    for name in ("a.jpg", "b.jpg"):
        (tmp_path / "photos" / name).write_bytes(b"\xff\xd8\xff")
    (tmp_path / "flight.ulg").write_bytes(b"ULog\x01\x12\x35\x01")
    (tmp_path / "cut.srt").write_bytes(b"")
    (tmp_path / "notes.md").write_text("fine weather")
    assert list(landing.landed()) == []
    now = watch.STILL_S - 1
    (tmp_path / "photos" / "c.jpg").write_bytes(b"\xff\xd8\xff")
    assert list(landing.landed()) == []
    now = watch.STILL_S
    assert [path.name for path in landing.landed()] == ["cut.srt", "flight.ulg"]
    now = 2 * watch.STILL_S
    assert [path.name for path in landing.landed()] == ["photos"]
    now = 9 * watch.STILL_S
    assert list(landing.landed()) == []


def test_the_short_way_says_at_once_that_no_server_answers(monkeypatch, capsys):
    """Prefect's own command would start a server that knows no deployment, and say that there is none."""
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setenv("UPPLIED_PORT", str(free_port()))
    assert main(["fleet", "run"]) == 1
    assert "upplied serve" in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
def test_no_server_is_told_at_once_and_in_words(tmp_path):
    variables = environment(tmp_path, "") | {"PREFECT_SERVER_ALLOW_EPHEMERAL_MODE": "false"}
    del variables["PREFECT_API_URL"]
    code = "from upplied.flows.upkeep import publish_reports; publish_reports()"
    process = subprocess.run(
        [sys.executable, "-c", code], env=variables, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert process.returncode != 0
    assert "PREFECT_API_URL" in process.stderr
    assert not os.listdir(tmp_path) or not (tmp_path / "reports").exists()


@pytest.mark.parametrize(
    "location",
    [
        "../secret",
        "link/secret",
        "~/secret",
        "file://{place}/%2e%2e/secret",
        "file://localhost/etc",
        "file://elsewhere{place}/x",
        "s3://bucket/fleet/../secret",
        "s3://bucket/fleet/%2e%2e/secret",
        "s3://bucket/fleet/%252e%252e/secret",
        "s3://bucket/fleeting",
        "s3://other/fleet",
        "S3://bucket/fleet",
        "catalog\0",
    ],
)
def test_no_other_way_of_saying_it_leads_out_of_the_roots(location, tmp_path, monkeypatch):
    """What opens a location takes ~ for a home, and reads percent signs and hosts of file://."""
    place = tmp_path / "place"
    place.mkdir()
    (place / "link").symlink_to(tmp_path)
    monkeypatch.chdir(place)
    monkeypatch.setenv(ROOTS, f"{place},s3://bucket/fleet")
    for fine in (
        "catalog",
        f"file://{place}/catalog",
        f"{place}",
        "s3://bucket/fleet",
        "s3://bucket/fleet/a",
    ):
        check_roots(catalog=fine)
    with pytest.raises(SettingsError, match="outside the roots"):
        check_roots(catalog=location.format(place=place))


def test_a_profile_that_is_no_toml_is_told(tmp_path):
    (tmp_path / "profiles.toml").write_text("active = ")
    with pytest.raises(InputError, match=r"profiles\.toml.*new password"):
        profile(tmp_path)


STUBBORN = """
import subprocess, sys, time
code = "import signal, time; [signal.signal(s, signal.SIG_IGN) for s in (2, 15)]; print(1, flush=True); "
code += "time.sleep(600)"
child = subprocess.Popen([sys.executable, "-c", code], start_new_session=True, stdout=subprocess.PIPE)
child.stdout.readline()
print(child.pid, flush=True)
time.sleep(600)
"""


@pytest.mark.parametrize("killed", [False, True])
def test_what_is_stopped_leaves_no_session_of_its_own(killed):
    """As a worker's run is, which tries for minutes to tell a server that is gone how it ended."""
    worker = subprocess.Popen(
        [sys.executable, "-c", STUBBORN],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    run = int(worker.stdout.readline())
    known = offspring(worker.pid)
    if killed:
        worker.kill()
        worker.wait()
    stop(worker, 0.5, known if killed else ())
    worker.stdout.close()
    deadline = time.monotonic() + 30
    while not ended(run) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert ended(run) and worker.returncode is not None


def test_a_flow_that_finds_no_space_or_right_ends_in_words():
    def full() -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "reports/index.html")

    assert errors_in_words(full)().message == "reports/index.html: No space left on device"


def test_the_state_of_a_run_names_lost_workers_and_who_did_their_work():
    job = fleet.Job("cube-sides-v1", "cube-v1", "box", "box", settings_for("baseline"), "", "", ("",) * 3)
    shards = {f"night/{number:05}.parquet": (replace(job, target_id=f"box-{number}"),) for number in range(8)}
    names = list(shards)
    planned = engines.Planned(fleet.Result(ok=8), shards=8)
    assert states.planned("8 ok", planned, [], 0.5).message == "8 ok"
    planned.attempted(shards, [planner.Attempt(name, "a/1/dask:x", True) for name in names])
    assert states.planned("8 ok", planned, [], 0.5).message == "8 ok", "nothing was lost"
    lost = [planner.Attempt(name, "a/2/dask:y") for name in names[:2]]
    planned.attempted(shards, [*lost, planner.Attempt(names[0], "a/1/dask:x", True)])
    first, second = (str(shards[name][0]) for name in names[:2])
    assert states.planned("8 ok", planned, [], 0.5).message == (
        f"8 ok. Lost workers: a/2/dask:y; done again: {first} (by a/1/dask:x), {second} (by this run)"
    )
    more = engines.Planned()
    more.attempted(shards, [planner.Attempt(name, f"a/{name}/dask:z") for name in names])
    planned.include(more)
    assert planned.loss.count("dask:z") == 4 and "and 4 more; done again" in planned.loss, (
        "a state is read in a line"
    )
