"""What docs/operating.md hands out works: the units, and the compose file's commands on a real database."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import prefect_api
import pytest
import supervisor
import yaml
from cases import slow_after
from ports import free_port
from random_members import random_member

from upplied.catalog import open_catalog
from upplied.cli import app
from upplied.flows import serve
from upplied.flows.server import start, stop
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

ROOT = Path(__file__).parents[2]

PAGE = (ROOT / "docs" / "operating.md").read_text(encoding="utf-8")
UNITS = {f"{name}.service": unit for name, unit in supervisor.units().items()}
PASSWORD = "made-for-this-test"
COMPOSE = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def test_systemd_finds_nothing_wrong_with_the_units(tmp_path):
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    assert len(UNITS) == 5
    for name, unit in UNITS.items():
        here = unit.replace("/srv/upplied/.venv/bin/", f"{Path(sys.executable).parent}/")
        (tmp_path / name).write_text(here.replace("User=upplied\n", ""))
    process = subprocess.run(
        ["systemd-analyze", "verify", *sorted(map(str, tmp_path.iterdir()))],
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr
    assert not [line for line in process.stderr.splitlines() if "upplied" in line]


def test_the_units_run_what_is_there():
    """Those of `upplied` are run by the drills as they stand; here is that their words are understood."""
    for name, unit in UNITS.items():
        _, _, program, *words = supervisor.words(unit)
        if program == "upplied":
            _, bound, _ = app.parse_args(words, exit_on_error=False, print_error=False)
            assert bound.arguments, name
        else:  # the very words that test_machines.py starts its machines with
            assert program == "prefect"
            assert words[:6] == ["worker", "start", "--pool", "planners", "--limit", "1"]


def test_the_compose_file_runs_the_parts_with_one_password():
    services = COMPOSE["services"]
    parts = {name: service["command"] for name, service in services.items() if name != "database"}
    assert parts == {name: f"serve --only {name}" for name in ("server", "worker", "reports")}
    for name, service in services.items():
        for port in service.get("ports", ()):
            assert port.startswith("127.0.0.1:"), f"{name} is given out to everybody"
    server, worker = services["server"]["environment"], services["worker"]["environment"]
    assert server["PREFECT_SERVER_API_AUTH_STRING"] == "upplied:${UPPLIED_PASSWORD}"
    assert worker["PREFECT_API_AUTH_STRING"].startswith("upplied:${UPPLIED_PASSWORD:?")
    assert set(serve.OF_SERVER) <= server.keys() and set(serve.OF_CLIENT) <= worker.keys()
    assert server["UPPLIED_HOSTS"] in worker["PREFECT_API_URL"]


@pytest.mark.ci
def test_the_images_steps_make_a_program_that_serves(tmp_path):
    """Each file that is copied is there, and its last step installs all of it."""
    for sources in re.findall(r"^COPY (.+) \S+$", DOCKERFILE, re.MULTILINE):
        for source in sources.split():
            assert (ROOT / source).exists(), source
            place = tmp_path / "build" / source
            place.parent.mkdir(parents=True, exist_ok=True)
            copy = shutil.copytree if (ROOT / source).is_dir() else shutil.copy
            copy(ROOT / source, place)
    lines = DOCKERFILE.replace("\\\n", " ")
    steps = [line.removeprefix("RUN ") for line in lines.splitlines() if line.startswith("RUN python -m pip")]
    locked, ours = (step.split("&&")[0].split() for step in steps)
    assert "--require-hashes" in locked and locked[-1] == "requirements-runtime.lock"
    there = tmp_path / "installed"
    process = subprocess.run(
        [sys.executable, *ours[1:], "--target", there, "--quiet"],
        cwd=tmp_path / "build",
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stdout + process.stderr
    assert {path.name for path in there.iterdir() if path.is_dir() and "dist-info" not in path.name} <= {
        "upplied",
        "bin",
    }, "something of a common name lands in site-packages"
    assert (there / "upplied" / "flows" / "prefect.yaml").read_bytes() == (ROOT / "prefect.yaml").read_bytes()
    code = "import upplied.flows.serve as s; print(s.__file__, s.env.carried('prefect.yaml'))"
    output = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": str(there), "UPPLIED_HOME": ""},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert output.stdout.count(str(there)) == 2, "the clone was imported"
    entry = re.search(r"^ENTRYPOINT (.+)$", DOCKERFILE, re.MULTILINE)[1]
    assert json.loads(entry) == ["upplied"] and (there / "bin" / "upplied").is_file()


@pytest.fixture
def database(tmp_path) -> Iterator[str]:
    """PostgreSQL as the compose file describes it, by the programs of this machine; its host and port."""
    programs = {name: shutil.which(name) for name in ("initdb", "postgres", "psql")}
    if None in programs.values():
        pytest.skip("PostgreSQL is not installed")
    variables = {
        name: text.split(":?")[0] for name, text in COMPOSE["services"]["database"]["environment"].items()
    }
    variables["POSTGRES_PASSWORD"] = PASSWORD
    base, port, somebody = Path(tempfile.mkdtemp(prefix="upplied-")), free_port(), {}
    folder, password = base / "data", base / "password"
    password.write_text(variables["POSTGRES_PASSWORD"])
    if os.geteuid() == 0:  # as which PostgreSQL refuses to run; nobody may not enter the test's own folder
        somebody = {"user": "nobody", "cwd": "/"}
        for path in (base, password):
            shutil.chown(path, "nobody")
    login = ["-U", variables["POSTGRES_USER"], "-A", "scram-sha-256", f"--pwfile={password}"]
    subprocess.run([programs["initdb"], "-D", folder, *login], check=True, capture_output=True, **somebody)
    options = ["-c", "listen_addresses=127.0.0.1", "-c", f"unix_socket_directories={base}"]
    with (tmp_path / "database.log").open("wb") as log:
        running = subprocess.Popen(
            [programs["postgres"], "-D", folder, "-p", str(port), *options],
            stdout=log,
            stderr=log,
            start_new_session=True,
            **somebody,
        )
    try:
        address = (
            f"postgresql://{variables['POSTGRES_USER']}:{variables['POSTGRES_PASSWORD']}@127.0.0.1:{port}"
        )
        make = [programs["psql"], f"{address}/postgres", "-c", f"create database {variables['POSTGRES_DB']}"]
        for _ in range(120):
            if subprocess.run(make, capture_output=True, check=False).returncode == 0:
                break
            time.sleep(0.5)
        else:
            pytest.fail((tmp_path / "database.log").read_text())
        yield f"127.0.0.1:{port}"
    finally:
        running.send_signal(signal.SIGINT)
        running.wait(60)
        shutil.rmtree(base)


@pytest.mark.server
@pytest.mark.slow
@pytest.mark.parametrize("fleet", slow_after(1, [False, True]), ids=["server", "fleet"])
def test_the_compose_files_services_work_on_postgresql(tmp_path, database, fleet):
    """Server and worker as the file says, with the addresses of this machine in place of its own names."""
    port, place = free_port(), tmp_path / "fleet"
    place.mkdir()
    variables = {
        name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "UPPLIED_"))
    }
    variables |= {"UPPLIED_HOME": str(place), "UPPLIED_PORT": str(port)}

    def environment_of(service: str) -> dict[str, str]:
        values = COMPOSE["services"][service]["environment"]
        text = (
            json.dumps(values)
            .replace("database:5432", database)
            .replace("http://server:4200", f"http://127.0.0.1:{port}")
        )
        return (
            variables
            | json.loads(re.sub(r"\$\{UPPLIED_PASSWORD.*?\}", PASSWORD, text))
            | {"UPPLIED_BIND": "127.0.0.1"}
        )

    catalog = open_catalog(place / "catalog")
    cube = member("cube-v1").structure
    catalog.add_structures([cube, random_member("box", 1).structure])
    catalog.add_demonstrations([fly(cube, "sides")])
    running = []
    try:
        for name in ("server", "worker") if fleet else ("server",):
            command = COMPOSE["services"][name]["command"].split()
            with (tmp_path / f"{name}.log").open("wb") as log:
                running.append(start("upplied", *command, environment=environment_of(name), log=log))
            if name == "server":
                wait_for(f"http://127.0.0.1:{port}/api/health", tmp_path / "server.log")
        if fleet:
            run_once(environment_of("worker") | {"PREFECT_HOME": str(tmp_path / "client")}, tmp_path)
        api_url = f"http://127.0.0.1:{port}/api"
        listed = prefect_api.ask(api_url, "automations/filter", {}, f"upplied:{PASSWORD}")
        assert ("a silent run is marked crashed" in {item["name"] for item in listed}) == fleet
        status, _, _ = prefect_api.send("POST", f"{api_url}/automations/filter", {})
        assert status in (401, 403)
    finally:
        for process in reversed(running):
            stop(process)
    assert not list(place.rglob("*.db")), "the server used a file instead of PostgreSQL"


def run_once(client: dict[str, str], place: Path) -> None:
    """A run that the worker plans, once it has come up."""
    deadline = time.monotonic() + 240
    while b"started!" not in (place / "worker.log").read_bytes():
        assert time.monotonic() < deadline, (place / "worker.log").read_text()
        time.sleep(1)
    process = subprocess.run(
        [sys.executable, "-m", "upplied", "fleet", "run", 'presets=["baseline"]', 'reports=""'],
        env=client, cwd=place, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert "Completed: 1 ok, 0 refused, 0 failed, 0 unchanged" in process.stdout, (
        process.stdout + process.stderr
    )
    assert process.returncode == 0


def wait_for(url: str, log: Path, patience_s: float = 240) -> None:
    deadline = time.monotonic() + patience_s
    while True:
        try:
            with urllib.request.urlopen(url, timeout=5):
                return
        except OSError:
            if time.monotonic() > deadline:
                pytest.fail(log.read_text())
            time.sleep(0.5)
