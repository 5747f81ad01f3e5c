"""Findings from a mark in a photo to the same view on another structure."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from findings_cases import scan_of
from made_plans import plan_as_demonstrated
from PIL import Image
from random_members import random_member
from true_counterparts import true_counterparts

from upplied import fleet
from upplied.catalog import open_catalog, verify
from upplied.catalog.database import Catalog
from upplied.catalog.verbs.published import export_tables
from upplied.cli import main
from upplied.config import CloudSettings
from upplied.errors import CatalogError, InputError, RefusedError, SettingsError
from upplied.findings.adding import Placing, add_marks, escaping, on_surface
from upplied.findings.campaign import due_jobs, plan_campaign, plan_job, selected_findings
from upplied.findings.carried import Carrying
from upplied.findings.crops import sharpness
from upplied.findings.looks import Spot, looks_at_spot, looks_frame, spot_at, spot_of
from upplied.findings.marks import Mark, box_corners, read_marks
from upplied.findings.photos import flight_of, register_photos
from upplied.findings.place import Errors, located
from upplied.findings.queries import by_reference, kind_map, photographed
from upplied.findings.rays import footprint_m, pixels_of, rays_of, widest_rad
from upplied.findings.reshoot import plan_reshoot
from upplied.geometry.poses import look_at, matrices
from upplied.geometry.scene import scene_of
from upplied.geometry.vectors import points_on_triangles
from upplied.outputs.page_data import fleet_findings, structure_facts
from upplied.outputs.pictures import reference_photos
from upplied.outputs.publish import publish_pages
from upplied.planning.surface.samples import surface_samples
from upplied.records import Camera, Demonstration, Lens, Structure
from upplied.samples.fleet import member
from upplied.web.live import LivePages

CUBE, CUBOID = member("cube-v1").structure, member("cuboid-v1").structure
LOW, HIGH = CUBE.vertices.min(axis=0), CUBE.vertices.max(axis=0)
CAMERA = Camera(70.0, 55.0, 1.0, 30.0, 1600, 1190)  # 7 mm a pixel from 8 m
MARK = np.array([HIGH[0], 1.0, 4.0])  # on the side that faces +X
BEGAN_NS = 1_770_000_000_000_000_000


def flown() -> Demonstration:
    """Past the side of the cube that faces +X, 8 m from it, looking straight at it."""
    y = np.linspace(-4.0, 4.0, 41)
    positions = np.column_stack([np.full(41, HIGH[0] + 8.0), y, np.full(41, 4.0)])
    quats = look_at(positions, positions - [8.0, 0.0, 0.0])
    t_ns = BEGAN_NS + np.arange(41, dtype=np.int64) * 500_000_000
    return Demonstration("past", "cube-v1", t_ns, positions, quats, CAMERA, sha256="ab" * 32)


def pixel_of(t_s: float, point: np.ndarray) -> tuple[float, float]:
    """Where a point is in the photo at a time, by tangents."""
    y = np.interp(t_s, [0.0, 20.0], [-4.0, 4.0])
    focal = 800 / np.tan(np.radians(35.0)), 595 / np.tan(np.radians(27.5))
    return 800 + focal[0] * (point[1] - y) / 8.0, 595 - focal[1] * (point[2] - 4.0) / 8.0


def square(t_s: float, half_m: float) -> tuple[tuple[float, float], ...]:
    ways = ((-1, 1), (1, 1), (1, -1), (-1, -1))
    return tuple(pixel_of(t_s, MARK + half_m * np.array([0.0, across, up])) for across, up in ways)


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """A catalog with the flight, a photo of it every 5 s, and one finding: a square of 0.4 m."""
    folder = tmp_path_factory.mktemp("findings")
    catalog = open_catalog(folder / "catalog")
    catalog.add_structures([CUBE, CUBOID])
    catalog.add_demonstrations([flown()])
    photos = folder / "photos"
    photos.mkdir()
    lines = ["name,t_ns"]
    for number, t_s in enumerate((0.0, 5.0, 10.0, 15.0, 20.0)):
        pixels = np.full((1190, 1600, 3), 90, np.uint8)
        corners = np.array(square(t_s, 0.2))
        (left, top), (right, bottom) = corners.min(axis=0).astype(int), corners.max(axis=0).astype(int)
        pixels[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = 250
        Image.fromarray(pixels).save(photos / f"P{number}.png", compress_level=1)
        lines.append(f"P{number}.png,{BEGAN_NS + int(t_s * 1e9)}")
    (folder / "times.csv").write_text("\n".join(lines))
    new, refused = register_photos(
        catalog, flight_of(catalog, "past"), photos, folder / "times.csv", by="Ada"
    )
    assert (new, refused) == (5, [])
    marks = add_marks(catalog, [Mark("it", "P2.png", square(10.0, 0.2), class_name="crack")], "Ada")
    assert marks.new == 1
    return catalog, folder, marks.ids[0]


@pytest.fixture
def catalog(filled) -> Catalog:
    return filled[0]


def row_of(catalog: Catalog, name: str) -> dict:
    return catalog.finding(name)


def test_a_pixel_is_the_ray_to_what_it_shows_and_back():
    quat = look_at(np.array([1.0, 2.0, 3.0]), np.array([4.0, -3.0, 1.0]))
    for camera in (CAMERA, Camera(200.0, 150.0, 1.0, 30.0, 1600, 1200)):
        pixels = np.array([[0.0, 0.0], [800.0, 595.0], [1599.0, 12.5]])
        points = np.array([1.0, 2.0, 3.0]) + 7 * rays_of(camera, pixels) @ matrices(quat).T
        assert pixels_of(camera, np.array([1.0, 2.0, 3.0]), quat, points) == pytest.approx(pixels, abs=1e-6)


LENSES = {
    "brown": (Lens("brown", (-0.28, 0.09, 1e-3, -5e-4, -0.01), (0.51, 0.49)), 73.7, 53.1),
    "rational": (Lens("brown", (0.5, 0.2, 1e-3, 0.0, 0.01, 0.6, 0.3, 0.02)), 60.0, 45.0),
    "fisheye": (Lens("fisheye", (-0.02, 0.003, 1e-4, -1e-4), (0.49, 0.5)), 170.0, 128.0),
    "behind": (Lens("fisheye", (0.05,)), 220.0, 165.0),
}


@pytest.mark.parametrize("name", LENSES)
def test_a_lens_shows_points_where_opencv_says_and_rays_lead_back_from_its_corners(name):
    lens, across, down = LENSES[name]
    camera = Camera(across, down, 1.0, 30.0, 4000, 3000, lens=lens)
    pixels = np.random.default_rng(3).uniform([0, 0], [4000, 3000], (300, 2))
    pixels = np.concatenate([pixels, [[0, 0], [4000, 0], [0, 3000], [4000, 3000]]])
    rays = rays_of(camera, pixels)
    assert np.linalg.norm(rays, axis=1) == pytest.approx(1.0)
    assert pixels_of(camera, np.zeros(3), np.array([0.0, 0, 0, 1]), 5 * rays) == pytest.approx(
        pixels, abs=1e-6
    )
    assert np.arccos(rays[:, 0]).max() <= widest_rad(camera) + 1e-9
    # The formulas of OpenCV's documentation, in its frame: x right, y down, z ahead.
    k = (*lens.coefficients, *(0.0,) * 8)
    for (u, v), (z, x, y) in zip(pixels, rays * [1, -1, -1], strict=True):
        if lens.model == "fisheye":
            angle = np.arctan2(np.hypot(x, y), z)
            grown = angle * (1 + k[0] * angle**2 + k[1] * angle**4 + k[2] * angle**6 + k[3] * angle**8)
            shown = grown * np.array([x, y]) / np.hypot(x, y)
            focal = 4000 / np.radians(across), 3000 / np.radians(down)
        else:
            a, b = x / z, y / z
            r2 = a * a + b * b
            ratio = (1 + k[0] * r2 + k[1] * r2**2 + k[4] * r2**3) / (
                1 + k[5] * r2 + k[6] * r2**2 + k[7] * r2**3
            )
            shown = (
                a * ratio + 2 * k[2] * a * b + k[3] * (r2 + 2 * a * a),
                b * ratio + k[2] * (r2 + 2 * b * b) + 2 * k[3] * a * b,
            )
            focal = 2000 / np.tan(np.radians(across / 2)), 1500 / np.tan(np.radians(down / 2))
        middle = 4000 * lens.middle[0], 3000 * lens.middle[1]
        assert (middle[0] + focal[0] * shown[0], middle[1] + focal[1] * shown[1]) == pytest.approx(
            (u, v), abs=1e-6
        )


def test_a_lens_whose_model_folds_the_picture_shows_nothing_beyond_the_fold():
    folding = Camera(90.0, 70.0, 1.0, 30.0, 4000, 3000, lens=Lens("brown", (-0.6,)))
    assert np.isnan(rays_of(folding, np.array([1.0, 1.0]))).all()
    aside = np.array([[1.0, -3.0, 0.0]])  # its model would bring it back into the picture
    assert np.isnan(pixels_of(folding, np.zeros(3), np.array([0.0, 0, 0, 1]), aside)).all()


def test_a_finding_in_the_corner_of_a_distorted_photo_lies_where_its_lens_saw_it(tmp_path):
    camera = replace(CAMERA, lens=Lens("brown", (-0.2, 0.04, 5e-4, -5e-4), (0.505, 0.495)))
    path = flown()
    stored = open_catalog(tmp_path / "catalog")
    stored.add_structures([CUBE])
    stored.add_demonstrations([replace(path, camera=camera)])
    assert stored.demonstration("past").camera.lens == flight_of(stored, "past").camera.lens == camera.lens
    at = 20
    corner = np.array([HIGH[0], path.positions[at, 1] + 4.7, 7.0])  # outside of what a pinhole would show
    (pixel,) = pixels_of(camera, path.positions[at], path.quat_xyzw[at], corner[None])
    assert (pixel > 0).all() and (pixel < [1600, 1190]).all()
    plain = pixels_of(CAMERA, path.positions[at], path.quat_xyzw[at], corner[None])[0]
    assert np.linalg.norm(plain - pixel) > 30
    mark = Mark("it", flight="past", t_s=at * 0.5, pixels=(tuple(pixel.tolist()),))
    marks = add_marks(stored, [mark], "Ada")
    row = stored.finding(marks.ids[0])
    assert [row["x_m"], row["y_m"], row["z_m"]] == pytest.approx(corner, abs=1e-4)
    (look,) = looks_at_spot(stored, spot_of(row))  # the finest moment of a flight without photos
    seen = look.row
    assert seen["left_px"] <= seen["right_px"] and look.camera.lens == camera.lens
    # A lens that folds the picture says so.
    folding = replace(path, demonstration_id="fold", camera=replace(camera, lens=Lens("brown", (-1.5,))))
    stored.add_demonstrations([replace(folding, sha256="cd" * 32)])
    bad = add_marks(stored, [replace(mark, flight="fold", pixels=((3.0, 3.0),))], "Ada")
    assert "outside the valid area of the lens model" in bad.refused[0] and not bad.new


def test_the_middle_pixel_covers_what_rays_through_its_corners_meet():
    position, place, normal = np.array([0.0, 0.0, 0.0]), np.array([6.0, 2.0, 1.0]), np.array([-0.8, 0.6, 0.0])
    quat = look_at(position, place)
    (pixel,) = pixels_of(CAMERA, position, quat, place[None])
    ends = []
    for way in np.radians(np.arange(0, 180, 1.0)):
        rays = rays_of(
            CAMERA, pixel + 0.5 * np.array([[-np.cos(way), -np.sin(way)], [np.cos(way), np.sin(way)]])
        )
        rays = rays @ matrices(quat).T
        there = position + ((place - position) @ normal / (rays @ normal))[:, None] * rays
        ends.append(np.linalg.norm(there[1] - there[0]))
    assert footprint_m(CAMERA, position, place, normal) == pytest.approx(max(ends), rel=0.01)


def test_a_finding_has_its_place_size_and_view(filled):
    catalog, _, name = filled
    row = row_of(catalog, name)
    assert [row[f"{axis}_m"] for axis in "xyz"] == pytest.approx(MARK, abs=1e-3)
    assert json.loads(row["normal_json"]) == pytest.approx([1.0, 0.0, 0.0])
    assert row["length_mm"] == pytest.approx(400 * np.sqrt(2), rel=1e-3)
    assert row["area_mm2"] == pytest.approx(160_000, rel=1e-3)
    assert row["distance_m"] == pytest.approx(np.hypot(8.0, 1.0)) and row["state"] == "open"
    assert (row["class"], row["by"], row["photo"], row["kind"]) == ("crack", "Ada", "P2.png", CUBE.kind)
    assert (
        f"{row['photo_at']:%H:%M:%S}" == f"{np.datetime64(BEGAN_NS, 'ns') + np.timedelta64(10, 's')}"[11:19]
    )
    # the position is not stated: half a metre; and 0.4 degrees of attitude from 8 m
    assert 0.3 < row["place_error_m"] < 0.7 and row["pixel_error_m"] < 0.04 and row["mesh_error_m"] == 0
    assert 0 < row["length_error_mm"] < 100 and verify(catalog) == []


def test_the_same_mark_again_adds_nothing_and_states_are_a_history(filled, tmp_path):
    catalog, _, name = filled
    mark = Mark("it", "P2.png", square(10.0, 0.2), class_name="crack")
    assert add_marks(catalog, [mark], "Bob").new == 0
    catalog.set_finding(name[:6], "watched", "Bob", "grows")
    assert (
        list(catalog.findings(state="watched")["note"]) == ["grows"] and catalog.findings(state="open").empty
    )
    history = catalog.findings(history=True)
    assert list(history["state"]) == ["open", "watched"] and list(history["by"]) == ["Ada", "Bob"]
    catalog.set_finding(name, "open", "Ada")
    for state, by, kind in (("gone", "Ada", SettingsError), ("open", " ", SettingsError)):
        with pytest.raises(kind):
            catalog.set_finding(name, state, by)
    with pytest.raises(CatalogError, match="is not in the catalog"):
        catalog.finding("nothing")
    assert len(catalog.findings(class_name="crack", since="2000-01-01", kind=CUBE.kind)) == 1
    assert catalog.findings(since="2100-01-01").empty and catalog.findings(structure="cuboid-v1").empty
    assert export_tables(catalog, tmp_path)["findings"] == 1 and verify(catalog) == []


@pytest.mark.parametrize(
    ("mark", "reason"),
    [
        (Mark("it", "P9.png", ((1.0, 1.0),)), "photo P9.png: belongs to no known flight"),
        (Mark("it", "P4.png", ((1590.0, 600.0),)), "is beside the structure, or on another surface"),
        (Mark("it", "P2.png", ((5000.0, 10.0),)), "lies outside its photo"),
        (Mark("it", flight="past", t_s=30.0, pixels=((1.0, 1.0),)), "the flight took 20.0 s"),
        (Mark("it", flight="none", t_s=1.0, pixels=((1.0, 1.0),)), "flight none: is not in the catalog"),
        (Mark("it", pixels=((1.0, 1.0),)), "has neither photo nor time"),
        (Mark("it", place=(0.0, 0.0, 90.0), structure="cube-v1"), "m off the surface of cube-v1"),
    ],
)  # fmt: skip
def test_what_cannot_be_placed_is_refused_with_the_reason(catalog, mark, reason):
    before = len(catalog.findings(history=True))
    marks = add_marks(catalog, [mark], "Ada")
    assert marks.new == 0 and reason in marks.refused[0] and len(catalog.findings(history=True)) == before


def test_a_grazing_look_is_refused():
    position = np.array([HIGH[0] + 0.5, -15.0, 4.0])
    quat = look_at(position, MARK)
    (pixel,) = pixels_of(CAMERA, position, quat, MARK[None])
    with pytest.raises(RefusedError, match=r"looks at the surface at 88 degrees"):
        located("it", scene_of(CUBE), CAMERA, position, quat, pixel[None], Errors())


def test_the_stated_error_holds_in_95_percent_of_draws():
    rng, scene = np.random.default_rng(5), scene_of(CUBE)
    errors, off = Errors(0.3, 0.5, 2.0), []
    position = np.array([HIGH[0] + 6.0, -2.0, 5.0])
    for _ in range(120):
        target = MARK + np.append(0.0, rng.uniform(-2, 2, 2))
        (pixel,) = pixels_of(CAMERA, position, look_at(position, MARK), target[None])
        logged = position + rng.normal(0, 0.3 / 2.7955, 3)
        aside = MARK + np.cross(rng.normal(0, np.radians(0.5), 3), MARK - position)
        spot = located("it", scene, CAMERA, logged, look_at(logged, logged + aside - position),
                        (pixel + rng.normal(0, 2.0, 2))[None], errors)  # fmt: skip
        off.append(np.linalg.norm(spot.place - target) / spot.error_m)
    assert 0.90 <= np.mean(np.array(off) <= 1) <= 0.99


def test_files_of_detections_say_the_same(tmp_path):
    corners = [[10.0, 20.0], [40.0, 20.0], [40.0, 60.0], [10.0, 60.0]]
    coco = {
        "images": [{"id": 1, "file_name": "a/P2.png", "width": 1600, "height": 1190}],
        "categories": [{"id": 3, "name": "crack"}],
        "annotations": [{"id": 7, "image_id": 1, "category_id": 3, "bbox": [10, 20, 30, 40]}],
    }
    (tmp_path / "c.json").write_text(json.dumps(coco))
    (tmp_path / "d.csv").write_text("photo,x_px,y_px,width_px,height_px,class\nP2.png,10,20,30,40,crack\n")
    shape = {"type": "Polygon", "coordinates": [[*corners, corners[0]]]}
    feature = {"type": "Feature", "geometry": shape, "properties": {"photo": "P2.png", "class": "crack"}}
    (tmp_path / "g.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    marks = [read_marks(tmp_path / name)[0] for name in ("c.json", "d.csv", "g.geojson")]
    assert {mark.pixels for mark in marks} == {box_corners(10.0, 20.0, 30.0, 40.0)}
    assert {mark.class_name for mark in marks} == {"crack"} and marks[0].size_px == (1600, 1190)
    assert all(len(mark.file_sha256) == 64 for mark in marks)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", "{"), ("b.json", "[1]"), ("c.json", '{"images": [], "annotations": []}'),
        ("d.csv", "a,b\n1,2\n"),
        ("e.csv", "photo,x_px,y_px\nP,nan,1\n"), ("f.geojson", '{"features": [{"geometry": {"type": "X", '
         '"coordinates": []}}]}'), ("g.json", "[" * 50_000), ("i.csv", "photo\n" + "1" * 200_000),
        ("j.json", '{"images": [{"id": 1, "file_name": "P", "width": 1e999}], "annotations": [{"image_id": '
         '1, "bbox": [1, 1, 1, 1]}]}'), ("k.json", '{"images": [{"id": 1, "file_name": "P"}], "annotations": '
         '[{"image_id": 1, "bbox": [1' + "0" * 400 + ", 1, 1, 1]}]}"),
        ("h.csv", "photo,outline_px\nP,1 2 3\n"),
    ],
)  # fmt: skip
def test_a_file_that_is_none_is_told_with_the_rule(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=rf"{name}: (cannot be read|holds 0 marks)"):
        read_marks(tmp_path / name)


def test_a_detection_in_a_smaller_copy_of_a_photo_is_enlarged_and_one_of_another_shape_refused(
    filled, tmp_path
):
    catalog = filled[0]
    x, y = pixel_of(5.0, MARK)
    image = {"id": 1, "file_name": "P1.png", "width": 800, "height": 595}
    coco = {"images": [image], "annotations": [{"image_id": 1, "bbox": [x / 2 - 5, y / 2 - 5, 10, 10]}]}
    (tmp_path / "half.json").write_text(json.dumps(coco))
    row = Placing(catalog).row(read_marks(tmp_path / "half.json")[0])
    assert [row["x_m"], row["y_m"], row["z_m"]] == pytest.approx(MARK, abs=1e-3)
    pixel_mm = 8e3 / (800 / np.tan(np.radians(35.0)))
    assert row["length_mm"] == pytest.approx(20 * 2**0.5 * pixel_mm, rel=0.02)
    coco["images"][0] |= {"width": 800, "height": 800}
    (tmp_path / "square.json").write_text(json.dumps(coco))
    (reason,) = add_marks(catalog, read_marks(tmp_path / "square.json"), "Ada").refused
    assert "is of a picture of 800 x 800 px, the photo has 1600 x 1190 px" in reason


def test_a_photo_and_a_time_that_differ_are_refused_and_an_unregistered_photo_counts_by_its_time(catalog):
    pixel = (pixel_of(5.0, MARK),)
    wrong = Mark("it", "P1.png", pixel, flight="past", t_s=12.0)
    (reason,) = add_marks(catalog, [wrong], "Ada").refused
    assert "is of 12 s, its photo P1.png of 5 s" in reason
    placing = Placing(catalog)
    by_photo = placing.row(Mark("it", "P1.png", pixel, flight="past", t_s=5.2))
    by_time = placing.row(Mark("it", "gone.png", pixel, flight="past", t_s=5.0))
    assert by_photo["photo_s"] == by_time["photo_s"] == 5.0 and by_time["photo"] == ""
    with pytest.raises(RefusedError, match="belongs to no known flight"):
        placing.row(Mark("it", "gone.png", pixel))


def test_what_lies_behind_a_mark_is_no_part_of_it():
    """A plate of 1 m before a wall that is 20 m behind it: a box about the plate's edge ends there."""
    plate, wall = trimesh.creation.box((0.1, 1.0, 1.0)), trimesh.creation.box((0.1, 60.0, 60.0))
    wall.apply_translation((20.0, 0.0, 0.0))
    mesh = trimesh.util.concatenate([plate, wall])
    scene = scene_of(Structure("plate", "box", np.array(mesh.vertices), np.array(mesh.faces)))
    position, quat = np.array([-8.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])
    edge = np.array([[-0.05, at, up] for at, up in ((0.6, 0.2), (0.1, 0.2), (0.1, -0.2), (0.6, -0.2))])
    spot = located(
        "it", scene, CAMERA, position, quat, pixels_of(CAMERA, position, quat, edge), Errors(pose_m=0.01)
    )
    assert (
        spot.place[0] == pytest.approx(-0.05, abs=1e-4) and spot.length_m < 0.6 and spot.length_error_m < 0.1
    )
    with pytest.raises(RefusedError, match="or on another surface than its middle"):
        wide = edge * [1, 1, 8]
        located("it", scene, CAMERA, position, quat, pixels_of(CAMERA, position, quat, wide), Errors())


