"""Structures of the sample fleet as they would be scanned: one shell, clouds, cut, noisy, among clutter.

A shell is made from what is visible of each part by Poisson's reconstruction and kept in the folder that
UPPLIED_SCANS names (default: `upplied-scans` in the temporary folder). The truth of each sample is the part
of the generator that lies nearest.
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from random_members import random_member
from real_data import real_folder, real_structure
from scipy.spatial import cKDTree

from upplied.config import settings_for
from upplied.geometry.scene import Scene, open3d, scene_of
from upplied.geometry.separation import separated, structure_alone
from upplied.planning.surface.samples import surface_samples
from upplied.records import Floats, Ints, Structure, Surroundings
from upplied.samples.fleet import member, shape_of
from upplied.samples.parametric import bridge
from upplied.samples.surfaces import Member, stamped

FOLDER = Path(os.environ.get("UPPLIED_SCANS", Path(tempfile.gettempdir()) / "upplied-scans"))
VARIANTS = ("model", "shell", "cloud", "cut20", "sparse", "noise", "clutter", "cut40", "cut10")
DIVIDED = "divided"  # the same surface in four times as many triangles: what sampling alone changes
CLEANED = "cleaned"  # what `upplied structures check --clean` leaves of clutter
_VISIBLE = 160_000  # samples that a shell is made from
_OFF = 2e-3  # m, above the surface, whence it is asked what is inside another part
_TRIANGLES = 40_000
_NOISE_M, _CLOUD_NOISE_M = 0.03, 0.01
_REAL_SAMPLES = 40_000
_FOLDERS = {"airliner": "airplane", "wind_turbine": "wind_turbine", "bridge": "bridge", "ship": "ship"}
_POINTS = {"cloud": 100_000, "sparse": 10_000, "rough": 60_000}  # of clouds; a rough one has no normals
_CLUTTER = 25  # boxes in the air


def member_of(kind: str, name: str) -> Member:
    """A sample by its id, ``r11`` for one that nobody built, ``p5`` for a bridge of five piers.

    ``airplane/b738_fr24`` is a real mesh (bench/real_data.py); its parts are those that its pieces tell.
    """
    if "/" in name:
        return _real(kind, name)
    if name[0] == "p" and name[1:].isdecimal():
        return _many_piers(int(name[1:]))
    return random_member(kind, int(name[1:])) if name[1:].isdecimal() else member(name)


def scan(kind: str, name: str, variant: str, seed: int = 0) -> Structure:
    """A structure as modelled or as scanned; the same for the same seed."""
    if variant == CLEANED:
        cluttered = scan(kind, name, "clutter", seed)
        vertices, triangles, _ = structure_alone(cluttered, separated(cluttered))
        return _structure(member_of(kind, name).structure, variant, vertices, triangles)
    if variant == DIVIDED:
        whole = member_of(kind, name).structure
        return _structure(whole, variant, *_divided(whole.vertices, whole.triangles))
    if variant.startswith("cloudcut"):
        return _cut_cloud(member_of(kind, name).structure, scan(kind, name, "cloud", seed), variant, seed)
    rng = np.random.default_rng([seed, (*VARIANTS, "rough").index(variant)])
    whole = member_of(kind, name).structure
    known = _visible(kind, name)
    if variant == "model":
        return whole
    if variant in _POINTS:
        chosen = rng.choice(len(known["op"]), min(_POINTS[variant], len(known["op"])), replace=False)
        noise = _NOISE_M if variant == "rough" else _CLOUD_NOISE_M
        points = known["op"][chosen] + rng.normal(0, noise, (len(chosen), 3))
        normals = None if variant == "rough" else known["on"][chosen]
        return _structure(whole, variant, points, np.empty((0, 3), np.int64), normals)
    vertices, triangles = np.asarray(known["v"], float), np.asarray(known["f"], np.int64)
    if variant.startswith("cut"):
        triangles = _cut(vertices, triangles, int(variant[3:]) / 100, rng)
        used, triangles = np.unique(triangles, return_inverse=True)
        vertices, triangles = vertices[used], triangles.reshape(-1, 3)
    if variant != "shell" and variant != "clutter":
        vertices = vertices + rng.normal(0, _NOISE_M, vertices.shape)
    if variant == "clutter":
        vertices, triangles = _cluttered(vertices, triangles, rng)
    return _structure(whole, variant, vertices, triangles)


def real_names(kind: str) -> list[str]:
    """The names of the real meshes of a kind, none where the folder of real data is not there."""
    folder = real_folder()
    places = [] if folder is None else sorted((folder / "meshes" / _FOLDERS[kind]).glob("*.ply"))
    return [f"{_FOLDERS[kind]}/{place.stem}" for place in places]


@cache
def _real(kind: str, name: str) -> Member:
    folder = real_folder()
    if folder is None:
        raise SystemExit("no folder of real data: set UPPLIED_REAL_DATA")
    structure = stamped(replace(real_structure(folder, name), kind=kind))
    return Member(structure, (), np.zeros(len(structure.triangles), np.int64))


@cache
def _tree(kind: str, name: str) -> cKDTree:
    return cKDTree(_visible(kind, name)["op"])


def surface_seen(kind: str, name: str) -> Floats:
    """Samples (N, 3) of what of a structure can be seen from outside, from which its scans are made."""
    return np.asarray(_visible(kind, name)["op"])


def true_parts(kind: str, name: str, points: Floats) -> np.ndarray:
    """The name of the generator's part that lies nearest to each point (N,)."""
    known = _visible(kind, name)
    return np.array([str(each) for each in known["names"]])[known["ol"]][_tree(kind, name).query(points)[1]]


