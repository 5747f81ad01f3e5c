"""The optimisation before a wall whose answers geometry gives."""

from dataclasses import replace

import numpy as np
import pytest

from upplied.config import OptimiseSettings, RetimeSettings, VisibilitySettings
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import Airspace
from upplied.planning.carry.standoff import Standoff
from upplied.planning.trajectory.optimise import Problem, as_good, optimise
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.terms.path import Leaving, Shape
from upplied.planning.trajectory.view import View
from upplied.records import Camera, Cloud, Surroundings

COUNT = 41


@pytest.fixture(scope="module")
def wall() -> View:
    """A wall of 20 x 12 m in the plane y = 0, seen from y < 0, with a sample every metre."""
    x, z = np.meshgrid(np.arange(-9.5, 10), np.arange(0.5, 12))
    points = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    corners = np.array([[-10.0, 0, 0], [10, 0, 0], [10, 0, 12], [-10, 0, 12]])
    return View(
        cloud=Cloud(points, normals=np.tile([0.0, -1, 0], (len(points), 1)), area_m2=np.ones(len(points))),
        need=np.full(len(points), 1 / len(points)),
        farthest_m=np.full(len(points), 15.0),
        inspected=points[:, 2] < 6,
        camera=Camera(hfov_deg=60, vfov_deg=60, min_range_m=0.5, max_range_m=40),
        settings=VisibilitySettings(occlusion=True, max_incidence_deg=75),
        limits=RetimeSettings(min_gimbal_pitch_deg=-40, max_gimbal_pitch_deg=20),
        scene=Scene(corners, np.array([[0, 1, 2], [0, 2, 3]])),
    )


def along(y: float = -6.0, yaw: float = np.pi / 2, height: float = 4.0) -> Flown:
    x = np.linspace(-10, 10, COUNT)
    positions = np.column_stack([x, np.full(COUNT, y), height + np.sin(x / 2)])
    return Flown(positions, np.full(COUNT, yaw), np.zeros(COUNT))


def problem(view: View, path: Flown, **changes) -> Problem:
    foot = (path.positions[::5] * [1, 0, 1])[:, None]
    standoff = Standoff(np.arange(0, COUNT, 5), foot, np.abs(path.positions[::5, 1]))
    base = Problem(
        starts=(path,),
        demonstrated=Shape.of(path.positions, np.eye(3)),
        view=view,
        standoff=standoff,
        airspace=Airspace(view.scene, 2.0, Surroundings()),
        turned_rad=np.pi / 2,
        aside_rad=np.zeros(COUNT),
    )
    return replace(base, **changes)


def shown(view: View, path: Flown) -> float:
    quats = from_yaw_pitch(path.yaw, path.pitch)
    return 1 - float(view.need[view.missed(path.positions, quats)].sum())


def result(view: View, task: Problem, shape: float = 0.3, **weights) -> Flown:
    return optimise(task, shape, replace(OptimiseSettings(), **weights)).path


def test_it_shows_more_of_what_a_flight_too_low_misses(wall: View):
    path = along(height=3.0)
    done = result(wall, problem(wall, path))
    assert shown(wall, done) > shown(wall, path) + 0.05


def test_the_same_again_gives_the_same_bytes(wall: View):
    task = problem(wall, along(height=3.0))
    first, second = result(wall, task), result(wall, task)
    assert first.positions.tobytes() == second.positions.tobytes()
    assert first.yaw.tobytes() == second.yaw.tobytes()


def test_a_path_that_shows_all_stays_where_it_is(wall: View):
    few = replace(wall, need=np.where(np.abs(wall.cloud.points[:, 2] - 4) < 2, 1.0, 0.0))
    few = replace(few, need=few.need / few.need.sum())
    path = along()
    assert shown(few, path) == pytest.approx(1)
    done = result(few, problem(few, path))
    assert shown(few, done) == pytest.approx(1)
    assert np.linalg.norm(done.positions - path.positions, axis=1).max() < 0.05
    assert np.abs(done.yaw - path.yaw).max() < np.radians(1)


def test_a_camera_that_looks_too_high_is_turned_down_and_the_path_hardly_left(wall: View):
    """The lowest row is missed; a path 6 m off is moved by a sixth of that at most."""
    low = np.abs(wall.cloud.points[:, 2] - 1.5) < 2
    few = replace(wall, need=np.where(low, 1 / low.sum(), 0.0))
    path = replace(along(), pitch=np.full(COUNT, np.radians(9)))
    assert shown(few, path) < 0.9
    done = result(few, problem(few, path))
    assert shown(few, done) == pytest.approx(1)
    assert np.linalg.norm(done.positions - path.positions, axis=1).max() < 1.0
    assert done.pitch.mean() < path.pitch.mean() - np.radians(2)


