"""Routes: whatever comes out keeps the rules on its whole length, or a refusal says where and why."""

from __future__ import annotations

import itertools
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from upplied.config import CloudSettings
from upplied.errors import RefusedError
from upplied.geometry.poses import look_at
from upplied.geometry.scene import Scene
from upplied.planning.airspace.detours import Ways, route, safe_positions
from upplied.planning.airspace.roadmap import roadmap, tightened, way, way_towards
from upplied.planning.airspace.rules import (
    Airspace,
    _kernel,
    crosses_box,
    crosses_fence,
    inside_fence,
    path_clearance,
    pushed_out,
)
from upplied.planning.surface.samples import surface_samples
from upplied.records import Floats, Structure, Surroundings, Waypoints

CLEARANCE = 2.0


def ways(surroundings: Surroundings | None = None, *boxes: tuple[Floats, Floats]) -> Ways:
    """Round a cube of 10 m on the origin, or round other boxes."""
    unit = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
    corners = boxes or ((np.full(3, -5.0), np.full(3, 5.0)),)
    vertices = np.vstack([low + unit * (np.asarray(high) - low) for low, high in corners])
    stacked = np.vstack([triangles + 8 * index for index in range(len(corners))])
    structure, scene = Structure("boxes", "box", vertices, stacked), Scene(vertices, stacked, 1)
    surface = surface_samples(structure, scene, CloudSettings(surface_samples=1200))
    return Ways(Airspace(scene, CLEARANCE, surroundings or Surroundings(), 1.0), surface)


def line(start: Floats, end: Floats, number: int) -> Floats:
    return np.asarray(start) + np.linspace(0, 1, number)[:, None] * (np.asarray(end) - start)


def waypoints(positions: Floats) -> Waypoints:
    count = len(positions)
    looks = look_at(positions, np.zeros_like(positions))
    return Waypoints(positions, looks, np.arange(count, dtype=float), np.ones(count, bool))


def independent_clearance(positions: Floats, low: float = -5.0, high: float = 5.0) -> float:
    """Distance of a densely sampled path from a solid cube, in closed form."""
    share = np.linspace(0, 1, 60)[:, None]
    dense = np.vstack([a + share * (b - a) for a, b in itertools.pairwise(positions)])
    return float(np.linalg.norm(np.maximum(np.maximum(low - dense, dense - high), 0), axis=1).min())


def test_a_safe_path_is_left_alone() -> None:
    path = waypoints(line([-20.0, -9, 0], [20, -9, 0], 30))
    round_cube = ways()
    assert route(path, round_cube) is path
    assert safe_positions(path.positions, round_cube) is path.positions


def test_a_path_through_the_cube_is_led_round_it() -> None:
    through = line([-20.0, 0.5, 0.2], [20, 0.5, 0.2], 80)
    round_cube = ways()
    dense = safe_positions(through, round_cube)
    assert len(dense) == 80
    assert dense[[0, -1]] == pytest.approx(through[[0, -1]])
    sparse = route(waypoints(through[::20]), round_cube)
    for positions in (dense, sparse.positions):
        assert independent_clearance(positions) >= CLEARANCE
        assert path_clearance(round_cube.airspace.scene, positions).distance_m >= CLEARANCE
        length = np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()
        assert length < 1.35 * 40  # the shortest way round is 46 m
    assert (np.diff(sparse.t_s) >= 0).all()


def test_viewpoints_stay_viewpoints_in_their_order() -> None:
    path = waypoints(line([-20.0, 0.5, 0.2], [20, 0.5, 0.2], 5))
    routed = route(path, ways())
    assert routed.is_viewpoint.sum() == 5
    viewpoints = routed.positions[routed.is_viewpoint]
    assert viewpoints[[0, 1, 3, 4]] == pytest.approx(path.positions[[0, 1, 3, 4]], abs=1e-9)
    assert (np.diff(viewpoints[:, 0]) > 0).all()
    assert routed.quat_xyzw[routed.is_viewpoint] == pytest.approx(path.quat_xyzw, abs=1e-9)
    assert np.linalg.norm(routed.quat_xyzw, axis=1) == pytest.approx(np.ones(len(routed)))


