"""One structure of a kind is the map for all: places go to it and on from there."""

from __future__ import annotations

import numpy as np
import pytest
from random_members import random_member
from true_counterparts import true_counterparts

from upplied.catalog import open_catalog
from upplied.findings import carried
from upplied.findings.adding import add_marks, on_surface
from upplied.findings.carried import Carrying
from upplied.findings.looks import Spot
from upplied.findings.marks import Mark
from upplied.findings.queries import by_reference, kind_map, photographed, study_kinds
from upplied.geometry.scene import scene_of
from upplied.geometry.vectors import points_on_triangles


def spots_on(structure, count: int) -> list[Spot]:
    points = points_on_triangles(structure, count, np.random.default_rng(0))[0]
    pairs = zip(*on_surface(scene_of(structure), points), strict=True)
    return [Spot(structure.structure_id, place, normal, place[None]) for place, normal in pairs]


@pytest.fixture(scope="module")
def boxes(tmp_path_factory):
    members = sorted(
        (random_member("box", 810 + at) for at in range(4)), key=lambda one: one.structure.structure_id
    )
    catalog = open_catalog(tmp_path_factory.mktemp("boxes") / "catalog")
    catalog.add_structures([one.structure for one in members])
    return catalog, members


@pytest.mark.slow
def test_a_place_goes_over_the_map_to_where_the_generator_has_it_and_back(boxes):
    catalog, (reference, one, other, _) = boxes
    names = [each.structure.structure_id for each in (reference, one, other)]
    carrying = Carrying(catalog)
    assert carrying.reference("box") == names[0]
    spots = spots_on(one.structure, 60)
    there = carrying.everywhere(spots, names)
    for place, member in zip(there, (reference, one, other), strict=True):
        truth = true_counterparts(one, member, np.array([spot.place for spot in spots]))
        off = np.linalg.norm(place.place - truth, axis=1)
        assert (off <= 0.01 * member.structure.diagonal_m)[~place.doubtful].all()
        assert place.doubtful.mean() < 0.1
        assert np.abs(np.linalg.det(place.turn)) == pytest.approx(np.ones(len(spots)))
    moved = [
        Spot(names[2], *each, each[0][None]) for each in zip(there[2].place, there[2].normal, strict=True)
    ]
    back = carrying.to(moved, names[1])
    sure = ~there[2].doubtful & ~back.doubtful
    off = np.linalg.norm(back.place - [spot.place for spot in spots], axis=1)
    assert sure.mean() > 0.8 and off[sure].max() < 0.01 * one.structure.diagonal_m
    assert (back.turn @ there[2].turn)[sure] == pytest.approx(
        np.repeat(np.eye(3)[None], sure.sum(), 0), abs=0.05
    )


@pytest.mark.slow
def test_questions_after_a_night_read_what_is_stored_and_no_mesh(boxes, monkeypatch):
    catalog, members = boxes
    name = members[2].structure.structure_id
    spots = [spot for one in members for spot in spots_on(one.structure, 3)]
    marks = [Mark("it", place=tuple(spot.place.tolist()), structure=spot.structure_id) for spot in spots]
    assert add_marks(catalog, marks, "Ada").new == 12 and study_kinds(catalog) == []
    studied: list[str] = []
    carrying = Carrying(catalog, studied.append)
    (spot,) = spots_on(members[1].structure, 1)
    monkeypatch.setattr(type(catalog), "structure", lambda *_: pytest.fail("a mesh was read"))
    assert len(photographed(catalog, spot, carrying=carrying)) == 4
    reference, rows = kind_map(catalog, "box")
    assert reference == members[0].structure.structure_id and np.isfinite(rows["reference_x_m"]).all()
    assert np.isfinite(by_reference(catalog, name, carrying=carrying)["reference_x_m"]).all() and not studied


@pytest.mark.ci
def test_places_on_many_structures_are_those_on_each_alone(boxes, monkeypatch):
    catalog, members = boxes
    names = [each.structure.structure_id for each in members]
    spots = spots_on(members[1].structure, 20)
    alone = [Carrying(catalog).to(spots, name) for name in names]
    monkeypatch.setattr(carried, "_FEW", 0)
    monkeypatch.setattr(carried, "_MANY", 2)  # groups of two and of one
    assert Carrying(catalog).study("box") == []
    for chosen in (names, names[2:], names[::-1]):
        for name, there in zip(chosen, Carrying(catalog).everywhere(spots, chosen), strict=True):
            for field, values in vars(alone[names.index(name)]).items():
                np.testing.assert_array_equal(getattr(there, field), values, err_msg=f"{name} {field}")


@pytest.mark.slow
def test_what_is_not_stored_is_studied_once_and_said(boxes, tmp_path):
    _, members = boxes
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([one.structure for one in members[:2]])
    spots, studied = spots_on(members[1].structure, 2), list[str]()
    first = Carrying(catalog, studied.append).to(spots, members[0].structure.structure_id)
    again = Carrying(catalog, studied.append).to(spots, members[0].structure.structure_id)
    assert len(studied) == 1 and members[1].structure.structure_id in studied[0]
    assert np.array_equal(first.place, again.place)


@pytest.mark.ci
def test_a_place_on_what_the_target_lacks_is_doubtful(tmp_path):
    # The one has plates at the ends of its stabiliser, the other has none: nothing there faces as they do.
    source, target = random_member("airliner", 321), random_member("airliner", 322)
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([source.structure, target.structure])
    spots = spots_on(source.structure, 3000)
    truth = true_counterparts(source, target, np.array([spot.place for spot in spots]))
    owner = scene_of(source.structure).closest(np.array([spot.place for spot in spots]))[1]
    names = np.array(source.part_names)[source.part_of_triangle[owner]]
    plates = np.char.startswith(names.astype(str), "endplate")
    assert plates.sum() >= 20 and np.isnan(truth[plates]).all()
    there = Carrying(catalog).to(spots, target.structure.structure_id)
    assert there.doubtful[plates].all() and (~there.doubtful[~plates]).sum() > 300
