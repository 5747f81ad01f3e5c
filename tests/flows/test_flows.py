"""The flows against a server of their own: what they do, what they refuse, what they leave to read."""

from __future__ import annotations

import importlib
import json
import math
import os
import queue
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import prefect_api
import pytest
import yaml

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.cli import main
from upplied.fleet import manifest
from upplied.flows import pages, pool, watch
from upplied.flows.environment import ROOTS, SETTINGS, environment, home
from upplied.flows.server import Server, ServerError, free_port, private_server, start, stop
from upplied.outputs.logs import write_log
from upplied.samples.fleet import member, random_member
from upplied.samples.pilot import fly

ROOT = Path(__file__).parents[2]

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


def upplied(server: Server, place: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command of ours, in the folder of the catalog."""
    return subprocess.run(
        [sys.executable, "-m", "upplied", *words],
        env=server.environment,
        cwd=place,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def listed(server: Server, what: str) -> list[dict[str, Any]]:
    """All that the server lists of something."""
    return prefect_api.ask(server.api_url, f"{what}/filter", {}, server.password)


def test_the_whole_way_by_flows(server, place):
    done = python(
        server,
        place,
        """
from upplied.flows.ingest_demonstrations import ingest_demonstrations
from upplied.flows.transfer_fleet import transfer_fleet
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
from upplied.flows.maintain_catalog import maintain_catalog
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


def test_assets_say_what_was_made_of_what(server, place):
    said = {"filter": {"event": {"prefix": ["prefect.asset."]}}, "limit": 50}
    deadline = time.monotonic() + 60
    made: dict[str, set[str]] = {}
    while len(made) < 3 and time.monotonic() < deadline:
        for event in prefect_api.ask(server.api_url, "events/filter", said, server.password)["events"]:
            if event["event"] == "prefect.asset.materialization.succeeded":
                key = event["resource"]["prefect.resource.id"]
                related = [item for item in event["related"] if item["prefect.resource.role"] == "asset"]
                made.setdefault(key, set()).update(item["prefect.resource.id"] for item in related)
        time.sleep(0.5)
    here = place.resolve().as_uri()
    assert made == {
        f"{here}/catalog/demonstrations": {f"{here}/flight.mcap"},
        f"{here}/catalog/transfers": {f"{here}/catalog/structures", f"{here}/catalog/demonstrations"},
        f"{here}/reports": {f"{here}/catalog/transfers"},
    }


def test_a_store_that_was_away_is_asked_again_and_a_wrong_input_is_not(server, place):
    done = python(
        server,
        place,
        """
from prefect import task
from upplied.errors import CatalogError, InputError
from upplied.flows import tasks
tried = []
@task(**{**tasks.STORED, "retry_delay_seconds": 0})
def attempt(error, times):
    tried.append(error)
    if tried.count(error) <= times:
        raise {"store": CatalogError("transfers", "is away"), "input": InputError("log", "is broken")}[error]
    return "done"
print(attempt("store", 2))
for error in ("store", "input"):
    print(attempt(error, 99, return_state=True).type.value)
print(tried.count("input"))
""",
    )
    assert done.stdout.split() == ["done", "FAILED", "FAILED", "1"], done.stdout + done.stderr


def test_a_plan_is_followed_from_its_log_to_its_page(server, place):
    tables = [item for item in listed(server, "artifacts") if item["key"] == "transfer-fleet-result"]
    rows = [row for item in tables for row in json.loads(item["data"])]
    (row,) = [row for row in rows if row["target"] == "box-random-1"]
    catalog = open_catalog(place / "catalog")
    (flown,) = catalog.demonstrations().to_dict("records")
    assert (row["log (sha256)"], row["demonstration"]) == (flown["sha256"], flown["demonstration_id"])
    assert len(catalog.waypoints(row["trajectory"])) > 0  # of a plan for comparison, which is not to be flown
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
        link = pages.address(str(home() / "reports"), "transfers/a--b.html")
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


def test_the_pages_of_a_folder_are_given_out_and_nothing_else(tmp_path):
    folder, secret = tmp_path / "reports", tmp_path / "secret.txt"
    (folder / "transfers").mkdir(parents=True)
    (folder / "index.html").write_text("the fleet")
    (folder / "transfers" / "a--b.html").write_text("the plan")
    secret.write_text("not yours")
    (folder / "link.txt").symlink_to(secret)
    (folder / "linked").symlink_to(tmp_path)
    with pages.served(folder, 0) as url:
        get = {
            path: prefect_api.send("GET", f"{url}/{path}", said={"Host": host})
            for path, host in {
                "": "127.0.0.1",
                "transfers/a--b.html": "localhost:4201",
                "index.html": "evil.example",
                "transfers/": "127.0.0.1",
                "transfers": "127.0.0.1",
                "link.txt": "127.0.0.1",
                "linked/secret.txt": "127.0.0.1",
                "../secret.txt": "127.0.0.1",
                "%2e%2e/secret.txt": "127.0.0.1",
            }.items()
        }
    assert (get[""][0], get[""][2]) == (200, b"the fleet")
    assert get["transfers/a--b.html"][2] == b"the plan"
    refused = {path: status for path, (status, _, _) in get.items() if status != 200}
    assert refused == {
        "index.html": 403,
        **dict.fromkeys(
            (
                "transfers/",
                "link.txt",
                "linked/secret.txt",
                "../secret.txt",
                "%2e%2e/secret.txt",
                "transfers",
            ),
            404,
        ),
    }
    for _, headers, body in get.values():
        assert pages.HEADERS.items() <= {name: headers.get(name.lower()) for name in pages.HEADERS}.items()
        assert b"not yours" not in body


def test_a_shard_plans_what_it_is_named_and_nothing_twice(server, place):
    """What a machine of the work pool does; two machines do it in test_machines.py."""
    changes = {"viewpoints": {"shared": 0.5}}
    catalog = open_catalog(place / "catalog")
    jobs = fleet.decide(catalog, fleet.PlanRequest(("paper",), changes)).jobs
    assert len(jobs) == 2
    (shard,) = manifest.write_shards(catalog, "night", [(jobs[0],)])
    assert manifest.read_shard(str(catalog.location), shard) == [jobs[0]]
    code = f"""
from upplied.flows.plan_shard import plan_shard
from upplied.flows.transfer_fleet import transfer_fleet
for _ in range(2):
    print(plan_shard("catalog", "night", "{shard}", return_state=True).message)
for name in ("night/00001.parquet", "../transfers/x.parquet"):
    print(plan_shard("catalog", "night", name, return_state=True).type.value)
asked = {{"presets": ["paper"], "changes": {changes}}}
print(transfer_fleet(reports="", resources={{"engine": "pool"}}, **asked, return_state=True).message)
"""
    done = python(server, place, code)
    told = done.stdout.splitlines()
    assert told[:4] == ["1 ok, 0 refused, 0 failed", "0 ok, 0 refused, 0 failed", "FAILED", "FAILED"], (
        done.stderr
    )
    assert "prefect worker start --pool planners" in told[4], "nobody takes shards, and it was not told"
    manifest.remove_shards(catalog, "night")
    assert not list((place / "catalog" / manifest.FOLDER).iterdir())
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
from upplied.flows.transfer_fleet import transfer_fleet
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


def test_failed_runs_say_so_and_name_what_failed(server, place):
    """A state of a type or a name of its own is what an alert can match."""
    (place / "broken").mkdir()
    (place / "broken" / "broken.mcap").write_bytes(b"not a log")
    (place / "mixed").mkdir()
    for name, source in {"broken": place / "broken" / "broken.mcap", "flight": place / "flight.mcap"}.items():
        (place / "mixed" / f"{name}.mcap").write_bytes(source.read_bytes())
    done = python(
        server,
        place,
        """
from upplied.flows.ingest_demonstrations import ingest_demonstrations
from upplied.flows.transfer_fleet import transfer_fleet
def say(state):
    print(state.type.value, state.name, "|", state.message)
say(ingest_demonstrations(["broken"], return_state=True))
say(ingest_demonstrations(["mixed"], return_state=True))
say(ingest_demonstrations(["nowhere"], return_state=True))
hasty = {"timeout_s": 0.001, "workers": 1}
asked = {"reports": "", "presets": ["paper"], "changes": {"viewpoints": {"shared": 0.6}}}
say(transfer_fleet(**asked, resources=hasty, return_state=True))
say(transfer_fleet(**asked, logs=["mixed"], retry_failed=True, return_state=True))
""",
    )
    told = [line.split(" | ") for line in done.stdout.splitlines()]
    assert [state for state, _ in told] == [
        "FAILED Failed",
        "COMPLETED CompletedWithFailures",
        "FAILED Failed",
        "FAILED Failed",
        "COMPLETED CompletedWithFailures",
    ], done.stdout + done.stderr
    for (_, message), words in zip(
        told,
        ("broken.mcap", "broken.mcap", "does not exist", "took longer than 0.001 s", "broken.mcap"),
        strict=True,
    ):
        assert words in message
    assert "2 ok" in told[4][1], "what could be planned was not"


def test_runs_keep_to_the_declared_roots(server, place, tmp_path):
    code = """
from upplied.flows.maintain_catalog import maintain_catalog
from upplied.flows.publish_reports import publish_reports
for call in CALLS:
    state = eval(call)
    print(state.type.value, state.message)
"""
    calls = [
        f"publish_reports('{tmp_path}/elsewhere', return_state=True)",
        f"publish_reports('reports', '{tmp_path}/catalog', return_state=True)",
        "publish_reports('s3://bucket/other', return_state=True)",
        "maintain_catalog('../../catalog', return_state=True)",
        "publish_reports('link', return_state=True)",
        "publish_reports('reports', return_state=True)",
    ]
    (place / "link").symlink_to(tmp_path)
    bounded = Server.__new__(Server)
    bounded.environment = server.environment | {ROOTS: f"{place},s3://bucket/fleet"}
    done = python(bounded, place, code.replace("CALLS", repr(calls)))
    told = done.stdout.splitlines()
    assert [line.split()[0] for line in told] == ["FAILED"] * 5 + ["COMPLETED"], done.stdout + done.stderr
    assert all("outside the roots" in line and "--root" in line for line in told[:5])
    assert not list(tmp_path.iterdir())


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
from upplied.flows.automations import apply, zombies
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
        module, name = deployment["entrypoint"].rsplit(".", 1)
        assert importlib.import_module(module).__dict__[name].name == deployment["name"]
        assert name == deployment["name"].replace("-", "_")
    nightly = declared[0]
    assert nightly["name"] == "transfer-fleet"
    assert nightly["concurrency_limit"]["collision_strategy"] == "CANCEL_NEW"


def test_from_a_clone_to_a_scheduled_worker(server, place):
    """The README's commands: pool, deployments, worker, a run on demand, and runs for the nights to come."""
    open_catalog(place / "catalog").add_demonstrations([fly(member("cube-v1").structure, "sides")])
    assert prefect(server, "work-pool", "create", "local", "--type", "process").returncode == 0
    prefect_api.ask(
        server.api_url, "work_pools/", {"name": "planners", "type": "process"}, server.password
    )  # as above, without a process
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
    parameters = [f'catalog="{place}/catalog"', 'reports=""', 'presets=["baseline"]']
    options = [word for parameter in parameters for word in ("--param", parameter)]
    with receiver() as (address, received):
        try:
            ran = prefect(server, "deployment", "run", "transfer-fleet/transfer-fleet", "--watch", *options)
            assert ran.returncode == 0, ran.stdout + ran.stderr
            # The short way says how it ended, and an alert reaches whoever is told, by either kind of block.
            for number, url in enumerate((f"http://{address}/hook", f"json://{address}/apprise")):
                assert "Failed, Crashed" in upplied(server, place, "fleet", "notify", url).stdout
                hasty = 'resources={"timeout_s": 0.001, "workers": 1}'
                shared = f'changes={{"viewpoints": {{"shared": 0.{number + 2}}}}}'
                failed = upplied(server, place, "fleet", "run", *parameters, hasty, shared)
                assert failed.returncode == 1
                assert "Failed: 0 ok, 0 refused, 2 failed" in failed.stdout, failed.stderr
                assert "took longer than 0.001 s" in failed.stdout
                told = received.get(timeout=60)
                assert "transfer-fleet: Failed" in told and "took longer than 0.001 s" in told
            assert "nobody" in upplied(server, place, "fleet", "notify", "").stdout
            again = upplied(server, place, "fleet", "run", *parameters, "retry_failed=true")
            assert again.returncode == 0, again.stdout + again.stderr
            assert "Completed: 0 ok" in again.stdout or "Completed: 2 ok" in again.stdout
            outside = upplied(server, place, "fleet", "run", 'catalog="/srv/elsewhere"')
            assert outside.returncode == 1 and "outside the roots" in outside.stdout
        finally:
            stop(worker)
        # A message may come twice: Prefect sends it again where the answer took long.
        while not received.empty():
            assert "took longer than 0.001 s" in received.get(), "somebody was told of a run that went well"
    plans = open_catalog(place / "catalog").transfers(preset="baseline")
    assert set(plans["target_id"]) == {"box-random-1", "box-random-2"}
    assert (plans["status"] == "ok").all()
    assert scheduled(server) >= 1

    for wrong in ('presets=["best"]', "presets=best", "nonsense", 'nonsense=""'):
        refused = upplied(server, place, "fleet", "run", wrong)
        assert refused.returncode == 1
        assert wrong.partition("=")[0] in refused.stderr.replace("\n", " ")
        assert "Traceback" not in refused.stderr


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


def test_a_port_that_is_taken_is_told_and_its_owner_not_taken_for_ours(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as somebody:
        port = somebody.getsockname()[1]
        with pytest.raises(ServerError, match=f"port {port} already"), private_server(tmp_path, port):
            pass


@pytest.mark.parametrize(
    ("folder", "code", "told"), [("nowhere", 2, "no folder"), (".", 1, "no Prefect server")]
)
def test_a_watcher_that_cannot_tell_anybody_says_so(folder, code, told, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PREFECT_API_URL", f"http://127.0.0.1:{free_port()}/api")
    assert main(["watch", folder]) == code
    assert told in capsys.readouterr().err


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


def test_the_short_way_says_at_once_that_no_server_answers(monkeypatch, capsys):
    """Prefect's own command would start a server that knows no deployment, and say that there is none."""
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setenv("UPPLIED_PORT", str(free_port()))
    assert main(["fleet", "run"]) == 1
    assert "upplied serve" in " ".join(capsys.readouterr().err.split())


def test_no_server_is_told_at_once_and_in_words(tmp_path):
    variables = environment(tmp_path, "") | {"PREFECT_SERVER_ALLOW_EPHEMERAL_MODE": "false"}
    del variables["PREFECT_API_URL"]
    code = "from upplied.flows.publish_reports import publish_reports; publish_reports()"
    done = subprocess.run(
        [sys.executable, "-c", code], env=variables, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert "PREFECT_API_URL" in done.stderr
    assert not os.listdir(tmp_path) or not (tmp_path / "reports").exists()


def test_a_flight_that_lands_is_judged_and_what_it_left_out_is_planned(server, place):
    done = python(
        server,
        place,
        """
from dataclasses import replace
from upplied.catalog import open_catalog
from upplied.outputs.logs import write_log
from upplied.flows.ingest_flights import ingest_flights
from upplied.flows.transfer_fleet import transfer_fleet
from upplied.samples.fleet import member, random_member
from upplied.samples.pilot import fly
cube = member("cube-v1").structure
flown = open_catalog("flown")  # what is planned here is none of the other tests' business
flown.add_structures([cube, random_member("box", 1).structure])
flown.add_demonstrations([fly(cube, "sides", seed=1)])
transfer_fleet("flown", presets=["recommended"], targets=["box-random-1"], reports="")
catalog = open_catalog("flown")
plan = catalog.transfers(preset="recommended", status="ok").iloc[0]
path = catalog.trajectory(plan["transfer_id"])
part = path.t_s <= 0.6 * path.t_s[-1]
demonstration = catalog.demonstration(plan["demonstration_id"])
flown = replace(
    demonstration, demonstration_id="came-back", structure_id=plan["target_id"],
    t_ns=demonstration.t_ns[0] + (path.t_s[part] * 1e9).astype("int64"),
    positions=path.positions[part], quat_xyzw=path.quat_xyzw[part],
)
write_log("came-back.mcap", flown, catalog.structure(plan["target_id"]), heavy_topic=False)
open("broken.mcap", "wb").write(b"nothing")
print(ingest_flights(["came-back.mcap", "broken.mcap"], "flown", "pages", return_state=True).name)
print(ingest_flights(["came-back.mcap"], "flown", "pages", return_state=True).name)
print(len(catalog.flights(kind="flown")))
every = catalog.transfers(every=True)
print(every["purpose"].str.startswith("gap ").sum())
""",
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["CompletedWithFailures", "Completed", "1", "1"]


def test_what_lands_while_a_run_plans_is_planned_by_it(server, tmp_path):
    """A run that is started meanwhile is cancelled, and nothing starts another before the next night."""
    catalog, cube = open_catalog(tmp_path / "catalog"), member("cube-v1").structure
    catalog.add_structures([cube, random_member("box", 1).structure])
    catalog.add_demonstrations([fly(cube, "sides")])
    code = """
import importlib
from dataclasses import replace
from upplied.catalog import open_catalog
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
night = importlib.import_module("upplied.flows.transfer_fleet")
landing, flight, plan = ["first", "second"], fly(member("cube-v1").structure, "sides"), night.plan
def while_planning(catalog, *given):
    made = plan(catalog, *given)
    for name in landing[:1]:
        landing.remove(name)
        open_catalog(catalog).add_demonstrations([replace(flight, demonstration_id=name, sha256="")])
    return made
night.plan = while_planning
print(night.transfer_fleet(presets=["baseline"], reports="", return_state=True).message)
"""
    done = python(server, tmp_path, code)
    assert done.stdout == "3 ok, 0 refused, 0 failed, 0 unchanged\n", done.stdout + done.stderr
    assert fleet.decide(catalog, fleet.PlanRequest(("baseline",))).jobs == []
    assert catalog.transfers(every=True)["run_id"].nunique() == 1