def test_what_is_a_little_too_near_is_pushed_out_and_little_else_moves() -> None:
    near = line([-30.0, 6.5, 0], [30, 6.5, 0], 121)
    safe = safe_positions(near, ways())
    moved = np.linalg.norm(safe - near, axis=1)
    assert independent_clearance(safe) >= CLEARANCE and moved.max() < 1.2
    assert moved[np.abs(near[:, 0]) > 14].max() < 1e-9
    turn = np.diff(safe, axis=0)
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.clip((turn[1:] * turn[:-1]).sum(axis=1), -1, 1))).max() < 30


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**31))
def test_any_path_comes_out_safe_or_refused(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ground = Surroundings(ground_z_m=-7.0, keep_out_m=np.array([[[8.0, -3, -3], [12, 3, 6]]]))
    corner = np.cumsum(rng.normal(0, 7, (4, 3)), axis=0)
    path = np.vstack([line(a, b, 25) for a, b in itertools.pairwise(corner)])
    round_cube = ways(ground)
    for planned in (safe_positions(path, round_cube), route(waypoints(path[::12]), round_cube).positions):
        assert independent_clearance(planned) >= CLEARANCE
        assert planned[:, 2].min() >= -6.0 - 1e-9
        share = np.linspace(0, 1, 60)[:, None]
        dense = np.vstack([a + share * (b - a) for a, b in itertools.pairwise(planned)])
        assert not ((dense > [8, -3, -3]) & (dense < [12, 3, 6])).all(axis=1).any()


def test_ways_that_are_drawn_tight_do_not_depend_on_where_they_led() -> None:
    """Along the cube's side, by other corners: one way, hardly longer than the shortest 2.1 m off it."""
    rules, ends = ways().planning, np.array([[-20.0, 4, 0.5], [20, 4, 0.5]])
    lines = [
        np.stack([ends[0], np.array([-9.0 + dx, 12 + dy, dz]), np.array([9.0, 13 - dy, -dz]), ends[1]])
        for dx, dy, dz in ((0.0, 0, 0), (3, 6, 1), (-4, 2, -2))
    ]
    drawn = [tightened(each, rules) for each in lines]
    # A tangent to the round about an edge, 15 m ahead and 1 m aside, an arc of that, along the side, and on.
    edge = np.hypot(15, 1)
    shortest = 2 * (np.sqrt(edge**2 - 2.1**2) + 2.1 * (np.arctan2(1, 15) + np.arcsin(2.1 / edge))) + 10
    for each in drawn:
        assert not rules.broken(each).any() and np.array_equal(each[[0, -1]], ends)
        length = np.linalg.norm(np.diff(each, axis=0), axis=1).sum()
        assert length < 1.02 * shortest  # places are 0.7 m apart, and keep 0.05 m more
    at = np.linspace(-19, 19, 60)
    across = [np.interp(at, each[:, 0], each[:, 1]) for each in drawn]
    assert np.ptp(across, axis=0).max() < 0.4
    inside = np.array([[-4.0, 0, 0], [0, 1, 0], [4, 0, 0]])  # of the cube: no way, and left as it is
    assert np.array_equal(tightened(inside, rules), inside)


def test_a_path_that_begins_inside_begins_where_it_comes_out() -> None:
    round_cube = ways()
    path = line([0.0, 3, 0.3], [25, 3, 0.3], 80)
    safe = safe_positions(path, round_cube)
    assert independent_clearance(safe) >= CLEARANCE and len(safe) == 80
    assert np.linalg.norm(safe[0] - [7.0, 3, 0.3]) < 4  # and not on another side of the cube
    assert safe[path[:, 0] > 12] == pytest.approx(path[path[:, 0] > 12], abs=0.5)
    assert safe_positions(path[::-1], round_cube) == pytest.approx(safe[::-1], abs=0.3)
    graph = round_cube.graph
    there = way_towards(graph, np.array([20.0, 3, 0.3]), np.array([-20.0, 3, 0.3]))
    assert not graph.airspace.broken(there).any()
    assert np.linalg.norm(there[-1] - [-20, 3, 0.3]) < 14  # round to the other side


def test_inside_of_a_hollow_box_is_no_place_to_fly() -> None:
    hollow = ways(None, (np.full(3, -12.0), np.full(3, 12.0)))
    inside = line([-3.0, 0, 0], [3, 0, 0], 40)  # 9 m from every wall, yet nobody gets there
    safe = safe_positions(inside, hollow)
    assert independent_clearance(safe, -12, 12) >= CLEARANCE


def test_a_path_that_begins_in_a_cage_begins_outside_of_it() -> None:
    """The sky is seen from there, between bars that nothing passes: what a way leads to is flown."""
    around = [
        (x, y) for x, y in itertools.product(np.linspace(-10, 10, 9), repeat=2) if max(abs(x), abs(y)) == 10
    ]
    bars = [(np.array([x - 0.2, y - 0.2, -10]), np.array([x + 0.2, y + 0.2, 10])) for x, y in around]
    slabs = [(np.array([-10.0, -10, z]), np.array([10.0, 10, z + 0.4])) for z in (-10.4, 10)]
    cage = ways(None, *bars, *slabs)
    path = line([0.0, 1, 0], [30, 1, 0], 80)
    assert cage.airspace.allowed(path[:1]).all() and cage.airspace.broken(path).any()
    safe = safe_positions(path, cage)
    assert len(safe) == 80 and not cage.airspace.broken(safe).any()
    assert np.abs(safe).max(axis=1).min() >= 12 and np.linalg.norm(safe[0] - [12, 1, 0]) < 4
    assert safe[path[:, 0] > 15] == pytest.approx(path[path[:, 0] > 15], abs=0.5)


def test_ground_ceiling_and_fence_hold() -> None:
    fence = np.array([[-30.0, -30], [30, -30], [30, 9], [-30, 9]])
    limits = Surroundings(ground_z_m=-5.0, ceiling_z_m=12.0, geofence_m=fence)
    round_cube = ways(limits)
    wild = np.vstack([line([-20.0, -12, -9], [20, -12, 20], 40), line([20.0, -12, 20], [20, 15, 0], 40)])
    safe = safe_positions(wild, round_cube)
    assert safe[:, 2].min() >= -4.0 and safe[:, 2].max() <= 12.0
    assert inside_fence(fence, safe).all() and not round_cube.airspace.broken(safe).any()


def test_what_cannot_be_repaired_is_refused_with_place_and_reason() -> None:
    low_ceiling = Surroundings(ground_z_m=5.0, ceiling_z_m=5.5)  # no height is allowed
    with pytest.raises(RefusedError, match=r"waypoint \d+ at \(.*\) m"):
        safe_positions(line([-20.0, 0, 0], [20, 0, 0], 30), ways(low_ceiling))
    walled = Surroundings(
        geofence_m=np.array([[-30.0, -4], [30, -4], [30, 4], [-30, 4]]), ground_z_m=-6.0, ceiling_z_m=6.5
    )
    with pytest.raises(RefusedError, match=r"waypoint \d+ at"):
        route(waypoints(line([-20.0, 0, 0], [20, 0, 0], 5)), ways(walled))


def test_reasons_are_in_words() -> None:
    limits = Surroundings(
        ground_z_m=-9.0,
        ceiling_z_m=20.0,
        keep_out_m=np.array([[[8.0, -3, -3], [12, 3, 6]]]),
        geofence_m=np.array([[-30.0, -30], [30, -30], [30, 30], [-30, 30]]),
    )
    airspace = ways(limits).airspace
    cases = {
        (0.0, 6, 0): "from the structure",
        (20.0, 0, -8.5): "least height",
        (20.0, 0, 25): "ceiling",
        (40.0, 0, 0): "geofence",
        (10.0, 0, 0): "keep-out",
    }
    for place, words in cases.items():
        assert words in airspace.why(np.array(place))
        assert not airspace.allowed(np.array([place]))[0]
    assert airspace.why(np.array([20.0, 0, 0])) == ""
    assert airspace.allowed(np.array([[20.0, 0, 0]]))[0]


@pytest.mark.ci
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_boxes_and_fences_agree_with_dense_sampling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, end = rng.uniform(-5, 5, (2, 40, 3))
    axis = int(rng.integers(3))
    end[:10, axis] = start[:10, axis]  # legs along a face
    low, high = np.array([-2.0, -1, -3]), np.array([1.0, 2, 2])
    dense = start[:, None] + np.linspace(0, 1, 3001)[:, None] * (end - start)[:, None]
    depth = np.minimum(dense - low, high - dense).min(axis=2).max(axis=1)
    sure = np.abs(depth) > 5e-3
    assert np.array_equal(crosses_box(start, end, low, high)[sure], (depth > 0)[sure])
    polygon = np.array([[-4.0, -4], [4, -4], [4, 4], [0, 0.5], [-4, 4]])
    inside = inside_fence(polygon, dense.reshape(-1, 3)).reshape(dense.shape[:2])
    leaves = inside.any(axis=1) & ~inside.all(axis=1)
    both_in = inside[:, 0] & inside[:, -1]
    assert (crosses_fence(polygon, start, end) | ~leaves).all()
    clean = both_in & ~leaves
    grazing = np.array([_gap_to_edges(polygon, path[:, :2]) < 0.01 for path in dense])
    assert not (crosses_fence(polygon, start, end) & clean & ~grazing).any()


NOTCHED = np.array(
    [(0, 0), (10, 0), (10, 10), (7, 10), (7, 5), (7, 2), (3, 2), (3, 5), (3, 10), (0, 10)], float
)


def test_a_leg_that_leaves_the_fence_through_vertices_is_told() -> None:
    across = np.array([[1.0, 5, 3]]), np.array([[9.0, 5, 3]])  # 4 m outside, in and out at a vertex
    assert inside_fence(NOTCHED, np.vstack(across)).all()
    assert crosses_fence(NOTCHED, *across).all() and crosses_fence(NOTCHED, *across[::-1]).all()
    along = np.array([[3.0, 1, 3]]), np.array([[3.0, 4, 3]])  # on an edge, outside of nothing, kept by none
    assert crosses_fence(NOTCHED, *along).all()
    clear = np.array([[2.9, 1, 3]]), np.array([[2.9, 9, 3]])  # beside it, and on the line of another edge
    assert not crosses_fence(NOTCHED, *clear).any()
    beyond = np.array([[4.0, 1, 3]]), np.array([[6.0, 1, 3]])
    assert not crosses_fence(NOTCHED, *beyond).any()
    collinear = np.array([[1.0, 2, 3]]), np.array([[2.5, 2, 3]])  # on the line of the notch's floor
    assert not crosses_fence(NOTCHED, *collinear).any()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31))