def test_it_comes_no_nearer_to_the_structure_than_the_carried_path(wall: View):
    """What is resolved from 4.2 m only draws the path nearer than it is flown anywhere, 4.8 m."""
    path = replace(along(), positions=along().positions * [1, 0.8, 1])
    middle = np.abs(wall.cloud.points[:, 0]) < 3
    strict = replace(wall, need=np.where(middle, 1 / middle.sum(), 0.0), farthest_m=np.full(len(middle), 4.2))
    kept, nearer = (
        result(strict, problem(strict, path), shape=0.0, standoff=0.0, axis=0.0, clearance=weight)
        for weight in (50.0, 0.0)
    )
    assert np.abs(kept.positions[:, 1]).min() > 4.7
    assert np.abs(nearer.positions[:, 1]).min() < 4.4


def test_where_nothing_is_needed_the_path_is_the_carried_one(wall: View):
    path = along()
    done = result(wall, problem(replace(wall, need=np.zeros(len(wall.need))), path))
    assert np.abs(done.positions - path.positions).max() < 1e-6


def test_a_heavier_shape_strays_less(wall: View):
    frontal = replace(wall, settings=VisibilitySettings(occlusion=True, max_incidence_deg=50))
    path = along(y=-3.0)  # from here the upper rows are seen too obliquely, wherever the camera looks
    task = problem(frontal, path)
    loose, strict = (result(frontal, task, shape) for shape in (0.01, 10.0))
    assert shown(frontal, loose) > shown(frontal, path) + 0.1
    one = Shape.of(path.positions, np.eye(3))
    assert one.value(strict)[0] < one.value(loose)[0]


def test_the_safety_distance_is_kept_by_a_path_that_starts_too_near(wall: View):
    path = along(y=-1.0)
    done = result(wall, problem(wall, path), standoff=0.0)
    assert np.abs(done.positions[:, 1]).min() > 1.9


def test_a_level_flight_stays_level(wall: View):
    path = replace(along(), positions=along().positions * [1, 1, 0] + [0, 0, 3.0])
    done = result(wall, problem(wall, path, level=True))
    np.testing.assert_array_equal(done.positions[:, 2], 3.0)


def test_dear_turning_turns_less(wall: View):
    path = along(yaw=np.pi / 2 + 0.6)
    cheap, dear = (result(wall, problem(wall, path), turning=price) for price in (1e-4, 1.0))
    turned = [np.abs(np.diff(one.yaw)).sum() + np.abs(np.diff(one.pitch)).sum() for one in (cheap, dear)]
    assert turned[1] < 0.5 * turned[0]


def test_the_camera_looks_as_near_to_what_was_inspected_as_the_experts_did(wall: View):
    """A post in the middle of the wall that all stations show beside the middle of their pictures.

    Turning the camera is dear, so that without the term it stays as flown: however long the search lasts.
    """
    post = np.where(np.abs(wall.cloud.points[:, 0]) < 1, 1.0, 0.0)
    wide, farthest_m = replace(wall.camera, hfov_deg=100), np.full(len(post), 40.0)
    post = replace(wall, need=post / post.sum(), inspected=post > 0, farthest_m=farthest_m, camera=wide)
    towards = np.arctan2(6.0, -along().positions[:, 0])
    path = replace(along(), yaw=towards + np.radians(20))
    centred, as_expert = (
        result(post, replace(problem(post, path), aside_rad=np.full(COUNT, aside)), shape=10.0, turning=10.0)
        for aside in (0.0, 1.0)
    )
    off = [
        np.abs(done.yaw - np.arctan2(-done.positions[:, 1], -done.positions[:, 0]))
        for done in (centred, as_expert)
    ]
    assert np.degrees(off[0].mean()) < 12 < np.degrees(off[1].mean())


def test_a_path_that_shows_all_is_left_where_its_camera_looks_past_what_was_inspected(wall: View):
    """A strip 6 m off, all in the picture of a camera that looks 15 degrees over it; the expert's did not."""
    strip = np.abs(wall.cloud.points[:, 2] - 4) < 1
    few = replace(wall, inspected=strip, need=np.where(strip, 1 / strip.sum(), 0.0))
    path = replace(along(), pitch=np.full(COUNT, np.radians(15)))
    assert shown(few, path) == pytest.approx(1)
    done, as_it_is = result(few, problem(few, path)), result(few, problem(few, path), axis=0.0)
    assert shown(few, done) == pytest.approx(1)
    assert np.abs(done.pitch).mean() < np.radians(7) and as_it_is.pitch.mean() == path.pitch.mean()


