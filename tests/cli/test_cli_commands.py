"""The commands on a small catalog: checks, choices, pictures, missions, flights, reports and upkeep."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from cases import slow_after
from random_members import random_member

import upplied.planning.plan as planning
from upplied import provenance
from upplied.catalog import open_catalog
from upplied.cli import main
from upplied.errors import RefusedError
from upplied.outputs.missions import FORMATS
from upplied.records import Placement
from upplied.samples.fleet import member
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


@pytest.mark.slow
def test_choices_reach_the_plan_and_the_plan_that_was_asked_for_is_shown(planned, capsys):
    arguments = ["transfer", "cube-sides-v1", "--preset", "paper", "--workers", "1", "--json"]
    shown = []
    for chosen in ([], ["--search", "heading"], []):  # the last one is not the newest plan
        assert main([*arguments, *chosen]) == 0
        (row,) = json.loads(capsys.readouterr().out)
        shown.append(row["transfer_id"])
    assert shown[0] == shown[2] != shown[1]
    assert main([*arguments, "--counterpart", "nose"]) == 2


@pytest.mark.slow
def test_a_plan_is_made_again(planned, location, capsys):
    assert main(["transfer", "--reproduce", planned]) == 0
    assert "the result is the same" in capsys.readouterr().out
    assert main(["transfer", "--reproduce", "0" * 20]) == 2


@pytest.mark.ci
def test_a_plan_that_comes_out_otherwise_is_told_with_its_cause(planned, capsys, monkeypatch):
    """Another version of the method, and of a library; and nothing at all that is known to differ."""
    original = planning.plan_transfer

    def otherwise(*arguments):
        plan = original(*arguments)
        path = replace(plan.trajectory, positions=plan.trajectory.positions + 0.01)
        return replace(plan, trajectory=path)

    monkeypatch.setattr(planning, "plan_transfer", otherwise)
    assert main(["transfer", "--reproduce", planned]) == 1
    printed = capsys.readouterr().out
    assert "differs in waypoints_sha256" in printed and "please report this as a fault" in printed
    now = provenance.recorded()
    monkeypatch.setattr(provenance, "recorded", lambda: {**now, "libraries": "numpy 0.9, scipy 99.0"})
    monkeypatch.setattr(planning, "METHOD_VERSION", "none")
    assert main(["transfer", "--reproduce", planned]) == 1
    printed = capsys.readouterr().out
    assert "Cause: method " in printed and " became none" in printed and " became 0.9" in printed
    assert "report this" not in printed


@pytest.mark.parametrize(
    "what", [["structure", "cube-v1"], ["transfer", ""], ["comparison", "cube-sides-v1", "box-random-1"]]
)
def test_pictures(what, planned, tmp_path):
    output = tmp_path / "picture.png"
    assert main(["render", *(word or planned for word in what), "--output", str(output)]) == 0
    assert output.read_bytes().startswith(PNG)


@pytest.mark.ci
@pytest.mark.parametrize("format", slow_after(3, FORMATS))
def test_missions(format, planned, tmp_path, capsys):
    output = tmp_path / f"mission{FORMATS[format]}"
    arguments = ["export", planned, "--to", format, "--output", str(output), "--drone", "m30t"]
    assert main(arguments) == 1 and not output.exists()
    assert "preset: the plan is of preset baseline" in capsys.readouterr().err
    arguments += [*FORCED]
    assert main(arguments) == 1 and not output.exists()
    assert "use --draft" in capsys.readouterr().err.lower()
    arguments += ["--draft"]
    assert main(arguments) == 0
    assert output.stat().st_size > 100
    assert "note: OVERRULED preset" in capsys.readouterr().out
    assert main([*arguments, "--reserve-pct", "200"]) == 2


@pytest.mark.ci
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


@pytest.mark.slow
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
    clearance = rows["minimum clearance (m)"]
    assert clearance["flown"] != clearance["planned"]
    assert main(["report", str(reports)]) == 0
    text = page.read_text()
    assert f"gusts (seed 3): minimum clearance {clearance['flown']:.2f} m" in text
    assert '"flown":{"summary":"In a wind of 7 m/s' in text


@pytest.mark.slow
def test_what_was_overruled_is_kept_listed_and_shown(planned, location, tmp_path, capsys):
    export = ["export", planned, "--to", "csv", "--output", str(tmp_path / "a.csv"), "--draft", *FORCED]
    before = len(open_catalog(location).overruled(planned))
    for _ in range(2):
        assert main(export) == 0
    records = open_catalog(location).overruled(planned)
    assert len(records) <= before + 2  # the same again adds nothing
    rows = records[records["format"] == "csv"].set_index("rule")
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


@pytest.mark.ci
def test_a_report_in_one_file(planned, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["report", "--self-contained", "one.html", "--target", "box-random-1"]) == 0
    assert "box-random-1" in (tmp_path / "one.html").read_text()
    assert not (tmp_path / "reports").exists()
    assert main(["report", "--self-contained", "none.html", "--target", "nowhere"]) == 2


@pytest.mark.ci
def test_the_catalog_tells_and_is_kept(planned, capsys):
    def entries(*arguments: str) -> list[dict]:
        assert main(["catalog", *arguments, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    assert planned in {row["transfer_id"] for row in entries("transfers")}
    assert entries("as-of", "2020-01-01") == []
    assert {row["table"] for row in entries("history")} >= {"structures", "transfers"}
    assert len(entries("history", "--limit", "1")) == 1
    assert {row["change"] for row in entries("diff", "2020-01-01")} == {"added"}
    (verified,) = entries("verify")
    assert verified["findings"] == [] and verified["not_measured_here"] == []
    assert main(["catalog", "compact"]) == 0
    assert main(["catalog", "vacuum", "--keep-days", "1"]) == 0
    assert main(["catalog", "vacuum", "--keep-days", "0"]) == 2
    assert main(["catalog", "as-of", "never"]) == 2
    capsys.readouterr()
    (verified,) = entries("verify")
    assert verified["findings"] == [] and verified["not_measured_here"] == []


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
    assert main(["demonstrations", "show", "cube-sides-v1", "--json", "--quiet"]) == 0
    assert isinstance(json.loads(capsys.readouterr().out), dict)
    assert main(["catalog", "info"]) == 0
    assert "structures" in capsys.readouterr().out
