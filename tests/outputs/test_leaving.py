"""No draft, foreign or altered plan leaves in any format, or as a brief, unless as a draft."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from cases import slow_after
from fake_catalog import FakeCatalog

from upplied import fleet
from upplied.catalog import Catalog, export_dataset, import_dataset, open_catalog
from upplied.cli import main
from upplied.errors import InputError, RefusedError
from upplied.fleet import flights
from upplied.outputs.missions import FORMATS, MissionOptions
from upplied.outputs.render import brief_transfer, export_transfer
from upplied.records import Placement

PLAN = hashlib.sha256(b"plan").hexdigest()


def write_catalog(place: Path) -> Catalog:
    """A plan in force on a box that has a place on the Earth."""
    fake = FakeCatalog(targets=1)
    catalog = open_catalog(place)
    target = replace(fake.structure("cuboid-0"), placement=Placement(47.3, 8.5, 430.0, 20.0, "amsl"))
    catalog.add_structures([fake.structure("cube"), target])
    catalog.add_demonstrations([fake.demonstration("orbit-1")])
    catalog.add_plans([(PLAN, replace(fake.plans["t0000"], flyable=True), {})])
    return catalog


def rewrite(catalog: Catalog, table: str, **values: object) -> None:
    """Put other values into a table behind our back."""
    for path in Path(catalog.tables[table].uri).glob("*.parquet"):
        rows = pq.read_table(path)
        changed = [{**row, **values} for row in rows.to_pylist()]
        pq.write_table(pa.Table.from_pylist(changed, rows.schema), path)


@pytest.fixture(scope="module")
def catalogs(tmp_path_factory) -> dict[str, Catalog]:
    """Of one plan each: what it is, and what breaks the rule of that name."""
    place = tmp_path_factory.mktemp("leaving")
    catalogs = {name: write_catalog(place / name) for name in ("sound", "released", "altered")}
    for name in ("sound", "altered"):
        catalogs[name].release(PLAN[:20], "Grace")
    rewrite(catalogs["altered"], "transfers", min_clearance_m=99.0)
    export_dataset(catalogs["sound"], place / "set", "boxes-v1", [PLAN[:20]], "CC0-1.0")
    catalogs["foreign"] = open_catalog(place / "foreign")
    import_dataset(catalogs["foreign"], place / "set")
    return {name: open_catalog(catalog.location) for name, catalog in catalogs.items()}


# One gate asks every rule of every format: all rules of one, one of all; all of all before a release.
RULES = [("released", format) for format in FORMATS] + [
    pytest.param(rule, format, marks=() if format == "qgc-plan" else pytest.mark.slow)
    for rule in ("altered", "foreign")
    for format in FORMATS
]


@pytest.mark.parametrize(("rule", "format"), RULES)
def test_it_leaves_in_no_format_unless_as_a_draft(catalogs, tmp_path, rule, format):
    goal, force = tmp_path / f"plan{FORMATS[format]}", ("preset", "verdict", "superseded")
    options = MissionOptions(force=force, drone="m30t")
    for write in (export_transfer, brief_transfer):
        with pytest.raises(RefusedError, match=rf"{rule}.*--draft"):
            write(catalogs[rule], PLAN[:20], format, goal, options)
    assert list(tmp_path.iterdir()) == []
    written = export_transfer(catalogs[rule], PLAN[:20], format, goal, replace(options, draft=True))
    assert rule in {breach.rule for breach in written.overruled} and goal.exists()
    assert any(note.startswith("DRAFT, NOT RELEASED:") for note in written.notes)


@pytest.mark.parametrize("format", slow_after(2, FORMATS))
def test_what_is_in_force_leaves_and_says_by_which_decision(catalogs, tmp_path, format):
    goal = tmp_path / f"plan{FORMATS[format]}"
    written = export_transfer(catalogs["sound"], PLAN[:20], format, goal, MissionOptions(drone="m30t"))
    head = catalogs["sound"].decisions()["row_sha256"].iloc[-1][:20]
    assert f"custody: decisions {head}" in written.notes and written.overruled == ()
    brief_transfer(catalogs["sound"], PLAN[:20], "qgc-plan", tmp_path / "b.html", MissionOptions())
    assert head in (tmp_path / "b.html").read_text()
    if format == "qgc-plan":
        assert head in goal.read_text()


def test_the_command_says_that_what_is_in_force_is_not_what_was_released(catalogs, capsys):
    command = ["in-force", "--catalog", str(catalogs["altered"].location)]
    assert main(command) == 1
    assert "differs from the release" in capsys.readouterr().err
    assert main(["in-force", "--catalog", str(catalogs["sound"].location)]) == 0
    assert main(["catalog", "verify", "--catalog", str(catalogs["altered"].location)]) == 1
    out = capsys.readouterr().out
    assert "head of decisions: " in out and "which is in force" in out
    assert main(["catalog", "verify", "--catalog", str(catalogs["foreign"].location)]) == 0
    assert "1 imported plans were not measured here" in capsys.readouterr().out


def test_a_plan_that_cannot_be_judged_on_its_changed_structure_does_not_stay_in_force(tmp_path, monkeypatch):
    """Nobody knows that it is safe there."""
    catalog = write_catalog(tmp_path / "catalog")
    catalog.release(PLAN[:20], "Grace")
    structure = catalog.structure("cuboid-0")
    catalog.add_structures([replace(structure, sha256="changed")])

    class Unable:
        def __init__(self, *_: object, **__: object) -> None: ...
        def __enter__(self):
            return self

        def __exit__(self, *_: object) -> None: ...
        def run(self, *_: object):
            raise InputError("the structure", "has no surface")

    monkeypatch.setattr(flights, "Workers", Unable)
    (recheck,) = fleet.recheck(catalog)
    assert recheck.recalled and recheck.troubled and "cannot be judged" in recheck.note
    assert catalog.in_force().empty and list(catalog.recalled()["transfer_id"]) == [PLAN[:20]]


@pytest.mark.parametrize("firmware", ["px4", "ardupilot"])
@pytest.mark.parametrize("photos", ["viewpoints", "distance"])
def test_photos_are_asked_for_by_the_parameters_that_autopilots_read(catalogs, tmp_path, firmware, photos):
    """As MAVLink's own dialect documents them: by the name of each parameter, not by its place here."""
    mavutil = pytest.importorskip("pymavlink.mavutil", reason="pymavlink is not installed")
    dialect = mavutil.mavlink.enums["MAV_CMD"]
    options = MissionOptions(firmware=firmware, photos=photos, photo_distance_m=3.0)
    goal = tmp_path / "plan.waypoints"
    export_transfer(catalogs["sound"], PLAN[:20], "mavlink", goal, options)
    rows = [line.split("\t") for line in goal.read_text().splitlines()[1:]]
    command = {("ardupilot", "viewpoints"): 203, ("px4", "viewpoints"): 2000}.get((firmware, photos), 206)
    triggers = [[float(value) for value in row[4:11]] for row in rows if int(row[3]) == command]
    assert triggers
    words = {at: text.lower() for at, text in dialect[command].param.items()}
    for number, values in enumerate(triggers):
        parameters = {at: value for at, value in enumerate(values, start=1) if value}
        if command == 203:  # one trigger: "Shooting Command", and nothing of zoom, focus or session
            assert parameters == {5: 1.0} and "shoot" in words[5]
        elif command == 2000:
            assert parameters == {3: 1.0, 4: number + 1.0} and "total number of images" in words[3]
        else:
            assert parameters in ({1: 3.0, 3: 1.0}, {}) and "distance" in words[1] and "trigger" in words[3]
