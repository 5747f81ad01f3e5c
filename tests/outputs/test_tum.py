"""Trajectories as text for `evo`, and splits that keep structures apart."""

from __future__ import annotations

import json

import numpy as np
import pytest
from catalog_records import copied, demonstration, key_of, plan, structure

from upplied.catalog import open_catalog
from upplied.catalog.database import Catalog
from upplied.catalog.verbs.exporting import split_of
from upplied.cli import main
from upplied.errors import InputError
from upplied.outputs.learning import export_tum


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure("boxy"), *(structure(f"t{at}", at) for at in range(12))])
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans([(key_of(at), plan(f"t{at}", at), {}) for at in range(12)])
    catalog.add_plans([(key_of("no"), plan("t0", status="refused", preset="paper"), {})])
    return catalog


@pytest.fixture
def catalog(begun, tmp_path) -> Catalog:
    return copied(begun, tmp_path / "catalog")


def test_every_trajectory_is_a_file_that_evo_reads(catalog, tmp_path):
    assert export_tum(catalog, tmp_path / "out", catalog.transfers()) == {"plans": 12, "demonstrations": 1}
    actual = np.loadtxt(tmp_path / "out" / "plans" / f"{key_of(3)[:20]}.txt")
    path = plan("t3", 3).trajectory
    assert np.allclose(actual, np.column_stack([path.t_s, path.positions, path.quat_xyzw]), atol=1e-8)
    flown = np.loadtxt(tmp_path / "out" / "demonstrations" / "flight.txt")
    assert np.allclose(flown[:, 1:4], demonstration().positions, atol=1e-8)
    assert np.allclose(flown[:, 0], demonstration().t_ns * 1e-9, atol=1e-6)
    with pytest.raises(InputError, match="not empty"):
        export_tum(catalog, tmp_path / "out", catalog.transfers())


def test_no_structure_is_on_two_sides(catalog, tmp_path):
    export_tum(catalog, tmp_path / "out", catalog.transfers())
    splits = json.loads((tmp_path / "out" / "splits.json").read_text())["by_structure"]
    sides = [set(side["structures"]) for side in splits.values()]
    assert sum(map(len, sides)) == len(set.union(*sides)) == 13
    assert all(sides)
    targets = {key_of(at)[:20]: f"t{at}" for at in range(12)}
    for side in splits.values():
        assert {targets[name] for name in side["plans"]} == set(side["structures"]) - {"boxy"}


def test_splits_are_the_same_everywhere_and_hold_every_kind():
    kinds = {f"{kind}{at}": kind for kind, count in (("a", 20), ("b", 3), ("c", 1)) for at in range(count)}
    splits = split_of(kinds)
    assert splits == split_of(dict(reversed(list(kinds.items()))))
    counts = {kind: [splits[name] for name in kinds if kinds[name] == kind] for kind in "abc"}
    assert [counts["a"].count(side) for side in ("train", "validation", "test")] == [16, 2, 2]
    assert sorted(counts["b"]) == ["test", "train", "validation"]
    assert counts["c"] == ["train"]


@pytest.mark.parametrize("format", ["parquet", "lerobot", "tum"])
def test_the_command_writes_every_format(catalog, tmp_path, capsys, format):
    arguments = [
        "catalog",
        "export",
        str(tmp_path / "set-v1"),
        "--format",
        format,
        "--catalog",
        catalog.location,
    ]
    assert main([*arguments, *(["--licence", "CC0-1.0"] if format == "parquet" else [])]) == 0
    assert list((tmp_path / "set-v1").rglob("splits.json"))
    if format == "parquet":
        assert main(["catalog", "import", str(tmp_path / "set-v1"), "--catalog", str(tmp_path / "to")]) == 0
        assert len(open_catalog(tmp_path / "to").transfers()) == 12


@pytest.mark.parametrize(
    ("number", "size"),
    [(1, 0), (2, 0), (3, 1), (4, 1), (5, 1), (10, 1), (14, 1), (16, 2), (25, 2), (40, 4)],
)
def test_a_tenth_of_each_kind_is_held_back_twice_and_one_of_few(number, size):
    splits = list(split_of({f"s{at}": "ship" for at in range(number)}).values())
    assert splits.count("test") == splits.count("validation") == size
    assert splits.count("train") == number - 2 * size


def test_the_split_is_by_kind_and_by_the_names_alone():
    ships, planes = ({f"{kind}{at}": kind for at in range(12)} for kind in ("ship", "plane"))
    both = split_of(planes | ships)
    assert both == split_of(ships) | split_of(planes)
    from hashlib import sha256

    order = sorted(ships, key=lambda name: sha256(name.encode()).hexdigest())
    assert [both[name] for name in order[:3]] == ["test", "validation", "train"]