@pytest.mark.slow
def test_a_finding_on_a_mesh_that_was_replaced_states_how_far_off_it_is(filled, capsys):
    catalog, _, name = filled
    other = open_catalog(f"{catalog.location}-replaced")
    other.add_structures([CUBE, CUBOID])
    other.add_demonstrations([flown()])
    row = row_of(catalog, name)
    other.add_findings([{key: row[key] for key in row if key not in ("by", "entry_id")}], "Ada")
    before = Carrying(other).to([spot_of(row)], "cuboid-v1")
    assert not before.doubtful[0]
    wider = CUBE.vertices * [1 + 0.6 / HIGH[0], 1, 1]  # the side with the mark is 0.6 m farther off
    other.add_structures([replace(CUBE, vertices=wider, sha256="cd" * 32)])
    after = Carrying(other).to([spot_of(row)], "cuboid-v1")
    assert after.doubtful[0] and after.error_m[0] > before.error_m[0] + 0.5
    there = photographed(other, row)
    assert there["doubt"].str.startswith("doubtful").all() and (there["error_m"] > 0.55).all()
    assert main(["findings", "looks", name, "--catalog", other.location]) == 0
    assert "0.60 m off its surface" in capsys.readouterr().err


def test_every_photo_that_shows_a_place_is_found_and_no_other(filled):
    catalog, _, name = filled
    looks = looks_frame(looks_at_spot(catalog, spot_of(row_of(catalog, name))))
    pixels = np.array([pixel_of(t_s, MARK) for t_s in (0.0, 5.0, 10.0, 15.0, 20.0)])
    inside = ((pixels >= 0) & (pixels <= [1600, 1190])).all(axis=1)
    seen = {f"P{number}.png" for number in np.flatnonzero(inside)}
    assert set(looks["photo"]) == seen and 3 <= len(seen) < 6
    assert looks["mm_px"].is_monotonic_increasing and looks.iloc[0]["mm_px"] == pytest.approx(7.0, rel=0.05)
    at = looks.set_index("photo").loc["P2.png"]
    x, y = pixel_of(10.0, MARK)
    assert at["left_px"] < x < at["right_px"] and at["top_px"] < y < at["bottom_px"]
    assert at["blur_px"] == pytest.approx(0.4 / 500 / 7.0e-3, rel=0.1)
    # the other side of the cube is hidden by it
    assert not looks_at_spot(catalog, spot_at(catalog, "cube-v1", (LOW[0], 1.0, 4.0)))
    with pytest.raises(SettingsError, match="three coordinates"):
        spot_at(catalog, "cube-v1", (float("nan"), 0.0, 0.0))