@cache
def _visible(kind: str, name: str) -> dict[str, np.ndarray]:
    """The shell of a member (v, f), and what of its parts is visible: points, normals, part (op, on, ol)."""
    path = FOLDER / f"{kind}_{name}.npz"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, **_reconstructed(member_of(kind, name)))
    with np.load(path) as stored:
        return {
            key: stored[key].astype(float) if key in ("op", "on") else stored[key] for key in stored.files
        }


def _reconstructed(of: Member) -> dict[str, np.ndarray]:
    points, normals, part_of = _outside(of) if of.part_names else _outside_of_real(of.structure)
    names = of.part_names or [f"piece_{part}" for part in range(int(part_of.max()) + 1)]
    geometry = open3d().geometry
    cloud = geometry.PointCloud(open3d().utility.Vector3dVector(points))
    cloud.normals = open3d().utility.Vector3dVector(normals)
    depth = 8 if of.structure.kind == "bridge" else 9
    shell, _ = geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, n_threads=1)
    piece, count, _ = shell.cluster_connected_triangles()
    shell.remove_triangles_by_mask(np.asarray(piece) != np.argmax(count))
    shell.remove_unreferenced_vertices()
    shell = shell.simplify_quadric_decimation(_TRIANGLES)
    return {
        "v": np.asarray(shell.vertices), "f": np.asarray(shell.triangles), "names": np.array(names),
        "op": points.astype(np.float32), "on": normals.astype(np.float32), "ol": part_of,
    }  # fmt: skip


def _outside_of_real(structure: Structure) -> tuple[Floats, Floats, Ints]:
    """Points on what rays from outside meet, normals, and the part of each that pieces tell."""
    clouds = replace(settings_for("recommended").clouds, surface_samples=_REAL_SAMPLES)
    cloud = surface_samples(structure, scene_of(structure, 1), clouds)
    assert cloud.normals is not None and cloud.part is not None
    return cloud.points, cloud.normals, cloud.part


