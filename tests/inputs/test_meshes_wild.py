"""Real mesh and cloud files as they were found: each has its expected outcome."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import trimesh

from upplied.errors import InputError
from upplied.geometry.scene import Scene
from upplied.inputs.formats.reader import read_raw
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import normalise, read_structure


@dataclass(frozen=True)
class Wild:
    """A file as found, what a manifest would declare, and what must come of it."""

    file: str
    unit_m: float | None
    size_m: tuple[float, float, float]
    triangles: int
    up: str = "z"
    forward: str = "x"
    scale: float = 1.0
    says: str = ""  # a word of its notes


WILD = [
    Wild("bigben_ascii.stl", 1.0, (17.58, 17.71, 95.89), 526),
    Wild("bridge_diagonal.stl", 1.0, (210.16, 236.42, 51.62), 25620, says="63684 vertices welded"),
    Wild("empire_state_cm.obj", 0.01, (136.0, 60.0, 383.45), 2066, says="918 polygons triangulated"),
    Wild("house_1_inch_sdf1.5.dae", None, (16.49, 12.93, 7.68), 1881, scale=1.5, says="3 triangles without"),
    Wild("office_building_inverted.dae", None, (17.70, 17.70, 18.66), 2411, says="2351 triangles turned"),
    Wild("truss_bridge_inch.dae", None, (15.61, 8.47, 4.88), 3352, forward="y", says="52 repeated"),
    Wild(
        "turbine_yup_header_zup_data.dae", None, (10.92, 51.29, 91.62), 9302, says="y is up, the manifest z"
    ),
]


def entry(real_data: Path, wild: Wild) -> StructureEntry:
    path = real_data / "meshes" / "_raw" / wild.file
    return StructureEntry("wild", "any", path, wild.unit_m, wild.up, wild.forward, wild.scale)


@pytest.mark.parametrize("wild", WILD, ids=lambda wild: wild.file)
def test_files_as_found(real_data: Path, wild: Wild) -> None:
    structure = read_structure(entry(real_data, wild))
    assert np.ptp(structure.vertices, axis=0) == pytest.approx(wild.size_m, abs=0.01)
    assert len(structure.triangles) == wild.triangles
    assert wild.says in structure.notes


def test_gltf_1_is_refused_with_what_to_do(real_data: Path) -> None:
    with pytest.raises(InputError, match="gltf-pipeline"):
        read_structure(StructureEntry("a", "b", real_data / "meshes" / "_raw" / "a320_gltf1.glb", 1.0))


def test_every_file_as_found_is_named_here(real_data: Path) -> None:
    names = {path.name for path in (real_data / "meshes" / "_raw").iterdir()} - {"INDEX.csv"}
    assert names == {wild.file for wild in WILD} | {"a320_gltf1.glb"}


def folder(real_data: Path) -> list[Path]:
    return sorted(path for path in (real_data / "meshes").glob("[a-z]*/*.ply"))


def back_share(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Share of rays from outside, from above the horizon, that hit a back: another vote than the reader's."""
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(40, 3))
    directions[:, 2] = np.abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    centre, reach = vertices.mean(axis=0), float(np.linalg.norm(np.ptp(vertices, axis=0)))
    aim = centre + rng.uniform(-0.5, 0.5, (40, 500, 3)) * np.ptp(vertices, axis=0)
    origins = (aim + directions[:, None] * 2 * reach).reshape(-1, 3)
    rays = np.repeat(-directions, 500, axis=0)
    _, triangle, normal = Scene(vertices, triangles).cast(origins, rays)
    hit = triangle >= 0
    return float((np.einsum("nk,nk->n", normal[hit], rays[hit]) > 0).mean())


@pytest.mark.parametrize("step", [9, pytest.param(1, marks=pytest.mark.slow)])
def test_real_structures_are_read_whole_and_show_their_front(real_data: Path, step: int) -> None:
    for path in folder(real_data)[::step]:
        raw, sha256 = read_raw(path)
        oracle = trimesh.load(path, process=False)
        assert len(raw.triangles) == len(oracle.faces) and np.allclose(raw.vertices, oracle.vertices)
        structure, health = normalise(StructureEntry("a", "b", path, 1.0), raw, sha256)
        assert np.allclose(np.ptp(structure.vertices, axis=0), oracle.extents, atol=2e-4), path.name
        assert not health.outliers, path.name
        assert 0.3 * health.area_m2 < health.outside_area_m2 <= health.area_m2 * 1.0001, path.name
        sides = back_share(structure.vertices, structure.triangles)
        assert sides <= back_share(raw.vertices, raw.triangles) + 0.02, path.name


def test_an_inverted_building_and_halves_turned_inside_out_are_cured(real_data: Path) -> None:
    raw, sha256 = read_raw(real_data / "meshes" / "_raw" / "office_building_inverted.dae")
    assert back_share(raw.vertices, raw.triangles) > 0.8
    structure, _ = normalise(entry(real_data, WILD[4]), raw, sha256)
    assert back_share(structure.vertices, structure.triangles) < 0.05
    path = real_data / "meshes" / "airplane" / "a320_fgstatic_united.ply"
    raw, sha256 = read_raw(path)
    left = raw.vertices[raw.triangles][..., 1].mean(axis=1) > 0
    broken = np.where(left[:, None], raw.triangles[:, ::-1], raw.triangles)
    assert back_share(raw.vertices, broken) > 0.3
    structure, _ = normalise(StructureEntry("a", "b", path, 1.0), type(raw)(raw.vertices, broken), sha256)
    assert back_share(structure.vertices, structure.triangles) < 0.02


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "name", ["christ", *(pytest.param(n, marks=SLOW) for n in ("MBS", "pipe", "redbird", "tianqin"))]
)
def test_real_clouds_get_normals(real_data: Path, name: str) -> None:
    path = real_data / "meshes" / "_pointclouds" / f"fc_planner_{name}.ply"
    structure = read_structure(StructureEntry(name, "cloud", path, 1.0))
    assert structure.triangles.shape == (0, 3) and structure.normals is not None
    assert np.allclose(np.linalg.norm(structure.normals, axis=1), 1)
    top = structure.vertices[:, 2] > np.quantile(structure.vertices[:, 2], 0.995)
    assert structure.normals[top, 2].mean() > 0  # what lies on top looks up