def test_crops_show_a_place_in_one_view_and_scale(filled, tmp_path, capsys):
    catalog, folder, name = filled
    moved = folder / "photos" / "P1.png"
    moved.rename(tmp_path / "P1.png")
    where = "--catalog", catalog.location
    assert main(["findings", "looks", name, "--out", str(tmp_path / "out"), *where]) == 1
    assert "P1.png" in capsys.readouterr().err
    assert (
        main(["findings", "looks", name, "--out", str(tmp_path / "out"), "--photos", str(tmp_path), *where])
        == 0
    )
    (tmp_path / "P1.png").rename(moved)
    crops = [np.asarray(Image.open(path)) for path in sorted((tmp_path / "out").glob("*.png"))]
    page = (tmp_path / "out" / "index.html").read_text()
    assert len(crops) == page.count("<img") >= 3 and len({crop.shape for crop in crops}) == 1
    bright = [np.argwhere(crop[:, :, 0] > 170).mean(axis=0) for crop in crops if (crop[:, :, 0] > 170).any()]
    area = [(crop[:, :, 0] > 170).sum() for crop in crops]
    assert len(bright) == len(crops) and np.ptp(area) < 0.05 * np.mean(area)
    assert np.abs(np.array(bright) - np.array(crops[0].shape[:2]) / 2).max() < 3


