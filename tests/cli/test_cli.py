"""The command as people meet it: exit codes, JSON, one-line errors, and help that loads little."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
from random_members import random_member

import upplied
from upplied.catalog import open_catalog
from upplied.cli import main, terminal
from upplied.cli.transfer import COLUMNS, show_plans
from upplied.samples.fleet import member
from upplied.samples.pilot import fly


@pytest.fixture(scope="module")
def location(tmp_path_factory) -> str:
    """A catalog with a demonstration and one target."""
    catalog = open_catalog(tmp_path_factory.mktemp("cli") / "catalog")
    cube = member("cube-v1").structure
    catalog.add_structures([cube, random_member("box", 1).structure])
    catalog.add_demonstrations([fly(cube, "sides")])
    return str(catalog.location)


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own, its output piped."""
    command = [sys.executable, "-c", "import sys; from upplied.cli import main; sys.exit(main())", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | environment, check=False)


@pytest.mark.parametrize("arguments", [("--help",), ("transfer", "--help"), ("--version",)])
def test_help_loads_nothing_that_help_does_not_need(arguments):
    heavy = {
        "open3d",
        "prefect",
        "numba",
        "numpy",
        "scipy",
        "pandas",
        "pyarrow",
        "deltalake",
        "mcap",
        "trimesh",
    }
    code = "import sys; from upplied.cli import main; main(sys.argv[1:]); print('loaded', *sys.modules)"
    process = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True
    )
    loaded = set(process.stdout.rpartition("loaded ")[2].split())
    assert "cyclopts" in loaded and not heavy & loaded


def test_version():
    assert run("--version").stdout.strip() == upplied.__version__