def test_of_several_starts_the_best_is_taken(wall: View):
    """The first looks away from the wall; neither the order nor a start that shows nothing matters."""
    away, good = along(yaw=-np.pi / 2), along()
    task = problem(wall, good)
    best = result(wall, replace(task, starts=(good,)))
    for starts in ((away, good), (good, away)):
        done = result(wall, replace(task, starts=starts))
        np.testing.assert_array_equal(done.yaw, best.yaw)


def test_of_results_that_are_worth_as_much_the_order_decides() -> None:
    worths = [0.9, 0.901], [0.901, 0.9], [0.9, 0.8], [0.8, 0.9, 0.85]
    assert [as_good(worth) for worth in worths] == [[0, 1], [0, 1], [0], [1]]


def test_a_start_that_nothing_improves_is_kept(wall: View):
    """It shows all that is asked for already, and where its camera looks costs nothing."""
    path = along(yaw=np.pi / 2 + 0.3)
    seen = wall.shown(path.positions, from_yaw_pitch(path.yaw, path.pitch), np.arange(len(wall.need)))
    task = problem(replace(wall, need=seen / seen.sum(), inspected=seen), path)
    done = optimise(task, 0.3, OptimiseSettings(axis=0.0))
    np.testing.assert_array_equal(done.variables, done.search.first)
    np.testing.assert_array_equal(done.path.columns, path.columns)


def test_the_carried_flight_is_left_only_for_what_that_shows(wall: View):
    """A path farther along the wall shows as much: it is not flown there, and less far the dearer that is."""
    path = along(height=3.0)
    left = [
        np.linalg.norm(result(wall, problem(wall, path), leaving=price).positions - path.positions, axis=1)
        for price in (0.05, 0.5, 100.0)
    ]
    means = [off.mean() for off in left]
    assert means[0] > means[1] > means[2]
    assert means[2] < 0.05


def test_leaving_counts_a_kink_more_than_a_shift(wall: View):
    carried = along().positions
    term = Leaving.of(carried, 6.0)
    shift, kink = carried.copy(), carried.copy()
    shift[:, 2] += 1.0
    kink[20, 2] += 1.0 * np.sqrt(COUNT)  # the same mean square
    values = [term.value(replace(along(), positions=places))[0] for places in (carried, shift, kink)]
    assert values[0] == 0 and values[1] == pytest.approx(1 / 36)
    assert values[2] > 10 * values[1]
    still = Leaving.of(np.zeros((5, 3)), 6.0).value(Flown(np.ones((5, 3)), np.zeros(5), np.zeros(5)))
    assert still[0] == pytest.approx(3 / 36) and np.isfinite(still[1].positions).all()


@pytest.mark.ci
def test_under_a_roof_a_path_keeps_clear_of_wall_and_roof_at_once(wall: View):
    """Away from what is nearest alone, it would come too near to the other, and so to and fro."""
    eaves = [[-10.0, -8, 5], [10, -8, 5], [10, 0, 9], [-10, 0, 9]]
    corners = np.array([[-10.0, 0, 0], [10, 0, 0], [10, 0, 12], [-10, 0, 12], *eaves])
    scene = Scene(corners, np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]))
    high = np.abs(wall.cloud.points[:, 2] - 7) < 1.5
    need, farthest = np.where(high, 1 / high.sum(), 0.0), np.full(len(high), 4.5)
    below = replace(wall, scene=scene, need=need, farthest_m=farthest, inspected=high)
    done = optimise(problem(below, along(height=3.0)), 0.3, OptimiseSettings())
    path, is_clear = done.search.cleared(done.variables)
    assert is_clear and done.search.shown(path) == pytest.approx(1)