@pytest.mark.ci
def test_the_same_place_elsewhere_is_where_the_samples_say(catalog):
    places = np.array([[HIGH[0], 1.0, 4.0], [0.0, HIGH[1], 6.0], [1.0, 1.0, HIGH[2]]])
    points, normals = on_surface(scene_of(CUBE), places)
    assert points == pytest.approx(places, abs=1e-6) and (normals @ [1, 1, 1] == pytest.approx(1.0))
    spots = [Spot("cube-v1", place, way, place[None]) for place, way in zip(points, normals, strict=True)]
    there = Carrying(catalog).to(spots, "cuboid-v1")
    truth = true_counterparts("cube-v1", "cuboid-v1", places)
    assert np.linalg.norm(there.place - truth, axis=1).max() < 0.02 * CUBOID.diagonal_m
    assert there.normal == pytest.approx(normals, abs=1e-6) and not there.doubtful.any()
    assert np.einsum("nij,nj->ni", there.turn, normals) == pytest.approx(there.normal, abs=1e-6)
    with pytest.raises(RefusedError, match="structures of one kind"):
        Carrying(catalog).targets("cube-v1", "a320-v1")


def test_what_was_found_out_about_a_pair_serves_every_place(catalog, monkeypatch):
    spots = [spot_at(catalog, "cube-v1", place) for place in ((HIGH[0], 2.0, 5.0), (HIGH[0], -3.0, 2.0))]
    first = Carrying(catalog).to(spots[:1], "cuboid-v1")
    anew = "upplied.planning.correspondence.siblings.study"
    monkeypatch.setattr(anew, lambda *_: pytest.fail("the pair is studied anew"))
    again = Carrying(catalog).to(spots, "cuboid-v1")
    assert again.place[0] == pytest.approx(first.place[0], abs=1e-9) and not again.doubtful.any()


