"""What the fuzzer once found, replayed: every case is a record or a refusal now."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "faults"))
from fuzz_logs import replay
from made_seeds import seed_inputs

from upplied.inputs.logs import LogOptions, read_demonstration

FINDINGS = sorted((Path(__file__).parents[1] / "data" / "findings").iterdir())


@pytest.fixture(scope="module")
def seeds(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The sound inputs from which the fuzzer starts."""
    return seed_inputs(tmp_path_factory.mktemp("seeds"))


@pytest.mark.parametrize("finding", FINDINGS, ids=lambda path: path.name)
def test_a_finding_stays_fixed(tmp_path: Path, seeds: dict[str, bytes], finding: Path) -> None:
    (tmp_path / "sound.mcap").write_bytes(seeds["PoseStamped"][1:])
    refusal = replay(finding.read_bytes(), tmp_path)
    assert not refusal or str(tmp_path) in refusal  # a record, or an error that names its file


def test_the_seeds_are_sound(tmp_path: Path, seeds: dict[str, bytes]) -> None:
    """A fuzzer that starts from refused inputs would find nothing: each log of its seeds is read."""
    for name, data in seeds.items():
        if data[:1] == b"L":
            path = tmp_path / f"{name}.mcap"
            path.write_bytes(data[1:])
            assert len(read_demonstration(path, LogOptions(min_duration_s=0.0))) >= 4, name


@pytest.mark.slow
def test_the_fuzzer_runs_and_finds_nothing_in_a_short_time(tmp_path: Path) -> None:
    pytest.importorskip("atheris")
    script = Path(__file__).parents[1] / "faults" / "fuzz_logs.py"
    command = [sys.executable, str(script), "--seconds", "15", "--findings", str(tmp_path / "found")]
    process = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert process.returncode == 0, process.stderr[-2000:]
    assert not list((tmp_path / "found").iterdir())
