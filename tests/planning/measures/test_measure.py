"""Measures: cases whose answer is known by geometry, and what must not change them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from upplied.geometry.poses import interpolate, look_at
from upplied.geometry.scene import Scene
from upplied.planning.carry.inspected_surface import InspectedSurface, coverage, inspected_surface
from upplied.planning.measures.evaluate import measure, path_length, peaks
from upplied.planning.measures.fidelity import Shown, surface_states
from upplied.planning.visibility.observations import BY_FRUSTUM, TRULY, Views, stations, views
from upplied.records import Camera, Cloud, Correspondences, Floats, Trajectory

SIDE = 10.0


def cube() -> tuple[Scene, Cloud]:
    """A cube of 10 m and a grid of samples on it, a square metre each."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
    grid = np.arange(10) - 4.5
    points, normals = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            points += [np.insert([a, b], axis, side * SIDE / 2) for a in grid for b in grid]
            normals += [np.eye(3)[axis] * side] * 100
    scene = Scene((corner - 0.5) * SIDE, triangles, 1)
    return scene, Cloud(np.array(points), np.array(normals), np.ones(600), np.zeros(600, np.int64))


def ring(radius: float, number: int = 60, turns: float = 1.0, start: float = 0.0) -> Trajectory:
    """Round the cube at mid height, looking at its axis."""
    angle = start + np.linspace(0, 2 * np.pi * turns, number)
    at = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(number)])
    return Trajectory(np.linspace(0, 60.0, number), at, look_at(at, np.zeros_like(at)))


def identity(cloud: Cloud) -> Correspondences:
    number = len(cloud)
    return Correspondences(np.arange(number), np.zeros(number), cloud.points)


def judged(
    demonstrated: Trajectory,
    planned: Trajectory,
    match: Correspondences | None = None,
    carry: Floats | None = None,
):
    """Measures of a plan on the cube itself."""
    scene, cloud = cube()
    match = identity(cloud)
    voxels = Cloud(cloud.points)
    paper = inspected_surface(voxels, voxels, match, views(demonstrated, voxels, Camera(), BY_FRUSTUM))
    true = inspected_surface(cloud, cloud, match, views(demonstrated, cloud, Camera(), TRULY, scene), carry)
    return measure(
        planned,
        demonstrated.positions,
        scene,
        (paper, views(planned, voxels, Camera(), BY_FRUSTUM)),
        (true, views(planned, cloud, Camera(), TRULY, scene)),
    )


def test_flying_the_demonstration_itself_is_perfect() -> None:
    measures = judged(ring(20), ring(20))
    assert measures.coverage_paper_pct == measures.coverage_seen_pct == 100.0
    assert measures.frechet_z == pytest.approx(0, abs=1e-9) and measures.frechet_m == pytest.approx(
        0, abs=1e-9
    )
    assert measures.standoff_ratio_p50 == pytest.approx(1, rel=1e-9)
    assert measures.duration_s == 60.0
    assert measures.min_clearance_m == pytest.approx(20 - 5 * np.sqrt(2), abs=0.05)  # before the edges
    assert measures.path_length_m == pytest.approx(2 * np.pi * 20, rel=1e-2)
    assert measures.peak_speed_mps == pytest.approx(2 * np.pi * 20 / 60, rel=1e-2)
    assert measures.peak_acceleration_mps2 == pytest.approx((2 * np.pi / 60) ** 2 * 20, rel=2e-2)


def test_what_a_quarter_of_the_way_shows() -> None:
    measures = judged(ring(20), ring(20, number=16, turns=0.0, start=0.0))  # hovering before one face
    assert measures.coverage_paper_pct == 100.0  # the frustum sees through the cube
    assert measures.coverage_seen_pct == pytest.approx(25.0)  # one of the four sides


def test_standoff_and_incidence_are_those_of_the_views() -> None:
    nearer = judged(ring(20), ring(15))
    assert 0.6 < nearer.standoff_ratio_p50 < 0.75  # 10 m from the faces instead of 15
    scaled = judged(ring(20), ring(20), carry=2 * np.eye(3))
    assert scaled.standoff_ratio_p50 == pytest.approx(0.5, rel=1e-9)
    far = judged(ring(20), ring(45))
    assert far.incidence_p95_deg < judged(ring(20), ring(15)).incidence_p95_deg < 75


