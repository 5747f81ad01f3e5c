"""Own frames of structures: the heading of walls, and everything carried there and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from moved_scenes import about_z
from scipy.spatial.transform import Rotation

from upplied.config import settings_for
from upplied.planning.surface.frames import (
    DECLARED,
    demonstration_in,
    frames_for,
    in_declared,
    in_frame,
    named_axes,
    own_frame,
    plans_in_own_frame,
    registration_from,
    structure_in,
)
from upplied.records import (
    Demonstration,
    Frame,
    Registration,
    Structure,
    SurfaceStates,
    Trajectory,
)

FRAME = Frame(np.radians(33.0), np.array([4.0, -2.0, 0.0]))


def prism(degrees: float, sides: tuple[float, float] = (9.0, 5.0), corners: int = 4) -> Structure:
    """Upright walls on a rectangle, or on a regular polygon, turned."""
    angle = 2 * np.pi * (np.arange(corners) + 0.5) / corners
    outline = np.column_stack([sides[0] * np.cos(angle), sides[1] * np.sin(angle)])
    low, high = (np.column_stack([outline, np.full(corners, z)]) for z in (0.0, 6.0))
    here = np.arange(corners)
    there = (here + 1) % corners
    triangles = np.vstack(
        [
            np.column_stack([here, there, there + corners]),
            np.column_stack([here, there + corners, here + corners]),
        ]
    )
    vertices = np.vstack([low, high]) @ about_z(degrees).T
    return Structure(
        "prism", "box", vertices, triangles, sha256="abc", landmarks={"corner": tuple(vertices[0])}
    )


def off_axes_deg(heading_rad: float, degrees: float) -> float:
    """How far a heading is from a direction or a right angle from it."""
    return abs((np.degrees(heading_rad) - degrees + 45) % 90 - 45)


@pytest.mark.parametrize("degrees", [0.0, 10.0, 44.0, 46.0, -80.0, 200.0])
def test_the_axes_are_those_that_walls_face(degrees: float) -> None:
    for shape in (prism(degrees), prism(degrees, (9.0, 9.0)), prism(degrees, (30.0, 1.0))):
        frame = own_frame(shape)
        assert off_axes_deg(frame.heading_rad, degrees) < 1e-6
        assert -np.pi <= frame.heading_rad <= np.pi
        assert frame.origin_m == pytest.approx([*shape.vertices[:, :2].mean(axis=0), 0.0])
    upright = own_frame(prism(0.0)).heading_rad
    turned = own_frame(prism(degrees)).heading_rad
    assert np.degrees(turned - upright - np.radians(degrees) + np.pi) % 360 == pytest.approx(180)


def test_longer_walls_count_more() -> None:
    """A long shed with two oblique ends."""
    outline = np.array([(0, 0), (40, 0), (43, 5), (3, 5)], float)
    vertices = np.vstack([np.column_stack([outline, np.full(4, z)]) for z in (0.0, 3.0)])
    here, there = np.arange(4), np.array([1, 2, 3, 0])
    triangles = np.vstack(
        [np.column_stack([here, there, there + 4]), np.column_stack([here, there + 4, here + 4])]
    )
    assert off_axes_deg(own_frame(Structure("shed", "box", vertices, triangles)).heading_rad, 0.0) < 8


def test_round_walls_have_a_heading_from_their_vertices_alone() -> None:
    tower = prism(0.0, (5.0, 5.0), corners=64)
    heading = own_frame(tower).heading_rad
    offset = tower.vertices[:, :2] - tower.vertices[:, :2].mean(axis=0)
    along = ((np.arange(128) * (np.sqrt(5) - 1) / 2) % 1 - 0.5) @ offset
    assert heading == pytest.approx(np.arctan2(along[1], along[0]))
    turned = own_frame(prism(71.0, (5.0, 5.0), corners=64)).heading_rad
    assert np.degrees(turned - heading) % 360 == pytest.approx(71.0)


def test_points_tell_their_heading_by_normals_or_by_their_offsets() -> None:
    shape = prism(20.0, (9.0, 9.0))
    grid = np.vstack([shape.vertices, shape.vertices * [1, 1, 0.5]])
    normals = np.repeat([[1.0, 0, 0], [0, 1, 0]], 8, axis=0) @ about_z(20.0).T
    scan = Structure("scan", "box", grid, np.empty((0, 3), np.int64), normals)
    assert off_axes_deg(own_frame(scan).heading_rad, 20.0) < 1e-6
    plain = Structure("plain", "box", grid, np.empty((0, 3), np.int64))
    assert off_axes_deg(own_frame(plain).heading_rad, 65.0) < 1e-6  # the diagonals
    flat = Structure("flat", "box", np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    assert np.isfinite(own_frame(flat).heading_rad)


def test_what_is_published_keeps_the_declared_axes_unless_walls_stand_askew() -> None:
    paper, recommended = settings_for("paper"), settings_for("recommended")
    assert plans_in_own_frame(recommended) and not plans_in_own_frame(paper)
    other = prism(11.0)
    for degrees in (0.0, 1.9, -1.9, 91.0):
        assert frames_for(prism(degrees), other, paper) == (DECLARED, DECLARED)
    for degrees in (2.1, -2.1, 30.0):
        here, there = frames_for(prism(degrees), other, paper)
        assert (
            np.degrees(here.heading_rad)
            == pytest.approx(degrees)
            == pytest.approx(np.degrees(there.heading_rad))
        )
        assert not here.origin_m.any()
    assert frames_for(prism(0.0, (5.0, 5.0), 64), other, paper) == (DECLARED, DECLARED)
    own = frames_for(prism(30.0), other, recommended)
    assert own[1] is own_frame(other)


@pytest.mark.parametrize(
    "changes",
    [
        {"visibility": {"occlusion": False}},
        {"correspondence": {"method": "nearest"}},
        {"transfer": {"method": "zscore"}},
    ],
)
def test_every_step_must_mind_the_frame(changes: dict[str, dict[str, object]]) -> None:
    recommended = settings_for("recommended")
    ((section, values),) = changes.items()
    assert not plans_in_own_frame(
        replace(recommended, **{section: replace(getattr(recommended, section), **values)})
    )


def test_a_structure_is_carried_with_all_that_it_has() -> None:
    shape = replace(prism(5.0), normals=np.tile([1.0, 0, 0], (8, 1)))
    there = structure_in(FRAME, shape)
    assert there.vertices == pytest.approx((shape.vertices - FRAME.origin_m) @ about_z(33.0), abs=1e-6)
    assert np.array_equal(there.vertices, np.round(there.vertices * 2**20) / 2**20)
    assert there.normals == pytest.approx(np.tile([1.0, 0, 0] @ about_z(33.0), (8, 1)))
    corner = (np.array(shape.landmarks["corner"]) - FRAME.origin_m) @ about_z(33.0)
    assert there.landmarks["corner"] == pytest.approx(corner)
    assert there.frame is FRAME and there.triangles is shape.triangles
    assert there.sha256 == f"abc-turned-{np.radians(33):.12f}-about-4.000000--2.000000"
    assert structure_in(FRAME, shape) is there and structure_in(DECLARED, shape) is shape
    assert structure_in(Frame(0.1), shape) is not there
    assert structure_in(FRAME, replace(shape, sha256="")).sha256 == ""


def flight() -> Demonstration:
    rng = np.random.default_rng(0)
    quats = Rotation.random(6, rng).as_quat()
    return Demonstration("d", "s", np.arange(6), rng.normal(0, 20, (6, 3)), quats, sha256="def")


def test_a_flight_is_carried_there_and_back() -> None:
    before = flight()
    there = demonstration_in(FRAME, before)
    assert there.positions == pytest.approx((before.positions - FRAME.origin_m) @ about_z(33.0), abs=1e-6)
    turned = Rotation.from_matrix(about_z(-33.0)) * Rotation.from_quat(before.quat_xyzw)
    assert (Rotation.from_quat(there.quat_xyzw) * turned.inv()).magnitude() == pytest.approx(
        np.zeros(6), abs=1e-8
    )
    assert there.sha256.startswith("def-turned-") and demonstration_in(DECLARED, before) is before
    plain = in_frame(FRAME, before.trajectory)
    assert plain.positions == pytest.approx(there.positions, abs=1e-6)
    assert np.abs((plain.quat_xyzw * there.quat_xyzw).sum(axis=1)) == pytest.approx(np.ones(6))
    back = in_declared(FRAME, plain)
    assert back is not None
    assert back.positions == pytest.approx(before.positions)
    assert np.abs((back.quat_xyzw * before.quat_xyzw).sum(axis=1)) == pytest.approx(np.ones(6))
    path = Trajectory(before.trajectory.t_s, before.positions, before.quat_xyzw)
    assert in_frame(DECLARED, path) is path and in_declared(DECLARED, path) is path
    assert in_declared(FRAME, None) is None


def test_a_surface_is_carried_back() -> None:
    points, normals = np.ones((2, 3)), np.tile([0.0, 1, 0], (2, 1))
    surface = in_declared(FRAME, SurfaceStates(points, np.zeros(2, np.int64), normals))
    assert surface is not None
    assert surface.points == pytest.approx(points @ about_z(33.0).T + FRAME.origin_m)
    assert surface.normals == pytest.approx(normals @ about_z(33.0).T)
    plain = in_declared(FRAME, SurfaceStates(points, np.zeros(2, np.int64)))
    assert plain is not None and plain.normals is None
    assert in_declared(FRAME, None) is None
    states = SurfaceStates(points, np.zeros(2, np.int64))
    assert in_declared(DECLARED, states) is states


@pytest.mark.parametrize("heading", [20.0, 100.0, 178.0, -95.0])
def test_a_registration_says_the_same_in_the_declared_frames(heading: float) -> None:
    here = Frame(np.radians(heading), np.array([1.0, 2.0, 0.0]))
    turn = Rotation.from_euler("xyz", [0, 0, 90], degrees=True).as_matrix()
    rotation = Rotation.from_euler("xyz", [3, -2, 5], degrees=True).as_matrix()
    registration = Registration(
        np.array([2.0, 3.0, 4.0]), rotation, np.array([5.0, 6, 7]), 0.0, True, turn=turn
    )
    declared = registration_from(here, FRAME, registration)
    assert declared is not None
    points = np.random.default_rng(1).normal(0, 9, (5, 3))
    expected = here.to_declared(registration.to_demo(FRAME.from_declared(points)))
    assert declared.to_demo(points) == pytest.approx(expected)
    assert declared.to_target(expected) == pytest.approx(points)
    assert np.linalg.det(declared.rotation) == pytest.approx(1) and np.linalg.det(
        declared.turn
    ) == pytest.approx(1)
    quarter = round(heading / 90) % 2
    assert declared.scale == pytest.approx([3, 2, 4] if quarter else [2, 3, 4])
    assert registration_from(DECLARED, DECLARED, registration) is registration
    assert registration_from(here, FRAME, None) is None
    assert registration_from(DECLARED, FRAME, registration) is not registration


def test_words_mean_the_nearest_declared_axes() -> None:
    for degrees, front in ((0.0, [1, 0, 0]), (44.0, [1, 0, 0]), (46.0, [0, 1, 0]), (-100.0, [0, -1, 0])):
        assert named_axes(Frame(np.radians(degrees)))[:, 0] == pytest.approx(front)


def test_the_heading_does_not_depend_on_the_size() -> None:
    for scale in (0.003, 1.0, 500.0):
        shape = prism(30.0)
        sized = replace(shape, vertices=scale * shape.vertices)
        assert off_axes_deg(own_frame(sized).heading_rad, 30.0) < 1e-6
    upright = own_frame(prism(0.0)).heading_rad
    small = replace(prism(0.0), vertices=0.01 * prism(0.0).vertices)
    assert own_frame(small).heading_rad == pytest.approx(upright, abs=1e-9)