def test_legs_of_a_grid_through_a_fence_on_the_grid_agree_with_fractions(seed: int) -> None:
    """Whole coordinates hit vertices and edges all the time; the oracle counts in exact fractions."""
    rng = np.random.default_rng(seed)
    start, end = rng.integers(0, 11, (2, 30, 2))
    expected = [
        _leaves(NOTCHED.astype(int).tolist(), *ends)
        for ends in zip(start.tolist(), end.tolist(), strict=True)
    ]
    flat = np.zeros((30, 1))
    actual = crosses_fence(NOTCHED, np.hstack([start, flat]), np.hstack([end, flat]))
    assert actual.tolist() == expected


def _leaves(polygon: list[list[int]], p: list[int], q: list[int]) -> bool:
    """Whether a segment has a point in common with the outline, by solving for it exactly."""
    for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        ux, uy, vx, vy = q[0] - p[0], q[1] - p[1], bx - ax, by - ay
        wx, wy, det = ax - p[0], ay - p[1], ux * vy - uy * vx
        if det:
            along, on_edge = Fraction(wx * vy - wy * vx, det), Fraction(wx * uy - wy * ux, det)
            if 0 <= along <= 1 and 0 <= on_edge <= 1:
                return True
        elif ux == uy == 0:
            on_line = vx * (p[1] - ay) == vy * (p[0] - ax)
            if on_line and min(ax, bx) <= p[0] <= max(ax, bx) and min(ay, by) <= p[1] <= max(ay, by):
                return True
        elif wx * uy == wy * ux:
            shares = [
                Fraction((x - p[0]) * ux + (y - p[1]) * uy, ux * ux + uy * uy)
                for x, y in ((ax, ay), (bx, by))
            ]
            if max(shares) >= 0 and min(shares) <= 1:
                return True
    return False


