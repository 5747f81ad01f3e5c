"""Pictures: geometry of the view, what hides what, colours of the surface, equal bytes."""

from __future__ import annotations

import io

import numpy as np
import pytest
from calls import calls
from PIL import Image

from upplied.errors import SettingsError
from upplied.files import replace_file
from upplied.geometry.poses import look_at
from upplied.outputs import figures
from upplied.outputs.colours import DEMONSTRATED, PRESETS, STATES, rgb
from upplied.outputs.draw.canvas import Solid, corner_normals, picture
from upplied.outputs.draw.tubes import Tubes, frustum_corners, joined, path, thinned, tubes
from upplied.outputs.draw.views import VIEWS, Frame, View, facing, fitted
from upplied.records import Camera, Demonstration, Measures, Plan, Structure, SurfaceStates, Trajectory

NOTHING = joined([])


def box(low=(-1.0, -1.0, -1.0), high=(1.0, 1.0, 1.0)) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [tri for a, b, c, d in quads for tri in ((a, b, c), (a, c, d))]
    return np.array(low) + corners * (np.array(high) - np.array(low)), np.array(triangles)


def ball(rings: int = 48) -> tuple[np.ndarray, np.ndarray]:
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.arange(2 * rings) * np.pi / rings, indexing="ij"
    )
    vertices = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(rings), np.arange(2 * rings), indexing="ij"))
    a, b = i * 2 * rings + j, i * 2 * rings + (j + 1) % (2 * rings)
    c, d = a + 2 * rings, b + 2 * rings
    return vertices.reshape(-1, 3), np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])


def structure(name: str = "cube", size: float = 10.0) -> Structure:
    vertices, triangles = box()
    return Structure(name, "cube", size / 2 * vertices, triangles)


def circle(radius: float = 12.0, count: int = 60) -> Trajectory:
    angle = np.linspace(0, 2 * np.pi, count)
    positions = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)
    return Trajectory(angle, positions, look_at(positions, np.zeros_like(positions)))


def demonstration() -> Demonstration:
    flown = circle()
    return Demonstration("orbit", "cube", (flown.t_s * 1e9).astype(int), flown.positions, flown.quat_xyzw)


def plan(preset: str = "recommended", **changes) -> Plan:
    fields = {
        "status": "ok",
        "trajectory": circle(15.0),
        "measures": Measures(coverage_paper_pct=98.0),
    } | changes
    return Plan("orbit", "cube", "cuboid", "cube", preset, **fields)


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float) / 255


def shows(png: bytes, colour: str) -> bool:
    """Whether some pixel has a colour's hue, at any brightness."""
    image = pixels(png).reshape(-1, 3)
    tone = np.array(rgb(colour))
    vivid = np.ptp(image, axis=1) > 0.15
    cosine = image[vivid] @ tone / np.linalg.norm(image[vivid], axis=1) / np.linalg.norm(tone)
    return bool((cosine > 0.998).sum() > 5)


def places(frame: Frame, points: np.ndarray) -> np.ndarray:
    """Where points (N, 3), m, appear, (N, 2) px from the upper left."""
    local = points - frame.centre
    depth = local @ frame.back
    grow = frame.metre_px if np.isinf(frame.eye_m) else frame.metre_px * frame.eye_m / (frame.eye_m - depth)
    across, upward = (local @ frame.right) * grow, (local @ frame.up) * grow
    return np.stack([frame.width / 2 + across, frame.height / 2 - upward], axis=1)


@pytest.mark.parametrize("view", [*VIEWS.values(), View(30.0, -70.0, 80.0)])
def test_the_ray_through_a_points_pixel_meets_the_point(view):
    points = np.random.default_rng(1).normal(size=(40, 3)) * [30, 10, 5] + [100, -50, 7]
    frame = fitted(view, points, 640, 400)
    seen = places(frame, points)
    assert (seen >= 0).all() and (seen <= [640, 400]).all()
    origins, directions = frame.rays(seen[:, 0], seen[:, 1])
    off = np.cross(points - origins, directions)
    assert np.linalg.norm(off, axis=1).max() < 1e-6


def test_a_ball_covers_its_area_at_the_scale_of_the_frame():
    vertices, triangles = ball()
    frame = fitted(VIEWS["three-quarter"], vertices, 300, 300)
    image = picture(Solid(vertices, triangles), NOTHING, frame)
    covered = ((255.0 - image) / 255).max(axis=2) > 0.02
    assert covered.sum() == pytest.approx(np.pi * frame.metre_px**2, rel=0.02)


def test_smooth_normals_of_a_ball_are_radial_and_a_box_keeps_its_creases():
    vertices, triangles = ball()
    flipped = triangles.copy()
    flipped[::3] = flipped[::3, ::-1]
    real = np.linalg.norm(np.cross(*(np.diff(vertices[triangles], axis=1).swapaxes(0, 1))), axis=1) > 1e-9
    for wound in (triangles, flipped):
        normals = corner_normals(vertices, wound)[real]
        assert (np.abs(np.einsum("tkj,tkj->tk", normals, vertices[wound][real])) > 0.995).all()
    vertices, triangles = box()
    normals = corner_normals(vertices, triangles)
    assert np.allclose(normals, normals[:, :1]) and np.allclose(np.abs(normals).max(axis=2), 1)


