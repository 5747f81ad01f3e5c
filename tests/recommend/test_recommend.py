"""Retrieval: shapes are known again wherever they lie, and the right flight comes first, and fast."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from calls import calls
from cases import slow_after
from random_members import random_member

from upplied.catalog import Catalog, open_catalog
from upplied.catalog.store.contents import Cache
from upplied.cli import main
from upplied.config import settings_for
from upplied.errors import InputError
from upplied.fleet.reading import gather, learnt_flight, learnt_structure
from upplied.geometry.scene import scene_of
from upplied.inputs.manifests import read_manifest
from upplied.outputs.logs import write_log
from upplied.planning.correspondence.registration import fitted, register
from upplied.planning.surface.samples import surface_samples
from upplied.planning.visibility.observations import TRULY, views
from upplied.recommend.foresee import agreement, foresee, in_sight, inspected
from upplied.recommend.ranking import recommend
from upplied.recommend.shapes import ShapeLibrary, Shapes, library_of, shape_features, unlikeness
from upplied.records import Camera, Cloud
from upplied.samples.fleet import member
from upplied.samples.pilot import fly


def cloud_of(structure) -> Cloud:
    return surface_samples(structure, scene_of(structure), settings_for("recommended").clouds)


@pytest.fixture(scope="module")
def clouds() -> dict[str, Cloud]:
    names = ("a320-v1", "b777-v1", "turbine-1-v1", "turbine-2-v1", "cube-v1", "bridge-1-v1")
    return {name: cloud_of(member(name).structure) for name in names}


@pytest.fixture(scope="module")
def location(tmp_path_factory) -> str:
    """Flights over an airliner, a turbine and a cube, with declared kinds that mislead."""
    catalog = open_catalog(tmp_path_factory.mktemp("recommend") / "catalog")
    flown = [("a320-v1", "fuselage"), ("turbine-1-v1", "tower"), ("cube-v1", "sides")]
    for name, inspection in flown:
        structure = member(name).structure
        catalog.add_structures([replace(structure, kind="thing")])
        catalog.add_demonstrations([fly(structure, inspection)])
    others = [("b777-v1", "ship"), ("turbine-2-v1", "bridge"), ("cuboid-v1", "airliner")]
    catalog.add_structures([replace(member(name).structure, kind=kind) for name, kind in others])
    return str(catalog.location)


def test_features_do_not_change_with_place_and_size(clouds):
    cloud = clouds["a320-v1"]
    moved = replace(cloud, points=2.5 * cloud.points + [10.0, -3.0, 4.0], area_m2=6.25 * cloud.area_m2)
    here, there = shape_features(cloud), shape_features(moved)
    assert np.mean(here.occupied != there.occupied) < 0.1  # samples on a border of cells
    np.testing.assert_allclose(here.facing, there.facing)
    assert unlikeness(here, library_of([there]))[0] < 0.01


def test_unlikeness_is_symmetric_and_zero_for_itself(clouds):
    features = [shape_features(cloud) for cloud in clouds.values()]
    library = library_of(features)
    table = np.array([unlikeness(one, library) for one in features])
    np.testing.assert_allclose(table, table.T)
    np.testing.assert_allclose(np.diag(table), 0)
    assert (table[~np.eye(len(table), dtype=bool)] > 0.01).all()


def test_unlikeness_agrees_with_counting_cells(clouds):
    """An independent count of common cells, one after another."""
    one, other = (shape_features(clouds[name]) for name in ("a320-v1", "b777-v1"))
    bits = [
        np.unpackbits(words.view(np.uint8)) for words in (one.occupied, one.near, other.occupied, other.near)
    ]
    forth = sum(int(a and b) for a, b in zip(bits[0], bits[3], strict=True)) / sum(map(int, bits[0]))
    back = sum(int(a and b) for a, b in zip(bits[2], bits[1], strict=True)) / sum(map(int, bits[2]))
    same = replace(other, extent_m=one.extent_m, facing=one.facing)
    assert unlikeness(one, library_of([same]))[0] == pytest.approx((1 - (forth + back) / 2) / 0.45)


def test_library_is_the_same_however_it_is_joined(clouds):
    features = [shape_features(cloud) for cloud in clouds.values()]
    whole, pieces = (
        library_of(features),
        ShapeLibrary.stacked([library_of(features[:2]), library_of([]), library_of(features[2:])]),
    )
    np.testing.assert_array_equal(unlikeness(features[0], whole), unlikeness(features[0], pieces))
    assert len(library_of([])) == 0


def test_ten_thousand_structures_are_compared_in_as_many_calls_as_ten(clouds):
    features = [shape_features(cloud) for cloud in clouds.values()]
    few = library_of(features)
    rows = np.arange(10_000) % len(few)
    many = ShapeLibrary(few.extent_m[rows], few.occupied[rows], few.near[rows], few.facing[rows])
    distances = unlikeness(features[0], many)
    assert calls(lambda: unlikeness(features[0], many)) == calls(lambda: unlikeness(features[0], few))
    np.testing.assert_array_equal(np.flatnonzero(distances == 0), np.flatnonzero(rows == 0))


@pytest.fixture(scope="module")
def look(clouds):
    """An airliner, what a flight round it saw, and how it lies on itself."""
    structure, cloud = member("a320-v1").structure, clouds["a320-v1"]
    flight = fly(structure, "fuselage")
    seen = inspected(cloud, views(flight.trajectory, cloud, flight.camera, TRULY, scene_of(structure)))
    laid = fitted(cloud, cloud, 1.0)
    return cloud, laid, agreement(cloud, cloud, laid), seen, flight.camera


@pytest.mark.ci
def test_on_itself_all_that_was_inspected_is_foreseen(look):
    cloud, laid, agreed, seen, camera = look
    assert 0.05 < seen.share < 1
    np.testing.assert_array_equal(agreed.counterpart, np.arange(len(cloud)))
    forecast = foresee(cloud, cloud, laid, agreed, seen, camera)
    assert forecast.coverage_seen_pct > 98
    assert forecast.without_pct == 0
    blind = foresee(cloud, cloud, laid, agreed, seen, replace(camera, max_range_m=2.5))
    assert blind.coverage_seen_pct < 5


def test_what_lies_farther_off_on_a_larger_copy_is_foreseen_as_lost(look, clouds):
    """The flight is carried as the boxes are: twice the size, twice the distance."""
    cloud, _, _, seen, camera = look
    larger = replace(cloud, points=2 * cloud.points, area_m2=4 * cloud.area_m2)
    laid = fitted(cloud, larger, 1.0)
    agreed = agreement(cloud, larger, laid)
    same = foresee(cloud, larger, laid, agreed, seen, replace(camera, max_range_m=2 * camera.max_range_m))
    assert same.coverage_seen_pct > 98
    short = foresee(cloud, larger, laid, agreed, seen, replace(camera, max_range_m=12.0))
    assert short.coverage_seen_pct < same.coverage_seen_pct - 20


def test_discs_hide_what_the_mesh_hides(clouds):
    """Sight lines between samples against the ray caster, from places all round an airliner."""
    cloud, scene = clouds["a320-v1"], scene_of(member("a320-v1").structure)
    rng, index = np.random.default_rng(0), np.arange(0, len(cloud), 4)
    alike = []
    for direction in rng.normal(size=(8, 3)):
        place = cloud.points.mean(axis=0) + 45 * direction / np.linalg.norm(direction)
        sight = in_sight(cloud, index, place[None], Camera(max_range_m=200.0))
        ray = place - cloud.points[index]
        cosine = np.einsum("ij,ij->i", ray, cloud.normals[index]) / np.linalg.norm(ray, axis=1)
        free = ~scene.occluded(np.repeat(place[None], len(index), axis=0), cloud.points[index])
        alike.append(sight == (free & (cosine >= np.cos(np.radians(TRULY.max_incidence_deg)))))
    assert np.mean(alike) > 0.93


def test_more_places_show_no_less(clouds):
    cloud, rng = clouds["turbine-1-v1"], np.random.default_rng(1)
    places = cloud.points.mean(axis=0) + 60 * rng.normal(size=(12, 3))
    index = np.arange(0, len(cloud), 8)
    few, many = (in_sight(cloud, index, places[:count], Camera(max_range_m=300.0)) for count in (4, 12))
    assert (many >= few).all()
    each = [in_sight(cloud, index, place[None], Camera(max_range_m=300.0)) for place in places]
    np.testing.assert_array_equal(many, np.any(each, axis=0))


@pytest.mark.ci
@pytest.mark.parametrize(
    ("structure", "expected"),
    slow_after(1, [("b777-v1", "a320-v1"), ("turbine-2-v1", "turbine-1-v1"), ("cuboid-v1", "cube-v1")]),
)
def test_the_shape_decides_whatever_kind_is_declared(location, structure, expected):
    ranking = recommend(open_catalog(location), structure)
    assert ranking[0].source_id == expected
    assert ranking[0].verdict == "fits"
    assert ranking[0].rank == 1
    assert "parts match" in ranking[0].why
    assert ranking[0].unlikeness == min(one.unlikeness for one in ranking)


@pytest.mark.ci
def test_declared_kinds_are_evidence_but_not_all(tmp_path):
    """Shapes that fit outweigh what is declared; where none fits, the kind decides whom to look at first."""
    catalog = open_catalog(tmp_path / "catalog")
    flown = [("a320-v1", "fuselage", "boat"), ("cube-v1", "sides", "airliner")]
    for name, inspection, kind in flown:
        structure = member(name).structure
        catalog.add_structures([replace(structure, kind=kind)])
        catalog.add_demonstrations([fly(structure, inspection)])
    others = [("b777-v1", "airliner"), ("turbine-2-v1", "boat"), ("bridge-1-v1", "airliner")]
    catalog.add_structures([replace(member(name).structure, kind=kind) for name, kind in others])
    fits = recommend(catalog, "b777-v1")
    assert [one.source_id for one in fits] == ["a320-v1", "cube-v1"]
    assert "another kind, boat" in fits[0].why
    for name, source in (("turbine-2-v1", "a320-v1"), ("bridge-1-v1", "cube-v1")):
        ranking = recommend(catalog, name)
        assert (ranking[0].source_id, ranking[0].verdict) == (source, "refused")
    by_shape = recommend(catalog, "b777-v1", by_kind=False)
    assert by_shape[0].source_id == "a320-v1"
    assert "another kind" not in by_shape[0].why


@pytest.mark.ci
def test_the_verdict_is_that_of_the_registration(clouds):
    rules = settings_for("recommended").registration
    for target in ("b777-v1", "turbine-1-v1", "cube-v1"):
        full, quick = (
            register(clouds["a320-v1"], clouds[target], rules),
            fitted(clouds["a320-v1"], clouds[target], rules.acceptance),
        )
        assert (full.accepted, full.acceptance) == (quick.accepted, quick.acceptance)
        np.testing.assert_array_equal(full.matrix, quick.matrix)


def test_second_answer_comes_from_the_cache_and_is_the_same(location, monkeypatch):
    first = recommend(open_catalog(location), "b777-v1")
    computed: list[tuple[object, ...]] = []
    monkeypatch.setattr(Cache, "put", lambda *what: computed.append(what))
    assert repr(recommend(open_catalog(location), "b777-v1")) == repr(first)  # NaN is not equal to itself
    assert not computed


@pytest.mark.ci
def test_what_was_taken_in_is_asked_about_without_its_mesh_or_log(tmp_path, monkeypatch):
    catalog, cube = open_catalog(tmp_path / "catalog"), member("cube-v1").structure
    place = str(catalog.location), catalog.cache.folder
    text = (
        '[[structure]]\nid = "NAME"\nkind = "box"\npath = "NAME.stl"\nunits = "m"\nup = "z"\nforward = "x"\n'
    )
    for name, scale in (("cube-v1", 1.0), ("large", 1.3)):
        trimesh.Trimesh(scale * cube.vertices, cube.triangles).export(tmp_path / f"{name}.stl")
    (tmp_path / "structures.toml").write_text(text.replace("NAME", "cube-v1") + text.replace("NAME", "large"))
    entries = read_manifest(tmp_path / "structures.toml")
    catalog.add_structures([learnt_structure(*place, entry) for entry in entries])
    write_log(tmp_path / "flight.mcap", fly(cube, "sides"), cube)
    catalog.add_demonstrations([learnt_flight({}, place, {}, {}, None, tmp_path / "flight.mcap")])
    gather(catalog)
    for name in ("structure", "demonstration"):
        monkeypatch.setattr(Catalog, name, lambda *arguments: pytest.fail("read again"))
    monkeypatch.setattr(Shapes, "features", _only_of("large", Shapes.features))
    assert recommend(catalog, "large")[0].verdict == "fits"


def _only_of(structure_id, features):
    def counter(shapes, name, sha256):
        assert name == structure_id  # the others lie together in one file
        return features(shapes, name, sha256)

    return counter


def test_flight_over_the_structure_itself_comes_first(location):
    ranking = recommend(open_catalog(location), "a320-v1")
    assert (ranking[0].verdict, ranking[0].source_id) == ("own", "a320-v1")


def test_unknown_ids_and_empty_catalogs_are_told(tmp_path, location, capsys):
    with pytest.raises(InputError, match="known: a320-v1"):
        recommend(open_catalog(location), "nothing")
    empty = open_catalog(tmp_path / "empty").create()
    with pytest.raises(InputError, match="known: none"):
        recommend(empty, "a320-v1")
    empty.add_structures([random_member("box", 1).structure])
    with pytest.raises(InputError, match="no demonstration"):
        recommend(empty, "box-random-1")
    assert main(["recommend", "nothing", "--catalog", location]) == 2
    assert "not in the catalog" in capsys.readouterr().err


def test_command_answers_in_json(location, capsys):
    assert main(["recommend", "cuboid-v1", "--most", "2", "--json", "--catalog", location]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["rank"] for row in rows] == [1, 2]
    assert rows[0]["source_id"] == "cube-v1"


def test_best_asks_for_one_way_only(location, capsys):
    assert main(["transfer", "--catalog", location]) == 2
    capsys.readouterr()
    assert main(["transfer", "a", "--best", "cuboid-v1", "--catalog", location]) == 2
    assert "either --best" in capsys.readouterr().err


@pytest.mark.slow
def test_best_plans_the_first_but_only_within_a_kind(tmp_path, capsys):
    catalog = open_catalog(tmp_path / "catalog")
    cube, cuboid = member("cube-v1").structure, member("cuboid-v1").structure
    catalog.add_structures([cube, replace(cuboid, kind="ship", sha256="0" * 64)])
    catalog.add_demonstrations([fly(cube, "sides")])
    arguments = ["--preset", "baseline", "--workers", "1", "--json", "--catalog", catalog.location]
    assert main(["transfer", "--best", "cuboid-v1", *arguments]) == 2
    assert "is declared a ship" in capsys.readouterr().err
    catalog.add_structures([cuboid])
    assert main(["transfer", "--best", "cuboid-v1", *arguments]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["target_id"], row["status"]) for row in rows] == [("cuboid-v1", "ok")]