def _outside(of: Member) -> tuple[Floats, Floats, Ints]:
    """Points on what is visible of each part, normals and parts."""
    structure = of.structure
    points, normals, triangle = _samples(structure, _VISIBLE, np.random.default_rng(0))
    keep = np.ones(len(points), bool)
    ray = np.tile([0.1234, 0.2345, 0.964], (len(points), 1))
    for part in range(len(of.part_names)):  # part by part: over all of them, what lies inside two is outside
        scene = Scene(structure.vertices, structure.triangles[of.part_of_triangle == part], 1)
        keep &= scene.hits(points + _OFF * normals, ray) % 2 == 0
    return points[keep], normals[keep], of.part_of_triangle[triangle][keep]


def _samples(of: Structure, number: int, rng: np.random.Generator) -> tuple[Floats, Floats, Ints]:
    corners = of.vertices[of.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    chosen = rng.choice(len(area), number, p=area / area.sum())
    root, second = np.sqrt(rng.random(number))[:, None], rng.random(number)[:, None]
    at = corners[chosen]
    points = at[:, 0] * (1 - root) + root * (at[:, 1] * (1 - second) + at[:, 2] * second)
    return points, normals[chosen] / np.maximum(area[chosen, None], 1e-12), chosen


def _divided(vertices: Floats, triangles: Ints) -> tuple[Floats, Ints]:
    """Each triangle in four, at the middles of its edges."""
    mesh = (
        open3d()
        .geometry.TriangleMesh(
            open3d().utility.Vector3dVector(vertices), open3d().utility.Vector3iVector(triangles)
        )
        .subdivide_midpoint(1)
    )
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles, np.int64)


def _cut(vertices: Floats, triangles: Ints, share: float, rng: np.random.Generator) -> Ints:
    """What is left of the triangles where all round a place, a share of the area, was never scanned."""
    corners = vertices[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    middle = corners.mean(axis=1)
    at = middle[rng.choice(len(middle), p=area / area.sum())]
    order = np.argsort(np.linalg.norm(middle - at, axis=1))
    gone = order[np.cumsum(area[order]) < share * area.sum()]
    return np.delete(triangles, gone, axis=0)


def _cut_cloud(of: Structure, whole: Structure, variant: str, seed: int) -> Structure:
    """What is left of a cloud, ``cloudcut20``, of which a share round some point was never scanned."""
    share, points = int(variant.removeprefix("cloudcut")), whole.vertices
    at = points[np.random.default_rng([seed, share, 7]).integers(len(points))]
    left = np.sort(np.argsort(np.linalg.norm(points - at, axis=1))[len(points) * share // 100 :])
    normals = None if whole.normals is None else whole.normals[left]
    return _structure(of, variant, points[left], whole.triangles, normals)


def _cluttered(vertices: Floats, triangles: Ints, rng: np.random.Generator) -> tuple[Floats, Ints]:
    """Small boxes in the air round the structure, as birds, cables and ghosts leave."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    box = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
    size = 0.005 * np.linalg.norm(high - low)
    for _ in range(_CLUTTER):
        at = low + (high - low) * rng.uniform(0, 1, 3)
        triangles = np.vstack([triangles, box + len(vertices)])
        vertices = np.vstack([vertices, at + corners * rng.uniform(0.3, 1.0, 3) * size])
    return vertices, triangles


def _structure(
    of: Structure, variant: str, vertices: Floats, triangles: Ints, normals: Floats | None = None
) -> Structure:
    return stamped(
        replace(
            of,
            structure_id=f"{of.structure_id}-{variant}",
            vertices=vertices,
            triangles=triangles,
            normals=normals,
            surface=None if variant == DIVIDED else "scanned",
            surroundings=Surroundings(ground_z_m=0.0),
        )
    )


def _many_piers(number: int) -> Member:
    spacing = 30.0
    shape = shape_of("bridge-1-v1")
    shape = replace(shape, length_m=spacing * (number + 1), spacing_m=spacing, piers=number)
    return bridge(shape, f"bridge-p{number}")