@pytest.mark.slow
def test_who_plans_for_a_structure_carries_the_source_there_as_well(filled, monkeypatch):
    catalog, _, name = filled
    other = open_catalog(f"{catalog.location}-planned")
    other.add_structures([CUBE, CUBOID])
    other.add_demonstrations([flown()])
    jobs = fleet.decide(other, fleet.PlanRequest(presets=("recommended",))).jobs
    assert fleet.transfer(other, jobs, "night", plan=plan_job).ok == 1
    monkeypatch.setattr(Carrying, "_pair", lambda *_: pytest.fail("the pair was studied again"))
    assert np.isfinite(Carrying(other).to([spot_of(row_of(catalog, name))], "cuboid-v1").place).all()


@pytest.mark.ci
def test_a_place_that_could_as_well_be_elsewhere_is_doubtful(tmp_path):
    # Below the overhang of their bows both hulls are shorter, each by its own share of its length.
    source, target = random_member("ship", 10016), random_member("ship", 10017)
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([source.structure, target.structure])
    rng = np.random.default_rng(0)
    places, normals = on_surface(
        scene_of(source.structure), points_on_triangles(source.structure, 400, rng)[0]
    )
    name, size = source.structure.structure_id, target.structure.diagonal_m
    spots = [Spot(name, place, way, place[None]) for place, way in zip(places, normals, strict=True)]
    there = Carrying(catalog).to(spots, target.structure.structure_id)
    off = np.linalg.norm(there.place - true_counterparts(source, target, places), axis=1)
    free = escaping(scene_of(source.structure), places, normals, source.structure.diagonal_m) > 0.02
    wrong = ~(off <= 0.02 * size)
    assert (wrong & free & (normals[:, 2] < -0.5)).sum() >= 3 and (~free).sum() > 100
    assert there.doubtful[free].mean() < 0.5 and (there.error_m[free] >= off[free]).mean() > 0.9
    # what lies inside of other parts is shown by no photo, and no sample is near it
    assert there.doubtful[~free].mean() > 0.8 and not (wrong & ~there.doubtful).any()


@pytest.mark.slow
def test_every_blade_is_asked_for(tmp_path):
    source, target = member("turbine-1-v1"), member("turbine-2-v1")
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([source.structure, target.structure])
    name = source.part_names[next(at for at, each in enumerate(source.part_names) if "blade" in each)]
    triangles = source.structure.triangles[source.triangles_of(name)]
    middle = source.structure.vertices[triangles].mean(axis=(0, 1))
    spot = spot_at(catalog, "turbine-1-v1", middle)
    rows = photographed(catalog, spot, "turbine-2-v1", every=True)
    owner = scene_of(target.structure).closest(rows[["x_m", "y_m", "z_m"]].to_numpy())[1]
    parts = [target.part_names[target.part_of_triangle[at]] for at in owner]
    assert sorted(parts) == sorted(each for each in target.part_names if "blade" in each) and len(parts) == 3
    assert rows["part"].nunique() == 3 and rows["looked_at"].isna().all()
    assert len(photographed(catalog, spot, "turbine-2-v1")) == 1


