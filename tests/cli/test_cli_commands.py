"""The commands on a small catalog: checks, choices, pictures, missions, flights, reports and upkeep."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import trimesh

import upplied.planning.plan as planning
from upplied import provenance
from upplied.catalog import open_catalog
from upplied.catalog.schema.plan_rows import settings_text
from upplied.cli import main
from upplied.cli.choices import Choices
from upplied.cli.export import Flags
from upplied.config import settings_for
from upplied.config.stages import Drone
from upplied.errors import RefusedError
from upplied.outputs.missions import FORMATS, MissionOptions
from upplied.outputs.missions.dji_wpml import DRONES
from upplied.outputs.render import as_settled
from upplied.records import Placement
from upplied.samples.fleet import member, random_member
from upplied.samples.pilot import fly

FORCED = ("--force", "preset", "--force", "verdict")  # the plan is a comparison, and turns too hard
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def location(tmp_path_factory) -> str:
    """A catalog with a demonstration, a target with a place on the Earth, and a plan for it."""
    catalog = open_catalog(tmp_path_factory.mktemp("commands") / "catalog")
    cube, target = member("cube-v1").structure, random_member("box", 1).structure
    target = replace(target, placement=Placement(48.0, 11.0, 500.0, 30.0))
    catalog.add_structures([cube, target])
    catalog.add_demonstrations([fly(cube, "sides")])
    arguments = ["transfer", "cube-sides-v1", "--preset", "baseline", "--workers", "1", "--quiet"]
    assert main([*arguments, "--catalog", str(catalog.location)]) == 0
    return str(catalog.location)


@pytest.fixture
def planned(location, monkeypatch) -> str:
    """The id of the baseline's plan, its catalog the default."""
    monkeypatch.setenv("UPPLIED_CATALOG", location)
    rows = open_catalog(location).transfers(preset="baseline")
    return str(rows["transfer_id"].iloc[0])


TETRAHEDRON = """v 0 0 0
v 4 0 0
v 0 3 0
v 0 0 5
f 1 3 2
f 1 2 4
f 2 3 4
f 3 1 4
"""


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


def test_a_scan_is_written_without_its_ground(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    ground = 40 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    box = trimesh.creation.box((4, 6, 8))
    box.apply_translation((0, 0, 5))
    scene = trimesh.util.concatenate([box, trimesh.Trimesh(ground, [[0, 1, 2], [0, 2, 3]])])
    scene.export("tank.ply")
    box.export("alone.ply")
    assert main(["structures", "check", "tank.ply", "--clean"]) == 0
    said = capsys.readouterr().out
    assert "6400.0 m² of ground; 208.0 m² are left" in said and "ground_z = 0.00" in said
    assert Path("tank-clean.png").read_bytes().startswith(PNG)
    assert trimesh.load("tank-clean.ply").area == pytest.approx(208.0)
    assert main(["structures", "check", "alone.ply", "--clean"]) == 0
    assert "nothing to separate" in capsys.readouterr().out and not Path("alone-clean.ply").exists()


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
        "kept", 0.01, True, pairs, repeat="mirror", expect=2, clearance=3.0, search="heading",
        about="box 0 0 0 1 1 1",
    )  # fmt: skip
    made = settings_for("recommended", **chosen.onto({"route": {"clearance_m": 9.0, "enforce": False}}))
    assert (made.transfer.standoff, made.transfer.gsd_m, made.transfer.plane) == ("kept", 0.01, True)
    assert made.correspondence.counterparts == (("nose", "bow"), ("tail", "stern"))
    assert (made.correspondence.repeat, made.registration.search) == ("mirror", "heading")
    assert made.correspondence.expect == 2
    assert (made.route.clearance_m, made.route.enforce) == (3.0, False)
    assert made.inspection.about == "box 0 0 0 1 1 1"
    assert settings_for("recommended", **Choices().onto({})) == settings_for("recommended")


def test_flags_of_missions_are_the_options_of_missions():
    assert asdict(Flags()) == asdict(MissionOptions())


def test_missions_are_written_for_the_vehicle_and_clearance_that_the_plan_was_made_for():
    assert {*DRONES, ""} == {*get_args(Drone)}
    said = {"drone": "m30t", "endurance_s": 1200.0, "firmware": "ardupilot"}
    for made_m, asked_m, kept_m in ((5.0, 2.0, 5.0), (1.5, 2.0, 2.0), (5.0, 3.0, 3.0)):
        settings = settings_for("recommended", vehicle=said, route={"clearance_m": made_m})
        row = {"settings_json": settings_text(settings)}
        made = as_settled(row, MissionOptions(clearance_m=asked_m, endurance_s=900.0))
        assert (made.drone, made.endurance_s, made.firmware) == ("m30t", 900.0, "ardupilot")
        assert made.clearance_m == kept_m
    assert as_settled({"settings_json": settings_text(settings)}, MissionOptions(drone="m3e")).drone == "m3e"
    assert as_settled({}, MissionOptions()) == as_settled({"settings_json": "{"}, MissionOptions())


