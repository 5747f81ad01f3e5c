"""The flows against a server of their own: what they do, what they refuse, what they leave to read."""

from __future__ import annotations

import json
import math
import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from flows import pages, pool, watch
from flows.environment import ROOT, SETTINGS, environment
from flows.server import Server, ServerError, free_port, private_server, start, stop
from upplied import fleet
from upplied.catalog import open_catalog
from upplied.cli import main
from upplied.outputs.logs import write_log
from upplied.samples.fleet import member, random_member
from upplied.samples.pilot import fly

pytestmark = [pytest.mark.server, pytest.mark.filterwarnings("default")]


@pytest.fixture(scope="module")
def server(tmp_path_factory) -> Iterator[Server]:
    with private_server(tmp_path_factory.mktemp("prefect")) as server:
        server.wait()
        yield server


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder with a catalog of a cube and two boxes, and a log that is not in it yet."""
    place = tmp_path_factory.mktemp("place")
    cube = member("cube-v1").structure
    open_catalog(place / "catalog").add_structures(
        [cube, *(random_member("box", n).structure for n in (1, 2))]
    )
    write_log(place / "flight.mcap", fly(cube, "sides"), cube)
    return place


def python(server: Server, place: Path, code: str) -> subprocess.CompletedProcess[str]:
    """Run Python that knows the server, in the folder of the catalog."""
    variables = server.environment | {"PREFECT_LOGGING_LEVEL": "WARNING"}
    return subprocess.run(
        [sys.executable, "-c", code], env=variables, cwd=place, capture_output=True, text=True, check=False
    )


def prefect(server: Server, *command: str, timeout: float = 900) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "prefect", *command],
        env=server.environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout,
    )


def post(server: Server, path: str, body: dict[str, Any]) -> Any:
    """What the server's own interface answers."""
    request = urllib.request.Request(
        f"{server.api_url}/{path}", json.dumps(body).encode(), {"Content-Type": "application/json"}
    )
    with urllib.request.urlopen(request, timeout=120) as answer:
        return json.load(answer)


def listed(server: Server, what: str) -> list[dict[str, Any]]:
    """All that the server lists of something."""
    return post(server, f"{what}/filter", {})


def test_the_whole_way_by_flows(server, place):
    done = python(
        server,
        place,
        """
from flows.ingest_demonstrations import ingest_demonstrations
from flows.transfer_fleet import transfer_fleet
print(ingest_demonstrations(["flight.mcap"], return_state=True).message)
print(transfer_fleet(presets=["paper"], targets=["box-random-1"], return_state=True).message)
print(transfer_fleet(presets=["paper"], reports="", return_state=True).message)
print(transfer_fleet(presets=["paper"], reports="", return_state=True).message)
""",
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "1 added",
        "1 ok, 0 refused, 0 failed, 0 unchanged",
        "1 ok, 0 refused, 0 failed, 1 unchanged",
        "0 ok, 0 refused, 0 failed, 2 unchanged",
    ]
    assert (place / "reports" / "transfers.parquet").is_file()
    assert (place / "reports" / "index.html").is_file()


