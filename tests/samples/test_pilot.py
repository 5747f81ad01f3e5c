"""The simulated pilot: whatever he inspects, he keeps clear, flies like a person and looks at his work."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_members import random_member
from scipy.spatial import cKDTree
from true_counterparts import parts

from upplied.errors import RefusedError
from upplied.geometry.poses import angle_between, matrices, optical_axis, yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.records import Demonstration, Structure
from upplied.samples.airframe import airframe, left_nacelle, offset_outline
from upplied.samples.fleet import member, sample_demonstrations
from upplied.samples.pilot import fly, pushed_clear

DEMONSTRATIONS = {flight.demonstration_id: flight for flight in sample_demonstrations()}
INSPECTIONS = {
    "airliner": ("fuselage", "wings", "engine_left"),
    "wind_turbine": ("tower",),
    "ship": ("hull",),
    "box": ("sides",),
    "bridge": ("piers",),
}
STRANGERS = [(kind, word, seed) for kind, words in INSPECTIONS.items() for word in words for seed in (11, 12)]


def distance_between(flight: Demonstration, structure: Structure, cuts: int = 4) -> float:
    """Smallest distance of the path from the surface, looked at between the poses as well."""
    share = np.linspace(0, 1, cuts, endpoint=False)[:, None, None]
    between = flight.positions[:-1] + share * np.diff(flight.positions, axis=0)
    return float(scene_of(structure).distance(between.reshape(-1, 3)).min())


def share_in_view(flight: Demonstration, structure: Structure) -> float:
    """Share of the poses whose picture shows the structure somewhere near its middle."""
    y, z = np.meshgrid(np.linspace(-0.5, 0.5, 9), np.linspace(-0.5, 0.5, 9))
    rays = np.column_stack([np.ones(y.size), y.ravel(), z.ravel()])
    directions = np.einsum("nij,kj->nki", matrices(flight.quat_xyzw), rays)
    origins = np.repeat(flight.positions, len(rays), axis=0)
    _, hit, _ = scene_of(structure).cast(origins, directions.reshape(-1, 3))
    return float((hit >= 0).reshape(len(flight), -1).any(axis=1).mean())


def check_flight(flight: Demonstration, structure: Structure) -> None:
    seconds = flight.trajectory.t_s
    assert distance_between(flight, structure) >= 2.0
    assert flight.positions[:, 2].min() >= 1.0
    assert 300 < len(flight) < 2500
    assert 40 < seconds[-1] < 400
    assert (np.diff(flight.t_ns) > 0).all()
    assert np.allclose(np.linalg.norm(flight.quat_xyzw, axis=1), 1)
    left = matrices(flight.quat_xyzw)[:, :, 1]
    assert np.abs(left[:, 2]).max() < 1e-9, "the horizon is level"
    speed = np.linalg.norm(np.diff(flight.positions, axis=0), axis=1) / np.diff(flight.t_ns) * 1e9
    assert speed.max() < 7.0
    # He looks at the structure: the middle of the picture shows it nearly always.
    _, hit, _ = scene_of(structure).cast(flight.positions, optical_axis(flight.quat_xyzw))
    assert (hit >= 0).mean() > 0.8


@pytest.mark.parametrize("name", DEMONSTRATIONS)
def test_the_demonstrations_of_the_paper(name: str) -> None:
    flight = DEMONSTRATIONS[name]
    check_flight(flight, member(flight.structure_id).structure)


@pytest.mark.parametrize(("kind", "inspection", "seed"), STRANGERS)
def test_structures_he_never_saw(kind: str, inspection: str, seed: int) -> None:
    structure = random_member(kind, seed).structure
    check_flight(fly(structure, inspection, seed), structure)


def test_he_pauses_and_flies_unevenly() -> None:
    flight = DEMONSTRATIONS["a320-fuselage-v1"]
    seconds = flight.trajectory.t_s
    per_second = np.interp(np.arange(0, seconds[-1], 1.0), seconds, np.arange(len(flight))).astype(int)
    speed = np.linalg.norm(np.diff(flight.positions[per_second], axis=0), axis=1)
    assert np.percentile(speed, 3) < 0.25
    assert np.percentile(speed, 90) > 1.3 * np.percentile(speed, 30)


def test_the_gimbal_follows_without_leaps() -> None:
    for flight in DEMONSTRATIONS.values():
        rate = np.degrees(angle_between(flight.quat_xyzw[1:], flight.quat_xyzw[:-1])) / np.diff(
            flight.trajectory.t_s
        )
        assert np.percentile(rate, 99) < 90
        _, pitch = yaw_pitch(flight.quat_xyzw)
        assert pitch.min() >= -np.pi / 2 - 1e-9
        assert pitch.max() <= np.pi / 6 + 1e-9


@pytest.mark.parametrize("structure_id", ["a320-v1", "beluga-v1", "b747-v1", "b777-v1"])
def test_he_finds_the_inner_left_engine(structure_id: str) -> None:
    structure = member(structure_id).structure
    scene = scene_of(structure)
    nacelle = left_nacelle(structure, airframe(structure, scene), scene)
    assert np.linalg.norm(np.subtract(nacelle.centre, structure.landmarks["engine_left"])) < 1.2
    names, owner = parts(structure_id)
    engine = structure.triangles[owner == names.index("engine_left")]
    radius = np.ptp(structure.vertices[engine].reshape(-1, 3)[:, 1]) / 2
    assert nacelle.radius_m == pytest.approx(radius, rel=0.2)


def test_shapes_of_the_flights() -> None:
    fuselage = DEMONSTRATIONS["a320-fuselage-v1"].positions
    assert fuselage[:, 0].max() > 18
    assert fuselage[:, 0].min() < -18
    first_half = fuselage[: len(fuselage) // 2]
    assert np.median(first_half[:, 1]) > 4, "the left side comes first"
    wings = DEMONSTRATIONS["a320-wings-v1"].positions
    assert wings[0, 1] > 14
    assert wings[-1, 1] < -14
    tower = DEMONSTRATIONS["turbine-1-tower-v1"].positions
    turns = np.ptp(np.unwrap(np.arctan2(tower[:, 1], tower[:, 0]))) / (2 * np.pi)
    assert turns > 4
    sides = DEMONSTRATIONS["cube-sides-v1"].positions
    assert sides[0, 1] > 8
    assert sides[-1, 1] < -8
    assert np.abs(sides[[0, -1], 0]).max() < 8


def test_the_figure_8_turns_both_ways_round_the_piers() -> None:
    flight = DEMONSTRATIONS["bridge-1-piers-v1"].positions
    landmarks = member("bridge-1-v1").structure.landmarks
    winding = []
    for name in ("pier_1", "pier_2"):
        about = flight[:, :2] - np.array(landmarks[name][:2])
        angle = np.unwrap(np.arctan2(about[:, 1], about[:, 0]))
        winding.append((angle[-1] - angle[0]) / (2 * np.pi))
    assert winding[0] * winding[1] < 0
    assert np.abs(winding) == pytest.approx([1, 1], abs=0.2)


def test_the_same_seed_is_the_same_flight() -> None:
    structure = member("cube-v1").structure
    one, again, other = (fly(structure, "sides", seed) for seed in (5, 5, 6))
    assert np.array_equal(one.positions, again.positions)
    assert np.array_equal(one.t_ns, again.t_ns)
    assert one.sha256 == again.sha256
    assert one.sha256 != other.sha256


@pytest.mark.ci
@pytest.mark.parametrize("name", DEMONSTRATIONS)
def test_the_last_bit_does_not_choose_the_flight(name: str) -> None:
    """Processors differ in it: along a straight side, and where a quotient is whole, it chose before."""
    flight, seed = DEMONSTRATIONS[name], list(DEMONSTRATIONS).index(name)
    structure, inspection = member(flight.structure_id).structure, flight.notes.split(" inspection")[0]
    for draw in range(4):
        noise = np.random.default_rng(draw).normal(0, 1e-10, structure.vertices.shape)
        moved = replace(structure, vertices=structure.vertices + noise, sha256="")
        again = fly(moved, inspection.replace(" ", "_"), seed)
        assert len(again) == len(flight)
        assert np.abs(again.positions - flight.positions).max() < 1e-5


def test_moving_the_structure_moves_the_flight() -> None:
    structure = member("yacht-1-v1").structure
    shift = np.array([1000.0, -2000.0, 0.0])
    moved = Structure("yacht-1-v1", "ship", structure.vertices + shift, structure.triangles)
    here, there = fly(structure, "hull"), fly(moved, "hull")
    # Without a declared ground the lowest point of the hull counts: 0.4 m below the water.
    assert np.abs(there.positions - shift - here.positions)[:, :2].max() < 0.6


def test_a_point_cloud_is_flown_round_too() -> None:
    mesh = member("yacht-1-v1").structure
    rng = np.random.default_rng(0)
    corners = mesh.vertices[mesh.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = rng.choice(len(area), 20_000, p=area / area.sum())
    points = np.einsum("nk,nkj->nj", rng.dirichlet((1, 1, 1), 20_000), corners[chosen])
    cloud = Structure("yacht-cloud", "ship", points, np.empty((0, 3), np.int64))
    flight = fly(cloud, "hull")
    assert distance_between(flight, mesh) > 1.8  # of the mesh, which he never saw


@pytest.mark.parametrize("inspection", INSPECTIONS["airliner"])
def test_an_airplane_may_stand_beside_the_origin(inspection: str) -> None:
    structure = member("a320-v1").structure
    shift = np.array([300.0, -40.0, 0.0])
    moved = replace(structure, vertices=structure.vertices + shift)
    here, there = fly(structure, inspection), fly(moved, inspection)
    nearest = cKDTree(here.positions).query(there.positions - shift)[0]
    assert np.percentile(nearest, 90) < 0.5


def test_what_cannot_be_inspected_is_refused() -> None:
    with pytest.raises(RefusedError, match="no engine"):
        fly(member("cruise-v1").structure, "engine_left")
    with pytest.raises(RefusedError, match="no two piers"):
        fly(member("cube-v1").structure, "piers")
    with pytest.raises(RefusedError, match="slender tower"):
        fly(member("cube-v1").structure, "tower")
    with pytest.raises(RefusedError, match="is unknown"):
        fly(member("cube-v1").structure, "chimney")


def test_the_path_is_pushed_off_the_surface() -> None:
    scene = scene_of(member("cube-v1").structure)
    line = np.column_stack([np.linspace(-20, 20, 160), np.full(160, 6.5), np.full(160, 6.0)])
    clear = pushed_clear(line, scene, 2.0, 1.0)
    assert scene.distance(clear).min() >= 2.0
    assert np.abs(clear[[0, -1]] - line[[0, -1]]).max() < 0.2


def test_the_outline_keeps_its_distance() -> None:
    square = np.array([[0.0, 0], [4, 0], [4, 2], [0, 2], [2, 1]])
    loop = offset_outline(square, 3.0, 0.1)
    outside = np.maximum(np.maximum(-loop, loop - (4, 2)), 0)
    assert np.linalg.norm(outside, axis=1) == pytest.approx(3.0, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("folder", "name", "inspection"),
    [
        ("airplane", "a320_fr24", "fuselage"),
        ("airplane", "b744_fr24", "engine_left"),
        ("airplane", "crj900_fr24", "engine_left"),
        ("airplane", "md11_fgstatic", "wings"),
        ("airplane", "q400_fr24", "wings"),
        ("wind_turbine", "enercon_e82_98m", "tower"),
        ("ship", "cruise_ship_219m", "hull"),
        ("yacht", "catamaran_18m", "hull"),
        ("bridge", "larics_bridge", "piers"),
        ("building", "house_1_osrf", "sides"),
    ],
)
def test_real_meshes(real_data, folder: str, name: str, inspection: str) -> None:
    import trimesh

    mesh = trimesh.load(real_data / "meshes" / folder / f"{name}.ply", process=False)
    structure = Structure(name, folder, np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64))
    flight = fly(structure, inspection)
    assert distance_between(flight, structure) >= 2.0
    assert share_in_view(flight, structure) > 0.95
