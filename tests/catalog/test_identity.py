"""A place that is no catalog is told, and so is a catalog that lost what was committed last."""

from __future__ import annotations

import json
import shutil
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from catalog_records import copied, demonstration, key_of, plan, structure

from upplied.catalog import compact, diff, history, open_catalog, runs, vacuum, verify
from upplied.catalog.database import Catalog
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.opening import Identity
from upplied.cli import main
from upplied.errors import CatalogError
from upplied.fleet import decide, ingest_demonstrations
from upplied.outputs.publish import publish


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure("boxy"), structure("target", 1)])
    catalog.add_demonstrations([demonstration()])
    for seed in range(3):
        catalog.add_plans([(key_of(seed), plan("target", seed), {})])
    return catalog


@pytest.fixture
def catalog(begun, tmp_path) -> Catalog:
    return copied(begun, tmp_path / "catalog")


QUESTIONS = {
    "structures": lambda c, _: c.structures(),
    "demonstrations": lambda c, _: c.demonstrations(),
    "transfers": lambda c, _: c.transfers(),
    "one structure": lambda c, _: c.structure("boxy"),
    "known": lambda c, _: c.settled([key_of(0)], retry_failed=True),
    "as of": lambda c, _: c.transfers(as_of="2026-01-01"),
    "retire": lambda c, _: c.retire_structures(["boxy"]),
    "verify": lambda c, _: verify(c),
    "compact": lambda c, _: compact(c),
    "vacuum": lambda c, _: vacuum(c),
    "history": lambda c, _: history(c),
    "runs": lambda c, _: runs(c),
    "diff": lambda c, _: diff(c, "2026-01-01"),
    "decide": lambda c, _: decide(c),
    "publish": lambda c, place: publish(c, place / "reports"),
    "demonstrations add": lambda c, place: ingest_demonstrations(c, [place / "a.mcap"]),
}


@pytest.mark.parametrize("question", QUESTIONS)
@pytest.mark.parametrize("place", ["missing", "empty", "other"])
def test_what_is_no_catalog_is_an_error(tmp_path, question, place):
    location = tmp_path / place
    if place != "missing":
        location.mkdir()
    if place == "other":
        (location / "photos").mkdir()
        sqlite3.connect(location / "catalog.db").close()
    (tmp_path / "a.mcap").touch()
    before = sorted(location.rglob("*"))
    with pytest.raises(CatalogError, match="is no catalog"):
        QUESTIONS[question](open_catalog(location), tmp_path)
    assert sorted(location.rglob("*")) == before


def test_a_mistyped_catalog_is_an_error_of_the_command(tmp_path, capsys):
    for command in (["catalog", "info"], ["catalog", "verify"], ["report", str(tmp_path / "out")], ["plan"]):
        assert main([*command, "--catalog", str(tmp_path / "catlog")]) == 2
        assert "is no catalog" in capsys.readouterr().err
    assert not (tmp_path / "catlog").exists()
    assert not (tmp_path / "out").exists()


def test_an_empty_catalog_was_made_on_purpose(tmp_path):
    catalog = open_catalog(tmp_path / "new").create()
    assert catalog.transfers().empty
    assert verify(catalog) == []
    name = catalog.identity.id
    assert open_catalog(tmp_path / "new").create().identity.id == name
    assert open_catalog(tmp_path / "other").create().identity.id != name


def test_many_who_make_a_catalog_at_once_agree_on_its_name(tmp_path):
    places = [Identity(str(tmp_path / "new"), list(TABLES)) for _ in range(16)]
    with ThreadPoolExecutor(16) as threads:
        assert len(set(threads.map(lambda place: place.name(), places))) == 1
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["catalog.json"]


def test_a_catalog_of_an_earlier_version_gets_its_name_with_the_next_row(catalog):
    Path(catalog.location, "catalog.json").unlink()
    shutil.rmtree(Path(catalog.location, "heads"))
    again = open_catalog(catalog.location)
    assert len(again.transfers(every=True)) == 3
    assert again.identity.id == ""
    again.add_structures([structure("more", 2)])
    assert open_catalog(catalog.location).identity.id


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"format": "else", "id": "x"}', '{"format": "upplied catalog"}']
)
def test_an_identity_that_is_none_is_told(catalog, text):
    Path(catalog.location, "catalog.json").write_text(text)
    with pytest.raises(CatalogError, match=r"catalog\.json"):
        open_catalog(catalog.location).create()