def test_maintenance_checks_the_catalog_and_says_what_is_wrong_with_it(server, place):
    code = """
from flows.maintain_catalog import maintain_catalog
state = maintain_catalog(catalog="catalog", return_state=True)
print(state.type.value, state.message)
"""
    done = python(server, place, code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("COMPLETED") and "0 findings" in done.stdout
    mesh = sorted((place / "catalog" / "meshes").glob("*.parquet"))[0]
    whole = mesh.read_bytes()
    try:
        mesh.write_bytes(whole[: len(whole) // 2])
        done = python(server, place, code)
        assert done.stdout.startswith("FAILED") and "1 findings" in done.stdout
    finally:
        mesh.write_bytes(whole)


def test_runs_say_what_they_do_and_leave_something_to_read(server, place):
    names = {run["name"] for run in listed(server, "flow_runs")}
    assert {"demonstrations of flight.mcap", "every demonstration to box-random-1"} <= names
    left = {item["key"]: item for item in listed(server, "artifacts/latest")}
    assert {key: left[key]["type"] for key in left if key and key.startswith("transfer-fleet")} == {
        "transfer-fleet": "markdown",
        "transfer-fleet-result": "table",
        "transfer-fleet-report": "markdown",
        "transfer-fleet-progress": "progress",
    }
    assert left["transfer-fleet-progress"]["data"] == 100.0
    assert "2 unchanged" in left["transfer-fleet"]["data"]
    assert (place / "reports" / "index.html").as_uri() in left["transfer-fleet-report"]["data"]


def test_a_plan_is_followed_from_its_log_to_its_page(server, place):
    tables = [item for item in listed(server, "artifacts") if item["key"] == "transfer-fleet-result"]
    rows = [row for item in tables for row in json.loads(item["data"])]
    (row,) = [row for row in rows if row["target"] == "box-random-1"]
    catalog = open_catalog(place / "catalog")
    (flown,) = catalog.demonstrations().to_dict("records")
    assert (row["log (sha256)"], row["demonstration"]) == (flown["sha256"], flown["demonstration_id"])
    assert len(catalog.trajectory(row["trajectory"]).t_s) > 0
    assert row["status"] == "ok"
    page = (place / "reports" / "transfers" / f"{row['demonstration']}--box-random-1.html").resolve()
    assert row["page"].endswith(f"({page.as_uri()})")
    assert page.is_file()


def test_pages_open_from_prefect_where_they_are_given_out(tmp_path, monkeypatch):
    """A browser opens no file from a page that came over HTTP."""
    (tmp_path / "transfers").mkdir()
    (tmp_path / "transfers" / "a--b.html").write_text("the plan")
    with pages.served(tmp_path, 0) as url:
        monkeypatch.setenv(pages.ADDRESS, url)
        link = pages.address(str(pages.FOLDER), "transfers/a--b.html")
        with urllib.request.urlopen(link, timeout=60) as page:
            assert page.read() == b"the plan"
        with pages.served(tmp_path, int(url.rsplit(":", 1)[1])) as other:
            assert other != url, "a port that is taken must not end the service"
    elsewhere = pages.address(str(tmp_path), "index.html")
    assert elsewhere == (tmp_path / "index.html").as_uri(), "this folder is not the one that is given out"


@pytest.mark.parametrize("targets", [1, 30, 200, 1000, 10_000])
@pytest.mark.parametrize("machines", [1, 2, 5])
def test_every_machine_has_its_share_of_a_fleet(targets, machines):
    size = pool.shard_targets(targets, machines)
    shards = math.ceil(targets / size)
    assert shards >= min(machines, targets), "a machine is left without work"
    assert size >= min(targets // machines, 64), "starting a shard would cost more than planning it"
    assert shards <= 8 * machines


def test_a_shard_plans_what_it_is_named_and_nothing_twice(server, place):
    """What a machine of the work pool does; two machines do it in test_machines.py."""
    changes = {"viewpoints": {"shared": 0.5}}
    catalog = open_catalog(place / "catalog")
    jobs = fleet.decide(catalog, fleet.Wish(("paper",), changes)).jobs
    assert len(jobs) == 2
    named = [jobs[0].key, "0123456789abcdef"]
    code = f"""
from flows.plan_shard import plan_shard
from flows.transfer_fleet import transfer_fleet
asked = {{"presets": ["paper"], "changes": {changes}}}
for _ in range(2):
    print(plan_shard("catalog", "night", {named}, **asked, return_state=True).message)
transfer_fleet(reports="", resources={{"engine": "pool"}}, **asked)
"""
    done = python(server, place, code)
    assert done.stdout.splitlines() == ["1 ok, 0 refused, 0 failed", "0 ok, 0 refused, 0 failed"], done.stderr
    assert "prefect worker start --pool planners" in done.stderr, "nobody takes shards, and it was not told"
    rows = catalog.transfers(every=True)
    assert rows[rows["run_id"] == "night"]["key"].tolist() == [jobs[0].key]
    result, missing = fleet.kept(catalog, jobs)
    assert (result.ok, missing) == (1, jobs[1:])


def test_prefect_keeps_no_results(server, place):
    home = Path(server.environment["PREFECT_HOME"])
    assert not [path for path in home.rglob("storage/*") if path.is_file()]


WRONG = (
    "presets=['best']",
    "presets=[]",
    "changes={'route': {'clearance': 3}}",
    "targets=['../../etc']",
    "resources={'workers': -1}",
)


def test_wrong_parameters_are_refused_before_anything_runs(server, place):
    calls = "\n".join(f"attempt(lambda: transfer_fleet({wrong}))" for wrong in WRONG)
    code = f"""
from prefect.exceptions import ParameterTypeError
from flows.transfer_fleet import transfer_fleet
def attempt(call):
    try:
        call()
    except ParameterTypeError as error:
        print("refused:", str(error).splitlines()[1])
{calls}
"""
    done = python(server, place, code)
    told = [line for line in done.stdout.splitlines() if line.startswith("refused:")]
    assert len(told) == len(WRONG), done.stdout + done.stderr


def test_env_example_says_what_the_flows_are_given():
    lines = [line for line in (ROOT / ".env.example").read_text().splitlines() if line and line[0] != "#"]
    given = dict(line.split("=", 1) for line in lines)
    assert SETTINGS.items() <= given.items()
    assert set(given) - set(SETTINGS) == {"PREFECT_API_URL", "PREFECT_HOME", "UPPLIED_HOME"}


def test_env_example_names_this_clone_wherever_a_worker_runs():
    """A worker starts its runs in folders of their own, where a relative path is another one."""
    code = "set -a; source .env.example; cd /; echo $UPPLIED_HOME; echo $PREFECT_HOME"
    told = subprocess.run(["bash", "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert told.splitlines() == [str(ROOT), str(ROOT / ".cache" / "prefect")]


def test_a_foreign_prefect_setting_does_not_leak_in(monkeypatch, tmp_path):
    monkeypatch.setenv("PREFECT_API_KEY", "of somebody else")
    assert "PREFECT_API_KEY" not in environment(tmp_path, "http://127.0.0.1:1/api")


def test_an_automation_that_is_there_stays_with_what_it_has_heard(server, place):
    """In its place a new one would know nothing of the runs that died while nobody served."""
    done = python(
        server,
        place,
        """
from prefect import get_client
from flows.automations import apply, zombies
with get_client(sync_client=True) as client:
    for silence_s in (300, 300, 90):
        apply(zombies(silence_s))
        (there,) = client.read_automations_by_name(zombies().name)
        print(there.id, int(there.trigger.within.total_seconds()))
""",
    )
    first, again, changed = (line.split() for line in done.stdout.splitlines())
    assert first == again, done.stderr
    assert changed[0] != first[0]
    assert changed[1] == "90"


def test_every_deployment_names_a_flow_of_its_own_name():
    declared = yaml.safe_load((ROOT / "prefect.yaml").read_text())["deployments"]
    for deployment in declared:
        file, name = deployment["entrypoint"].split(":")
        assert f'name="{deployment["name"]}"' in (ROOT / file).read_text()
        assert name == deployment["name"].replace("-", "_")
    nightly = declared[0]
    assert nightly["name"] == "transfer-fleet"
    assert nightly["concurrency_limit"]["collision_strategy"] == "CANCEL_NEW"


def test_from_a_clone_to_a_scheduled_worker(server, place):
    """The README's commands: pool, deployments, worker, a run on demand, and runs for the nights to come."""
    open_catalog(place / "catalog").add_demonstrations([fly(member("cube-v1").structure, "sides")])
    assert prefect(server, "work-pool", "create", "local", "--type", "process").returncode == 0
    post(server, "work_pools/", {"name": "planners", "type": "process"})  # as above, without a process
    deployed = prefect(server, "--no-prompt", "deploy", "--all")
    assert deployed.returncode == 0, deployed.stdout + deployed.stderr
    worker = start(
        "worker", "start", "--pool", "local", environment=server.environment, log=subprocess.DEVNULL
    )
    try:
        parameters = [f'catalog="{place}/catalog"', 'reports=""', 'presets=["baseline"]']
        options = [word for parameter in parameters for word in ("--param", parameter)]
        ran = prefect(server, "deployment", "run", "transfer-fleet/transfer-fleet", "--watch", *options)
        assert ran.returncode == 0, ran.stdout + ran.stderr
    finally:
        stop(worker)
    plans = open_catalog(place / "catalog").transfers(preset="baseline")
    assert set(plans["target_id"]) == {"box-random-1", "box-random-2"}
    assert (plans["status"] == "ok").all()
    assert scheduled(server) >= 1

    short = "import sys; from upplied.cli import main; sys.exit(main(['fleet', 'run', 'presets=[\"best\"]']))"
    wrong = python(server, place, short)
    assert wrong.returncode == 1
    assert "best" in wrong.stdout + wrong.stderr


def scheduled(server: Server, patience_s: float = 180) -> int:
    """How many runs the cron has scheduled; the scheduler looks once a minute."""
    deadline = time.monotonic() + patience_s
    while time.monotonic() < deadline:
        runs = [run for run in listed(server, "flow_runs") if run["state_type"] == "SCHEDULED"]
        if count := sum(run["auto_scheduled"] for run in runs):
            return count
        time.sleep(1)
    return 0


def test_a_port_that_is_taken_is_told_and_its_owner_not_taken_for_ours(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as somebody:
        port = somebody.getsockname()[1]
        with pytest.raises(ServerError, match=f"port {port} already"), private_server(tmp_path, port):
            pass


@pytest.mark.parametrize(("folder", "told"), [("nowhere", "usage"), (".", "PREFECT_API_URL")])
def test_a_watcher_that_cannot_tell_anybody_says_so(folder, told, monkeypatch, capsys):
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    assert watch.main([folder]) == 2
    assert told in capsys.readouterr().err


def test_the_short_way_says_at_once_that_no_server_answers(monkeypatch, capsys):
    """Prefect's own command would start a server that knows no deployment, and say that there is none."""
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setenv("UPPLIED_PORT", str(free_port()))
    assert main(["fleet", "run"]) == 1
    assert "make serve" in " ".join(capsys.readouterr().err.split())


def test_no_server_is_told_at_once_and_in_words(tmp_path):
    variables = environment(tmp_path, "") | {"PREFECT_SERVER_ALLOW_EPHEMERAL_MODE": "false"}
    del variables["PREFECT_API_URL"]
    code = "from flows.publish_reports import publish_reports; publish_reports()"
    done = subprocess.run(
        [sys.executable, "-c", code], env=variables, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert "PREFECT_API_URL" in done.stderr
    assert not os.listdir(tmp_path) or not (tmp_path / "reports").exists()
