"""Generations of a publication: which may follow which, and what is kept of older ones."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from upplied.catalog.schema.tables import TABLES
from upplied.catalog.verbs.published import Before, Generation, check, clean, current, switch
from upplied.errors import CatalogError


def draft(place: Path, **files: str) -> Path:
    folder = place / "tables" / ".new.draft"
    folder.mkdir(parents=True)
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def names(place: Path) -> list[str]:
    return sorted(path.name for path in (place / "tables").iterdir())


def test_what_must_not_be_replaced_is_not(tmp_path: Path) -> None:
    def may(before: Generation, now: Generation, transfers: int = 1) -> None:
        check(tmp_path, before, now, transfers)

    may(Generation(), Generation("one"))
    may(Generation("one"), Generation())
    may(Generation("one", {"transfers": 3}), Generation("one", {"transfers": 3, "flights": 1}))
    with pytest.raises(CatalogError, match="another catalog"):
        may(Generation("one"), Generation("two"))
    with pytest.raises(CatalogError, match="newer publication: transfers had come further"):
        may(
            Generation("one", {"transfers": 4, "flights": 1}),
            Generation("one", {"transfers": 3, "flights": 1}),
        )
    with pytest.raises(CatalogError, match="newer publication: flights"):
        may(Generation("one", {"flights": 0}), Generation("one"))
    with pytest.raises(CatalogError, match="holds 7 transfers, the catalog has none"):
        may(Generation("one", rows={"transfers": 7}), Generation("one"), 0)
    may(Generation("one", rows={"transfers": 7}), Generation("one"), 1)
    may(Generation("one", rows={"transfers": 0}), Generation("one"), 0)


def test_a_draft_becomes_the_current_generation(tmp_path: Path) -> None:
    assert current(tmp_path) == Generation()
    generation = Generation(
        "one", {"transfers": 3}, {"transfers": 5}, "x", {"transfers": 7}, {"transfers": {"box": 5}}
    )
    for number in (1, 2, 3):
        switch(tmp_path, draft(tmp_path, text=str(number)), generation)
        assert os.readlink(tmp_path / "tables" / "current") == f"g{number:06d}"
        assert (tmp_path / "tables" / "current" / "text").read_text() == str(number)
    assert names(tmp_path) == ["current", "g000002", "g000003"]
    assert current(tmp_path) == generation
    for table in TABLES:
        assert os.readlink(tmp_path / f"{table}.parquet") == f"tables/current/{table}.parquet"
    assert not [path for path in tmp_path.rglob("*") if path.name.endswith(".draft")]


def test_damage_is_told(tmp_path: Path) -> None:
    switch(tmp_path, draft(tmp_path), Generation("one"))
    path = tmp_path / "tables" / "current" / "published.json"
    for text in ("{", json.dumps({"catalog": "one"}), "[]"):
        path.write_text(text)
        with pytest.raises(CatalogError, match="is damaged"):
            current(tmp_path)


def test_what_stopped_publishers_left_goes(tmp_path: Path) -> None:
    for _ in range(2):
        switch(tmp_path, draft(tmp_path), Generation("one"))
    tables = tmp_path / "tables"
    draft(tmp_path, text="left")
    (tables / "g000009").mkdir()  # never switched to
    (tables / "g12").mkdir()  # nobody's
    os.symlink("nowhere", tmp_path / ".transfers.parquet.1.draft")
    clean(tables)
    assert names(tmp_path) == ["current", "g000001", "g000002", "g12"]
    assert not os.path.lexists(tmp_path / ".transfers.parquet.1.draft")


def test_without_a_current_one_all_are_kept(tmp_path: Path) -> None:
    for name in ("g000001", "g000002", "g000003"):
        (tmp_path / "tables" / name).mkdir(parents=True)
    clean(tmp_path / "tables")
    assert len(names(tmp_path)) == 3


def test_files_of_before_are_taken_over(tmp_path: Path) -> None:
    switch(tmp_path, draft(tmp_path, file="old"), Generation("one"))
    folder, before = draft(tmp_path), Before(tmp_path / "tables", current(tmp_path))
    assert before.linked(folder, "file")
    assert (folder / "file").read_text() == "old" and (folder / "file").stat().st_nlink == 2
    assert not before.linked(folder, "gone")
    assert not Before(tmp_path / "nowhere", Generation()).linked(folder, "file")


def test_what_is_newest_is_told_by_the_last_rows_and_by_its_files(tmp_path: Path) -> None:
    generation = Generation("one", columns="x", added={"flights": 7, "transfers": 8})
    switch(tmp_path, draft(tmp_path, file="old"), generation)
    before = Before(tmp_path / "tables", current(tmp_path))
    assert before.is_newest(generation)
    others = ({"catalog": "two"}, {"columns": "y"}, {"added": {"flights": 7, "transfers": 9}})
    for other in others:
        assert not before.is_newest(replace(generation, **other)), other
    assert generation.has_same("flights", replace(generation, added={"flights": 7}))
    (tmp_path / "tables" / "current" / "file").unlink()
    assert not Before(tmp_path / "tables", current(tmp_path)).is_newest(generation), "a file is gone"


def test_a_file_is_found_by_what_it_is_whatever_it_holds(tmp_path: Path) -> None:
    switch(tmp_path, draft(tmp_path, **{"1-of-2-aa.parquet": "one"}), Generation("one"))
    before = Before(tmp_path / "tables", current(tmp_path))
    like = before.like("1-of-2-cc.parquet")
    assert like is not None and like.read_text() == "one"
    for file in ("2-of-2-cc.parquet", "1-of-4-aa.parquet", "plain.parquet"):
        assert before.like(file) is None, "a file that is gone, of other parts, or of no parts"
    assert Before(tmp_path / "nowhere", Generation()).like("1-of-2-aa.parquet") is None
