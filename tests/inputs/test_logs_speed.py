"""The benchmark of the readers runs, and all of them find the same poses."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_all_readers_agree_and_ours_costs_no_more_than_twice_the_best() -> None:
    script = Path(__file__).parents[2] / "bench" / "logs.py"
    command = [sys.executable, str(script), "--megabytes", "60"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    cpu = {}
    for line in done.stdout.splitlines()[2:]:
        *title, seconds, _, _, _, _ = line.split()
        cpu[" ".join(title)] = float(seconds)
    assert cpu["ours: poses"] < 2 * min(cpu["mcap, mcap-ros2-support"], cpu["rosbags"])
