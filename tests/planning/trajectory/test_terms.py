"""Every term: its slope against finite differences, and what it must say where geometry gives the answer."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import Airspace
from upplied.planning.carry.standoff import Standoff
from upplied.planning.geometry.frechet import frechet_floored
from upplied.planning.trajectory.state import Flown, Term
from upplied.planning.trajectory.terms.axis import Aims, Axis, aims_of, axes
from upplied.planning.trajectory.terms.coverage import Coverage
from upplied.planning.trajectory.terms.path import Clearance, Leaving, Shape, StandoffKept, Turning
from upplied.planning.trajectory.view import View
from upplied.records import Camera, Cloud, Surroundings

STATIONS = 14
NAMES = (
    "axis", "clearance", "coverage", "frontal", "leaving", "round", "shape", "standoff", "turning",
)  # fmt: skip


def flown(seed: int = 0) -> Flown:
    """A path of some bends before a wall in the plane y = 0, which it looks at."""
    rng = np.random.default_rng(seed)
    x = np.linspace(-6, 6, STATIONS)
    positions = np.column_stack([x, -4 + np.sin(x), 4 + np.cos(x / 2)]) + rng.normal(0, 0.2, (STATIONS, 3))
    return Flown(positions, np.pi / 2 + rng.normal(0, 0.4, STATIONS), rng.normal(0, 0.3, STATIONS))


@pytest.fixture(scope="module")
def wall() -> View:
    """20 x 8 m with a sample every metre and a half, seen from y < 0."""
    x, z = np.meshgrid(np.arange(-9.5, 10, 1.5), np.arange(0.5, 8, 1.5))
    points = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    corners = np.array([[-10.0, 0, 0], [10, 0, 0], [10, 0, 8], [-10, 0, 8]])
    return View(
        cloud=Cloud(points, normals=np.tile([0.0, -1, 0], (len(points), 1)), area_m2=np.ones(len(points))),
        need=np.full(len(points), 1 / len(points)),
        farthest_m=np.full(len(points), 9.0),
        inspected=np.ones(len(points), bool),
        camera=Camera(hfov_deg=60, vfov_deg=50, min_range_m=0.5, max_range_m=40),
        settings=VisibilitySettings(occlusion=True, max_incidence_deg=75),
        limits=RetimeSettings(),
        scene=Scene(corners, np.array([[0, 1, 2], [0, 2, 3]])),
    )


def coverage(view: View, path: Flown, width: float) -> Coverage:
    chosen = np.flatnonzero(view.need > 0)
    oblique = VisibilitySettings(occlusion=True, max_incidence_deg=88)
    anywhere = replace(view, farthest_m=np.full(len(view.need), 1e3), settings=oblique, least_cosine=None)
    free = anywhere.reach(path.positions, chosen)
    return Coverage.of(view, chosen, view.need[chosen], free, width=width)


def term(name: str, view: View) -> Term:
    path, other = flown(), flown(1)
    seen = np.tile(view.cloud.points[:8] + 0.1, (5, 1, 1))
    standoff = Standoff(np.arange(0, STATIONS, 3), seen, np.linspace(3, 9, 5))
    airspace = Airspace(view.scene, 4.5, Surroundings(ground_z_m=3.5, ceiling_z_m=4.8), 0.5)
    turned = np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]])
    narrow = np.tile(turned @ np.diag([1.0, 3.0, 1.5]) @ turned.T, (STATIONS, 1, 1))
    aside = np.resize([0.0, 0.1, np.nan, 0.3, 0.05], STATIONS)
    cosines = np.where(view.cloud.points[:, 0] > 0, np.cos(np.radians(40)), 0.0)
    frontal = replace(view, least_cosine=cosines)
    around = replace(view, camera=replace(view.camera, hfov_deg=220))
    return {
        "axis": lambda: Axis(Aims(np.resize(seen[0], (STATIONS, 3)), narrow), aside),
        "clearance": lambda: Clearance.of(airspace, path),
        "coverage": lambda: coverage(view, path, 0.15),
        "frontal": lambda: coverage(frontal, path, 0.15),
        "leaving": lambda: Leaving.of(other.positions, 5.0),
        "round": lambda: coverage(around, path, 0.15),
        "shape": lambda: Shape.of(other.positions, turned),
        "standoff": lambda: StandoffKept.of(standoff, path, 0.08),
        "turning": lambda: Turning(other.yaw, other.pitch, 2.0),
    }[name]()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", [0, 2])
def test_slopes_agree_with_finite_differences(name: str, seed: int, wall: View):
    one, path, step = term(name, wall), flown(seed), 1e-6
    value, slope = one.value(path)
    assert value > 0
    actual, expected = [], []
    for field in ("positions", "yaw", "pitch"):
        at = getattr(path, field)
        for index in np.ndindex(at.shape):
            both = []
            for sign in (1, -1):
                moved = np.array(at)
                moved[index] += sign * step
                both.append(one.value(replace(path, **{field: moved}))[0])
            expected.append((both[0] - both[1]) / (2 * step))
            actual.append(getattr(slope, field)[index])
    scale = np.abs(expected).max()
    assert scale > 0
    np.testing.assert_allclose(actual, expected, rtol=2e-4, atol=2e-6 * max(scale, 1))


def test_coverage_is_what_is_missed_sample_by_sample(wall: View):
    """By its definition, with more samples than a batch holds: as far as every station fails to show it."""
    rng, heights = np.random.default_rng(2), np.linspace(0, 1, 5)
    places = np.concatenate([wall.cloud.points + height * np.array([0, 0, 1]) for height in heights])
    cloud = Cloud(places, np.tile([0.0, -1, 0], (len(places), 1)))
    need, farthest_m = rng.random(len(places)), rng.uniform(4, 12, len(places))
    view = replace(
        wall, cloud=cloud, need=need / need.sum(), farthest_m=farthest_m, inspected=np.ones(len(places), bool)
    )
    path, free, width = flown(4), np.random.default_rng(3).random((STATIONS, len(places))) < 0.8, 0.2
    left = np.ones(len(places))
    for at, quat, sees in zip(path.positions, from_yaw_pitch(path.yaw, path.pitch), free, strict=True):
        ray = places - at
        away = np.linalg.norm(ray, axis=1)
        x, y, z = Rotation.from_quat(quat).inv().apply(ray / away[:, None]).T
        cosine, half_h, half_v = -(ray @ [0, -1, 0]) / away, np.radians(30), np.radians(25)
        over = (
            cosine - np.cos(np.radians(75)), cosine - away / farthest_m,
            x * np.sin(half_h) - np.abs(y) * np.cos(half_h), x * np.sin(half_v) - np.abs(z) * np.cos(half_v),
        )  # fmt: skip
        parts = np.clip((np.array(over) / width + 0.5) / 2, 0, 1)
        left *= 1 - 0.98 * np.prod(parts**2 * (3 - 2 * parts), axis=0) * sees
    value, _ = Coverage.of(view, np.arange(len(places)), view.need, free, width=width).value(path)
    assert len(places) > 2 * 128 and 0.1 < value < 0.9
    assert value == pytest.approx(view.need @ left, rel=1e-7)


def test_coverage_with_sharp_borders_counts_what_is_truly_seen(wall: View):
    path = flown(3)
    chosen = np.flatnonzero(wall.need > 0)
    seen = wall.shown(path.positions, from_yaw_pitch(path.yaw, path.pitch), chosen)
    assert 0.2 < seen.mean() < 0.95
    missed, _ = coverage(wall, path, 1e-6).value(path)
    # One station shows at most 0.98 of a sample, so a little of what is seen once counts as missed.
    assert 1 - seen.mean() - 1e-9 <= missed <= 1 - 0.98 * seen.mean() + 1e-9


def test_shape_minds_neither_place_nor_extent_along_each_axis(wall: View):
    path = flown().positions
    one = Shape.of(path, np.eye(3))
    nothing = np.zeros(STATIONS)
    assert one.value(Flown(path * [1.7, 0.6, 1.2] + [30, -4, 9], nothing, nothing))[0] < 1e-12
    bent = path + np.column_stack([np.zeros(STATIONS), np.linspace(-1, 1, STATIONS) ** 2, np.zeros(STATIONS)])
    assert one.value(Flown(bent, nothing, nothing))[0] > 1e-3
    assert frechet_floored(path, one.image(bent)) < 0.01  # an axis along which the path is level is floored


def test_shape_is_told_along_the_axes_of_the_source():
    path = flown().positions
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])  # the target stands turned
    nothing = np.zeros(STATIONS)
    stretched = (path * [1.7, 0.6, 1.2]) @ turn.T
    assert Shape.of(path @ turn.T, turn.T).value(Flown(stretched, nothing, nothing))[0] < 1e-12
    assert Shape.of(path @ turn.T, np.eye(3)).value(Flown(stretched, nothing, nothing))[0] > 1e-3


def test_clearance_asks_nothing_of_a_path_that_keeps_it(wall: View):
    path = flown()
    free = Airspace(wall.scene, 1.0, Surroundings(ground_z_m=0.0), 1.0)
    assert Clearance.of(free, path).value(path)[0] == 0


def test_clearance_asks_to_come_no_nearer_than_a_distance(wall: View):
    """Half a metre is lacking everywhere; the ground and the ceiling ask nothing."""
    low = Airspace(wall.scene, 1.0, Surroundings(ground_z_m=4.0), 1.0)
    near = replace(flown(), positions=flown().positions * [1, 0, 1] - [0, 2.5, 0])
    assert Clearance.of(low, near).value(near)[0] > 0
    assert Clearance.of(low, near).no_nearer(3.0).value(near)[0] == pytest.approx(0.25)
    assert Clearance.of(low, near).no_nearer(2.5).value(near)[0] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    ("clearance_m", "floor_m", "clear"), [(2.49, 3.0, True), (2.53, 3.0, False), (2.49, 5.0, False)]
)
def test_a_path_keeps_its_distance_where_every_station_does(wall, clearance_m, floor_m, clear):
    near = replace(flown(), positions=flown().positions * [1, 0, 1] - [0, 2.5, 0])
    assert near.positions[:, 2].min() > 3 and near.positions[:, 2].min() < 5
    airspace = Airspace(wall.scene, clearance_m, Surroundings(ground_z_m=floor_m - 1.0), 1.0)
    assert Clearance.of(airspace, near).broken(near).any() != clear


def test_clearance_holds_along_the_surface_past_its_nearest_point(wall: View):
    """A path that is moved along the wall, and into it, lacks as much as one that was moved straight in."""
    free = Airspace(wall.scene, 1.0, Surroundings(), 0.0)
    before = replace(flown(), positions=flown().positions * [1, 0, 1] - [0, 2, 0])

    def moved(x: float, y: float, z: float) -> Flown:
        return replace(before, positions=before.positions + np.array([x, y, z]))

    straight, aslant, through = moved(0, 1.5, 0), moved(1, 1.5, 0.5), moved(0, 3, 0)
    one = Clearance.of(free, before)
    assert one.value(aslant)[0] == pytest.approx(one.value(straight)[0])
    assert one.value(through)[0] > one.value(straight)[0] > 0  # as far off, on the other side


def test_a_camera_turned_aside_once_and_for_all_costs_no_turning():
    path = flown()
    one = Turning(path.yaw, path.pitch, 2.0)
    assert one.value(replace(path, yaw=path.yaw + 0.5))[0] == pytest.approx(0, abs=1e-12)
    aside = path.yaw + 0.5 * (np.arange(STATIONS) == 6)
    there_and_back = one.value(replace(path, yaw=aside, pitch=path.pitch))[0]
    assert there_and_back == pytest.approx(0.5, rel=0.2)  # twice half a radian, over two


def test_an_axis_beside_the_inspected_surface_costs_what_the_expert_did_not_look_aside():
    """A camera 10 m before a patch, which it looks 0.3 rad past; the expert looked 0.1 rad past it."""
    path = Flown(np.zeros((4, 3)), np.full(4, 0.3), np.zeros(4))
    patch = Aims(np.tile([10.0, 0, 0], (4, 1)), np.tile(np.eye(3), (4, 1, 1)))
    past = 2 * np.sin(0.15) - 0.1
    assert Axis(patch, np.full(4, 0.1)).value(path)[0] == pytest.approx(past**2)
    assert Axis(patch, np.full(4, 0.4)).value(path)[0] == 0
    unseen = np.array([0.1, np.nan, 0.1, np.nan])
    assert Axis(patch, unseen).value(path)[0] == pytest.approx(past**2 / 2)


def test_the_aim_is_the_inspected_surface_next_to_the_optical_axis():
    """Two patches 0.8 rad apart: the nearer one is aimed at, whatever the other weighs, if it is seen."""
    patches = np.array([[10.0, 1, 0], [10 * np.cos(0.8), 10 * np.sin(0.8), 0]])
    place, ahead = np.zeros((1, 3)), axes(np.zeros(1), np.zeros(1))
    weight = np.array([1.0, 100.0])
    near = aims_of(place, ahead, patches, weight, np.array([[True, True]]))
    np.testing.assert_allclose(near.at[0], patches[0], atol=1e-6)
    far = aims_of(place, ahead, patches, weight, np.array([[False, True]]))
    np.testing.assert_allclose(far.at[0], patches[1])
    aside, ahead_of_it = 2 * np.sin(0.8), 1 - np.cos(0.8)  # one patch is as narrow as can be
    assert far.angles(place, ahead) == pytest.approx(np.hypot(aside, ahead_of_it))
    assert np.isnan(aims_of(place, ahead, patches, weight, np.array([[False, False]])).at).all()


def test_beside_a_narrow_surface_an_axis_is_dearer_than_beside_a_wide_one():
    """A pole of 0.2 m and a wall, 10 m ahead of a camera that looks 0.1 rad aside, and 0.1 rad up."""
    place, ahead = np.zeros((1, 3)), axes(np.zeros(1), np.zeros(1))
    grid = np.linspace(-1, 1, 41)
    y, z = (part.ravel() for part in np.meshgrid(grid, 5 * grid))
    wall = np.column_stack([np.full(len(y), 10.0), 5 * y, z])
    pole = wall * [1, 0.02, 1]
    seen, weight = np.ones((1, len(y)), bool), np.ones(len(y))
    aside, up = axes(np.full(1, 0.1), np.zeros(1)), axes(np.zeros(1), np.full(1, 0.1))
    for surface, sideways in ((wall, 0.1), (pole, 0.2)):
        aims = aims_of(place, ahead, surface, weight, seen)
        assert aims.angles(place, ahead) == pytest.approx(0, abs=1e-6)
        assert aims.angles(place, aside) == pytest.approx(sideways, rel=0.06)
        assert aims.angles(place, up) == pytest.approx(0.1, rel=0.06)


def test_stand_off_costs_nothing_within_its_tolerance():
    x = np.linspace(-10, 10, 21)
    path = Flown(np.column_stack([x, np.full(21, -5.0), np.zeros(21)]), x, x)
    station = np.arange(0, 21, 4)
    foot = path.positions[station] * [1, 0, 1]
    standoff = Standoff(station, foot[:, None], np.full(len(station), 5.0))
    one = StandoffKept.of(standoff, path, 0.08)
    assert one.value(path)[0] == 0
    assert one.value(replace(path, positions=path.positions * [1, 1.07, 1]))[0] == 0
    assert one.value(replace(path, positions=path.positions * [1, 1.28, 1]))[0] == pytest.approx(0.04)