def test_legs_between_allowed_places_break_the_fence_where_they_leave_it() -> None:
    """Both ends are inside; what is in between is told by the leg alone."""
    fence = 10.0 * NOTCHED - [50.0, 10.0]
    airspace = ways(Surroundings(geofence_m=fence)).airspace
    ends = np.array([[-40.0, 60, 0], [40, 60, 0], [40, 30, 0]])
    assert airspace.allowed(ends).all()
    assert airspace.broken(ends).tolist() == [True, False]
    assert airspace.broken_legs(ends[:1], ends[1:2]).tolist() == [True]


def test_the_graph_of_ways_has_no_place_that_cannot_be_left() -> None:
    """A hollow box of 24 m has room for a vehicle inside; no way leads in."""
    hollow = ways(None, (np.full(3, -12.0), np.full(3, 12.0)))
    inside = line([-9.0, 0, 0], [9, 0, 0], 30)
    graph = roadmap(hollow.planning, hollow.surface, further=inside)
    assert hollow.planning.allowed(inside).all()
    assert len(graph.places) > 100 and not (np.abs(graph.places) < 12).all(axis=1).any()
    assert graph.first.max() < len(graph.places) and graph.second.max() < len(graph.places)
    assert np.linalg.norm(graph.places[graph.first] - graph.places[graph.second], axis=1) == pytest.approx(
        graph.length_m
    )


