"""Site and notes of a manifest: no plan depends on them, and the row follows them all the same."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import trimesh
from catalog_records import demonstration

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.fleet import reading
from upplied.samples.fleet import member


@pytest.fixture
def place(tmp_path) -> Path:
    cube = member("cube-v1").structure
    trimesh.Trimesh(cube.vertices, cube.triangles).export(tmp_path / "one.stl")
    return tmp_path


def statuses(place: Path, catalog, site: str = "dock 3", notes: str = "") -> list[str]:
    (place / "structures.toml").write_text(
        f'[[structure]]\nid = "one"\nkind = "box"\npath = "one.stl"\nunits = "m"\nup = "z"\nforward = "x"\n'
        f'site = "{site}"\nnotes = "{notes}"\n'
    )
    return [item.status for item in fleet.ingest_structures(catalog, place / "structures.toml", 1)]


@pytest.mark.slow
def test_corrected_words_reach_the_row_and_make_no_plan_old(place):
    catalog = open_catalog(place / "catalog")
    assert statuses(place, catalog, "dock 3", "painted; new rotor") == ["added"]
    first = catalog.newest("structures", "one")
    catalog.add_demonstrations([demonstration("flown", structure_id="one")])
    request = fleet.PlanRequest(("baseline",))
    keys = [job.key for job in fleet.decide(catalog, request).jobs]
    for site, notes in (
        ("dock 4", "painted; old rotor"),
        ("dock 4", ""),
        ("dock 4", "painted; old rotor"),  # back again: what was read once is not what the row says
    ):
        assert statuses(place, catalog, site, notes) == ["added"], (site, notes)
        row = catalog.newest("structures", "one")
        assert (row["site"], row["sha256"]) == (site, first["sha256"])
        assert row["notes"].split("; ")[: 1 + notes.count(";")] == notes.split("; ") or not notes
        assert "rotor" not in row["notes"] or "rotor" in notes
        assert statuses(place, catalog, site, notes) == ["unchanged"]
    assert len(catalog.structures(every=True)) == 4
    assert [job.key for job in fleet.decide(catalog, request).jobs] == keys
    assert list(catalog.structures(site="dock 4")["structure_id"]) == ["one"]
    assert catalog.structures(site="dock 3").empty


def test_what_says_the_same_is_not_parsed_though_the_cache_is_lost(place, monkeypatch):
    catalog = open_catalog(place / "catalog")
    assert statuses(place, catalog, notes="painted") == ["added"]
    monkeypatch.setattr(reading.Workers, "run", lambda *_: 1 / 0)
    assert statuses(place, catalog, notes="painted") == ["unchanged"]
    shutil.rmtree(catalog.cache.folder)
    assert statuses(place, catalog, notes="painted") == ["unchanged"]
    assert statuses(place, catalog, notes="rusty") == ["failed"]  # it is read, as the patched worker tells