@pytest.mark.parametrize(
    "arguments",
    [
        ("nonsense",),
        ("transfer",),
        ("transfer", "x", "--workers", "many"),
        ("structures", "add"),
        ("structures", "add", "no-such-manifest.toml"),
        ("demonstrations", "add", "no-such-folder"),
        ("transfer", "no-such-demonstration"),
        ("plan", "--dry-run", "--preset", "best"),
        ("plan", "--dry-run", "--set", "route.clearance=3"),
        ("plan", "--dry-run", "--set", "three"),
        ("findings", "list", "--state", "odd"),
    ],
)
def test_wrong_use_is_one_line_and_code_2(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("UPPLIED_CATALOG", str(tmp_path / "catalog"))
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("error: ")
    assert len(printed.err.strip().splitlines()) == 1


@pytest.mark.ci
def test_transfer_then_nothing_left_to_plan(location, capsys):
    arguments = (
        "--catalog",
        location,
        "transfer",
        "cube-sides-v1",
        "--to",
        "box-random-1",
        "--preset",
        "paper",
    )
    assert main([*arguments, "--json", "--workers", "1"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["target_id"], row["preset"], row["status"]) == ("box-random-1", "paper", "ok")
    assert row["frechet_z"] >= 0
    assert main(["plan", "--dry-run", "--preset", "paper", "--catalog", location, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == []
    assert main(["plan", "--dry-run", "--preset", "baseline", "--catalog", location]) == 0
    assert "1  new pair" in capsys.readouterr().out


def test_a_refused_target_is_code_1_and_says_why(location, capsys):
    gate = ("--set", "registration.gamma=1e-9")
    code = main(
        ["transfer", "cube-sides-v1", "--preset", "paper", *gate, "--catalog", location, "--workers", "1"]
    )
    assert code == 1
    assert "refused: box-random-1 (paper): " in capsys.readouterr().out


def test_lists(location, capsys):
    assert main(["structures", "list", "--json", "--catalog", location]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert ("cube-v1", "box") in [(row["structure_id"], row["kind"]) for row in listed]
    assert main(["demonstrations", "list", "--json", "--catalog", location]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [(row["demonstration_id"], row["structure_id"]) for row in listed] == [
        ("cube-sides-v1", "cube-v1")
    ]
    assert listed[0]["verdict"] == "" and listed[0]["flown_clearance_m"] is None  # it came without a log
    assert main(["catalog", "info", "--json", "--catalog", location]) == 0
    assert {"what": "structures", "count": 2} in json.loads(capsys.readouterr().out)


def test_a_bad_mesh_is_code_1(tmp_path: Path, capsys):
    (tmp_path / "bad.stl").write_bytes(b"")
    entry = (
        '[[structure]]\nid = "bad"\nkind = "box"\npath = "bad.stl"\nunits = "m"\nup = "z"\nforward = "x"\n'
    )
    (tmp_path / "structures.toml").write_text(entry)
    manifest, catalog = str(tmp_path / "structures.toml"), str(tmp_path / "catalog")
    assert main(["structures", "add", manifest, "--catalog", catalog, "--workers", "1"]) == 1
    printed = capsys.readouterr()
    assert "bad.stl" in printed.err
    assert "Traceback" not in printed.err
    assert main(["structures", "check", manifest, "--workers", "1"]) == 1


def test_doctor_says_what_is_missing_and_how_to_get_it(location, monkeypatch, capsys):
    def missing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("upplied.cli.quickstart.version", missing)
    monkeypatch.setattr("platform.libc_ver", lambda: ("glibc", "2.31"))
    assert main(["doctor", "--json", "--catalog", location]) == 1
    checks = {row["check"]: row for row in json.loads(capsys.readouterr().out)}
    assert (
        checks["packages"]["details"]
        == "sqlalchemy is not installed: install from requirements-runtime.lock, as make quickstart does"
    )
    assert checks["system"]["result"] == "bad" and "Debian 12" in checks["system"]["details"]


def test_doctor_finds_this_machine_fit(location, capsys):
    assert main(["doctor", "--json", "--catalog", location]) == 0
    assert {row["result"] for row in json.loads(capsys.readouterr().out)} == {"good"}


def test_piped_output_has_no_colours(location):
    process = run("structures", "list", "--catalog", location, FORCE_COLOR="")
    assert process.returncode == 0
    assert "\x1b" not in process.stdout + process.stderr


def test_a_fault_is_told_without_a_traceback(location, monkeypatch, capsys):
    monkeypatch.setattr("upplied.catalog.open_catalog", lambda _: 1 / 0)
    assert main(["structures", "list", "--catalog", location]) == 3
    assert "Traceback" not in capsys.readouterr().err


def test_success_says_what_to_do_next_to_a_terminal_alone(location, monkeypatch, capsys):
    arguments = ["plan", "--dry-run", "--preset", "baseline", "--catalog", location]
    assert main(arguments) == 0
    assert "Next:" not in capsys.readouterr().out
    monkeypatch.setattr(terminal.console, "_force_terminal", True)
    assert main(arguments) == 0
    last_line = capsys.readouterr().out.splitlines()[-1]
    assert f"Next: upplied plan --catalog {location}" in last_line
    monkeypatch.setenv("UPPLIED_CATALOG", location)
    assert main(arguments) == 0
    assert "Next: upplied plan  (" in capsys.readouterr().out.splitlines()[-1]
    for silent in ("--json", "--quiet"):
        assert main([*arguments, silent]) == 0
        assert "Next:" not in capsys.readouterr().out


@pytest.mark.parametrize(("width", "left_out"), [(200, ""), (80, "paper %, Frechet"), (40, "seen %")])
def test_tables_fit_and_say_what_they_left_out(width, left_out, monkeypatch, capsys):
    monkeypatch.setattr(terminal.console, "_force_terminal", True)
    monkeypatch.setattr(terminal.console, "_width", width)
    row = {"transfer": "0123456789abcdef0123", "target": "turbine-3-v1", "preset": "recommended"}
    row |= {"seen %": 100.0, "paper %": 99.5, "Frechet": float("nan"), "clear m": 4.0, "time s": 1234.5}
    terminal.PRINTED.show("plans", [row], spare=("paper %", "Frechet", "time s", "clear m", "seen %"))
    lines = capsys.readouterr().out.splitlines()
    assert max(len(re.sub("\x1b[^m]*m", "", line)) for line in lines[:-1]) <= width
    assert "nan" not in "".join(lines) and ("99.50" in "".join(lines)) == (width == 200)
    assert left_out in lines[-1] and ("hidden columns" in lines[-1]) == bool(left_out)


def test_a_command_that_is_stopped_says_so(tmp_path, monkeypatch, capsys):
    def stopped(location: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("upplied.catalog.open_catalog", stopped)
    assert main(["catalog", "transfers", "--catalog", str(tmp_path)]) == 130
    assert "Stopped. Finished work is stored." in capsys.readouterr().err


def test_the_warnings_of_a_plan_are_shown_under_it(capsys: pytest.CaptureFixture[str]) -> None:
    known = dict.fromkeys(COLUMNS, None) | {"transfer_id": "one", "preset": "recommended", "status": "ok"}
    known |= {"reason": None, "not_flyable": None, "flyable": True}
    plain = known | {"target_id": "plain-v1", "warnings": "[]"}
    scan = known | {"target_id": "scan-v1", "warnings": '["the scan ends on wing_left", "28 % is missing"]'}
    show_plans("wings-v1", [plain, scan], terminal.PRINTED)
    printed = " ".join("".join(capsys.readouterr()).split())
    assert "check: scan-v1 (recommended): the scan ends on wing_left; 28 % is missing" in printed
    assert "check: plain-v1" not in printed