def test_a_path_is_not_led_out_of_the_fence_at_a_vertex() -> None:
    """What the rule of single legs is for: a plan through the notch's vertices would be 4 m outside."""
    fence = 10.0 * NOTCHED - [50.0, 10.0]  # the cube stands below the notch, which is 40 m wide
    round_cube = ways(Surroundings(geofence_m=fence))
    path = line([-40.0, 40, 0], [40, 40, 0], 60)
    safe = safe_positions(path, round_cube)
    share = np.linspace(0, 1, 60)[:, None]
    dense = np.vstack([a + share * (b - a) for a, b in itertools.pairwise(safe)])
    assert not ((np.abs(dense[:, 0]) <= 20) & (dense[:, 1] >= 10)).any()
    assert (np.abs(dense[:, 0]) < 50).all() and (np.abs(dense[:, 1] - 40) < 50).all()


def test_ways_lead_round_the_posts_of_a_fence_far_from_the_structure() -> None:
    fence = 10.0 * NOTCHED - [50.0, 10.0] + [0, 200.0]
    fence = np.vstack(
        [fence, [[-50, 190]], [[-60, 190]], [[-60, -10]], [[60, -10]], [[60, 190]], [[50, 190]]]
    )
    graph = ways(Surroundings(geofence_m=fence[[9, 11, 12, 13, 14, 1, 2, 3, 4, 5, 6, 7, 8]])).graph
    path = way(graph, np.array([-40.0, 260, 0]), np.array([40.0, 260, 0]))
    assert path is not None and not graph.airspace.broken(path).any()
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    # Down to the notch's floor, along it, and up; the way is through places, and one may lie beside it.
    assert length < 1.1 * (2 * np.hypot(20, 50) + 40)


