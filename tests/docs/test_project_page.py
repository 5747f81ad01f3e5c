"""The how-to page of photogrammetry projects: its commands as they stand, up to released missions."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from upplied.catalog import open_catalog
from upplied.cli import main
from upplied.geometry.poses import look_at

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "project.md"
CAMERA_R_OPTICAL = Rotation.from_matrix([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
SISTER = """[[structure]]
id = "{name}"
kind = "tower"
path = "{name}.ply"
units = "m"
up = "z"
forward = "x"
ground_z = 0.0
surface = "scanned"
lat = 53.5352
lon = 9.8350
alt = 48.2
heading = 30.0
"""


def tower(radius: float, height: float) -> trimesh.Trimesh:
    """A round tower with a shed before it, of triangles as small as a reconstruction's."""
    body = trimesh.creation.cylinder(radius, height, sections=48)
    body.apply_translation([0, 0, height / 2])
    shed = trimesh.creation.box([2, 2, 3])
    shed.apply_translation([radius + 1.5, 0, 1.5])
    return trimesh.util.concatenate([body, shed]).subdivide_to_size(0.6)


def write_project(folder: Path) -> None:
    """What OpenDroneMap leaves of photos that spiral round a tower."""
    angle = np.linspace(0.3, 4 * np.pi - 0.3, 120)
    places = np.column_stack([14 * np.cos(angle), 14 * np.sin(angle), np.linspace(4, 14, 120)])
    quats = look_at(places, np.column_stack([0 * angle, 0 * angle, places[:, 2] - 1]))
    inverse = (Rotation.from_quat(quats) * CAMERA_R_OPTICAL).inv()
    shots = {
        f"{at:04d}.jpg": {
            "rotation": inverse[at].as_rotvec().tolist(), "translation": (-inverse[at].apply(place)).tolist(),
            "camera": "c", "capture_time": 1.77e9 + 2 * at,
        }
        for at, place in enumerate(places)
    }  # fmt: skip
    content = {
        "cameras": {"c": {"width": 4000, "height": 3000, "focal": 0.8}}, "shots": shots,
        "reference_lla": {"latitude": 53.5, "longitude": 9.8, "altitude": 20.0},
    }  # fmt: skip
    (folder / "opensfm").mkdir(parents=True)
    (folder / "odm_meshing").mkdir()
    (folder / "opensfm" / "reconstruction.json").write_text(json.dumps([content]))
    tower(5, 16).export(folder / "odm_meshing" / "odm_mesh.ply")


@pytest.mark.slow
def test_a_project_becomes_released_missions_of_two_sisters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_project(Path("tower-1"))
    for name, radius, height in (("tower-2", 5.5, 18), ("tower-3", 4.5, 15)):
        tower(radius, height).export(f"{name}.ply")
    Path("sisters.toml").write_text("\n".join(SISTER.format(name=name) for name in ("tower-2", "tower-3")))
    (block,) = re.findall(r"```bash\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    commands = [line.split(" #")[0].strip() for line in block.splitlines()]
    each = [command for command in commands if "TRANSFER" in command]
    for command in commands:
        if command not in each:
            assert main(shlex.split(command)[1:]) == 0, command
    plans = open_catalog("towers").transfers(preset="recommended", status="ok")
    assert sorted(plans["target_id"]) == ["tower-2", "tower-3"]
    for plan in plans["transfer_id"]:
        for command in each:
            assert main(shlex.split(command.replace("TRANSFER", plan))[1:]) == 0, command
        items = json.loads(Path(f"{plan}.plan").read_text())["mission"]["items"]
        assert sum(item.get("command") == 16 for item in items) > 5
    assert len(open_catalog("towers").in_force()) == 2