@pytest.mark.parametrize("lost", [1, 2, 4])
def test_missing_newest_log_entries_are_noticed(catalog, lost):
    log = sorted(Path(catalog.location, "transfers", "_delta_log").glob("*.json"))
    for entry in log[-lost:]:
        entry.unlink()
    again = open_catalog(catalog.location)
    for question in (again.transfers, lambda: again.add_plans([(key_of(9), plan(), {})])):
        with pytest.raises(CatalogError, match=r"missing.*backup"):
            question()
    assert any("missing" in finding and "backup" in finding for finding in map(str, verify(again)))
    assert sorted(Path(catalog.location, "transfers", "_delta_log").glob("*.json")) == log[:-lost]


@pytest.mark.parametrize("table", ["waypoints", "poses"])
def test_steps_that_are_gone_are_noticed(catalog, table):
    shutil.rmtree(Path(catalog.location, "steps", table))
    again = open_catalog(catalog.location)
    with pytest.raises(CatalogError, match=r"0 steps are stored.*backup"):
        again.demonstration("flight") if table == "poses" else again.trajectory(key_of(2)[:20])
    assert any("0 steps" in finding for finding in map(str, verify(again)))


def test_a_table_that_is_gone_is_not_taken_for_an_empty_one(catalog):
    shutil.rmtree(Path(catalog.location, "transfers"))
    with pytest.raises(CatalogError, match="transfers: is missing"):
        open_catalog(catalog.location).transfers()


def test_heads_follow_the_newest_commit_of_all(catalog):
    other = open_catalog(catalog.location)
    other.add_plans([(key_of(7), plan("target", 7), {})])
    catalog.add_plans([(key_of(8), plan("target", 8), {})])
    compact(other)
    for name, table in catalog.tables.items():
        names = [path.name for path in Path(catalog.location, "heads").glob(f"{name}-*")]
        delta = table.delta()  # none where nothing was ever added: no flight was flown here
        assert names == ([] if delta is None else [f"{name}-{delta.version():020}"])


def flip(path: Path, at: int) -> None:
    content = bytearray(path.read_bytes())
    content[at] ^= 1
    path.write_bytes(bytes(content))


@pytest.mark.ci
def test_one_changed_bit_never_becomes_a_trajectory(catalog):
    """Wherever the bit lies and however it is read, the path is the one that was planned, or an error."""
    name, expected = key_of(1)[:20], plan("target", 1).trajectory
    file = next(
        path
        for path in Path(catalog.location, "steps", "waypoints").iterdir()
        if name.encode() in path.read_bytes()
    )
    whole, refusals = file.read_bytes(), 0
    for at in range(4, len(whole) - 8, 311):
        flip(file, at)
        for ask in ("trajectory", "plan", "waypoints"):
            try:
                again = open_catalog(catalog.location)
                force = [["superseded"]] if ask == "trajectory" else []
                record = getattr(again, ask)(name, *force)
            except CatalogError:
                refusals += 1
                continue
            path = record.trajectory if ask == "plan" else record
            t_s, x_m = (path.t_s, path.positions[:, 0]) if ask != "waypoints" else (path["t_s"], path["x_m"])
            assert list(t_s) == list(expected.t_s)
            assert list(x_m) == list(expected.positions[:, 0])
        file.write_bytes(whole)
    assert refusals > 5


@pytest.mark.parametrize("table", ["waypoints", "poses"])
def test_steps_of_another_hash_are_neither_read_nor_published(catalog, tmp_path, table):
    from test_catalog_maintenance import rewrite

    rewrite(
        catalog, table, lambda rows: rows.assign(x_m=rows["x_m"].where(rows.index != 7, rows["x_m"] + 1e-9))
    )
    again = open_catalog(catalog.location)
    with pytest.raises(CatalogError, match="match the hash"):
        again.demonstration("flight") if table == "poses" else [
            again.trajectory(key_of(at)[:20], ["superseded"]) for at in range(3)
        ]
    if table == "poses":
        with pytest.raises(CatalogError, match="match the hash"):
            publish(again, tmp_path / "reports")
        assert not list(tmp_path.glob("reports/*.parquet"))


def test_the_identity_says_what_it_is(catalog):
    identity = json.loads(Path(catalog.location, "catalog.json").read_text())
    assert identity["format"] == "upplied catalog"
    assert len(identity["id"]) == 32
