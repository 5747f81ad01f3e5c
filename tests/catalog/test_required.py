"""Zones that must be seen: versions, what is refused, and whose they are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from catalog_records import copied, structure

from upplied.catalog import open_catalog
from upplied.catalog.database import Catalog
from upplied.catalog.verbs.belonging import Zones
from upplied.errors import CatalogError, SettingsError

ROOF = {"zone": "roof", "where": "box 0 0 9 10 10 10"}
SIDE = {"zone": "side", "where": "box 0 0 0 1 10 10", "looks": 2, "gsd_mm": 3.0}


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure("boxy"), structure("other", 1)])
    return catalog


@pytest.fixture
def catalog(begun, tmp_path) -> Catalog:
    return copied(begun, tmp_path / "catalog")


def requirements(catalog: Catalog, every: bool = False) -> list[tuple[str, str, int, str]]:
    rows = catalog.requirements(every=every).to_dict("records")
    return [(row["owner"], row["name"], row["version"], row["by"]) for row in rows]


def test_each_set_of_an_owner_has_its_versions_and_the_last_one_holds(catalog: Catalog) -> None:
    kind = catalog.structure("boxy").kind
    assert catalog.require("kind", kind, "monthly", [ROOF], "Ada") == 1
    assert catalog.require("structure", "boxy", "monthly", [ROOF, SIDE], "Bob") == 1
    assert catalog.require("kind", kind, "monthly", [SIDE], "Cyd") == 1
    assert catalog.require("kind", kind, "yearly", [ROOF], "Ada") == 1
    expected = [("boxy", "monthly", 1, "Bob"), (kind, "monthly", 2, "Cyd"), (kind, "yearly", 1, "Ada")]
    assert requirements(catalog) == expected
    assert requirements(catalog, every=True) == [(kind, "monthly", 1, "Ada"), *expected]
    mine = [
        (row["set"], row["version"], row["asked_by"], row["zone"]) for row in Zones(catalog).of(kind, "boxy")
    ]
    assert mine == [
        ("monthly", 2, f"kind {kind}", "side"), ("yearly", 1, f"kind {kind}", "roof"),
        ("monthly", 1, "structure boxy", "roof"), ("monthly", 1, "structure boxy", "side"),
    ]  # fmt: skip
    assert [row["zone"] for row in Zones(catalog).of(kind, "other")] == ["side", "roof"]
    assert Zones(catalog).of("another", "unknown") == []


def test_a_set_of_no_zones_takes_it_back(catalog: Catalog) -> None:
    catalog.require("structure", "boxy", "monthly", [ROOF], "Ada")
    catalog.require("structure", "boxy", "monthly", [], "Ada")
    assert requirements(catalog) == [] and len(requirements(catalog, every=True)) == 2
    catalog.require("structure", "boxy", "monthly", [SIDE], "Ada")
    assert requirements(catalog) == [("boxy", "monthly", 3, "Ada")]


@pytest.mark.parametrize(
    ("zone", "why"),
    [
        ({"where": "a"}, "has no zone"),
        ({"zone": "a"}, "has no where"),
        ({"zone": " ", "where": "a"}, "has no zone"),
        ({"zone": "a", "where": "b", "colour": 1}, "has 'colour'"),
        ({"zone": "a", "where": "b", "looks": 0}, "looks is 0"),
        ({"zone": "a", "where": "b", "looks": True}, "looks is True"),
        ({"zone": "a", "where": "b", "looks": 1.5}, "looks is 1.5"),
        ({"zone": "a", "where": "b", "on": 3}, "is on 3"),
        ({"zone": "a", "where": "b", "gsd_mm": 0}, "gsd_mm is 0"),
        ({"zone": "a", "where": "b", "gsd_mm": True}, "gsd_mm is True"),
        ({"zone": "a", "where": "b", "incidence_deg": 91}, "incidence_deg is 91"),
        ({"zone": "a", "where": "b", "max_age_days": "x"}, "max_age_days is 'x'"),
    ],
)
def test_zones_that_cannot_be_asked_for_are_refused(catalog: Catalog, zone: dict[str, Any], why: str) -> None:
    with pytest.raises(SettingsError, match=why):
        catalog.require("structure", "boxy", "monthly", [zone], "Ada")
    assert not len(catalog.requirements(every=True))


def test_limits_themselves_may_be_asked_for(catalog: Catalog) -> None:
    zone = {"zone": "a", "where": "b", "looks": 1, "on": "other", "incidence_deg": 90}
    assert catalog.require("structure", "boxy", "monthly", [zone], "Ada") == 1
    (requirement,) = Zones(catalog).of("none", "boxy")
    assert {key: requirement[key] for key in zone} == zone


def test_whose_and_by_whom_must_be_known(catalog: Catalog) -> None:
    with pytest.raises(SettingsError, match="has nobody who says so"):
        catalog.require("structure", "boxy", "monthly", [ROOF], " ")
    for scope, owner in (("structure", "nowhere"), ("kind", "boxy"), ("site", "boxy")):
        with pytest.raises((CatalogError, SettingsError)):
            catalog.require(scope, owner, "monthly", [ROOF], "Ada")


def test_a_zone_is_named_once_and_found_on_a_structure_of_its_kind(catalog: Catalog) -> None:
    catalog.add_structures([replace(structure("odd", 2), kind="odd_kind")])
    cases = [
        ([ROOF, ROOF], "twice"),
        ([{**ROOF, "on": "odd"}], "is on 'odd'"),
        ([{**ROOF, "on": "x"}], "is on"),
    ]
    for zones, why in cases:
        with pytest.raises(SettingsError, match=why):
            catalog.require("structure", "boxy", "monthly", zones, "Ada")
    assert catalog.require("structure", "boxy", "monthly", [ROOF, {**SIDE, "on": "other"}], "Ada") == 1
