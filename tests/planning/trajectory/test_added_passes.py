"""Added passes: whole, beside the demonstrated one, only where they are needed and fit into the time."""

from dataclasses import replace

import numpy as np
import pytest

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.geometry.poses import from_yaw_pitch, optical_axis
from upplied.geometry.scene import Scene
from upplied.planning.airspace.detours import Ways
from upplied.planning.airspace.rules import Airspace
from upplied.planning.geometry.frechet import frechet
from upplied.planning.trajectory.added_passes import Beside, Extended, Pace
from upplied.planning.trajectory.lanes import lanes_beside
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.records import Camera, Cloud, Surroundings

AWAY, COUNT, HALF = 6.0, 81, np.radians(17.5)  # m before the wall, stations, rad
SWATH = 2 * AWAY * np.tan(HALF)


def wall(high: float, needed_from: float = -20.0) -> View:
    """A wall of 40 m along x at y = 0, seen from y < 0; what lies beyond an x is to be shown."""
    step = 0.5
    x, z = np.meshgrid(np.arange(-20 + step / 2, 20, step), np.arange(step / 2, high, step), indexing="ij")
    points = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    points = np.random.default_rng(0).permutation(points)  # every beginning is spread evenly
    corners = np.array([[-20.0, 0, 0], [20, 0, 0], [20, 0, high], [-20, 0, high]])
    need = (points[:, 0] >= needed_from).astype(float)
    return View(
        cloud=Cloud(
            points, normals=np.tile([0.0, -1, 0], (len(points), 1)), area_m2=np.full(len(points), step**2)
        ),
        need=need / need.sum(),
        farthest_m=np.full(len(points), AWAY / np.cos(HALF) ** 2),
        inspected=need > 0,
        camera=Camera(hfov_deg=70, vfov_deg=70, min_range_m=0.5, max_range_m=40),
        settings=VisibilitySettings(occlusion=True, max_incidence_deg=75),
        limits=RetimeSettings(),
        scene=Scene(corners, np.array([[0, 1, 2], [0, 2, 3]])),
    )


def along(high: float) -> Flown:
    """Along the wall at a height, looking at it."""
    x = np.linspace(-20, 20, COUNT)
    positions = np.column_stack([x, np.full(COUNT, -AWAY), np.full(COUNT, high)])
    return Flown(positions, np.full(COUNT, np.pi / 2), np.zeros(COUNT))


def extended(view: View, path: Flown, allowed_s: float = 1000.0, most: int = 3) -> Extended | None:
    airspace = Airspace(view.scene, 2.0, Surroundings())
    pace = Pace(np.ones(len(path)), 1.0)
    missed = view.missed(path.positions, from_yaw_pitch(path.yaw, path.pitch))
    beside = Beside.of(path, view, missed, Ways(airspace, view.cloud), pace, HALF, most)
    return None if beside is None else beside.with_passes(allowed_s - beside.own_s)


def shown(view: View, path: Flown) -> float:
    return 1 - float(view.need[view.missed(path.positions, from_yaw_pitch(path.yaw, path.pitch))].sum())


def passes(longer: Extended) -> list[np.ndarray]:
    """The positions of each stretch of added stations."""
    number = np.flatnonzero(longer.added)
    runs = np.split(number, np.flatnonzero(np.diff(number) > 1) + 1)
    return [longer.path.positions[run] for run in runs if len(run)]


def test_a_wall_of_less_than_a_swath_needs_no_pass() -> None:
    view, path = wall(0.9 * SWATH), along(0.45 * SWATH)
    assert shown(view, path) > 0.97
    assert extended(view, path) is None


@pytest.mark.parametrize("swaths", [2, 3])
def test_a_higher_wall_is_shown_in_whole_passes_beside_the_demonstrated_one(swaths: int) -> None:
    view, path = wall(swaths * SWATH), along(SWATH / 2)
    assert shown(view, path) < 1.2 / swaths
    longer = extended(view, path)
    assert longer is not None
    assert shown(view, longer.path) > 0.95
    levels = longer.path.positions[longer.added]
    whole = np.abs(np.diff(levels[:, 0])) > 0.2  # flown along, not up to the next one
    heights = np.unique(np.round(levels[1:][whole, 2] / (SWATH / 3)))
    assert swaths - 1 <= len(heights) <= swaths
    assert np.ptp(levels[:, 0]) > 37  # over the whole length
    np.testing.assert_allclose(levels[:, 1], -AWAY, atol=0.05)
    axis = optical_axis(from_yaw_pitch(longer.path.yaw, longer.path.pitch))
    np.testing.assert_allclose(axis[longer.added][:, 1], 1.0, atol=0.02)


