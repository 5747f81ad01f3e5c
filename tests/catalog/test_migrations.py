"""Catalogs of every schema that there was, and programs older than a catalog."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from catalog_records import demonstration, differences, key_of, plan, structure
from deltalake import DeltaTable

from upplied.catalog import compact, export_dataset, export_tables, import_dataset, open_catalog, verify
from upplied.catalog.database import Catalog
from upplied.catalog.schema import tables
from upplied.catalog.schema.tables import TYPES, Column, Table
from upplied.catalog.store import delta, opening
from upplied.catalog.verbs import adding
from upplied.errors import CatalogError
from upplied.records import Camera, Trajectory

RELEASED = sorted(path.name for path in (Path(__file__).parent / "released").iterdir())


@pytest.fixture(params=RELEASED)
def older(request, tmp_path) -> Path:
    """A catalog and an export as that version wrote them, from the records of these tests."""
    return Path(shutil.copytree(Path(__file__).parent / "released" / request.param, tmp_path / "older"))


def content(place: Path) -> dict[str, bytes]:
    return {str(path.relative_to(place)): path.read_bytes() for path in place.rglob("*") if path.is_file()}


def older_schema(place: Path) -> int:
    return int(json.loads((place / "export" / "dataset.json").read_text())["schema_version"])


def check_older(catalog: Catalog) -> None:
    """Everything that was put into the released catalogs comes back equal."""
    assert differences(structure("boxy"), catalog.structure("boxy")) == []
    assert differences(structure("target", 1, notes="repainted"), catalog.structure("target")) == []
    versions = catalog.structures(every=True).query("structure_id in ('boxy', 'target')")
    assert list(versions["version"])[:3] == [1, 1, 2]
    # Cameras were known by less when these catalogs were written.
    camera = Camera(80.0, 60.0, 1.5, 40.0, 1920, 1080)
    assert differences(demonstration(camera=camera, stills=False), catalog.demonstration("flight")) == []
    assert set(catalog.transfers()["key"]) >= {key_of("second"), key_of("refused")}
    assert key_of("first") not in set(catalog.transfers()["key"])
    for name, seed in (("first", 1), ("second", 2)):
        check_path(catalog.plan(key_of(name)[:20]).trajectory, seed)
    assert verify(catalog) == []


def check_path(path: Trajectory, seed: int) -> None:
    """The random records of the tests draw one number more for every measure that came since."""
    assert len(path) == 60
    expected = plan("target", seed).trajectory
    assert (path.t_s[0] == expected.t_s[0]) == (differences(expected, path) == [])


def test_an_older_catalog_is_read_as_it_is_and_not_changed(older):
    before = content(older / "catalog")
    catalog = open_catalog(older / "catalog")
    check_older(catalog)
    assert set(catalog.structures()["overruled"]) == set(catalog.demonstrations()["overruled"]) == {""}
    assert catalog.overruled().empty
    assert content(older / "catalog") == before


@pytest.mark.slow
def test_an_older_catalog_takes_rows_and_keeps_all_it_had(older, tmp_path):
    catalog = open_catalog(older / "catalog")
    had = catalog.transfers(every=True)
    assert list(had["added_at"]) == list(had["planned_at"]) or older_schema(older) > 1
    early = catalog.structures(every=True)["added_at"].max()
    catalog.add_plans([(key_of("boxy"), plan("boxy", 4, preset="baseline"), {})])
    overruled = json.dumps([{"rule": "size", "severity": "refuse", "found": "too large", "overruled": True}])
    catalog.add_structures([structure("third", 3, verdicts_json=overruled)])
    rows = catalog.structures().set_index("structure_id")["overruled"]
    assert rows["third"] == "size" and set(rows.drop("third")) == {""}
    check_older(open_catalog(older / "catalog"))
    row = {"transfer_id": key_of("second")[:20], "way": "export", "format": "csv", "rule": "preset"}
    assert [catalog.add_overruled([{**row, "found": "preset paper"}]) for _ in range(2)] == [1, 0]
    assert list(catalog.overruled(key_of("second")[:20])["rule"]) == ["preset"]
    compact(catalog)
    check_older(open_catalog(older / "catalog"))
    catalog.add_plans([(key_of("first"), plan("target", 1), {})])  # an older plan is current again
    assert key_of("second") not in set(catalog.transfers()["key"])
    catalog.retire_structures(["target"])
    assert "target" not in set(catalog.structures()["structure_id"])
    assert set(catalog.structures(as_of=early)["structure_id"]) == {"boxy", "target"}
    assert verify(catalog) == []
    export_tables(catalog, tmp_path / "reports")
    export_dataset(catalog, tmp_path / "set", "boxes-v2", catalog.transfers(every=True), "CC0-1.0")
    import_dataset(open_catalog(tmp_path / "to"), tmp_path / "set")


def test_an_older_catalog_that_nobody_wrote_to_is_compacted(older):
    catalog = open_catalog(older / "catalog")
    assert compact(catalog)["transfers"] > 1
    check_older(open_catalog(older / "catalog"))
    assert verify(catalog) == []


def test_an_older_export_is_imported(older, tmp_path):
    catalog = open_catalog(tmp_path / "to")
    assert import_dataset(catalog, older / "export") == {"structures": 2, "demonstrations": 1, "transfers": 2}
    check_path(catalog.plan(key_of("second")[:20]).trajectory, 2)
    assert verify(catalog) == []
    assert sum(import_dataset(catalog, older / "export").values()) == 0


def test_every_schema_version_is_in_the_released_ones():
    """Raising the version without keeping a catalog of the one before fails here."""
    versions = {
        json.loads((Path(__file__).parent / "released" / name / "export" / "dataset.json").read_text())[
            "schema_version"
        ]
        for name in RELEASED
    }
    assert versions >= set(range(1, tables.SCHEMA_VERSION))


def test_an_older_program_refuses_a_newer_catalog_in_words(tmp_path, monkeypatch):
    catalog = open_catalog(tmp_path)
    catalog.add_structures([structure("boxy")])
    monkeypatch.setattr(opening, "SCHEMA_VERSION", 1)
    for again in (catalog, open_catalog(tmp_path)):
        for ask in (again.structures, lambda again=again: again.add_structures([structure("other")])):
            with pytest.raises(CatalogError, match=r"schema version 3.*at most 1.*newer version of upplied"):
                ask()


def newer(table: Table) -> Table:
    more = (
        Column("battery_wh", TYPES["real"], "Wh", "of a newer program"),
        Column("passport", TYPES["text"], "", "also"),
    )
    return replace(table, columns=(*table.columns, *more))


@pytest.fixture
def both(tmp_path) -> tuple[Catalog, Catalog]:
    """A catalog as a newer program has it open, whose tables have more columns, and as this one has."""
    ours, theirs = open_catalog(tmp_path), open_catalog(tmp_path)
    for name in ("transfers", "structures"):
        theirs.tables[name] = delta.StoredTable(theirs.location, newer(tables.TABLES[name]))
    ours.add_structures([structure("boxy"), structure("target", 1)])
    ours.add_demonstrations([demonstration()])
    return ours, theirs


def written(theirs: Catalog, name: str, rows: list[dict]) -> None:
    """Rows of a newer program: ours, with its columns filled."""
    table = theirs.tables[name]
    stored = table.read()
    for at, column in enumerate(stored.column_names):
        if column in ("battery_wh", "passport"):
            value = [77.0 if column == "battery_wh" else "p"] * len(stored)
            stored = stored.set_column(at, stored.schema.field(column), [value])
    table.append(stored)


def test_what_a_newer_program_wrote_outlives_an_older_ones_compaction(both):
    ours, theirs = both
    for number in range(3):
        ours.add_plans([(key_of(number), plan("target", number), {})])
    written(theirs, "transfers", [])
    ours.add_plans([(key_of(9), plan("boxy", 9), {})])  # the older program goes on writing
    values = sorted(map(str, theirs.tables["transfers"].read(None, ["battery_wh"])["battery_wh"].to_pylist()))
    assert values == ["77.0"] * 3 + ["None"] * 4
    assert compact(ours)["transfers"] == 5
    again = delta.StoredTable(theirs.location, newer(tables.TABLES["transfers"]))
    assert sorted(map(str, again.read(None, ["battery_wh"])["battery_wh"].to_pylist())) == values
    assert len(ours.transfers(every=True)) == 4
    assert verify(ours) == []


def test_what_a_newer_program_wrote_stays_in_a_row_that_an_older_one_repeats(both):
    ours, theirs = both
    for number in range(2):
        ours.add_plans([(key_of(number), plan("target", number), {})])
    written(theirs, "transfers", [])
    written(theirs, "structures", [])
    ours.add_plans([(key_of(0), plan("target", 0), {})])
    assert list(ours.transfers()["key"]) == [key_of(0)]
    ours.retire_structures(["boxy"])
    for name in ("transfers", "structures"):
        rows = theirs.tables[name].read().to_pandas().sort_values("commit_version")
        assert rows.iloc[-1]["battery_wh"] == 77.0, name
        assert rows.iloc[-1]["passport"] == "p", name


def test_an_export_that_lacks_a_column_that_was_always_there_is_refused(older, tmp_path):
    import hashlib

    path = older / "export" / "transfers.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["target_id"]), path)
    about = json.loads((older / "export" / "dataset.json").read_text())
    about["files"]["transfers.parquet"] = hashlib.sha256(path.read_bytes()).hexdigest()
    (older / "export" / "dataset.json").write_text(json.dumps(about))
    with pytest.raises(CatalogError, match="target_id"):
        import_dataset(open_catalog(tmp_path / "to"), older / "export")


@pytest.fixture
def catalog(tmp_path) -> Catalog:
    return open_catalog(tmp_path / "catalog")


def plans(count: int) -> list:
    return [(key_of(at), plan(f"t{at}", at), {}) for at in range(count)]


def test_a_catalog_of_a_newer_program_is_left_alone(catalog, monkeypatch):
    monkeypatch.setattr(opening, "SCHEMA_VERSION", tables.SCHEMA_VERSION + 1)
    catalog.add_plans(plans(1))
    monkeypatch.undo()
    older = open_catalog(catalog.location)
    before = DeltaTable(older.tables["transfers"].uri).version()
    for act in (older.transfers, lambda: older.add_plans(plans(2))):
        with pytest.raises(CatalogError, match="newer version of upplied"):
            act()
    assert DeltaTable(older.tables["transfers"].uri).version() == before


def test_a_catalog_of_an_older_program_gains_the_new_columns(catalog, monkeypatch):
    declared = tables.TABLES["transfers"]
    old = replace(declared, columns=tuple(c for c in declared.columns if c.name != "runner_up_gap"))
    monkeypatch.setattr(catalog.tables["transfers"], "declared", old)
    monkeypatch.setitem(adding.TABLES, "transfers", old)
    catalog.add_plans(plans(1))
    monkeypatch.undo()
    newer = open_catalog(catalog.location)
    assert newer.transfers()["runner_up_gap"].isna().all()
    newer.add_plans(plans(2))
    assert newer.transfers()["runner_up_gap"].notna().sum() == 1
    assert len(newer.trajectory(key_of(0)[:20])) == 60