def test_questions_over_the_fleet(filled):
    catalog, _, name = filled
    looks = photographed(catalog, row_of(catalog, name)).set_index("structure_id")
    assert list(looks.index) == ["cube-v1", "cuboid-v1"] and list(looks["looks"]) == [1, 0]
    assert looks.loc["cube-v1", "flight_id"] == "past"  # its demonstration showed it
    assert looks.loc["cuboid-v1", "error_m"] >= row_of(catalog, name)["place_error_m"]
    on = by_reference(catalog, "cuboid-v1", class_name="crack")
    truth = true_counterparts("cube-v1", "cuboid-v1", MARK[None])[0]
    assert on[[f"reference_{axis}_m" for axis in "xyz"]].to_numpy()[0] == pytest.approx(truth, abs=0.3)
    assert by_reference(catalog, "cuboid-v1", class_name="rust").empty
    (shown,) = structure_facts(catalog, CUBE, [], [])["marks"]
    assert (shown["finding"], shown["class"], shown["photo"]) == (name, "crack", "P2.png")
    assert fleet_findings(catalog) == [{"kind": CUBE.kind, "class": "crack", "map": False, "open": 1}]
    assert fleet_findings(catalog, [CUBE.kind])[0]["map"]


@pytest.mark.slow
def test_findings_of_several_structures_stand_in_their_order_on_one(catalog, tmp_path):
    other = open_catalog(tmp_path / "catalog")
    other.add_structures([CUBE, CUBOID])
    top = CUBOID.vertices[:, 2].max()
    places = {
        "cube-v1": [(HIGH[0], 1.0, 4.0), (HIGH[0], -2.0, 7.0)],
        "cuboid-v1": [(1.0, 2.0, top), (-3.0, 0.0, top)],
    }
    for at in (1, 0):
        marks = [Mark("it", place=places[name][at], structure=name) for name in ("cuboid-v1", "cube-v1")]
        assert add_marks(other, marks, "Ada").new == 2
    on = by_reference(other, "cube-v1")
    assert list(on["target_id"]) == ["cuboid-v1", "cube-v1"] * 2 and not on["reference_doubtful"].any()
    placed = on[["reference_x_m", "reference_y_m", "reference_z_m"]].to_numpy()
    assert placed[[1, 3]] == pytest.approx(np.array(places["cube-v1"])[::-1], abs=1e-6)
    truth = true_counterparts("cuboid-v1", "cube-v1", np.array(places["cuboid-v1"]))
    assert placed[[0, 2]] == pytest.approx(truth[::-1], abs=0.3)


@pytest.mark.slow
def test_the_findings_of_a_kind_have_a_page_that_the_fleet_leads_to(filled, tmp_path):
    catalog, _, name = filled
    reference, rows = kind_map(catalog, CUBE.kind)
    assert reference == "cube-v1" and list(rows["finding_id"]) == [name]
    with pytest.raises(CatalogError, match="has no structure"):
        kind_map(catalog, "ship")
    published = publish_pages(catalog, tmp_path, pictures=0, map_of=kind_map)
    assert {f"findings/{CUBE.kind}.html", "data/cube-v1.js"} <= set(
        published.written
    ) and not published.problems
    page = (tmp_path / "findings" / f"{CUBE.kind}.html").read_text()
    assert name in page and '"../assets/structure.js"' in page and '"../data/cube-v1.js"' in page
    assert '"map":true' in (tmp_path / "index.html").read_text()
    assert not publish_pages(catalog, tmp_path, pictures=0, map_of=kind_map).written
    assert f"findings/{CUBE.kind}.html" in publish_pages(catalog, tmp_path, pictures=0).removed
    live = LivePages(catalog)
    assert name in live.page("findings", CUBE.kind) and '"map":true' in live.page("")


def test_a_look_counts_on_the_side_that_it_saw_and_as_finely_as_asked(tmp_path):
    catalog = open_catalog(tmp_path / "catalog")
    plate = replace(CUBE, vertices=CUBE.vertices * [0.01, 1.0, 1.0], sha256="ef" * 32)  # 12 cm thick
    catalog.add_structures([plate])
    catalog.add_demonstrations([flown()])
    surface = surface_samples(plate, scene_of(plate), CloudSettings())
    catalog.add_plans([("12" * 32, plan_as_demonstrated(plate, flown(), surface), {})])
    front = surface.outward[:, 0] > 0.9
    values = dict.fromkeys(
        ("distance_m", "incidence_deg", "speed_mps", "t_s", "frontal_distance_m", "frontal_incidence_deg"),
        np.full(len(surface), 8.0),
    )
    (plan,) = catalog.transfers(every=True)["transfer_id"]
    row = {
        "flight_id": "34" * 32, "transfer_id": plan, "kind": "flown", "target_id": "cube-v1",
        "demonstration_id": "past", "flown_at": catalog.clock.now(),
        "looks_sha256": catalog.put_looks(surface.points, surface.normals, front, values),
    }  # fmt: skip
    catalog.add_flight(row, flown().trajectory)
    sides = [spot_at(catalog, "cube-v1", (x, 1.0, 4.0)) for x in (0.06, -0.06)]
    assert [side.normal[0] for side in sides] == pytest.approx([1.0, -1.0])
    last = [photographed(catalog, side, "cube-v1").iloc[0] for side in sides]
    assert last[0]["looks"] == 2 and last[1]["looks"] == 0  # by the flight and the demonstration
    assert last[0]["mm_px"] == pytest.approx(1e3 * 8 / np.cos(np.radians(8)) * np.tan(np.radians(35)) / 800)
    assert photographed(catalog, sides[0], "cube-v1", mm_px=7.0).iloc[0]["looks"] == 0
    assert photographed(catalog, sides[0], "cube-v1", since="2100-01-01").iloc[0]["looks"] == 0