def test_points_without_counterpart_are_reported_and_in_no_coverage() -> None:
    scene, cloud = cube()
    demonstrated = views(ring(20), cloud, Camera(), TRULY, scene)
    index = np.arange(600)
    index[cloud.points[:, 0] == 5.0] = -1
    match = replace(identity(cloud), target_index=index)
    needed = inspected_surface(cloud, cloud, match, demonstrated)
    assert needed.without_pct == pytest.approx(25.0)
    assert needed.need.sum() == 300
    assert coverage(needed, cloud.points[:, 0] != 5.0) == 100.0


def test_area_decides_the_weight() -> None:
    cloud = Cloud(np.zeros((3, 3)), None, np.array([1.0, 2.0, 5.0]))
    seen = Views(
        Trajectory(np.zeros(1), np.ones((1, 3)), np.array([[0.0, 0, 0, 1]])), np.array([[True, True, True]])
    )
    match = Correspondences(np.array([0, 1, 1]), np.zeros(3), np.zeros((3, 3)))
    needed = inspected_surface(cloud, cloud, match, seen)
    assert needed.need.tolist() == [1.0, 7.0, 0.0]
    assert coverage(needed, np.array([False, True, True])) == pytest.approx(87.5)


def test_a_demonstration_that_saw_nothing_has_no_coverage() -> None:
    away = ring(20)
    away = Trajectory(away.t_s, away.positions, look_at(away.positions, 3 * away.positions))
    measures = judged(away, ring(20))
    assert np.isnan(measures.coverage_seen_pct) and np.isnan(measures.coverage_paper_pct)
    assert np.isnan(measures.standoff_ratio_p50)


def test_stations_keep_the_poses_and_leave_no_gap() -> None:
    coarse = ring(20, number=9)
    dense = stations(coarse)
    gap = np.linalg.norm(np.diff(dense.positions, axis=0), axis=1)
    assert gap.max() <= 0.5 + 1e-9 and (np.diff(dense.t_s) > 0).all()
    assert np.isin(coarse.t_s.round(9), dense.t_s.round(9)).all()
    same = interpolate(coarse, dense.t_s)
    assert dense.positions == pytest.approx(same.positions)
    few = stations(ring(20, number=5000), most=300)
    assert 250 <= len(few) <= 300 and few.t_s[0] == 0 and few.t_s[-1] == 60
    assert len(stations(ring(20, number=9), most=40)) <= 40
    one = Trajectory(np.zeros(1), np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]))
    assert len(stations(one)) == 1


def test_hovering_adds_no_stations() -> None:
    still = Trajectory(np.arange(5000.0), np.zeros((5000, 3)), np.tile([0.0, 0, 0, 1], (5000, 1)))
    assert len(stations(still, most=1000)) <= 1000


def test_peaks_of_constant_acceleration() -> None:
    t = np.linspace(0, 4, 81)
    line = np.column_stack([0.75 * t**2, np.zeros((81, 2))])
    speed, acceleration = peaks(Trajectory(t, line, np.tile([0.0, 0, 0, 1], (81, 1))))
    assert speed == pytest.approx(6.0, rel=0.01) and acceleration == pytest.approx(1.5, rel=1e-6)
    assert peaks(Trajectory(t[:1], line[:1], np.array([[0.0, 0, 0, 1]]))) == (0.0, 0.0)
    assert path_length(line) == pytest.approx(12.0)


def test_states_of_the_surface() -> None:
    needed = InspectedSurface(Cloud(np.zeros((4, 3))), np.array([0.0, 1, 1, 1]), np.ones(4), 0.0)
    shown = np.array([True, True, False, False])
    never = np.array([False, False, False, True])
    assert surface_states(Shown(needed, shown, never)).state.tolist() == [0, 1, 2, 3]
    # as much area is missed as need: not the rim that hardly counts, nor what nobody asked to be shown
    rim = InspectedSurface(Cloud(np.zeros((4, 3))), np.array([1.0, 1, 0.01, 0]), np.ones(4), 0.0)
    shown, never = np.array([True, True, False, False]), np.zeros(4, bool)
    assert surface_states(Shown(rim, shown, never)).state.tolist() == [1, 1, 0, 0]
    nothing = np.zeros(4, bool)
    assert surface_states(Shown(rim, nothing, never)).state.tolist() == [2, 2, 2, 0]
