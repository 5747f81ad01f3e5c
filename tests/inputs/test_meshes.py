"""Structures from meshes: frames, units, repair, the outside, outliers, clouds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mesh_files
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from upplied.errors import InputError
from upplied.inputs.formats.reader import read_raw
from upplied.inputs.manifest_keys import AXES
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import normalise, read_structure, turn
from upplied.inputs.outside import outward_normals
from upplied.inputs.repair import WELD_M, clean, clip_below, topology_of, weld
from upplied.records import Floats, Ints, Structure, Surroundings

TURNS = [(up, forward) for up in AXES for forward in AXES if up[-1] != forward[-1]]


def saved(folder: Path, vertices: Floats, triangles: Ints, suffix: str = "obj", **values) -> StructureEntry:
    path = folder / f"a.{suffix}"
    path.write_bytes(mesh_files.write(vertices, triangles, suffix))
    return StructureEntry("a", "thing", path, **({"unit_m": 1.0} | values))


def findings(entry: StructureEntry):
    return normalise(entry, *read_raw(entry.path))[1]


def joined(*meshes: trimesh.Trimesh) -> tuple[Floats, Ints]:
    both = trimesh.util.concatenate(meshes)
    return np.asarray(both.vertices, float), np.asarray(both.faces, np.int64)


def box(size: tuple, at: tuple = (0, 0, 0)) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(at)
    return mesh


def area(structure: Structure) -> float:
    return trimesh.Trimesh(structure.vertices, structure.triangles, process=False).area


def volume(structure: Structure) -> float:
    return trimesh.Trimesh(structure.vertices, structure.triangles, process=False).volume


# Frames and units --------------------------------------------------------------------------------


@pytest.mark.parametrize(("up", "forward"), TURNS)
def test_a_turned_file_with_its_axes_declared_gives_the_same_structure(
    tmp_path: Path, up: str, forward: str
) -> None:
    vertices, triangles = mesh_files.shape()
    same = read_structure(saved(tmp_path, vertices, triangles))
    rotation = turn(up, forward)
    assert np.linalg.det(rotation) == pytest.approx(1)
    turned = read_structure(saved(tmp_path, vertices @ rotation, triangles, up=up, forward=forward))
    assert np.allclose(turned.vertices, same.vertices, atol=1e-7)
    assert np.array_equal(turned.triangles, same.triangles)


@pytest.mark.parametrize(("unit", "factor"), [(0.001, 1000), (0.0254, 1 / 0.0254), (0.3048, 1 / 0.3048)])
def test_units_and_scale_are_undone(tmp_path: Path, unit: float, factor: float) -> None:
    vertices, triangles = mesh_files.shape()
    metres = read_structure(saved(tmp_path, vertices, triangles))
    other = read_structure(saved(tmp_path, vertices * factor / 2, triangles, unit_m=unit, scale=2.0))
    assert np.allclose(other.vertices, metres.vertices, atol=1e-5)


def test_units_of_the_file_and_disagreements(tmp_path: Path) -> None:
    vertices, triangles = mesh_files.shape()
    entry = saved(tmp_path, vertices * 1000, triangles, "3mf", unit_m=None)
    assert np.allclose(np.ptp(read_structure(entry).vertices, axis=0), np.ptp(vertices, axis=0))
    assert findings(entry).unit_from == "file"
    with pytest.raises(InputError, match="does not declare its units"):
        read_structure(saved(tmp_path, vertices, triangles, "stl", unit_m=None))
    disagreeing = saved(tmp_path, vertices, triangles, "glb", unit_m=0.01, scale=100, up="z", forward="x")
    words = " ".join(findings(disagreeing).warnings)
    assert "unit is 1 m, the manifest 0.01 m" in words and "y is up, the manifest z" in words
    assert np.allclose(np.ptp(read_structure(disagreeing).vertices, axis=0), np.ptp(vertices, axis=0))


def test_projected_coordinates_keep_their_tenth_of_a_millimetre(tmp_path: Path) -> None:
    vertices, triangles = mesh_files.shape()
    far = np.array([2_683_000.0, 1_247_000.0, 400.0])
    entry = saved(tmp_path, vertices + far, triangles)
    assert "projected coordinates" in " ".join(findings(entry).warnings)
    near = read_structure(replace(entry, local_origin=tuple(far)))
    assert np.abs(near.vertices - read_structure(saved(tmp_path, vertices, triangles)).vertices).max() < 1e-5
    assert "projected" not in near.notes


def test_nominal_size_is_checked_within_seven_percent(tmp_path: Path) -> None:
    vertices, triangles = mesh_files.shape()
    length, width, height = np.ptp(vertices, axis=0)
    entry = saved(tmp_path, vertices, triangles)
    read_structure(replace(entry, nominal_m=(length * 1.06, width * 0.95, None)))
    with pytest.raises(InputError, match=r"width.*off the nominal"):
        read_structure(replace(entry, nominal_m=(length, width * 1.09, height)))
    assert len(findings(replace(entry, nominal_m=(length * 2, width / 2, height))).problems) == 2


def test_what_is_stated_of_the_surface_is_kept_hashed_and_bounded_by_the_size(tmp_path: Path) -> None:
    silent = saved(tmp_path, *joined(box((10, 4, 2))))
    plain = read_structure(silent)
    assert plain.surface is None and plain.surface_error_m is None and not plain.is_scan
    hashes = {plain.sha256}
    for surface in ("drawn", "scanned"):
        structure = read_structure(replace(silent, surface=surface))
        assert structure.surface == surface and structure.is_scan == (surface == "scanned")
        hashes.add(structure.sha256)
    assert len(hashes) == 3
    for stated in (0.0, 0.2, 1.0):
        structure = read_structure(replace(silent, surface_error_m=stated))
        assert structure.surface_error_m == stated and structure.sha256 != plain.sha256
    with pytest.raises(InputError, match=r"surface_error_m is 1.2 m.*at most 1.1 m, a tenth of its size"):
        read_structure(replace(silent, surface_error_m=1.2))


def test_the_hash_covers_the_file_and_what_is_said_of_it(tmp_path: Path) -> None:
    entry = saved(tmp_path, *mesh_files.shape())
    changes = {
        "unit_m": 0.01,
        "up": "y",
        "scale": 2.0,
        "local_origin": (1.0, 0.0, 0.0),
        "kind": "other",
        "drop_hidden": True,
        "landmarks": {"nose": (0.0, 0.0, 0.0)},
        "surroundings": Surroundings(ground_z_m=-9.0),
    }
    entries = [entry, *(replace(entry, **{key: value}) for key, value in changes.items())]
    entries[2] = replace(entries[2], forward="x")
    hashes = {read_structure(one).sha256 for one in entries}
    assert len(hashes) == len(entries)
    assert read_structure(entry).sha256 == read_structure(entry).sha256
    assert read_structure(replace(entry, notes="x")).sha256 == read_structure(entry).sha256


# Repair ------------------------------------------------------------------------------------------


def test_duplicates_slivers_and_loose_vertices_go(tmp_path: Path) -> None:
    vertices, triangles = mesh_files.shape()
    soup = np.concatenate([vertices[triangles].reshape(-1, 3), [[99.0, 99.0, 99.0]]])
    corners = np.arange(3 * len(triangles)).reshape(-1, 3)
    extra = [corners[:5], corners[:3, ::-1], [[0, 0, 1], [2, 2, 2]]]
    left, joined_up, index, repairs = clean(soup, np.concatenate([corners, *extra]))
    assert len(joined_up) == len(triangles) and np.array_equal(index, np.arange(len(triangles)))
    assert len(left) == len(vertices) and np.ptp(left, axis=0).max() < 10
    removed = (
        "2 triangles without area removed",
        "8 repeated triangles removed",
        "1 unused vertices dropped",
    )
    assert repairs[1:] == removed and repairs[0].endswith("vertices welded")
    assert topology_of(joined_up).watertight


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_cleaning_is_idempotent_and_independent_of_the_order_of_vertices(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, triangles = mesh_files.shape()
    soup = vertices[triangles].reshape(-1, 3) + rng.uniform(-0.2, 0.2, (3 * len(triangles), 3)) * WELD_M
    order = rng.permutation(len(soup))
    shuffled = np.argsort(order)[np.arange(len(soup)).reshape(-1, 3)]
    once = clean(soup[order], shuffled)
    again = clean(once[0], once[1])
    assert np.array_equal(once[0], again[0]) and np.array_equal(once[1], again[1])
    assert len(once[0]) == len(vertices) and len(once[1]) == len(triangles)


def test_weld_joins_neighbours_across_any_grid_and_leaves_others() -> None:
    step = np.array([0.0, 0.6, 5.0, 5.9, 20.0]) * WELD_M
    vertices = np.column_stack([step, 0 * step, 0 * step])
    assert weld(vertices).tolist() == [0, 0, 2, 2, 4]
    assert weld(vertices - 7 * WELD_M).tolist() == [0, 0, 2, 2, 4]


def test_clipping_below_the_ground_keeps_what_is_above(tmp_path: Path) -> None:
    vertices, triangles = joined(trimesh.creation.icosphere(3, 2.0))
    above, cut, index = clip_below(vertices, triangles, 0.3)
    assert above[:, 2].min() == pytest.approx(0.3)
    below, rest, _ = clip_below(-vertices, triangles, -0.3)
    halves = [trimesh.Trimesh(*half, process=False).area for half in ((above, cut), (below, rest))]
    assert sum(halves) == pytest.approx(trimesh.Trimesh(vertices, triangles).area, rel=1e-9)
    assert halves[0] == pytest.approx(2 * np.pi * 2.0 * 1.7, rel=0.01)  # the cap of a sphere
    assert (np.diff(index) >= 0).all()
    inside = np.isin(np.arange(len(triangles)), index)
    assert (vertices[triangles[~inside]][..., 2] <= 0.3).all()
    tower = saved(tmp_path, *joined(box((2, 2, 20))), surroundings=Surroundings(ground_z_m=-1.0))
    assert "9.0 m below the declared ground" in read_structure(tower).notes
    short = read_structure(replace(tower, clip_ground=True))
    assert short.vertices[:, 2].min() == pytest.approx(-1) and area(short) == pytest.approx(2 * 4 * 11 + 4)


# The outside -------------------------------------------------------------------------------------


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_inverted_patches_are_turned(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = [trimesh.creation.icosphere(2, 1.0), box((1, 2, 3), (4, 0, 0)), box((2, 1, 1), (0, 5, 0))]
    expected = sum(part.volume for part in parts)
    for part in parts:
        if rng.random() < 0.6:
            part.invert()
    structure = read_structure(saved(tmp_path_factory.mktemp("m"), *joined(*parts)))
    assert volume(structure) == pytest.approx(expected, rel=1e-3)


def test_half_a_mesh_mirrored_inside_out_is_turned(tmp_path: Path) -> None:
    sphere = trimesh.creation.icosphere(3, 5.0)
    half = sphere.triangles_center[:, 1] > 0
    faces = np.where(half[:, None], sphere.faces[:, ::-1], sphere.faces)
    entry = saved(tmp_path, np.asarray(sphere.vertices), faces)
    assert read_structure(entry).notes.startswith(f"{half.sum()} triangles turned")
    assert volume(read_structure(entry)) == pytest.approx(sphere.volume, rel=1e-5)


def test_sheets_and_open_bottoms_are_left_as_they_are(tmp_path: Path) -> None:
    sheet = trimesh.Trimesh([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0]], [[0, 2, 1], [0, 3, 2]])
    house = box((6, 8, 5))
    house.update_faces(house.triangles_center[:, 2] > -2.4)
    for mesh in (sheet, house):
        vertices, triangles = joined(mesh)
        structure = read_structure(saved(tmp_path, vertices, triangles))
        assert np.array_equal(structure.triangles, triangles)


def test_hidden_parts_are_reported_or_dropped(tmp_path: Path) -> None:
    cabin = box((1, 1, 1))
    entry = saved(tmp_path, *joined(box((4, 4, 4)), cabin, box((0.5, 0.5, 0.5), (3, 0, 0))))
    health = findings(entry)
    assert (health.parts, health.hidden_parts) == (3, 1)
    assert health.outside_area_m2 == pytest.approx(6 * 16 + 1.5, rel=0.02)
    assert "12 of 36 triangles" in " ".join(health.warnings)
    assert len(read_structure(replace(entry, drop_hidden=True)).triangles) == 24


def test_nobody_sees_a_slab_from_below_the_ground(tmp_path: Path) -> None:
    entry = saved(tmp_path, *joined(box((4, 4, 2))))
    grounded = replace(entry, surroundings=Surroundings(ground_z_m=-1.0))
    assert findings(entry).outside_area_m2 == pytest.approx(64, rel=0.01)
    assert findings(grounded).outside_area_m2 == pytest.approx(48, rel=0.01)


def test_billboards_wakes_and_specks_are_outliers_and_parts_in_touch_are_not(tmp_path: Path) -> None:
    hull = box((100, 20, 15))
    mast = box((1, 1, 30), (0, 0, 20))
    wake = trimesh.Trimesh(
        [[-40, -5, -7], [-600, -40, -7], [-600, 40, -7], [-40, 5, -7]], [[0, 1, 2], [0, 2, 3]]
    )
    speck = box((1, 1, 1), (70, 0, 0))
    entry = saved(tmp_path, *joined(hull, mast, wake, speck))
    health = findings(entry)
    assert sorted(len(outlier.triangles) for outlier in health.outliers) == [2, 12]
    assert "drop_outliers" in " ".join(health.warnings)
    with pytest.raises(InputError, match="drop_outliers = true"):
        read_structure(replace(entry, nominal_m=(100.0, None, None)))
    structure = read_structure(replace(entry, drop_outliers=True, nominal_m=(100.0, 20.0, 42.5)))
    assert len(structure.triangles) == 24
    alone = findings(saved(tmp_path, *joined(hull, mast)))
    assert not alone.outliers


def test_a_field_of_equal_panels_has_no_outliers(tmp_path: Path) -> None:
    panels = [box((2, 1, 0.1), (4 * i, 3 * j, 1)) for i in range(6) for j in range(5)]
    assert not findings(saved(tmp_path, *joined(*panels))).outliers


# Clouds ------------------------------------------------------------------------------------------


def sampled(mesh: trimesh.Trimesh, number: int) -> tuple[Floats, Floats]:
    points, face = trimesh.sample.sample_surface(mesh, number, seed=1)
    return np.asarray(points), np.asarray(mesh.face_normals[face])


@pytest.mark.parametrize("mesh", [trimesh.creation.torus(6, 2), box((10, 6, 4)), trimesh.creation.cone(3, 9)])
def test_estimated_normals_point_outwards(mesh: trimesh.Trimesh) -> None:
    points, normals = sampled(mesh, 4000)
    estimates, _ = outward_normals(points)
    agree = (estimates * normals).sum(axis=1)
    assert np.allclose(np.linalg.norm(estimates, axis=1), 1)
    assert (agree > 0).mean() > 0.98
    assert np.median(agree) > 0.97


def test_given_normals_are_kept_and_turned_as_a_whole() -> None:
    points, normals = sampled(trimesh.creation.torus(6, 2), 3000)
    actual, word = outward_normals(points, 3 * normals)
    assert np.allclose(actual, normals) and word == ""
    turned, word = outward_normals(points, -normals)
    assert np.allclose(turned, normals) and "turned" in word
    holed = normals.copy()
    holed[:10] = 0
    holed[10:20] = np.nan
    filled, _ = outward_normals(points, holed)
    assert np.isfinite(filled).all() and np.allclose(np.linalg.norm(filled, axis=1), 1)


def test_a_cloud_becomes_a_structure_without_triangles(tmp_path: Path) -> None:
    points, _ = sampled(box((10, 6, 4)), 2000)
    twice = np.concatenate([points, points[:100], [[np.nan, 0, 0]]])
    entry = saved(tmp_path, twice, np.empty((0, 3), int), "pcd", up="y", forward="-x")
    structure = read_structure(entry)
    assert structure.triangles.shape == (0, 3) and len(structure.vertices) == 2000
    assert structure.normals is not None and structure.normals.shape == (2000, 3)
    assert np.allclose(np.ptp(structure.vertices, axis=0), [10, 4, 6], atol=0.1)
    assert ((structure.normals * structure.vertices).sum(axis=1) > 0).mean() > 0.97
    assert "101 points dropped" in structure.notes
    with pytest.raises(InputError, match="do not lie on a line"):
        read_structure(saved(tmp_path, np.outer(np.arange(9.0), [1, 2, 3]), np.empty((0, 3), int), "pcd"))


def test_reading_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    entry = saved(tmp_path, *joined(box((4, 4, 4)), trimesh.creation.icosphere(3, 2.2)))
    one, other = read_structure(entry), read_structure(entry)
    assert one.vertices.tobytes() == other.vertices.tobytes()
    assert one.triangles.tobytes() == other.triangles.tobytes() and one.notes == other.notes


def test_a_cloud_is_a_scan_and_not_declared_to_be_drawn(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    points = np.random.default_rng(4).uniform(0, 9, (400, 3))
    trimesh.PointCloud(points).export(path)
    entry = StructureEntry("cloud", "box", path, 1.0)
    assert read_structure(entry).is_scan and read_structure(replace(entry, surface="scanned")).is_scan
    with pytest.raises(InputError, match="is a point cloud and declared to be drawn"):
        read_structure(replace(entry, surface="drawn"))
