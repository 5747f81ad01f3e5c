"""The graph of ways: places where they should be, edges that are free, ways no longer than the graph's."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from upplied.geometry.scene import Scene
from upplied.planning.airspace.roadmap import Roadmap, links, roadmap, shortened, way
from upplied.planning.airspace.rules import Airspace
from upplied.records import Cloud, Floats, Ints, Surroundings

CLEARANCE = 2.0


def cube(*boxes: tuple[float, float, float, float]) -> Scene:
    """Cubes, each by its centre and half its edge."""
    unit = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
    cubes = boxes or ((0.0, 0.0, 0.0, 5.0),)
    vertices = np.vstack([unit * half + [x, y, z] for x, y, z, half in cubes])
    return Scene(vertices, np.vstack([triangles + 8 * index for index in range(len(cubes))]), 1)


def surface(number: int = 5) -> Cloud:
    """A grid on each face of the cube of 10 m."""
    grid = list(itertools.product(np.linspace(-4.5, 4.5, number), repeat=2))
    points = [np.insert(at, axis, 5.0 * side) for axis in range(3) for side in (-1, 1) for at in grid]
    normals = [np.eye(3)[axis] * side for axis in range(3) for side in (-1, 1) for _ in grid]
    return Cloud(np.array(points), np.array(normals))


@pytest.fixture(scope="module")
def graph() -> Roadmap:
    return roadmap(Airspace(cube(), CLEARANCE, Surroundings()), surface())


def has(places: Floats, place: Floats) -> bool:
    return bool(np.linalg.norm(places - place, axis=1).min() < 1e-9)


def test_places_and_edges_keep_the_rules_and_hang_together(graph: Roadmap) -> None:
    assert graph.airspace.allowed(graph.places).all()
    ends = graph.places[graph.first], graph.places[graph.second]
    assert not graph.airspace.broken_legs(*ends).any()
    assert graph.length_m == pytest.approx(np.linalg.norm(ends[0] - ends[1], axis=1))
    pairs = {(int(a), int(b)) for a, b in zip(graph.first, graph.second, strict=True)}
    assert len(pairs) == len(graph.first) and all(a != b for a, b in pairs)
    reached, edges = {0}, [set[int]() for _ in graph.places]
    for a, b in pairs:
        edges[a].add(b)
        edges[b].add(a)
    waiting = [0]
    while waiting:
        new = edges[waiting.pop()] - reached
        reached |= new
        waiting += new
    assert len(reached) == len(graph.places)


def test_places_stand_before_each_sample_straight_and_leaning() -> None:
    rules = Airspace(cube(), CLEARANCE, Surroundings())
    one = Cloud(np.array([[5.0, 0, 0]]), np.array([[1.0, 0, 0]]))
    places = roadmap(rules, one).places
    near = CLEARANCE + 0.15 + 0.15  # the spacing of one sample counts as a metre
    assert has(places, np.array([5 + near, 0, 0]))
    assert has(places, np.array([5 + near + 3.5, 0, 0]))
    for tilt in np.radians([45.0, 80.0]):
        for turn in np.arange(4) * np.pi / 2:
            lean = near * np.array([np.cos(tilt), np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn)])
            place = one.points[0] + lean
            assert has(places, place) == bool(rules.allowed(place[None])[0])
    steps = near * np.linspace(-1, 1, 5)
    round_it = [step for step in itertools.product(steps, repeat=3) if near in np.abs(step)]
    for step in round_it:
        place = np.array([5.0, 0, 0]) + step
        if rules.allowed(place[None])[0] and np.abs(place).max() > 5:
            assert np.linalg.norm(places - place, axis=1).min() < 0.4 * np.sqrt(3)


def test_an_edge_has_leaning_places_round_it() -> None:
    rules, near = Airspace(cube(), CLEARANCE, Surroundings()), CLEARANCE + 0.3
    corner, normal = np.array([5.0, 5, 5]), np.ones(3) / np.sqrt(3)
    places = roadmap(rules, Cloud(corner[None], normal[None])).places
    first = np.array([normal[1], -normal[0], 0]) / np.hypot(normal[0], normal[1])
    second, leaning = np.cross(normal, first), 0
    for tilt in np.radians([45.0, 80.0]):
        for beside in (first, second, -first, -second):
            place = corner + near * (np.cos(tilt) * normal + np.sin(tilt) * beside)
            allowed = bool(rules.allowed(place[None])[0])
            assert has(places, place) == allowed
            leaning += allowed
    assert leaning >= 3


def test_further_places_and_the_rounds_of_boxes_and_posts_are_offered() -> None:
    box, fence = (
        np.array([[[10.0, -3, -3], [14, 3, 3]]]),
        np.array([[-30.0, -30], [30, -30], [30, 30], [-30, 30]]),
    )
    rules = Airspace(cube(), CLEARANCE, Surroundings(keep_out_m=box, geofence_m=fence))
    further = np.array([[0.0, 20, 0.3], [0, 29, 0]])
    places = roadmap(rules, surface(3), further).places
    near = CLEARANCE + 0.15 + 0.15 * np.sqrt(0.5)  # from edge to edge
    assert has(places, further[0])
    apart = 0.05 + 0.1 * CLEARANCE
    low, high = box[0][0] - apart, box[0][1] + apart
    for place in itertools.product(*zip(low, (low + high) / 2, high, strict=True)):
        on_it = any(value in (a, b) for value, a, b in zip(place, low, high, strict=True))
        if on_it and rules.allowed(np.array([place]))[0]:
            assert np.linalg.norm(places - place, axis=1).min() < 1.5
    heights = np.linspace(-5 - near, 5 + near, 5)
    post = [-30 + 0.5 * np.sqrt(0.5)] * 2  # within the fence, on the diagonal
    beside = np.linalg.norm(places[:, :2] - post, axis=1) < 1e-9
    assert sorted(places[beside, 2]) == pytest.approx(heights)


def test_pockets_that_cannot_be_left_are_no_places() -> None:
    inner, outer = surface(), surface()
    points = np.vstack([inner.points, outer.points * 12 / 5])
    cloud = Cloud(points, np.vstack([inner.normals, outer.normals]))  # type: ignore[list-item]
    hollow = Airspace(cube((0, 0, 0, 12.0)), CLEARANCE, Surroundings())
    assert hollow.allowed(inner.points + (CLEARANCE + 0.3) * inner.normals).any()  # type: ignore[operator]
    places = roadmap(hollow, cloud).places
    assert len(places) > 100 and (np.abs(places).max(axis=1) > 12).all()


def distances(graph: Roadmap, start: Ints, goal: Ints, ends: tuple[Floats, Floats]) -> float:
    """Bellman and Ford."""
    total = np.full(len(graph.places), np.inf)
    total[start] = np.linalg.norm(graph.places[start] - ends[0], axis=1)
    for _ in range(len(total)):
        before = total.copy()
        np.minimum.at(total, graph.second, total[graph.first] + graph.length_m)
        np.minimum.at(total, graph.first, total[graph.second] + graph.length_m)
        if np.array_equal(before, total):
            break
    return float((total[goal] + np.linalg.norm(graph.places[goal] - ends[1], axis=1)).min())


@pytest.mark.parametrize("seed", range(3))
def test_a_way_is_free_and_no_longer_than_the_shortest_of_the_graph(graph: Roadmap, seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, goal = np.array([-9.0, *rng.uniform(-3, 3, 2)]), np.array([9.0, *rng.uniform(-3, 3, 2)])
    path = way(graph, start, goal)
    assert path is not None
    assert np.array_equal(path[0], start) and np.array_equal(path[-1], goal)
    assert not graph.airspace.broken(path).any()
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    known = distances(graph, links(graph, start), links(graph, goal), (start, goal))
    assert length <= known + 1e-9 and known < 2 * 9 + 15
    assert len(shortened(path, graph.airspace)) == len(path)


def test_the_straight_way_is_taken_where_it_is_free(graph: Roadmap) -> None:
    ends = np.array([[-9.0, 9, 0], [9, 9, 0]])
    path = way(graph, *ends)
    assert path is not None and np.array_equal(path, ends)


def test_there_is_no_way_into_a_closed_room() -> None:
    rules = Airspace(cube((0, 0, 0, 12.0)), CLEARANCE, Surroundings())
    outside = np.array([[13.0, 0, 0], [-13, 0, 0], [0, 13, 0]])
    graph = roadmap(rules, Cloud(outside - np.sign(outside), np.sign(outside)))
    assert way(graph, np.zeros(3), np.array([20.0, 0, 0])) is None
    assert way(graph, np.array([20.0, 0, 0]), np.zeros(3)) is None
    assert not len(links(graph, np.zeros(3))) and len(links(graph, np.array([20.0, 0, 0])))


def test_links_are_the_free_ones_of_the_nearest(graph: Roadmap) -> None:
    at = np.array([9.0, 1, 1])
    linked = links(graph, at)
    near = np.argsort(np.linalg.norm(graph.places - at, axis=1), kind="stable")[:56]
    legs = graph.airspace.broken_legs(np.tile(at, (len(near), 1)), graph.places[near])
    assert sorted(linked) == sorted(near[~legs])
    empty = Roadmap(np.empty((0, 3)), *np.empty((2, 0), np.int64), np.empty(0), graph.airspace)
    assert len(links(empty, at)) == 0


def test_corners_that_can_be_cut_are_cut(graph: Roadmap) -> None:
    square = np.array(
        [[-9.0, 9, 0], [-9, 9, 9], [0, 9, 9], [9, 9, 9], [9, 9, 0], [9, -9, 0], [0, -9, 0], [-9, -9, 0]]
    )
    assert np.array_equal(shortened(square[:7], graph.airspace), square[[0, 4, 5, 6]])
    assert np.array_equal(shortened(square[:2], graph.airspace), square[:2])


def test_patches_that_stand_apart_are_joined_by_long_edges() -> None:
    scene = cube((0, 0, 0, 1.0), (300, 0, 0, 1.0))
    grid = np.array(list(itertools.product(np.linspace(-0.9, 0.9, 6), repeat=2)))
    tops = [np.column_stack([grid[:, 0] + x, grid[:, 1], np.ones(36)]) for x in (0.0, 300.0)]
    cloud = Cloud(np.vstack(tops), np.tile([0.0, 0, 1], (72, 1)))
    graph = roadmap(Airspace(scene, CLEARANCE, Surroundings()), cloud)
    assert graph.places[:, 0].min() < 1 and graph.places[:, 0].max() > 299
    assert way(graph, np.array([0.0, 0, -4]), np.array([300.0, 0, -4])) is not None