def test_what_no_push_leads_out_of_counts_as_at_the_start(wall: View):
    """Two plates 2 m apart, between which nothing keeps 2 m, behind a path; only its middle dips in there."""
    plates = [[x, y, z] for y in (-11.0, -13.0) for x, z in ((-10, -9), (10, -9), (10, 19), (-10, 19))]
    corners = np.concatenate([[[-10.0, 0, 0], [10, 0, 0], [10, 0, 12], [-10, 0, 12]], np.array(plates)])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * plate for plate in range(3)])
    scene = Scene(corners, faces)
    task = problem(replace(wall, scene=scene), along(), airspace=Airspace(scene, 2.0, Surroundings()))
    search = optimise(task, 0.3, OptimiseSettings()).search
    change = search.first.reshape(-1, 5).copy()
    change[len(change) // 2 - 2 : len(change) // 2 + 2, 1] = -6.0 / search.state.unit[1]
    dipped, start = search.state.flown(change.ravel()), search.state.flown(search.first)
    assert (np.abs(dipped.positions[:, 1] + 12) < 0.5).any()
    path, is_clear = search.cleared(change.ravel())
    assert is_clear and task.airspace.allowed(path.positions).all()
    at_start = (path.positions == start.positions).all(axis=1)
    assert at_start.any() and not at_start.all()
    assert search.worth(change.ravel(), search.first_sight) > 0


def test_a_path_that_comes_too_near_is_worth_what_it_shows_once_pushed_out(wall: View):
    """Resolved from 2.5 m, drawn to it without a price for coming nearer than 2.2 m."""
    middle = np.abs(wall.cloud.points[:, 2] - 4) < 1
    fine = replace(wall, need=np.where(middle, 1 / middle.sum(), 0.0), farthest_m=np.full(len(middle), 2.5))
    task = problem(fine, along(y=-2.9), airspace=Airspace(wall.scene, 2.2, Surroundings()))
    done = optimise(task, 0.3, replace(OptimiseSettings(), clearance=0.0, standoff=0.0, rounds=2))
    search, variables = done.search, done.variables
    assert not task.airspace.allowed(search.state.flown(variables).positions).all()
    out, is_clear = search.cleared(variables)
    assert is_clear and task.airspace.allowed(out.positions).all()
    sight = search.sight(search.state.flown(variables))
    assert search.worth(variables, sight) == search.value(out, sight)
    assert search.shown(out) > search.shown(search.state.flown(search.first)) + 0.1


def test_a_path_that_no_push_leads_out_of_a_gap_is_worth_less_than_any(wall: View):
    """Two walls 3 m apart, of which 2 m are to be kept."""
    corners = np.array([[-10.0, 0, 0], [10, 0, 0], [10, 0, 12], [-10, 0, 12]])
    both = np.vstack([corners, corners - [0, 3, 0]])
    scene = Scene(both, np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]))
    task = problem(replace(wall, scene=scene), along(y=-1.5), airspace=Airspace(scene, 2.0, Surroundings()))
    search = optimise(task, 0.3, OptimiseSettings(rounds=1)).search
    assert not search.cleared(search.first)[1]
    assert search.worth(search.first, search.first_sight) < 0


@pytest.mark.parametrize(
    ("worths", "rounds", "flown"),
    [([0.5, 0.6, 0.605, 0.9], 3, 2), ([0.5, 0.4, 0.9], 2, 0), ([0.5, 0.6, 0.7, 0.8], 4, 3)],
)
def test_rays_are_cast_until_a_round_gains_less_than_a_point(
    wall: View, monkeypatch: pytest.MonkeyPatch, worths: list[float], rounds: int, flown: int
):
    search, solved = optimise(problem(wall, along()), 0.3, OptimiseSettings(rounds=1)).search, []
    search = replace(search, weights=OptimiseSettings(rounds=4))
    ends = [search.first + number for number in range(4)]
    monkeypatch.setattr(type(search), "solved", lambda *_: solved.append(0) or ends[len(solved) - 1])
    monkeypatch.setattr(type(search), "worth", lambda *_: worths[len(solved) - 1])
    worth, variables = search.improved()
    assert len(solved) == rounds and worth == worths[flown]
    np.testing.assert_array_equal(variables, ends[flown])


def test_where_stations_lie_does_not_move_the_path(wall: View):
    """Noise in a log makes stations dense where the flight bends no more: here on one half of it."""
    path = along(height=3.0)
    places = np.concatenate([np.linspace(0, 20, 61), np.arange(21.0, COUNT)])
    task = problem(wall, path)
    denser = replace(
        task,
        starts=[path.between(places)],
        demonstrated=task.demonstrated.between(places),
        standoff=replace(task.standoff, station=np.searchsorted(places, task.standoff.station)),
        aside_rad=np.zeros(len(places)),
    )
    even, uneven = result(wall, task), result(wall, denser)
    moved = np.linalg.norm(even.positions - path.positions, axis=1)
    apart = np.linalg.norm(
        uneven.between(np.searchsorted(places, np.arange(COUNT))).positions - even.positions, axis=1
    )
    assert moved.max() > 1 and apart.max() < 0.02 * moved.max()


def test_with_stations_added_the_search_starts_from_the_best_path_too(wall: View):
    path, best = along(), along(height=5.0, yaw=1.2)
    origin = np.r_[np.arange(COUNT), [COUNT - 1] * 4]
    added = np.arange(len(origin)) >= COUNT
    aside = path.positions[origin] - np.outer(added, [0.0, 1.0, 0.0])
    longer = Flown(aside, path.yaw[origin], path.pitch[origin])
    first, second = problem(wall, path).along(longer, origin, added, best).starts
    np.testing.assert_array_equal(first.positions, aside)
    np.testing.assert_array_equal(second.positions[~added], best.positions)
    np.testing.assert_array_equal(second.positions[added], aside[added])
    np.testing.assert_array_equal(second.yaw[~added], best.yaw)