def test_a_tube_is_bright_in_front_and_faint_behind():
    body = Solid(*box())
    frame = fitted(VIEWS["side"], body.vertices, 200, 200)  # the eye is on the side of -Y
    red = (1.0, 0.0, 0.0)
    reds = []
    for y in (-3.0, 3.0):
        line = tubes(np.array([[-1.0, y, 0.0]]), np.array([[1.0, y, 0.0]]), 0.1, red)
        colour = picture(body, line, frame)[100, 100].astype(float)
        reds.append(colour[0] - colour[1])
    assert reds[0] > 200 and 10 < reds[1] < 80


def test_the_two_skins_of_a_thin_plate_keep_their_own_colours():
    vertices, triangles = box((-5, -5, -0.02), (5, 5, 0.02))
    grid = np.stack(np.meshgrid(np.linspace(-5, 5, 20), np.linspace(-5, 5, 20)), axis=-1).reshape(-1, 2)
    points = np.concatenate([np.c_[grid, np.full(400, 0.02)], np.c_[grid, np.full(400, -0.02)]])
    normals = np.repeat([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], 400, axis=0)
    states = SurfaceStates(points, np.repeat([1, 2], 400), normals)
    body = Solid(vertices, triangles, states)
    for elevation, name in ((80.0, "shown"), (-80.0, "missed")):
        image = picture(body, NOTHING, fitted(View(0.0, elevation), vertices, 120, 120))
        colour = image[60, 60] / 255
        tone = np.array(rgb(STATES[name]))
        assert np.argmax(colour) == np.argmax(tone)
        assert np.allclose(colour / colour.max(), tone / tone.max(), atol=0.03)


def test_moving_a_structure_does_not_change_its_picture():
    here = structure()
    there = Structure("cube", "cube", here.vertices + np.array([4096.0, -512.0, 64.0]), here.triangles)
    difference = np.abs(
        pixels(figures.structure_png(here, width=500)) - pixels(figures.structure_png(there, width=500))
    )
    assert (difference > 0.1).mean() < 1e-3


def test_equal_input_gives_equal_bytes():
    source, target = structure(), structure("cuboid", 12.0)
    first = figures.transfer_png(source, target, demonstration(), plan(), width=500)
    assert first == figures.transfer_png(source, target, demonstration(), plan(), width=500)


def test_a_transfer_shows_both_paths_and_a_refused_one_none():
    source, target = structure(), structure("cuboid", 12.0)
    picture = figures.transfer_png(source, target, demonstration(), plan(), width=500)
    assert shows(picture, DEMONSTRATED) and shows(picture, PRESETS["recommended"])
    refused = plan(status="refused", reason="score 0.9 m² above gamma → “no”", trajectory=None)
    png = figures.transfer_png(source, target, demonstration(), refused, width=500)
    assert shows(png, DEMONSTRATED) and not shows(png, PRESETS["recommended"])


def test_a_comparison_shows_each_preset_in_its_colour():
    png = figures.comparison_png(structure("cuboid"), [plan(preset) for preset in PRESETS], width=900)
    assert all(shows(png, colour) for colour in PRESETS.values())


def test_a_point_cloud_and_any_text_can_be_drawn():
    points = ball(12)[0]
    cloud = Structure("cloud", "statue", points, np.empty((0, 3), int), normals=points)
    png = figures.structure_png(cloud, ("top",), title="<b>日本 \x00 é " + "x" * 500, width=300)
    assert pixels(png).shape[1] == 300


def test_a_wrong_view_is_named_with_those_that_exist():
    with pytest.raises(SettingsError, match="three-quarter"):
        figures.structure_png(structure(), ("sideways",))


def test_frustum_corners_lie_at_the_half_angles():
    corners = frustum_corners(np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]), Camera(90.0, 60.0), 2.0)[0]
    assert np.allclose(corners[:, 0], 2) and np.allclose(np.abs(corners[:, 1]), 2)
    assert np.allclose(np.abs(corners[:, 2]), 2 * np.tan(np.radians(30)))


def test_thinning_keeps_the_ends_and_a_standing_path_can_be_drawn():
    line = np.c_[np.linspace(0, 1, 1000), np.zeros((1000, 2))]
    remaining = thinned(line, 0.1)
    assert len(remaining) <= 12 and np.allclose(remaining[[0, -1]], line[[0, -1]])
    assert len(path(np.zeros((5, 3)), 0.1, (0, 0, 0)).triangles)
    assert isinstance(joined([]), Tubes) and len(joined([]).triangles) == 0


def test_saving_leaves_one_file(tmp_path):
    goal = replace_file(
        tmp_path / "deep" / "cube.png", figures.structure_png(structure(), ("top",), width=200)
    )
    assert [item.name for item in goal.parent.iterdir()] == ["cube.png"]


@pytest.mark.ci
def test_a_real_structure_is_drawn_by_arrays_and_not_triangle_by_triangle(real_data):
    import trimesh

    mesh = trimesh.load(real_data / "meshes" / "airplane" / "beluga_fr24.ply", process=False)
    real = Structure("beluga", "airplane", np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64))
    png = figures.structure_png(real)  # the ray caster is loaded once
    assert calls(lambda: figures.structure_png(real)) < len(real.triangles) / 2
    assert (pixels(png) < 0.95).any(axis=2).mean() > 0.05


@pytest.mark.parametrize(
    ("side", "azimuth"), [((0, 9, 0), 52), ((0, -9, 0), -52), ((-20, 9, 0), 128), ((-20, -9, 0), -128)]
)
def test_the_view_is_from_the_side_on_which_was_flown(side, azimuth):
    flown = circle(1.0).positions + np.array(side)
    assert facing(structure().vertices, flown).azimuth_deg == azimuth