def test_choices_reach_the_plan_and_the_plan_that_was_asked_for_is_shown(planned, capsys):
    arguments = ["transfer", "cube-sides-v1", "--preset", "paper", "--workers", "1", "--json"]
    shown = []
    for chosen in ([], ["--search", "heading"], []):  # the last one is not the newest plan
        assert main([*arguments, *chosen]) == 0
        (row,) = json.loads(capsys.readouterr().out)
        shown.append(row["transfer_id"])
    assert shown[0] == shown[2] != shown[1]
    assert main([*arguments, "--counterpart", "nose"]) == 2


def test_a_plan_is_made_again(planned, location, capsys):
    assert main(["transfer", "--reproduce", planned]) == 0
    assert "the same again" in capsys.readouterr().out
    assert main(["transfer", "--reproduce", "0" * 20]) == 2


def test_a_plan_that_comes_out_otherwise_is_told_with_its_cause(planned, capsys, monkeypatch):
    """Another version of the method, and of a library; and nothing at all that is known to differ."""
    made = planning.plan_transfer

    def otherwise(*given):
        plan = made(*given)
        path = replace(plan.trajectory, positions=plan.trajectory.positions + 0.01)
        return replace(plan, trajectory=path)

    monkeypatch.setattr(planning, "plan_transfer", otherwise)
    assert main(["transfer", "--reproduce", planned]) == 1
    said = capsys.readouterr().out
    assert "differs in waypoints_sha256" in said and "please report this as a fault" in said
    now = provenance.recorded()
    monkeypatch.setattr(provenance, "recorded", lambda: {**now, "libraries": "numpy 0.9, scipy 99.0"})
    monkeypatch.setattr(planning, "METHOD_VERSION", "none")
    assert main(["transfer", "--reproduce", planned]) == 1
    said = capsys.readouterr().out
    assert "Cause: method " in said and " became none" in said and " became 0.9" in said
    assert "report this" not in said


@pytest.mark.parametrize(
    "what", [["structure", "cube-v1"], ["transfer", ""], ["comparison", "cube-sides-v1", "box-random-1"]]
)
def test_pictures(what, planned, tmp_path):
    output = tmp_path / "picture.png"
    assert main(["render", *(word or planned for word in what), "--output", str(output)]) == 0
    assert output.read_bytes().startswith(PNG)


@pytest.mark.parametrize("format", FORMATS)
def test_missions(format, planned, tmp_path, capsys):
    output = tmp_path / f"mission{FORMATS[format]}"
    arguments = ["export", planned, "--to", format, "--output", str(output), "--drone", "m30t"]
    assert main(arguments) == 1 and not output.exists()
    assert "preset: the plan is of preset baseline" in capsys.readouterr().err
    arguments += [*FORCED]
    assert main(arguments) == 1 and not output.exists()
    assert "say --draft" in capsys.readouterr().err.lower()
    arguments += ["--draft"]
    assert main(arguments) == 0
    assert output.stat().st_size > 100
    assert "note: OVERRULED preset" in capsys.readouterr().out
    assert main([*arguments, "--reserve-pct", "200"]) == 2


def test_the_page_for_the_pilot_passes_the_same_gate(planned, tmp_path, capsys):
    output = tmp_path / "brief.html"
    assert main(["brief", planned, "--output", str(output)]) == 1 and not output.exists()
    assert "--force preset" in capsys.readouterr().err
    assert main(["brief", planned, "--output", str(output), *FORCED, "--draft"]) == 0
    assert "OVERRULED preset" in output.read_text()


def test_a_refused_mission_is_code_1_and_says_why(planned, tmp_path, capsys):
    output = str(tmp_path / "mission.kmz")
    wrong = ["--drone", "m30t", "--altitude", "ellipsoid"]
    assert main(["export", planned, "--to", "dji-wpml", "--output", output, *wrong]) == 1
    assert capsys.readouterr().err.startswith("refused: ")


def test_a_flight_in_wind_is_told_in_the_report(planned, tmp_path, capsys):
    reports = tmp_path / "reports"
    assert main(["report", str(reports)]) == 0
    (page,) = (reports / "transfers").glob("*.html")
    assert "In a wind of" not in page.read_text()
    capsys.readouterr()
    assert main(["fly", planned, "--wind", "7"]) == 1  # it is for comparison
    assert "preset: the plan is of preset baseline" in capsys.readouterr().err
    assert main(["fly", planned, "--wind", "7", "--seed", "3", "--json", *FORCED]) == 0
    rows = {row["measure"]: row for row in json.loads(capsys.readouterr().out)}
    clearance = rows["least clearance, m"]
    assert clearance["flown"] != clearance["planned"]
    assert main(["report", str(reports)]) == 0
    text = page.read_text()
    assert f"gusts (seed 3): least clearance {clearance['flown']:.2f} m" in text
    assert '"flown":{"said":"In a wind of 7 m/s' in text


