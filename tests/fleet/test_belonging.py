"""Settings belong to kinds and structures: inherited, part of what names a plan, told with their source."""

from __future__ import annotations

import json

import pytest
from catalog_records import demonstration, structure

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.catalog.database import Catalog
from upplied.cli import main
from upplied.errors import CatalogError, SettingsError

BOTH = fleet.PlanRequest(("recommended", "baseline"))


@pytest.fixture
def catalog(tmp_path) -> Catalog:
    made = open_catalog(tmp_path / "catalog")
    made.add_structures([structure("boxy"), structure("t1", 1), structure("t2", 2)])
    made.add_demonstrations([demonstration()])
    return made


def clearances(catalog: Catalog, plan_request: fleet.PlanRequest = BOTH) -> dict[tuple[str, str], float]:
    jobs = fleet.decide(catalog, plan_request).jobs
    return {(job.target_id, job.settings.preset): job.settings.route.clearance_m for job in jobs}


def test_a_structure_says_more_than_its_kind_and_a_run_more_than_both(catalog):
    usual = clearances(catalog)
    keys = {job.key for job in fleet.decide(catalog, BOTH).jobs}
    catalog.set("kind", "box", {"route.clearance_m": 3.0}, "Ada", "gusty sites")
    catalog.set("structure", "t1", {"route.clearance_m": 5.0, "transfer.standoff": "kept"}, "Ada")
    now = clearances(catalog)
    assert (now["t1", "recommended"], now["t2", "recommended"]) == (5.0, 3.0)
    assert now["t1", "baseline"] == usual["t1", "baseline"]  # for comparison: as its preset
    jobs = fleet.decide(catalog, BOTH).jobs
    assert {job.key for job in jobs if job.settings.preset == "recommended"}.isdisjoint(keys)
    assert {job.key for job in jobs if job.settings.preset == "baseline"} <= keys
    asked = fleet.PlanRequest(("recommended",), {"route": {"clearance_m": 8.0}}, experiment="far")
    assert set(clearances(catalog, asked).values()) == {8.0}
    catalog.set("structure", "t1", {"route.clearance_m": None}, "Ada")
    assert clearances(catalog)["t1", "recommended"] == 3.0


def test_every_value_is_told_with_where_it_comes_from(catalog, capsys):
    where = ["--catalog", catalog.location]
    assert main(["set", "box", "--kind", "route.clearance_m=3", "--by", "Ada", *where]) == 0
    assert main(["set", "t1", "transfer.gsd_m=0.002", "--by", "Ada", *where]) == 0
    capsys.readouterr()
    assert main(["settings", "t1", "--json", *where]) == 0
    rows = {row["setting"]: row for row in json.loads(capsys.readouterr().out)}
    assert (rows["route.clearance_m"]["value"], rows["route.clearance_m"]["from"]) == (3, "kind box")
    assert rows["transfer.gsd_m"]["from"] == "structure t1"
    assert rows["retime.max_speed_mps"]["from"] == "preset recommended"
    assert main(["set", "t1", "transfer.gsd_m=", "--by", "Ada", *where]) == 0
    assert list(catalog.said_settings()["value_json"]) == ["3", "0.002", ""]


@pytest.mark.parametrize(
    ("scope", "owner", "values", "error"),
    [
        ("structure", "nobody", {"route.clearance_m": 3.0}, CatalogError),
        ("kind", "airliner", {"route.clearance_m": 3.0}, CatalogError),
        ("kind", "box", {"route.nearness": 3.0}, SettingsError),
        ("kind", "box", {"route.nearness": None}, SettingsError),
        ("kind", "box", {"clearance": 3.0}, SettingsError),
        ("kind", "box", {"route.clearance_m": "far"}, SettingsError),
    ],
)
def test_what_cannot_be_set_is_told_and_nothing_is_kept(catalog, scope, owner, values, error):
    with pytest.raises(error):
        catalog.set(scope, owner, values, "Ada")
    with pytest.raises(SettingsError, match="Say --by NAME"):
        catalog.set("kind", "box", {"route.clearance_m": 3.0}, "")
    assert not len(catalog.said_settings())