def test_a_place_on_the_fence_is_pushed_inside() -> None:
    fence = np.array([[-30.0, -30], [30, -30], [30, 9], [-30, 9]])
    limits = ways(Surroundings(geofence_m=fence))
    on_it = np.array([[-20.0, 9, 0], [0, 9, 8], [20, 9, 0]])
    pushed = pushed_out(on_it, limits.planning)
    assert limits.airspace.in_bounds(pushed).all() and not limits.airspace.broken(pushed).any()
    assert np.linalg.norm(pushed - on_it, axis=1).max() < 0.5


def test_pushes_are_a_running_mean_along_the_path() -> None:
    weights = _kernel(line([0.0, 0, 0], [30, 0, 0], 31), reach=4.0)
    assert weights.sum(axis=1) == pytest.approx(1)
    assert weights[15, 15] == weights[15].max() == pytest.approx(0.25)
    assert weights.nnz <= 31 * 9  # what is farther off takes no place
    assert weights[15, 15 + 4] == 0 and weights[15, 15 + 2] == pytest.approx(0.125)


def _gap_to_edges(polygon: Floats, path: Floats) -> float:
    edge = np.roll(polygon, -1, axis=0) - polygon
    share = np.clip(((path[:, None] - polygon) * edge).sum(axis=2) / (edge**2).sum(axis=1), 0, 1)
    return float(np.linalg.norm(polygon + share[..., None] * edge - path[:, None], axis=2).min())


def test_the_ground_margin_is_kept_only_where_ground_is_known() -> None:
    airspace = ways().airspace
    deep = np.array([[20.0, 0, -500]])
    assert airspace.allowed(deep)[0]
    assert not replace(airspace, surroundings=Surroundings(ground_z_m=-10.0)).allowed(deep)[0]


def test_a_small_push_leaves_a_curve_its_shape() -> None:
    turn = np.linspace(0, 4 * np.pi, 160)
    ring = np.column_stack([30 * np.cos(turn), 30 * np.sin(turn), np.linspace(-2, 2, 160)])
    near = np.array(ring)
    near[70:74, :2] *= 0.2  # into the box
    safe = safe_positions(near, ways())
    assert independent_clearance(safe) >= CLEARANCE
    untouched = np.abs(np.arange(160) - 71.5) > 12
    assert np.linalg.norm((safe - ring)[untouched], axis=1).max() < 1.0


def test_neighbours_of_what_is_pushed_go_with_it() -> None:
    """One place too near the cube: the path leaves it in a curve, in no spike."""
    path = line([-20.0, -7.1, 0], [20, -7.1, 0], 81)
    path[40, 1] += 0.8
    pushed = pushed_out(path, ways().planning)
    moved = np.linalg.norm(pushed - path, axis=1)
    assert moved[40] > 0.7
    assert moved[38] > 0.2 and moved[42] > 0.2
    assert moved[:30].max() < 0.05 and moved[51:].max() < 0.05


def test_a_detour_is_round_and_has_no_corners() -> None:
    safe = safe_positions(line([-20.0, -3, 1], [20, -3, 1], 81), ways())
    assert independent_clearance(safe) >= CLEARANCE
    step = np.diff(safe, axis=0)
    step = step[np.linalg.norm(step, axis=1) > 1e-6]
    ahead = step / np.linalg.norm(step, axis=1, keepdims=True)
    turn = np.degrees(np.arccos(np.clip((ahead[1:] * ahead[:-1]).sum(axis=1), -1, 1)))
    assert turn.max() < 60 and turn.sum() < 400


def test_places_lean_over_edges_so_that_detours_are_short() -> None:
    """Round a cube of 10 m at 2 m; no sample faces the way over its edges, so some places lean out there."""
    safe = safe_positions(line([-20.0, 0, 1], [20, 0, 1], 81), ways())
    assert independent_clearance(safe) >= CLEARANCE
    assert np.linalg.norm(np.diff(safe, axis=0), axis=1).sum() < 50.5


def test_ways_are_planned_a_little_beyond_the_safety_distance() -> None:
    one = ways()
    assert one.planning.clearance_m == pytest.approx(CLEARANCE + 0.05)
    assert one.airspace.clearance_m == CLEARANCE and one.graph.airspace is one.planning
