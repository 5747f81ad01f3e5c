"""What plans see and what was flown is the catalog's own: losing the cache loses time alone."""

from __future__ import annotations

import os
import shutil
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from catalog_records import copied, demonstration, differences, key_of, plan, structure

from upplied.catalog import export_dataset, import_dataset, open_catalog, vacuum, verify
from upplied.catalog.database import Catalog
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.contents import Cache
from upplied.errors import CatalogError
from upplied.outputs.verdicts import Flights
from upplied.records import Cloud, SurfaceStates, Trajectory

DAY = 86_400


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure("boxy"), structure("target", 1)])
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans([(key_of(at), plan("target", at), {}) for at in range(3)])
    return catalog


@pytest.fixture
def catalog(begun, tmp_path) -> Catalog:
    return copied(begun, tmp_path / "catalog")


def lose_cache(catalog: Catalog) -> Catalog:
    shutil.rmtree(catalog.cache.folder, ignore_errors=True)
    return open_catalog(catalog.location)


def fly(catalog: Catalog, seed: int = 0, at: int = 0) -> tuple[dict, Trajectory]:
    row = catalog.transfer(key_of(at)[:20])
    path = plan("target", 100 + seed).trajectory
    flight = {name: row[name] for name in ("transfer_id", "waypoints_sha256")}
    flight |= {"flight_id": key_of("flight", at, seed), "seed": seed, "min_clearance_m": 3.0 + seed}
    catalog.add_flight(flight, path)
    return flight, path


def test_surfaces_outlive_the_cache(catalog):
    again = lose_cache(catalog)
    for at in range(3):
        assert differences(plan("target", at).surface, again.surface(key_of(at)[:20])) == []
    assert again.surface(key_of(0)[:20]).state.dtype == np.int64
    assert verify(again) == []


def test_samples_that_plans_share_are_kept_once(catalog):
    surface = plan("target").surface
    for number in range(4):
        other = replace(plan("target", number), surface=replace(surface, state=(surface.state + number) % 5))
        catalog.add_plans([(key_of("more", number), other, {})])
    files = list(Path(catalog.location, "samples").iterdir())
    assert len(files) == 3  # of the three plans before; these four share that of the first
    for number in range(4):
        samples = catalog.surface(key_of("more", number)[:20])
        assert np.array_equal(samples.state, (surface.state + number) % 5)


def test_a_surface_with_normals_and_large_states(catalog):
    surface = SurfaceStates(np.zeros((4, 3)), np.array([0, 4, 300, 70_000]), np.ones((4, 3)))
    sha256 = catalog.surfaces.put(surface)
    assert differences(surface, catalog.surfaces.get(sha256)) == []


def test_a_surface_of_version_0_1_0_is_found_in_the_cache(tmp_path):
    place = shutil.copytree(Path(__file__).parent / "released" / "0.1.0", tmp_path / "older")
    catalog = open_catalog(place / "catalog")
    assert catalog.surface(key_of("second")[:20]).points.shape == (30, 3)
    assert catalog.surface(key_of("refused")[:20]) is None


@pytest.mark.parametrize("folder", ["surfaces", "samples", "flown"])
def test_what_is_damaged_or_gone_is_told(catalog, folder):
    fly(catalog)
    path = sorted(Path(catalog.location, folder).iterdir())[0]
    path.write_bytes(path.read_bytes()[:-100])
    assert [str(path) in finding.what for finding in verify(open_catalog(catalog.location))] == [True]
    path.unlink()
    assert "cannot be read" in verify(open_catalog(catalog.location))[0].found


def test_flights_outlive_the_cache_and_the_last_counts(catalog):
    for seed in (0, 1):
        flight, path = fly(catalog, seed)
    again = lose_cache(catalog)
    assert list(again.flights()["seed"]) == [0, 1]
    row = again.transfer(flight["transfer_id"])
    last = Flights(again).of(row)
    assert flight.items() <= last.items() and differences(path, again.flown(last["flight_sha256"])) == []
    assert Flights(again).of({**row, "waypoints_sha256": "other"}) is None
    assert Flights(again).of(again.transfer(key_of(1)[:20])) is None
    assert again.flights("nothing").empty


def test_a_flight_of_no_plan_is_refused(catalog):
    with pytest.raises(CatalogError, match="not in the catalog"):
        catalog.add_flight({"flight_id": "f", "transfer_id": "nothing"}, plan().trajectory)
    assert catalog.flights().empty


def test_what_is_seen_goes_out_and_in_with_the_plans(catalog, tmp_path):
    export_dataset(catalog, tmp_path / "set", "a-v1", catalog.transfers(every=True), "CC0-1.0")
    other = open_catalog(tmp_path / "to")
    import_dataset(other, tmp_path / "set")
    for at in range(3):
        assert differences(plan("target", at).surface, other.surface(key_of(at)[:20])) == []
    assert verify(other) == []


def test_surfaces_that_no_plan_names_are_removed_when_they_are_old(catalog):
    catalog.keep_surface(plan("target", 77))
    folder = Path(catalog.location, "surfaces")
    assert len(list(folder.iterdir())) == 4
    assert vacuum(catalog).surfaces_removed == 0
    for path in folder.iterdir():
        os.utime(path, (time.time() - 40 * DAY,) * 2)
    other = open_catalog(catalog.location)
    planned = other.keep_surface(plan("target", 77))  # a planner at work counts on it
    assert vacuum(catalog).surfaces_removed == 0
    for path in folder.iterdir():
        os.utime(path, (time.time() - 40 * DAY,) * 2)
    assert vacuum(catalog).surfaces_removed == 1
    assert not (folder / f"{planned.surface_sha256}.parquet").exists()
    assert verify(catalog) == []


def test_entries_of_the_cache_that_were_swapped_are_not_believed(tmp_path):
    cache = Cache(tmp_path)
    keys = [key_of("one"), key_of("two")]
    clouds = [Cloud(np.full((3, 3), number)) for number in (1.0, 2.0)]
    for key, cloud in zip(keys, clouds, strict=True):
        cache.put("clouds", key, cloud)
    paths = [cache.path("clouds", key) for key in keys]
    contents = [path.read_bytes() for path in paths]
    for path, content in zip(paths, reversed(contents), strict=True):
        path.write_bytes(content)
    for key, cloud in zip(keys, clouds, strict=True):
        assert cache.get("clouds", Cloud, key) is None
        assert differences(cloud, cache("clouds", Cloud, key, lambda cloud=cloud: cloud)) == []
        assert differences(cloud, cache.get("clouds", Cloud, key)) == []
    other = cache.path("shapes", keys[0])
    other.parent.mkdir(parents=True)
    shutil.copy(paths[0], other)
    assert cache.get("shapes", Cloud, keys[0]) is None  # of another stage


def test_flights_are_a_table_like_the_others(catalog):
    fly(catalog)
    assert list(catalog.flights().columns) == TABLES["flights"].names
