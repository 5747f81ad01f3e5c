"""What goes out comes in again equal, once, and nothing else comes in."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest
from catalog_records import demonstration, differences, key_of, plan, structure

from upplied.catalog import export_dataset, import_dataset, open_catalog, recipe, verify
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.verbs.exporting import EXCHANGED
from upplied.catalog.verbs.recipes import siblings_of
from upplied.errors import CatalogError, InputError


@pytest.fixture(scope="module")
def catalog(tmp_path_factory):
    catalog = open_catalog(tmp_path_factory.mktemp("from"))
    catalog.add_structures([structure("boxy"), *(structure(f"t{at}", at) for at in range(4))])
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans(
        [(key_of(at), plan(f"t{at}", at), {"run_id": "r", "planning_s": 0.5}) for at in range(3)]
    )
    catalog.add_plans([(key_of(3), plan("t3", status="refused"), {})])
    return catalog


@pytest.fixture
def folder(catalog, tmp_path) -> Path:
    export_dataset(catalog, tmp_path / "set", "boxes-v1", catalog.transfers(), "CC-BY-4.0", "Ada & sons")
    return tmp_path / "set"


def rows(catalog) -> dict[str, int]:
    return {name: len(table.read()) for name, table in catalog.tables.items()}


def test_a_folder_stands_for_itself(folder):
    about = json.loads((folder / "dataset.json").read_text())
    assert about["rows"] == {
        "structures": 5,
        "demonstrations": 1,
        "poses": 50,
        "transfers": 4,
        "waypoints": 180,
    }
    assert "CC-BY-4.0" in (folder / "README.md").read_text()
    assert "Ada & sons" in (folder / "LICENCE.txt").read_text()
    assert "waypoints" in (folder / "DATA_DICTIONARY.md").read_text()
    for name in EXCHANGED:
        assert list(pd.read_parquet(folder / f"{name}.parquet").columns) == TABLES[name].names
    assert set(about["files"]) | {"dataset.json"} == {
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    }


def test_out_and_in_again_is_equal_and_whole(catalog, folder, tmp_path):
    other = open_catalog(tmp_path / "to")
    assert import_dataset(other, folder) == {"structures": 5, "demonstrations": 1, "transfers": 4}
    assert verify(other) == []
    for name in ("boxy", "t2"):
        assert differences(catalog.structure(name), other.structure(name)) == []
    assert differences(catalog.demonstration("flight"), other.demonstration("flight")) == []
    commit = ("commit_id", "added_at", "commit_version", "row_sha256", "imported_from")
    names = [name for name in TABLES["transfers"].names if name not in commit]
    pd.testing.assert_frame_equal(catalog.transfers()[names], other.transfers()[names])
    for name in catalog.transfers()["transfer_id"]:
        assert differences(catalog.plan(name), other.plan(name)) == []
    assert recipe(other, key_of(1)[:20]).differences(plan("t1", 1)) == []


def test_a_second_import_adds_nothing(folder, tmp_path):
    other = open_catalog(tmp_path / "to")
    import_dataset(other, folder)
    before = rows(other)
    assert set(import_dataset(other, folder).values()) == {0}
    assert rows(other) == before


def test_a_part_takes_only_what_it_refers_to(catalog, tmp_path):
    counts = export_dataset(catalog, tmp_path / "one", "one-v2", [key_of(1)[:20]], "CC0-1.0")
    assert counts == {"structures": 2, "demonstrations": 1, "poses": 50, "transfers": 1, "waypoints": 60}
    assert len(list((tmp_path / "one" / "meshes").iterdir())) == 2
    other = open_catalog(tmp_path / "to")
    import_dataset(other, tmp_path / "one")
    assert verify(other) == []


def test_a_name_that_means_something_else_here_is_not_overwritten(folder, tmp_path):
    other = open_catalog(tmp_path / "to")
    other.add_structures([structure("t1", 99)])
    before = rows(other)
    with pytest.raises(CatalogError, match="structures t1"):
        import_dataset(other, folder)
    assert rows(other) == before
    import_dataset(other, folder, replace=True)
    assert len(other.structures(every=True)) == 6
    other.add_structures([structure("t1", 98)])  # newer than what was imported
    assert set(import_dataset(other, folder).values()) == {0}
    assert differences(other.structure("t1"), structure("t1", 98)) == []


def resigned(folder: Path) -> None:
    """Make the hashes of `dataset.json` right again, as somebody would who means harm."""
    from upplied.catalog.verbs.exporting import _sha256

    about = json.loads((folder / "dataset.json").read_text())
    about["files"] = {name: _sha256(folder / name) for name in about["files"]}
    (folder / "dataset.json").write_text(json.dumps(about))


def edited(folder: Path, name: str, change) -> None:
    table = pd.read_parquet(folder / f"{name}.parquet")
    import pyarrow as pa

    rows = pa.Table.from_pandas(change(table), TABLES[name].schema, preserve_index=False)
    pq.write_table(rows, folder / f"{name}.parquet")
    resigned(folder)


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (lambda f: (f / "poses.parquet").unlink(), "poses.parquet: is missing"),
        (lambda f: (f / "poses.parquet").write_bytes(b"PAR1"), "not the file that was exported"),
        (lambda f: (f / "dataset.json").write_text("{"), "cannot be read"),
        (lambda f: (f / "dataset.json").write_text("[1]"), "cannot be read"),
        (lambda f: ((f / "poses.parquet").write_bytes(b"PAR1"), resigned(f)), "has not the declared columns"),
        (lambda f: edited(f, "waypoints", lambda t: t.iloc[:-1]), "do not match their row"),
        (
            lambda f: edited(f, "waypoints", lambda t: t.assign(x_m=t["x_m"] + 1)),
            "do not match their row",
        ),
        (lambda f: edited(f, "poses", lambda t: t.assign(qw=0.5)), "do not match their row"),
        (lambda f: edited(f, "transfers", lambda t: t.assign(status="great")), "transfers.status"),
        (lambda f: edited(f, "transfers", lambda t: t.assign(key="0" * 64)), "does not match its key"),
        (lambda f: edited(f, "transfers", lambda t: t.assign(transfer_id="../x", key="../x")), "got '../x'"),
        (lambda f: edited(f, "structures", lambda t: t.assign(structure_id="<b>")), "got '<b>'"),
        (lambda f: edited(f, "structures", lambda t: t.assign(mesh_sha256="../../up")), "is no hash"),
    ],
)
def test_a_folder_that_is_not_right_adds_nothing(folder, tmp_path, harm, words):
    harm(folder)
    other = open_catalog(tmp_path / "to")
    with pytest.raises((CatalogError, InputError)) as error:
        import_dataset(other, folder)
    assert words in str(error.value)
    assert not (tmp_path / "to").exists() or sum(rows(other).values()) == 0


@pytest.mark.parametrize("name", ["../outside.txt", "/etc/hostname", "meshes/../../outside.txt"])
def test_no_file_outside_the_folder_is_touched(folder, tmp_path, name):
    (folder.parent / "outside.txt").write_text("")
    about = json.loads((folder / "dataset.json").read_text())
    about["files"][name] = "0" * 64
    (folder / "dataset.json").write_text(json.dumps(about))
    with pytest.raises(CatalogError, match="outside the folder"):
        import_dataset(open_catalog(tmp_path / "to"), folder)


def test_a_folder_of_a_newer_program_is_refused(folder, tmp_path):
    about = json.loads((folder / "dataset.json").read_text())
    (folder / "dataset.json").write_text(json.dumps({**about, "schema_version": 99}))
    with pytest.raises(CatalogError, match="schema version 99"):
        import_dataset(open_catalog(tmp_path / "to"), folder)


def test_an_export_says_what_it_lacks(catalog, tmp_path):
    for name in ("boxes", "boxes-v0", "../boxes-v1"):
        with pytest.raises(InputError, match="airliners-v1"):
            export_dataset(catalog, tmp_path / "x", name, catalog.transfers(), "CC0-1.0")
    with pytest.raises(InputError, match="licence"):
        export_dataset(catalog, tmp_path / "x", "a-v1", catalog.transfers(), " ")
    with pytest.raises(CatalogError, match="nothing-like-it"):
        export_dataset(catalog, tmp_path / "x", "a-v1", ["nothing-like-it"], "CC0-1.0")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    with pytest.raises(InputError, match="not empty"):
        export_dataset(catalog, tmp_path / "full", "a-v1", catalog.transfers(), "CC0-1.0")


def test_an_imported_failure_makes_way(catalog, folder, tmp_path):
    other = open_catalog(tmp_path / "to")
    other.add_plans([(key_of(1), replace(plan("t1", status="failed")), {})])
    assert import_dataset(other, folder)["transfers"] == 4
    assert other.transfer(key_of(1)[:20])["status"] == "ok"


def test_a_sibling_that_told_parts_goes_with_its_plans(tmp_path):
    origin = open_catalog(tmp_path / "from")
    sibling, stranger = structure("told", 7), structure("asked", 8)
    origin.add_structures([structure("boxy"), structure("target"), sibling, stranger, structure("other", 9)])
    origin.add_demonstrations([demonstration()])
    siblings = [("asked", stranger.sha256), ("told", sibling.sha256)]
    known = replace(plan("target"), parts_told_by="told")
    origin.add_plans([(key_of(0), known, {"siblings": siblings})])
    (name,) = origin.transfers()["transfer_id"]
    assert [one.structure_id for one in recipe(origin, name).siblings] == ["asked", "told"]
    assert recipe(origin, name).doubts == ()
    assert origin.plan(name).parts_told_by == "told"
    export_dataset(origin, tmp_path / "set", "boxes-v1", origin.transfers(), "CC-BY-4.0", "Ada")
    received = []

    def measured(made_from, of):
        received.extend(made_from.siblings)
        return of.measures

    there = open_catalog(tmp_path / "to")
    import_dataset(there, tmp_path / "set", measured=measured)
    assert [one.structure_id for one in received] == ["told"]
    assert set(there.structures()["structure_id"]) == {"boxy", "target", "told"}
    again = recipe(there, name)
    assert [one.structure_id for one in again.siblings] == ["told"]
    assert any("siblings" in doubt for doubt in again.doubts)


@pytest.mark.parametrize("text", ["{", "[1]", '["ab"]x', '[["a"]]'])
def test_siblings_that_are_no_pairs_are_told(catalog, text):
    row = {**catalog.transfers().iloc[0].to_dict(), "siblings": text}
    with pytest.raises(CatalogError, match="siblings"):
        siblings_of(row)
