"""What a scan lacks is found where it is open and the source has surface; paths and measures hold to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import slow_after
from made_scans import END, as_cloud, body, cut

from upplied.config import settings_for
from upplied.geometry.scene import Scene, scene_of
from upplied.geometry.supposed_scene import obstacle, scene_for, with_supposed
from upplied.planning.correspondence.fit import Fit
from upplied.planning.correspondence.never_scanned import (
    NOTHING_MISSING,
    NeverScanned,
    never_scanned,
    supposed_surface,
    without,
)
from upplied.planning.correspondence.pair import surfaces_of
from upplied.planning.surface.samples import surface_samples
from upplied.records import Cloud, Correspondences, Floats, Registration, Structure, SupposedSurface

CLOUDS = settings_for("recommended").clouds
SAME = Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True)


def samples(structure: Structure) -> Cloud:
    return surface_samples(structure, scene_of(structure), CLOUDS)


def missing_of(source: Structure, target: Structure) -> NeverScanned:
    return never_scanned(source, target, fit_of(source, target, SAME))


def fit_of(source: Structure, target: Structure, registration: Registration) -> Fit:
    return Fit(samples(source), samples(target), registration)


def likely(missing: NeverScanned) -> tuple[Floats, Floats]:
    assert missing.supposed is not None
    mine = missing.supposed.likely
    return missing.supposed.points[mine], missing.supposed.normals[mine]


@pytest.mark.ci
@pytest.mark.parametrize("form", slow_after(1, ["mesh", "cloud"]))
def test_the_end_that_was_not_scanned_is_found_and_nothing_else(form: str) -> None:
    scan = cut(body()) if form == "mesh" else as_cloud(cut(body()))
    missing, here = missing_of(body(), scan), samples(body())
    points, _ = likely(missing)
    assert (points[:, 0] > END).all()
    lacks = here.points[:, 0] > END
    assert missing.area_m2 == pytest.approx(here.areas[lacks].sum(), rel=0.2)
    assert np.isin(np.flatnonzero(here.points[:, 0] > END + 1.2), missing.beyond).all()
    # Nothing moved: what is missing is supposed where it is.
    assert np.abs(points - here.points[missing.beyond]).max() < 0.1
    assert missing.error_m < 0.1
    opening = samples(scan).points[missing.opening]
    assert opening[:, 0].max() > END - 0.5 and opening[:, 0].min() > -4  # it shows a long way in


@pytest.mark.slow
@pytest.mark.parametrize("form", ["mesh", "cloud"])
def test_nothing_is_missing_of_what_is_closed(form: str) -> None:
    whole = body() if form == "mesh" else as_cloud(body())
    missing = missing_of(body(), whole)
    assert not len(missing.beyond) and not len(missing.opening)
    assert missing.supposed is None and scene_for(whole, None) is scene_of(whole)


@pytest.mark.ci
def test_only_a_scan_is_asked_what_was_never_scanned_of_it() -> None:
    hull = cut(body())
    for surface in ("scanned", "drawn", None):
        target = replace(hull, surface=surface)
        task = surfaces_of(body(), target, settings_for("recommended"))
        missing = task.missing(Fit(*task.clouds, SAME))
        assert (len(missing.beyond) > 0) == (surface == "scanned")
        assert (missing is NOTHING_MISSING) == (surface != "scanned")


def test_what_is_open_on_both_was_meant_to_be() -> None:
    pipe = cut(body())
    missing = missing_of(pipe, pipe)
    assert not len(missing.beyond) and not len(missing.opening)


def likely_alone(missing: NeverScanned) -> SupposedSurface | None:
    surface = missing.supposed
    assert surface is not None
    rows = {
        name: getattr(surface, name)[surface.likely]
        for name in ("points", "normals", "corner", "radius_m", "likely")
    }
    return replace(surface, **rows)


@pytest.mark.ci
def test_distances_are_from_what_may_be_there_and_rays_end_on_it() -> None:
    scan = cut(body())
    every = missing_of(body(), scan)
    supposed = likely_alone(every)
    scene, true, known = scene_for(scan, supposed), scene_of(body()), scene_of(scan)
    places = np.random.default_rng(2).uniform([-9, -7, -3], [12, 7, 7], (20_000, 3))
    inside = np.abs(places - [0, 0, 1.5]) < [7, 2, 1.5]
    places = places[~inside.all(axis=1) & (true.distance(places) > 0.3)]
    least = scene.distance(places)
    assert (scene_for(scan, every.supposed).distance(places) <= least).all()
    assert (least <= true.distance(places) + 0.02).all()
    assert (known.distance(places) > true.distance(places) + 1).any()
    assert (least >= true.distance(places) - every.error_m - 0.5).all()  # discs stand over edges
    at, triangle = scene.closest(places)
    assert np.linalg.norm(at - places, axis=1) == pytest.approx(least, abs=1e-5)
    beyond = places[:, 0] > 9
    assert (triangle[beyond] == -1).all() and (triangle[places[:, 0] < 0] >= 0).all()
    across = np.array([[5.5, -5.0, 1.5]]), np.array([[5.5, 5.0, 1.5]])
    assert scene.occluded(*across)[0] and not known.occluded(*across)[0]
    assert scene.occluded(places, places[::-1]).sum() >= known.occluded(places, places[::-1]).sum()


@pytest.mark.ci
def test_where_a_scan_may_go_on_farther_than_was_found_is_kept_clear_of_and_hides_nothing() -> None:
    scan = cut(body())  # ends at 4 m, the body at 7 m
    stretched = Registration(
        np.array([14 / 11, 1, 1]), np.eye(3), np.array([-7 + 7 * 14 / 11, 0, 0]), 0.0, True
    )
    there = samples(scan)
    missing = never_scanned(body(), scan, fit_of(body(), scan, stretched))
    supposed = missing.supposed
    assert supposed is not None
    doubtful = supposed.points[~supposed.likely]
    assert supposed.points[supposed.likely, 0].max(initial=4) < 5 and missing.reach_m > 1
    assert doubtful[:, 0].max() > 6 and doubtful[:, 0].min() > 3
    np.testing.assert_allclose(np.linalg.norm(supposed.normals, axis=1), 1, atol=1e-9)
    scene = with_supposed(scene_of(scan), supposed)
    before = np.array([[9.0, 0, 1.5]])  # 2 m before where the body ends, 5 m before the scan does
    assert scene.distance(before)[0] < 2.5 < 4.5 < scene_of(scan).distance(before)[0]
    across = np.array([[5.5, -5.0, 1.5]]), np.array([[5.5, 5.0, 1.5]])
    assert not scene.occluded(*across)[0]
    assert len(obstacle(there, supposed)) == len(there) + len(supposed.points)


def test_a_sample_that_lies_alone_stands_for_no_more_surface_than_others() -> None:
    lone = np.array([[0.0, 0, 0], [0.5, 0, 0], [0, 0.5, 0], [0.5, 0.5, 0], [40, 0, 0]])
    up = np.tile([0.0, 0, 1], (5, 1))
    far = Structure("far", "tank", np.array([[0.0, 0, -90], [1, 0, -90], [0, 1, -90]]), np.array([[0, 1, 2]]))
    scene = with_supposed(Scene(far.vertices, far.triangles), supposed_surface([(lone, up)], 0.5, 0.0))
    assert scene.distance(np.array([[20.0, 0, 0]]))[0] > 15


def test_what_was_never_scanned_has_no_counterpart_unless_a_part_corresponds_elsewhere() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]])
    here = Cloud(points, points, np.ones(4), np.array([0, 0, 1, 1]))
    there = Cloud(points, points, np.ones(4), np.array([0, 0, 1, 2]))
    match = Correspondences(np.arange(4), np.zeros(4), points, "", np.array([0, 1]), np.array([0, 1, -1]))
    missing = replace(NOTHING_MISSING, beyond=np.array([1, 3]))
    carried = np.array([0, 0, 1, 1])
    lies_there = without(match, missing, here, there, carried)
    assert lies_there.target_index.tolist() == [0, -1, 2, -1]
    assert np.isnan(lies_there.target_points[[1, 3]]).all() and np.isnan(lies_there.distance_m[[1, 3]]).all()
    # Part 1 was told to correspond to part 2: where part 1 would lie tells nothing of it.
    pinned = replace(match, target_class=np.array([0, -1, 1]))
    elsewhere = without(pinned, missing, here, there, np.array([0, 0, 1, -1]))
    assert elsewhere.target_index.tolist() == [0, -1, 2, 3]
    assert without(match, NOTHING_MISSING, here, there, carried) is match


@pytest.mark.ci
def test_areas_and_normals_are_those_of_the_surface_once_it_was_stretched() -> None:
    size = np.array([2.0, 0.5, 3.0])
    stretched = replace(cut(body()), vertices=cut(body()).vertices * size)
    back = Registration(1 / size, np.eye(3), np.zeros(3), 0.0, True)
    missing = never_scanned(body(), stretched, fit_of(body(), stretched, back))
    whole = replace(body(), vertices=body().vertices * size)
    assert missing.area_m2 == pytest.approx(_area(whole, END * 2), rel=0.2)
    points, normals = likely(missing)
    assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-9
    end = points[:, 0] > 13.9
    assert end.any() and normals[end, 0].max() > 0.999


@pytest.mark.ci
def test_where_nothing_lies_on_what_was_scanned_nothing_fails() -> None:
    scan = cut(body())
    far = replace(SAME, translation=np.array([200.0, 0, 0]))
    missing = never_scanned(body(), scan, fit_of(body(), scan, far))
    assert np.isfinite(missing.error_m) and missing.error_m >= 0


def _area(structure: Structure, beyond: float) -> float:
    corners = structure.vertices[structure.triangles]
    twice = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(twice, axis=1)[corners[:, :, 0].mean(axis=1) > beyond].sum() / 2)


@pytest.mark.ci
def test_ways_round_lead_round_what_was_never_scanned() -> None:
    scan = cut(body())
    missing, there = missing_of(body(), scan), samples(scan)
    both = obstacle(there, missing.supposed)
    assert missing.supposed is not None and len(both) == len(there) + len(missing.supposed.points)
    assert missing.supposed.likely.sum() == len(missing.beyond)
    assert both.points[:, 0].max() > 6.5 > END + 0.5 > there.points[:, 0].max()
    assert obstacle(there, NOTHING_MISSING.supposed) is there


@pytest.mark.ci
@pytest.mark.parametrize("form", slow_after(1, ["mesh", "cloud"]))
def test_what_a_camera_looks_at_is_what_was_scanned(form: str) -> None:
    scan = cut(body()) if form == "mesh" else as_cloud(cut(body()))
    scene, known = scene_for(scan, missing_of(body(), scan).supposed), scene_of(scan)
    places = np.random.default_rng(3).uniform([-9, -7, -3], [12, 7, 7], (500, 3))
    middle = np.array([0, 0, 1.5]) - places
    for one, other in zip(scene.cast(places, middle), known.cast(places, middle), strict=True):
        assert np.array_equal(one, other)
    assert np.array_equal(scene.hits(places, middle), known.hits(places, middle))
