"""The wheel in an empty folder, as a newcomer has it: nothing of the clone is on a path."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest
from random_members import random_member

from upplied.catalog import open_catalog
from upplied.flows.server import end_with_parent
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

pytestmark = [pytest.mark.slow, pytest.mark.server]

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """The built wheel, unpacked; its dependencies are those of this environment."""
    place = tmp_path_factory.mktemp("wheel")
    command = ["pip", "wheel", str(ROOT), "--no-deps", "--no-build-isolation", "--quiet", "-w", str(place)]
    process = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stdout + process.stderr
    (wheel,) = place.glob("*.whl")
    with zipfile.ZipFile(wheel) as packed:
        names = packed.namelist()
        packed.extractall(place / "site")
    assert {name.split("/")[0] for name in names if "dist-info" not in name} == {"upplied"}
    assert {"prefect.yaml", "requirements-runtime.lock"} <= {Path(name).name for name in names}
    return place / "site"


def upplied(
    installed: Path, folder: Path, *words: str, timeout: float = 1500
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "upplied", *words],
        env=environment_of(installed),
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout,
    )


def environment_of(installed: Path) -> dict[str, str]:
    variables = {
        name: value for name, value in os.environ.items() if not name.startswith(("PREFECT", "UPPLIED"))
    }
    return variables | {"PYTHONPATH": str(installed)}


def test_a_fleet_is_served_from_an_empty_folder(installed, tmp_path):
    assert "0.2" in upplied(installed, tmp_path, "--version").stdout
    log = tmp_path.with_name("serve.log")
    with log.open("wb") as file:
        service = subprocess.Popen(
            [sys.executable, "-m", "upplied", "serve", "--port", "0"],
            env=environment_of(installed),
            cwd=tmp_path,
            stdout=file,
            stderr=file,
            preexec_fn=end_with_parent,
        )
    try:
        while b"Run now" not in log.read_bytes():  # a service that waited in vain ends by itself
            assert service.poll() is None, log.read_text()
            time.sleep(0.5)
        catalog = open_catalog(tmp_path / "catalog")
        cube = member("cube-v1").structure
        catalog.add_structures([cube, random_member("box", 1).structure])
        catalog.add_demonstrations([fly(cube, "sides")])
        ran = upplied(installed, tmp_path, "fleet", "run", 'presets=["baseline"]')
        assert "Completed: 1 ok, 0 refused, 0 failed, 0 unchanged" in ran.stdout, ran.stderr + log.read_text()
        assert ran.returncode == 0
        assert (tmp_path / "reports" / "index.html").is_file()
        assert upplied(installed, tmp_path, "deploy").returncode == 0
        again = upplied(installed, tmp_path, "serve", "--port", "0")
        assert (again.returncode, "Another service" in again.stdout) == (1, True), again.stdout + again.stderr
        service.send_signal(signal.SIGTERM)
        assert service.wait(60) == 0
    finally:
        service.kill()
        service.wait()
    assert {path.name for path in tmp_path.iterdir()} == {".cache", "catalog", "reports"}


def test_the_quickstart_runs_in_an_empty_folder(installed, tmp_path):
    process = upplied(installed, tmp_path, "quickstart")
    assert process.returncode == 0, process.stdout + process.stderr
    assert (tmp_path / "reports" / "transfers.parquet").is_dir()
