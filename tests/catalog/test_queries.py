"""Questions to the catalog, against the same question asked of a plain list of rows."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pandas as pd
import pytest
from catalog_records import demonstration, key_of, plan, structure

from upplied.catalog import open_catalog
from upplied.catalog.store.delta import StoredTable
from upplied.catalog.verbs import ordering
from upplied.errors import CatalogError, SettingsError

START = datetime(2026, 3, 1, tzinfo=UTC)


@pytest.fixture(scope="module")
def catalog(tmp_path_factory):
    """Twelve nights of plans, some of them refused or failed, some of them superseded."""
    catalog = open_catalog(tmp_path_factory.mktemp("nights"))
    catalog.add_structures([structure(f"t{at}", at, site=f"site {at % 2}") for at in range(6)])
    catalog.add_demonstrations([demonstration()])
    rng = np.random.default_rng(0)
    for night in range(12):
        batch = []
        for target in range(6):
            status = rng.choice(["ok", "ok", "refused", "failed"])
            preset = rng.choice(["paper", "recommended"])
            item = plan(f"t{target}", int(rng.integers(1000)), status=status, preset=preset)
            attributes = {
                "planned_at": START + timedelta(days=night, minutes=target),
                "run_id": f"night-{night}",
            }
            batch.append((key_of(night, target), item, attributes))
        catalog.add_plans(batch)
    return catalog


@pytest.fixture(scope="module")
def every(catalog) -> pd.DataFrame:
    """All rows, read without any of our questions."""
    return catalog.tables["transfers"].read().to_pandas()


def newest(rows: pd.DataFrame) -> dict:
    """The newest plan of each pair and preset, by a loop."""
    by_target: dict = {}
    for row in rows.sort_values(["commit_version", "planned_at"]).itertuples():
        by_target[row.demonstration_id, row.target_id, row.preset] = row.key
    return by_target


def keys(frame: pd.DataFrame) -> list[str]:
    assert frame["key"].is_unique
    return sorted(frame["key"])


def test_the_newest_plan_of_each_pair_and_preset(catalog, every):
    assert keys(catalog.transfers()) == sorted(newest(every).values())
    assert keys(catalog.transfers(every=True)) == sorted(every["key"])


@pytest.mark.parametrize("status", ["ok", "refused", "failed"])
def test_a_status_is_that_of_the_newest_plan(catalog, every, status):
    current = every[every["key"].isin(newest(every).values())]
    assert keys(catalog.transfers(status=status)) == sorted(current[current["status"] == status]["key"])


@pytest.mark.parametrize(
    ("question", "column", "value"),
    [
        ({"structure": "t3"}, "target_id", "t3"),
        ({"preset": "paper"}, "preset", "paper"),
        ({"demonstration": "flight"}, "demonstration_id", "flight"),
        ({"kind": "box"}, "kind", "box"),
        ({"kind": "ship"}, "kind", "ship"),
    ],
)
def test_questions_about_pairs(catalog, every, question, column, value):
    assert keys(catalog.transfers(**question)) == sorted(newest(every[every[column] == value]).values())


def test_a_site_is_that_of_the_target(catalog, every):
    there = every[every["target_id"].isin(["t1", "t3", "t5"])]
    assert keys(catalog.transfers(site="site 1")) == sorted(newest(there).values())


@pytest.mark.parametrize("night", [0, 3, 11])
def test_as_of_a_moment(catalog, every, night):
    until = every[every["run_id"] == f"night-{night}"]["added_at"].max()
    expected = sorted(newest(every[every["added_at"] <= until]).values())
    assert keys(catalog.transfers(as_of=until)) == expected
    assert keys(catalog.transfers(as_of=until.strftime("%Y-%m-%d %H:%M:%S.%f"))) == expected
    assert keys(catalog.transfers(as_of=until.astimezone(tz=None))) == expected


def test_as_of_a_version_is_what_was_committed_then(catalog, every):
    for version in (1, 5, 12):
        rows = every[every["run_id"].isin([f"night-{night}" for night in range(version)])]
        assert keys(catalog.transfers(version=version)) == sorted(newest(rows).values())
    with pytest.raises(CatalogError, match="version 99"):
        catalog.transfers(version=99)


def test_since_chooses_among_the_newest(catalog, every):
    since = START + timedelta(days=9)
    current = every[every["key"].isin(newest(every).values())]
    assert keys(catalog.transfers(since=since)) == sorted(current[current["planned_at"] >= since]["key"])


def test_columns_and_their_units(catalog):
    rows = catalog.transfers(columns=["target_id", "frechet_m"])
    assert list(rows.columns) == ["target_id", "frechet_m"]
    assert rows.attrs["units"]["frechet_m"] == "m"
    with pytest.raises(SettingsError, match="frechet_km"):
        catalog.transfers(columns=["frechet_km"])
    with pytest.raises(SettingsError, match="yesterdayish"):
        catalog.transfers(as_of="yesterdayish")


def test_structures_by_kind_and_site_and_moment(catalog):
    assert len(catalog.structures(kind="box")) == 6
    assert catalog.structures(kind="ship").empty
    assert list(catalog.structures(site="site 0")["structure_id"]) == ["t0", "t2", "t4"]
    assert catalog.structures(as_of="2026-01-01").empty
    assert len(catalog.demonstrations(structure="boxy")) == 1


def test_retired_targets_have_no_current_plan_but_their_history(tmp_path):
    catalog = open_catalog(tmp_path)
    catalog.add_structures([structure("target"), structure("other")])
    catalog.add_plans([(key_of(at), plan(name), {}) for at, name in enumerate(("target", "other"))])
    before = datetime.now(UTC)
    catalog.retire_structures(["target"])
    assert list(catalog.transfers()["target_id"]) == ["other"]
    assert len(catalog.transfers(every=True)) == 2
    assert len(catalog.transfers(as_of=before)) == 2
    assert len(catalog.trajectory(key_of(0)[:20])) == 60
    catalog.add_structures([structure("target")])
    assert len(catalog.transfers()) == 2


def test_a_trajectory_at_any_time(catalog):
    name = catalog.transfers(status="ok", preset="recommended")["transfer_id"].iloc[0]
    path = catalog.trajectory(name)
    exact = path.at(path.t_s)
    assert np.allclose(exact.positions, path.positions, atol=1e-12)
    between = path.at(path.t_s[3:5].mean())
    assert np.allclose(between.positions[0], path.positions[3:5].mean(axis=0))
    assert np.allclose(path.at([-5.0, 1e9]).positions, path.positions[[0, -1]])
    assert len(path.at(0.0)) == 1


def test_reading_one_column_of_one_plan_does_not_read_the_others(catalog):
    """The rows of other commits are skipped by the statistics of the files."""
    row = catalog.transfer(catalog.transfers(status="ok")["transfer_id"].iloc[0])
    dataset = catalog.tables["waypoints"].dataset()
    import pyarrow.compute as pc

    files = list(dataset.get_fragments(filter=pc.field("commit_id") == row["commit_id"]))
    assert len(files) == 1
    assert len(list(dataset.get_fragments())) > 6


def test_of_a_few_plans_no_others_are_read_whole(catalog, every, monkeypatch):
    """However many there are of which their names choose."""
    read: set[str] = set()
    batches = StoredTable.batches

    def noted(table: StoredTable, columns: list[str], *arguments: object):
        for rows in batches(table, columns, *arguments):
            if "settings_json" in columns:
                read.update(rows["transfer_id"].to_pylist())
            yield rows

    monkeypatch.setattr(StoredTable, "batches", noted)
    chosen = sorted(every["transfer_id"].head(2))
    rows = catalog.transfers(every=True, ids=chosen)
    assert sorted(rows["transfer_id"]) == chosen
    assert read == set(chosen)


def test_named_columns_say_what_the_whole_rows_say(catalog):
    whole = catalog.transfers(every=True)
    for names in (["reason", "n_waypoints", "state"], list(whole)[::-1]):
        pd.testing.assert_frame_equal(catalog.transfers(every=True, columns=names), whole[names])


def test_retired_is_what_the_newest_version_says(tmp_path):
    catalog = open_catalog(tmp_path)
    catalog.add_structures([structure("a"), structure("b", 1), structure("c", 2)])
    catalog.retire_structures(["a", "b"])
    catalog.add_structures([structure("a")])
    table = catalog.tables["structures"]
    assert ordering.retired(table) == ["b"]
    assert ordering.retired(table) == [
        name for name, row in sorted(ordering.newest_rows(table).items()) if row["retired"]
    ]