@pytest.mark.ci
def test_a_mission_shows_a_place_as_its_photo_did_and_as_finely_as_asked(filled):
    catalog, _, name = filled
    rows = selected_findings(catalog, "open", "cube-v1")
    reshoot = plan_reshoot(catalog, rows, "cube-v1", 5.0)
    plan = catalog.plan(reshoot.transfer_id)
    assert reshoot.shown == (name,) and not reshoot.refused
    assert plan.trajectory is not None and plan.is_viewpoint is not None and plan.flyable
    shot = plan.trajectory.take(plan.is_viewpoint)
    position = shot.positions[0]
    assert 1e3 * footprint_m(CAMERA, position, MARK, np.array([1.0, 0.0, 0.0])) <= 5.0
    expected = np.array([8.0, -1.0, 0.0]) / np.hypot(8.0, 1.0)  # the photo at 10 s was taken from y = 0
    way = (position - MARK) / np.linalg.norm(position - MARK)
    assert np.degrees(np.arccos(way @ expected)) < 0.1
    assert scene_of(CUBE).distance(plan.trajectory.positions).min() >= 2.0
    (row,) = catalog.transfers(every=True, ids=[reshoot.transfer_id]).to_dict("records")
    assert row["purpose"].startswith("reshoot ") and row["state"] == "draft"
    assert plan_reshoot(catalog, rows, "cube-v1", 5.0).transfer_id == reshoot.transfer_id
    file, where = f"{catalog.location}.plan", ("--catalog", catalog.location)
    assert (
        main(["export", reshoot.transfer_id, "--to", "qgc-plan", "-o", file, "--draft", *where]) == 0
    )  # its gate
    assert main(["transfer", "--reproduce", reshoot.transfer_id, *where]) == 1
    assert main(["brief", reshoot.transfer_id, "-o", f"{file}.html", "--draft", *where]) == 0
    brief = Path(f"{file}.html").read_text()
    (picture,) = re.findall(r'src="data:image/png;base64,([^"]+)"', brief.split("Reference photos")[1])
    thumbnail = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture))))
    height, width = thumbnail.shape[:2]
    assert max(width, height) == 320 and thumbnail[height // 2, width // 2, 0] == 250  # the square it marks
    assert (thumbnail == (214, 39, 40)).all(axis=2).any() and "P2.png, 8.1 m away" in brief
    photo = Path(row_of(catalog, name)["photo_path"])
    content = photo.read_bytes()
    try:
        photo.write_bytes(content[:-1])
        ((caption, picture),) = reference_photos(catalog, plan.warnings)
        assert picture == b"" and "is not the one that was registered" in caption
    finally:
        photo.write_bytes(content)
    with pytest.raises(RefusedError, match=r"no safe look at 0\.2 mm/px, 2 m away"):
        plan_reshoot(catalog, rows, "cube-v1", 0.2)
    with pytest.raises(RefusedError, match="has neither plan nor demonstration"):
        plan_reshoot(catalog, rows, "cuboid-v1", 5.0)


@pytest.mark.slow
def test_a_campaign_has_a_draft_for_each_structure_without_a_look(filled, monkeypatch):
    catalog, _, name = filled
    other = open_catalog(f"{catalog.location}-campaign")
    other.add_structures([CUBE, CUBOID])
    about = {"demonstration_id": "there", "structure_id": "cuboid-v1"}
    away = look_at(
        flown().positions, flown().positions + np.array([8.0, 0.0, 0.0])
    )  # it shows nothing of the place
    other.add_demonstrations([replace(flown(), quat_xyzw=away, **about)])
    row = row_of(catalog, name)
    other.add_findings([{key: row[key] for key in row if key not in ("by", "entry_id")}], "Ada")
    (one,) = plan_campaign(other, row, 8.0)
    plan = other.plan(one["words"].split(";")[0])
    assert (one["structure_id"], one["status"]) == ("cuboid-v1", "draft")
    assert f"finding {name}: from " in one["words"] and "mm/px, as P2.png showed it" in one["words"]
    assert plan.trajectory is not None and plan.target_id == "cuboid-v1"
    place = true_counterparts("cube-v1", "cuboid-v1", MARK[None])[0]
    ahead = matrices(plan.trajectory.quat_xyzw[0])[:, 0]
    assert ahead @ (place - plan.trajectory.positions[0]) > 0.999 * np.linalg.norm(
        place - plan.trajectory.positions[0]
    )
    assert plan_campaign(other, row, 0.1)[0]["status"] == "refused"
    # The next night plans nothing again, nor what was refused, and says what it cannot plan.
    assert due_jobs(other, [name], 8.0) == ([], [])
    assert due_jobs(other, [name], 0.1) == ([], [])
    (job,), (problem,) = due_jobs(other, [name, "none"], 7.0)
    assert "campaign none" in problem and job.target_id == "cuboid-v1"
    monkeypatch.setattr("upplied.findings.campaign.transfer", lambda _, jobs, *__, **___: len(jobs) and 1 / 0)
    other.reject(one["words"].split(";")[0], "Ada", "the mark is gone")
    assert plan_campaign(other, row, 8.0)[0]["status"] == "rejected"
    # What its mission depends on was changed: it is due again.
    other.add_structures([replace(CUBOID, vertices=CUBOID.vertices * [1, 1, 1.01], sha256="ef" * 32)])
    assert [each.target_id for each in due_jobs(other, [name], 8.0)[0]] == ["cuboid-v1"]
    assert [each.target_id for each in due_jobs(other, [name], 0.1)[0]] == ["cuboid-v1"]


def test_a_camera_without_known_pixels_is_taken_to_have_those_of_the_photo(filled):
    catalog, _, name = filled
    other = open_catalog(f"{catalog.location}-no-pixels")
    other.add_structures([CUBE])
    other.add_demonstrations([replace(flown(), camera=replace(CAMERA, width_px=0, height_px=0))])
    reshoot = plan_reshoot(other, [row_of(catalog, name)], "cube-v1", 5.0)
    assert (
        reshoot.words[1] == "the pixels of the camera are not known: 1600 x 1190 px, as a photo of a finding"
    )
    assert "at 4.8" in reshoot.words[2] or "at 4.9" in reshoot.words[2]


def test_a_place_that_is_hidden_where_its_photo_was_taken_from_is_seen_from_aside(filled):
    catalog, _, name = filled
    below = replace(CUBE, surroundings=replace(CUBE.surroundings, keep_out_m=np.array(
        [[[HIGH[0] + 3.0, -2.0, 0.0], [HIGH[0] + 20.0, 2.0, 12.0]]])))  # fmt: skip
    other = open_catalog(f"{catalog.location}-kept-out")
    other.add_structures([replace(below, sha256="cd" * 32)])
    other.add_demonstrations([flown()])
    reshoot = plan_reshoot(other, [row_of(catalog, name)], "cube-v1", 7.5)
    assert (
        "degrees aside: no nearer viewpoint is safe and shows it" in reshoot.words[1]
        or "m nearer" in reshoot.words[1]
    )
    shot = other.plan(reshoot.transfer_id).trajectory.positions
    inside = ((shot > [HIGH[0] + 3.0, -2.0, 0.0]) & (shot < [HIGH[0] + 20.0, 2.0, 12.0])).all(axis=1)
    assert not inside.any()


def test_the_command_places_lists_and_changes(filled, capsys, tmp_path):
    catalog, _, name = filled
    where = "--catalog", catalog.location
    x, y = pixel_of(5.0, MARK + np.array([0.0, 0.0, 1.0]))
    words = [
        "findings",
        "add",
        "--photo",
        "P1.png",
        "--pixel",
        f"{x}",
        f"{y}",
        "--class",
        "rust",
        "--by",
        "Ada",
    ]
    assert main([*words, *where, "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["class"] == "rust" and row["z_m"] == pytest.approx(MARK[2] + 1.0, abs=1e-3)
    assert (
        main(["findings", "set", row["finding_id"], "dismissed", "--by", "Bob", "--note", "dirt", *where])
        == 0
    )
    assert main(["findings", "list", "--state", "open", *where]) == 0
    output = capsys.readouterr().out
    assert name in output and row["finding_id"] not in output.split("is dismissed")[1]
    assert main(["findings", "history", row["finding_id"], *where]) == 0 and "dirt" in capsys.readouterr().out
    (tmp_path / "d.csv").write_text("photo,x_px,y_px\nP1.png,1,1\nP7.png,1,1\n")
    capsys.readouterr()
    assert main(["findings", "add", "--outline", "1 2 x", "--by", "Ada", *where]) == 2
    assert "the mark: cannot be read" in capsys.readouterr().err
    assert main(["findings", "add", str(tmp_path / "d.csv"), "--by", "Ada", *where]) == 1
    assert "d.csv, line 2" in (errors := capsys.readouterr().err) and "P7.png" in errors
    assert main(["looks", "cube-v1", *map(str, MARK), *where]) == 0 and "P2.png" in capsys.readouterr().out
    assert main(["findings", "add", "--by", "Ada", *where]) == 2


def test_a_look_that_the_errors_of_its_pose_may_undo_is_doubtful_and_says_by_what(filled):
    catalog, _, name = filled
    spot = spot_of(row_of(catalog, name))
    sure = looks_frame(looks_at_spot(catalog, replace(spot, error_m=0.0)))
    vague = looks_frame(looks_at_spot(catalog, replace(spot, error_m=9.0)))
    assert (sure["doubt"] == "").sum() > (vague["doubt"] == "").sum() == 1
    assert vague.iloc[0]["photo"] == "P2.png" and vague.iloc[0]["probability"] == 1.0  # the mark is in it
    doubtful = vague[vague["doubt"] != ""]
    assert set(doubtful["doubt"]) <= {"edge of the picture", "incidence", "range", "occlusion"}
    assert doubtful["probability"].between(0.03, 0.95).all()
    inside = sure.set_index("photo")["in_picture_pct"] == 100  # the place and what is about it
    assert (sure.set_index("photo").loc[inside, "doubt"] == "").all()
    # Its own error alone: in half of the cases a place at the rim of a picture is in it.
    aside = np.linspace(0, 6, 601)
    rim_y = np.interp(1600.0, [pixel_of(0.0, np.array([0.0, y, 4.0]))[0] for y in aside], aside)
    rim = np.array([HIGH[0], rim_y, 4.0])
    looks = looks_frame(looks_at_spot(catalog, replace(spot, place=rim, error_m=0.0, photo=("", 0.0))))
    first = looks.set_index("photo").loc["P0.png"]
    assert first["doubt"] == "edge of the picture" and 0.3 < first["probability"] < 0.7


def test_a_photo_that_is_registered_again_counts_once_and_names_twice_are_refused(filled, tmp_path):
    catalog = open_catalog(shutil.copytree(filled[0].location, tmp_path / "catalog"))
    photos = shutil.copytree(filled[1] / "photos", tmp_path / "card" / "photos")
    times, flight = filled[1] / "times.csv", flight_of(catalog, "past")
    assert register_photos(catalog, flight, photos, times)[0] == 5  # moved: the same photos
    assert set(catalog.flight_photos()["path"]) == {str(path.resolve()) for path in photos.glob("*.png")}
    Image.new("RGB", (1600, 1190)).save(photos / "P2.png")  # developed again
    assert register_photos(catalog, flight, photos, times)[0] == 1
    assert len(catalog.flight_photos()) == 5
    mark = Mark("it", "P2.png", square(10.0, 0.1))
    assert add_marks(catalog, [mark], "Ada").new == 1
    other = shutil.copytree(photos, tmp_path / "card" / "other")
    Image.new("RGB", (1600, 1190), "white").save(other / "P2.png")
    assert register_photos(catalog, flight, other, times)[0] == 5  # the others are moved
    again = replace(mark, pixels=square(10.0, 0.2))
    assert "names 2 photos of past" in add_marks(catalog, [again], "Ada").refused[0]
    assert add_marks(catalog, [replace(again, photo=str(other / "P2.png"))], "Ada").new == 1


def test_marks_of_a_file_are_of_the_flight_of_the_command_where_they_name_none(filled, tmp_path, capsys):
    marks = tmp_path / "marks.csv"
    x, y = pixel_of(5.0, MARK)
    marks.write_text(f"photo,x_px,y_px,class\nP1.png,{x},{y},chip\n")
    where = ("--by", "Ada", "--catalog", filled[0].location)
    assert main(["findings", "add", str(marks), "--flight", "gone", *where]) == 1
    assert "flight gone: is not in the catalog" in capsys.readouterr().err
    assert main(["findings", "add", str(marks), "--flight", "past", *where]) == 0


def test_the_edge_of_a_photo_is_no_sharpness():
    even = np.full((40, 40, 3), 120, np.uint8)
    even[::2] = 124
    cut = even.copy()
    cut[:, 20:] = 0
    assert sharpness(cut) == pytest.approx(sharpness(even), rel=0.1)


def test_the_normal_of_a_place_on_a_noisy_scan_is_that_of_its_side():
    box = random_member("box", 347).structure
    scan = scan_of(box, np.random.default_rng(247))
    low, high = box.vertices.min(axis=0), box.vertices.max(axis=0)
    aside = np.random.default_rng(1).uniform(low[1:] + 1.0, high[1:] - 1.0, (200, 2))
    places = np.column_stack([np.full(200, high[0]), aside])
    assert (on_surface(scene_of(scan), places)[1][:, 0] > 0.95).all()
