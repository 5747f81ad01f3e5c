"""What docs/operating.md hands out works: the units, and the compose file's commands on a real database."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

from flows.environment import ROOT, SETTINGS
from flows.server import free_port, start, stop
from upplied.catalog import open_catalog
from upplied.samples.fleet import member, random_member
from upplied.samples.pilot import fly

PAGE = (ROOT / "docs" / "operating.md").read_text(encoding="utf-8")
UNITS = {
    re.search(r"system/(\S+\.service)", block)[1]: block
    for block in re.findall(r"```ini\n(.*?)```", PAGE, re.DOTALL)
}
COMPOSE = yaml.safe_load(re.search(r"```yaml\n# compose.yaml\n(.*?)```", PAGE, re.DOTALL)[1])


def test_systemd_finds_nothing_wrong_with_the_units(tmp_path):
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    assert len(UNITS) == 3
    for name, unit in UNITS.items():
        here = unit.replace("/srv/upplied/.venv/bin/", f"{Path(sys.executable).parent}/")
        (tmp_path / name).write_text(here.replace("User=upplied\n", ""))
    done = subprocess.run(
        ["systemd-analyze", "verify", *sorted(map(str, tmp_path.iterdir()))],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not [line for line in done.stderr.splitlines() if "upplied" in line]


def test_the_units_run_what_is_there():
    for unit in UNITS.values():
        program, *words = re.search(r"^ExecStart=(.*)$", unit, re.MULTILINE)[1].split()
        if words[0] == "-m":
            assert importlib.util.find_spec(words[1]) is not None
        else:  # the very words that tests/flows/test_machines.py starts its machines with
            assert Path(program).name == "prefect"
            assert words[:6] == ["worker", "start", "--pool", "planners", "--limit", "1"]


def test_the_compose_file_says_what_the_flows_are_given():
    given = COMPOSE["services"]["server"]["environment"]
    shared = SETTINGS.keys() & given.keys()
    assert {name: given[name] for name in shared} == {name: SETTINGS[name] for name in shared}
    assert {name for name in SETTINGS if name.startswith("PREFECT_SERVER")} - shared == {
        "PREFECT_SERVER_ALLOW_EPHEMERAL_MODE"  # of clients
    }


def test_the_compose_files_server_has_the_versions_that_are_known_to_work():
    dockerfile = COMPOSE["services"]["server"]["build"]["dockerfile_inline"]
    given = {asked.name: asked.specifier for asked in map(Requirement, re.findall(r'"(.+?)"', dockerfile))}
    ours = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    wanted = {asked.name: asked.specifier for asked in map(Requirement, ours)}
    locked = re.search(r"^prefect==(\S+)", (ROOT / "requirements.lock").read_text(), re.MULTILINE)[1]
    assert given["prefect"] == f"=={locked}", "clients and server should be of one version"
    assert {name: given[name] for name in ("fastapi", "sqlalchemy")} == {
        name: wanted[name] for name in ("fastapi", "sqlalchemy")
    }


@pytest.fixture
def database(tmp_path) -> Iterator[str]:
    """PostgreSQL as the compose file describes it, by the programs of this machine; its host and port."""
    programs = {name: shutil.which(name) for name in ("initdb", "postgres", "psql")}
    if None in programs.values():
        pytest.skip("PostgreSQL is not installed")
    said = COMPOSE["services"]["database"]["environment"]
    base, port, somebody = Path(tempfile.mkdtemp(prefix="upplied-")), free_port(), {}
    folder, password = base / "data", base / "password"
    password.write_text(said["POSTGRES_PASSWORD"])
    if os.geteuid() == 0:  # as which PostgreSQL refuses to run; nobody may not enter the test's own folder
        somebody = {"user": "nobody", "cwd": "/"}
        for path in (base, password):
            shutil.chown(path, "nobody")
    login = ["-U", said["POSTGRES_USER"], "-A", "scram-sha-256", f"--pwfile={password}"]
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
        address = f"postgresql://{said['POSTGRES_USER']}:{said['POSTGRES_PASSWORD']}@127.0.0.1:{port}"
        make = [programs["psql"], f"{address}/postgres", "-c", f"create database {said['POSTGRES_DB']}"]
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


@pytest.mark.slow
@pytest.mark.server
def test_the_compose_files_server_runs_a_fleet_on_postgresql(tmp_path, database):
    port = free_port()
    api_url = f"http://127.0.0.1:{port}/api"
    served = COMPOSE["services"]["server"]
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    url = served["environment"]["PREFECT_API_DATABASE_CONNECTION_URL"].replace("database:5432", database)
    changed = {"PREFECT_HOME": str(tmp_path / "home"), "PREFECT_API_DATABASE_CONNECTION_URL": url}
    command = served["command"].replace("0.0.0.0", "127.0.0.1").split()[1:]
    client = kept | SETTINGS | {"PREFECT_API_URL": api_url, "PREFECT_HOME": str(tmp_path / "client")}
    client |= {"UPPLIED_HOME": str(ROOT), "PYTHONPATH": str(ROOT), "PREFECT_LOGGING_LEVEL": "WARNING"}
    with (tmp_path / "server.log").open("wb") as log:
        server = start(
            *command, "--port", str(port), environment=kept | served["environment"] | changed, log=log
        )
    try:
        wait_for(f"{api_url}/health", tmp_path / "server.log")
        for line in commands_after_compose():
            done = subprocess.run(line, env=client, cwd=ROOT, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stdout + done.stderr
        catalog = open_catalog(tmp_path / "catalog")
        cube = member("cube-v1").structure
        catalog.add_structures([cube, random_member("box", 1).structure])
        catalog.add_demonstrations([fly(cube, "sides")])
        code = f"""
from flows.transfer_fleet import transfer_fleet
print(transfer_fleet("{tmp_path}/catalog", "", presets=["baseline"], return_state=True).message)
"""
        done = subprocess.run(
            [sys.executable, "-c", code], env=client, cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert "1 ok, 0 refused, 0 failed, 0 unchanged" in done.stdout, done.stderr
        request = urllib.request.Request(
            f"{api_url}/automations/filter", b"{}", {"Content-Type": "application/json"}
        )
        with urllib.request.urlopen(request, timeout=60) as answer:
            assert "a silent run is marked crashed" in {item["name"] for item in json.load(answer)}
    finally:
        stop(server)
    assert not list((tmp_path / "home").glob("*.db*")), "the server used a file instead of PostgreSQL"


def commands_after_compose() -> list[list[str]]:
    """What the page says to run once, with the Python of this test."""
    block = next(b for b in re.findall(r"```bash\n(.*?)```", PAGE, re.DOTALL) if "deploy --all" in b)
    lines = [line.split() for line in block.splitlines() if line.startswith(("prefect", "python"))]
    assert len(lines) == 4
    return [
        [sys.executable, "-m", *line] if line[0] == "prefect" else [sys.executable, *line[1:]]
        for line in lines
    ]


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
