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
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([structure("boxy"), structure("t1", 1), structure("t2", 2)])
    catalog.add_demonstrations([demonstration()])
    return catalog


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
    request = fleet.PlanRequest(("recommended",), {"route": {"clearance_m": 8.0}}, experiment="far")
    assert set(clearances(catalog, request).values()) == {8.0}
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
    assert list(catalog.declared_settings()["value_json"]) == ["3", "0.002", ""]


def test_the_preset_that_is_flown_belongs_to_things_and_those_for_comparison_are_refused(catalog, capsys):
    usual = keys(catalog)
    where = ["--catalog", catalog.location]

    def preset_of(name: str) -> tuple[str, str]:
        rows = catalog.settings_of(name).set_index("setting")
        return rows.loc["preset", "value"], rows.loc["preset", "from"]

    assert preset_of("t1") == ("recommended", "preset recommended")
    assert main(["set", "box", "--kind", "preset=recommended", "--by", "Ada", *where]) == 0
    assert preset_of("t1") == preset_of("t2") == ("recommended", "kind box")
    assert main(["set", "t1", "preset=recommended", "route.clearance_m=4", "--by", "Ada", *where]) == 0
    assert (preset_of("t1")[1], preset_of("t2")[1]) == ("structure t1", "kind box")
    now = keys(catalog)
    assert {name for name in usual if now[name] != usual[name]} == {("t1", "recommended")}  # the clearance
    assert main(["set", "t1", "preset=", "route.clearance_m=", "--by", "Ada", *where]) == 0
    assert preset_of("t1")[1] == "kind box" and keys(catalog) == usual
    number = len(catalog.declared_settings())
    for preset in ("paper", "baseline"):
        capsys.readouterr()
        assert main(["set", "t1", f"preset={preset}", "--by", "Ada", *where]) != 0
        words = " ".join(capsys.readouterr().err.split())
        assert (
            f"preset {preset}: is for comparison" in words and f"--preset {preset} --experiment NAME" in words
        )
    with pytest.raises(SettingsError, match="is unknown"):
        catalog.set("kind", "box", {"preset": "best"}, "Ada")
    with pytest.raises(SettingsError, match="is unknown"):
        catalog.set("kind", "box", {"preset": 3}, "Ada")
    assert len(catalog.declared_settings()) == number


def test_programs_that_know_no_preset_of_things_read_past_it(catalog):
    """They take each row of the two scopes for STAGE.NAME of the preset, and ask for no other scope."""
    catalog.set("kind", "box", {"preset": "recommended", "route.clearance_m": 3.0}, "Ada")
    catalog.set("structure", "t1", {"preset": "recommended"}, "Ada")
    catalog.set("structure", "t1", {"preset": None}, "Ada")
    rows = catalog.declared_settings()
    older = rows[rows["scope"].isin(["kind", "structure"])]
    assert list(older["setting"]) == ["route.clearance_m"] and len(rows) == 4
    assert all(len(setting.split(".")) == 2 for setting in rows["setting"])


def test_a_setting_of_a_newer_program_is_refused_by_its_name(catalog):
    row = {"setting_id": "x-0", "scope": "kind", "owner": "box", "setting": "route.battery_wh"}
    catalog.add_rows("settings", [row | {"value_json": "7", "by": "Ada", "note": ""}])
    with pytest.raises(SettingsError, match=r"route\.battery_wh.*is unknown"):
        fleet.decide(catalog, BOTH)


def keys(catalog: Catalog) -> dict[tuple[str, str], str]:
    return {(job.target_id, job.settings.preset): job.key for job in fleet.decide(catalog, BOTH).jobs}


def test_what_must_be_seen_is_part_of_the_key_of_plans_that_are_flown(catalog, capsys):
    usual = keys(catalog)
    zone = {"zone": "roof", "where": "part_0", "gsd_mm": 2.0}
    catalog.require("kind", "box", "monthly", [zone], "Ada")
    of_kind = keys(catalog)
    changed = {name for name in usual if of_kind[name] != usual[name]}
    assert changed == {("t1", "recommended"), ("t2", "recommended")}
    # what a plan is not made by does not make another
    catalog.require(
        "kind", "box", "monthly", [{**zone, "zone": "top", "max_age_days": 30, "looks": 2}], "Ada"
    )
    assert keys(catalog) == of_kind
    catalog.require("structure", "t1", "yearly", [{"zone": "side", "where": "box 0 0 0 1 1 1"}], "Ada")
    own = keys(catalog)
    assert {name for name in own if own[name] != of_kind[name]} == {("t1", "recommended")}
    rows = catalog.settings_of("t1").set_index("setting")
    assert rows.loc["required.zones", "value"] == "top (monthly 2), side (yearly 1)"
    assert rows.loc["required.zones", "from"] == "kind box, structure t1"
    # a zone that is carried from a structure follows its mesh
    catalog.require("structure", "t1", "yearly", [{**zone, "on": "t2"}], "Ada")
    carried = keys(catalog)["t1", "recommended"]
    catalog.add_structures([structure("t2", 3)])
    assert keys(catalog)["t1", "recommended"] not in (carried, own["t1", "recommended"])
    for owner in (("kind", "box", "monthly"), ("structure", "t1", "yearly")):
        catalog.require(*owner, [], "Ada")
    assert keys(catalog)["t1", "recommended"] == usual["t1", "recommended"]
    assert (
        catalog.settings_of("t1").set_index("setting").loc["required.zones", "from"] == "preset recommended"
    )
    with pytest.raises(SettingsError, match="upplied require"):
        catalog.set("kind", "box", {"required.zones": "abc"}, "Ada")


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
    assert not len(catalog.declared_settings())
