"""The commands that look at structures, and the choices that become settings."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import trimesh

from upplied.catalog import open_catalog
from upplied.cli import main
from upplied.cli.options import Choices
from upplied.config import settings_for
from upplied.config.stages import Drone
from upplied.outputs.missions import MissionOptions
from upplied.outputs.missions.dji_wpml import DRONES
from upplied.outputs.render import as_settled
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

PNG = b"\x89PNG\r\n\x1a\n"
TETRAHEDRON = """v 0 0 0
v 4 0 0
v 0 3 0
v 0 0 5
f 1 3 2
f 1 2 4
f 2 3 4
f 3 1 4
"""


@pytest.mark.ci
def test_a_mesh_is_checked_in_words_and_drawn(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("good.obj").write_text(TETRAHEDRON)
    assert main(["structures", "check", "good.obj"]) == 0
    assert "4.00 x 3.00 x 5.00 m" in capsys.readouterr().out
    assert Path("good-check.png").read_bytes().startswith(PNG)
    Path("bad.obj").write_text("no mesh at all")
    assert main(["structures", "check", "bad.obj"]) == 1
    assert main(["structures", "check", "none.obj"]) == 2
    assert not Path("bad-check.png").exists()


@pytest.mark.slow
def test_a_scan_is_written_without_its_ground(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    ground = 40 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    box = trimesh.creation.box((4, 6, 8))
    box.apply_translation((0, 0, 5))
    scene = trimesh.util.concatenate([box, trimesh.Trimesh(ground, [[0, 1, 2], [0, 2, 3]])])
    scene.export("tank.ply")
    box.export("alone.ply")
    assert main(["structures", "check", "tank.ply", "--clean"]) == 0
    printed = capsys.readouterr().out
    assert "6400.0 m² of ground; 208.0 m² are left" in printed and "ground_z = 0.00" in printed
    assert Path("tank-clean.png").read_bytes().startswith(PNG)
    assert trimesh.load("tank-clean.ply").area == pytest.approx(208.0)
    assert main(["structures", "check", "alone.ply", "--clean"]) == 0
    assert "nothing to separate" in capsys.readouterr().out and not Path("alone-clean.ply").exists()


@pytest.mark.ci
def test_one_structure_of_a_manifest_is_checked_against_what_is_declared(tmp_path, capsys):
    (tmp_path / "mesh.obj").write_text(TETRAHEDRON)
    manifest, png = tmp_path / "structures.csv", tmp_path / "there.png"
    manifest.write_text(
        "id,kind,path,units,up,forward,nominal_length_m\none,box,mesh.obj,m,z,x,4\nother,box,mesh.obj,mm,z,x,4\n"
    )
    arguments = ["structures", "check", str(manifest), "--png", str(png)]
    assert main([*arguments, "--id", "one"]) == 0
    assert main([*arguments, "--id", "other"]) == 1
    assert "refused" in capsys.readouterr().out
    assert png.read_bytes().startswith(PNG)
    assert main([*arguments, "--id", "third"]) == 2


def test_choices_become_settings():
    pairs = ("nose=bow", "tail=stern")
    chosen = Choices(
        "kept", 10.0, True, pairs, repeat="mirror", expect=2, clearance=3.0, search="heading",
        about="box 0 0 0 1 1 1",
    )  # fmt: skip
    settings = settings_for("recommended", **chosen.onto({"route": {"clearance_m": 9.0, "enforce": False}}))
    assert (settings.transfer.standoff, settings.transfer.gsd_m, settings.transfer.plane) == (
        "kept",
        0.01,
        True,
    )
    assert settings.correspondence.counterparts == (("nose", "bow"), ("tail", "stern"))
    assert (settings.correspondence.repeat, settings.registration.search) == ("mirror", "heading")
    assert settings.correspondence.expect == 2
    assert (settings.route.clearance_m, settings.route.enforce) == (3.0, False)
    assert settings.inspection.about == "box 0 0 0 1 1 1"
    assert settings_for("recommended", **Choices().onto({})) == settings_for("recommended")


def test_missions_are_written_for_the_vehicle_and_clearance_that_the_plan_was_made_for():
    assert {*DRONES, ""} == {*get_args(Drone)}
    vehicle = {"drone": "m30t", "endurance_s": 1200.0, "firmware": "ardupilot"}
    for made_m, asked_m, kept_m in ((5.0, 2.0, 5.0), (1.5, 2.0, 2.0), (5.0, 3.0, 3.0)):
        settings = settings_for("recommended", vehicle=vehicle, route={"clearance_m": made_m})
        row = {"settings_json": settings.text}
        options = as_settled(row, MissionOptions(clearance_m=asked_m, endurance_s=900.0))
        assert (options.drone, options.endurance_s, options.firmware) == ("m30t", 900.0, "ardupilot")
        assert options.clearance_m == kept_m
    assert as_settled({"settings_json": settings.text}, MissionOptions(drone="m3e")).drone == "m3e"
    assert as_settled({}, MissionOptions()) == as_settled({"settings_json": "{"}, MissionOptions())


@pytest.mark.slow
def test_the_user_says_which_engine_is_meant(tmp_path, monkeypatch):
    a320, b747 = member("a320-v1").structure, member("b747-v1").structure
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([a320, b747])
    catalog.add_demonstrations([fly(a320, "engine_left")])
    monkeypatch.setenv("UPPLIED_CATALOG", str(catalog.location))
    arguments = ["transfer", "a320-engine-left-v1", "--to", "b747-v1", "--preset", "recommended", "--quiet"]
    assert main(arguments) == 0
    assert main([*arguments, "--counterpart", "engine_left=outer"]) == 0
    plans = catalog.transfers(every=True)
    assert list(plans["status"]) == ["ok", "ok"]
    paths = [catalog.trajectory(name, ["superseded"]) for name in plans["transfer_id"]]
    inner, outer = (path.positions[:, 1].mean() for path in paths)
    apart = b747.landmarks["engine_left_outer"][1] - b747.landmarks["engine_left"][1]
    assert abs(outer - inner) == pytest.approx(apart, rel=0.5)  # the loop is flown round the other engine