def test_what_was_overruled_is_kept_listed_and_shown(planned, location, tmp_path, capsys):
    export = ["export", planned, "--to", "csv", "--output", str(tmp_path / "a.csv"), "--draft", *FORCED]
    before = len(open_catalog(location).overruled(planned))
    for _ in range(2):
        assert main(export) == 0
    kept = open_catalog(location).overruled(planned)
    assert len(kept) <= before + 2  # the same again adds nothing
    rows = kept[kept["format"] == "csv"].set_index("rule")
    assert set(rows.index) == {"preset", "verdict"} and set(rows["way"]) == {"export"}
    assert "preset baseline" in rows.loc["preset", "found"]
    capsys.readouterr()
    assert main(["catalog", "transfers", "--json"]) == 0
    rows = {each["transfer_id"]: each for each in json.loads(capsys.readouterr().out)}
    assert rows[planned]["overruled"] == "preset verdict"
    assert main(["catalog", "show", planned, "--json"]) == 0
    shown = [each for each in json.loads(capsys.readouterr().out) if each["what"] == "overruled for"]
    assert "preset" in {each["rule"] for each in shown}
    assert main(["report", str(tmp_path / "reports")]) == 0
    (page,) = (tmp_path / "reports" / "transfers").glob("*.html")
    assert '"overruled":["export ' in page.read_text() and '"export csv, 20' in page.read_text()


def test_only_what_may_be_flown_is_given_out(planned, location):
    catalog = open_catalog(location)
    with pytest.raises(RefusedError, match=r'preset baseline.*force=\["preset"'):
        catalog.trajectory(planned)
    force = ["preset", "verdict", "superseded"]
    assert len(catalog.trajectory(planned, force).t_s) == len(catalog.waypoints(planned))


def test_a_flight_that_is_blown_away_is_refused(planned, capsys):
    assert main(["fly", planned, "--wind", "40", *FORCED]) == 1
    assert "fly slower" in capsys.readouterr().err.lower()


def test_a_report_in_one_file(planned, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["report", "--self-contained", "one.html", "--target", "box-random-1"]) == 0
    assert "box-random-1" in (tmp_path / "one.html").read_text()
    assert not (tmp_path / "reports").exists()
    assert main(["report", "--self-contained", "none.html", "--target", "nowhere"]) == 2


def test_the_catalog_tells_and_is_kept(planned, capsys):
    def told(*arguments: str) -> list[dict]:
        assert main(["catalog", *arguments, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    assert planned in {row["transfer_id"] for row in told("transfers")}
    assert told("as-of", "2020-01-01") == []
    assert {row["table"] for row in told("history")} >= {"structures", "transfers"}
    assert len(told("history", "--limit", "1")) == 1
    assert {row["change"] for row in told("diff", "2020-01-01")} == {"added"}
    assert told("verify") == []
    assert main(["catalog", "compact"]) == 0
    assert main(["catalog", "vacuum", "--keep-days", "1"]) == 0
    assert main(["catalog", "vacuum", "--keep-days", "0"]) == 2
    assert main(["catalog", "as-of", "never"]) == 2
    capsys.readouterr()
    assert told("verify") == []


def test_a_damaged_catalog_is_code_1(planned, location, tmp_path, capsys):
    assert main(["catalog", "export", str(tmp_path / "boxes-v1"), "--licence", "CC-BY-4.0"]) == 0
    other = str(tmp_path / "other")
    assert main(["catalog", "import", str(tmp_path / "boxes-v1"), "--catalog", other]) == 0
    capsys.readouterr()
    assert main(["catalog", "import", str(tmp_path / "boxes-v1"), "--catalog", other]) == 0
    assert capsys.readouterr().out == "added rows: none\n"
    mesh = next((Path(other) / "meshes").rglob("*.parquet"))
    mesh.write_bytes(mesh.read_bytes()[:-20])
    assert main(["catalog", "verify", "--catalog", other]) == 1
    assert "1 finding" in capsys.readouterr().out


def test_quiet_says_nothing_and_json_is_still_told(planned, capsys):
    assert main(["--quiet", "catalog", "info"]) == 0
    assert capsys.readouterr().out == ""
    assert main(["catalog", "info", "--json", "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out)
    assert main(["catalog", "info"]) == 0
    assert "structures" in capsys.readouterr().out


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
