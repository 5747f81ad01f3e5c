"""The LeRobot export is loaded by `lerobot` itself, in an environment of its own: `make lerobot`."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from catalog_records import demonstration, key_of, plan, structure

from upplied.catalog import export_lerobot, open_catalog

ROOT = Path(__file__).parents[2]
PYTHON = Path(os.environ.get("LEROBOT_PYTHON", ROOT / ".venv-lerobot" / "bin" / "python"))


@pytest.mark.skipif(not PYTHON.exists(), reason="lerobot is not installed: make lerobot (5 GB)")
def test_lerobot_itself_loads_what_was_exported(tmp_path: Path) -> None:
    catalog = open_catalog(tmp_path / "from")
    catalog.add_structures([structure("boxy"), *(structure(f"t{at}", at) for at in range(3))])
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans([(key_of(at), plan(f"t{at}", at), {"run_id": "r"}) for at in range(3)])
    counts = export_lerobot(catalog, tmp_path / "set", catalog.transfers(), fps=20)
    command = [str(PYTHON), str(Path(__file__).parent / "read_by_lerobot.py"), str(tmp_path / "set")]
    home = {"HF_HOME": str(tmp_path / "home"), "HF_LEROBOT_HOME": str(tmp_path / "home")}
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=600, env=os.environ | home, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads(done.stdout.splitlines()[-1])
    assert (found["episodes"], found["frames"]) == (counts["episodes"], counts["frames"])
    assert found["fps"] == 20
    frames = pd.concat(
        [pd.read_parquet(path) for path in sorted((tmp_path / "set" / "data").rglob("*.parquet"))]
    )
    assert np.allclose(found["states"], np.stack(frames["observation.state"].to_list()))
    assert np.allclose(found["actions"], np.stack(frames["action"].to_list()))
    assert found["episode_of"] == frames["episode_index"].tolist()
    assert np.allclose(found["seconds"], frames["timestamp"])
    assert len(found["tasks"]) >= 1 and all(found["tasks"])