def test_the_demonstrated_flight_comes_first_and_stays_whole() -> None:
    view, path = wall(2 * SWATH), along(SWATH / 2)
    longer = extended(view, path)
    assert longer is not None
    own = np.flatnonzero(~longer.added)
    assert own.tolist() == list(range(COUNT))
    np.testing.assert_array_equal(longer.origin[own], np.arange(COUNT))
    np.testing.assert_allclose(longer.path.positions[own, :2], path.positions[:, :2], atol=1e-9)
    assert longer.path.positions[-1, 0] < -15  # and back along it


def test_a_pass_is_flown_only_where_it_is_needed() -> None:
    view, path = wall(2 * SWATH, needed_from=5.0), along(SWATH / 2)
    longer = extended(view, path)
    assert longer is not None
    assert shown(view, longer.path) > 0.95
    assert longer.path.positions[longer.added][:, 0].min() > 0


def test_passes_end_where_the_time_does() -> None:
    view, path = wall(3 * SWATH), along(SWATH / 2)
    assert extended(view, path, allowed_s=39.0) is None
    some, all_of_it = extended(view, path, allowed_s=70.0), extended(view, path)
    assert some is not None
    assert all_of_it is not None
    length = [
        float(np.linalg.norm(np.diff(one.path.positions, axis=0), axis=1).sum()) for one in (some, all_of_it)
    ]
    assert length[0] <= 70.0 < length[1]
    assert shown(view, path) < shown(view, some.path) < shown(view, all_of_it.path)


def test_no_more_passes_than_asked_for() -> None:
    view, path = wall(4 * SWATH), along(SWATH / 2)
    one, many = extended(view, path, most=1), extended(view, path, most=3)
    assert one is not None
    assert many is not None
    assert shown(view, one.path) < shown(view, many.path)


def test_noise_of_millimetres_changes_no_arrangement() -> None:
    view, path = wall(2 * SWATH), along(SWATH / 2)
    given, rng = extended(view, path), np.random.default_rng(0)
    assert given is not None
    for _ in range(3):
        points = view.cloud.points + rng.normal(0, 1e-3, view.cloud.points.shape)
        other = extended(replace(view, cloud=replace(view.cloud, points=points)), path)
        assert other is not None
        assert frechet(given.path.positions, other.path.positions) < 0.05 * AWAY


@pytest.mark.parametrize(("share", "above"), [(0.86, False), (0.88, False), (1.0, True)])
def test_of_passes_that_show_as_much_the_first_is_flown_first(share: float, above: bool) -> None:
    # At 0.88 the pass above shows more by less than a hundredth of all, by which none is chosen.
    view, path = wall(3 * SWATH), along(1.5 * SWATH)
    need = view.need * np.where(view.cloud.points[:, 2] > 1.5 * SWATH, share, 1.0)
    one = extended(replace(view, need=need / need.sum()), path, allowed_s=95.0)
    assert one is not None
    assert (passes(one)[0][-1, 2] > 1.5 * SWATH) == above


def test_lanes_keep_the_distance_and_end_with_the_surface() -> None:
    view, path = wall(3 * SWATH), along(SWATH / 2)
    airspace = Airspace(view.scene, 2.0, Surroundings())
    lanes = lanes_beside(path, view, airspace, HALF, np.arange(0, len(view.need), 7), 2)
    assert lanes is not None
    assert lanes.swath_m == pytest.approx(SWATH)
    free = lanes.free
    assert free[:, lanes.middle].all()
    np.testing.assert_allclose(lanes.poses[..., 1][free], -AWAY, atol=0.05)
    heights = lanes.poses[..., 2] - SWATH / 2
    np.testing.assert_allclose(heights[free] / lanes.swath_m, np.nonzero(free)[1] - 2, atol=0.05)
    assert not free[:, 0].any()  # below the wall, on the right of a flight towards +x


def test_a_path_that_looks_past_the_surface_has_no_lanes() -> None:
    view, path = wall(SWATH), along(SWATH / 2)
    away = replace(path, yaw=path.yaw + np.pi)
    assert extended(view, away) is None
