"""The benchmarks run: one short row of each."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

BENCH = Path(__file__).parents[2] / "bench"


def run(script: str, *arguments: str) -> str:
    process = subprocess.run(
        [sys.executable, str(BENCH / script), *arguments], capture_output=True, text=True, timeout=300
    )
    assert process.returncode == 0, process.stderr
    return process.stdout


@pytest.mark.slow
def test_the_tables_of_the_paper(tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    printed = run("paper_tables.py", "--only", "cuboid", "--csv", str(table), "--pictures", str(tmp_path))
    assert "cube sides > cuboid" in printed
    assert len(table.read_text().splitlines()) == 4
    assert len(list(tmp_path.glob("*.png"))) == 4


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [(), ("--add",)])
def test_the_stages_one_by_one(arguments: tuple[str, ...]) -> None:
    lines = run("ablation.py", "--only", "cuboid", *arguments).splitlines()
    assert len(lines) > 4
    # A path without limits on its speed is flown at 20 m/s, and refused: that stage cannot be left out.
    flown = {line[:24].strip(): int(line[24:28]) for line in lines[1:]}
    assert flown == {name: int(name != "without retime") for name in flown}


@pytest.mark.slow
def test_what_a_flight_was_about() -> None:
    printed = run("attention.py", "--only", "cube")
    row = next(line for line in printed.splitlines() if line.startswith("cube-v1 sides"))
    assert float(row.split()[3]) > 90  # of the weight lies on the sides


@pytest.mark.slow
def test_planned_against_flown() -> None:
    assert "cube sides > cuboid" in run("flown.py", "--only", "cuboid", "--flights", "1")


@pytest.mark.slow
def test_all_readers_of_logs_find_the_same_poses() -> None:
    assert "times what the best of the others does" in run("logs.py", "--megabytes", "20", "--repeats", "1")


def test_the_fifteen_rows_are_those_of_the_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCH))
    from transfers import PUBLISHED

    assert len(PUBLISHED) == 15
    assert len({(row.source, row.target, row.inspection) for row in PUBLISHED}) == 15
    assert all(50 < row.baseline_pct <= row.coverage_pct <= 100 for row in PUBLISHED)


@pytest.mark.slow
def test_what_a_fleet_costs_besides_planning() -> None:
    heads, line = run("scale.py", "--targets", "20", "--flow", "0").splitlines()
    assert "overhead" in heads
    assert line.split()[0] == "20"
    assert 0 < float(line.split()[6]) < 2  # GiB of a worker


@pytest.mark.slow
def test_what_a_large_fleet_needs_on_several_machines() -> None:
    heads, *lines = run(
        "large.py", "--settled", "--planned", "12", "--demonstrations", "2", "--pages", "2"
    ).splitlines()
    assert "GiB, children" in heads
    steps = {line[26:38].strip(): line[38:].split() for line in lines}
    assert set(steps) == {"stage", "hand_out", "machine 1", "machine 2", "machine 3", "count", "published"}
    assert all(0 < float(step[1]) < 2 for step in steps.values()), lines
    assert steps["count"][3:9] == ["24", "plans,", "0", "twice,", "0", "left;"], lines


@pytest.mark.slow
def test_what_writing_and_publishing_cost() -> None:
    commits, title, *lines = run("writing.py", "--plans", "400", "--writers", "2").splitlines()
    assert commits.startswith("4 commits of 100 plans by 2 processes") and title == "the catalog"
    figures = {line[:32].strip(): float(line[32:]) for line in lines[:7]}
    assert 0 < figures["live, MB"] <= figures["written, MB"]
    assert [line.split()[1] for line in lines[7:]] == ["all", "nothing", "one"]


@pytest.mark.slow
def test_what_questions_to_a_catalog_cost() -> None:
    printed = run("catalog.py", "--plans", "4000")
    assert "one trajectory: " in printed and "commit 3 of 256 plans" in printed


@pytest.mark.slow
def test_what_visibility_costs_beside_the_rays_alone() -> None:
    *_, last = run("visibility.py", "--poses", "20", "--samples", "300").splitlines()
    assert last.split()[0] == "all" and int(last.split()[1]) > 0


@pytest.mark.slow
def test_what_the_history_of_a_patch_costs() -> None:
    printed = run("history.py", "--structures", "20", "--flights", "3", "--patches", "50")
    assert printed.count(" of 3 saw it") == 3


@pytest.mark.ci
def test_every_benchmark_can_be_loaded() -> None:
    """With all it imports, which moves."""
    load = f"import sys; sys.path.insert(0, {str(BENCH)!r}); "
    load += "from upplied.geometry.scene import open3d; open3d(); "
    names = sorted(path.stem for path in BENCH.glob("*.py"))
    process = subprocess.run(
        [sys.executable, "-c", f"{load}import {', '.join(names)}"], capture_output=True, text=True
    )
    assert len(names) > 30 and process.returncode == 0, process.stderr
