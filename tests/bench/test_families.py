"""The families of structures: closed bodies on the ground, the same for the same seed, and flights."""

from __future__ import annotations

import families
import numpy as np
import pytest
from families_pilot import CLEARANCE_M
from stability_pairs import pairs, structure
from stability_rows import clearance, resampled

from upplied.geometry.poses import optical_axis
from upplied.geometry.scene import scene_of


@pytest.mark.parametrize("family", families.FAMILIES)
def test_a_member_is_made_of_closed_bodies_on_the_ground(family: str) -> None:
    member = families.family_member(family, 1)
    one = member.structure
    assert one.kind == family and one.surroundings.ground_z_m == 0.0
    assert np.isfinite(one.vertices).all()
    assert one.vertices[:, 2].min() == pytest.approx(0.0, abs=0.11)
    assert one.vertices[:, 2].min() >= 0
    corners = one.vertices[one.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert area.min() > 1e-5
    for number, name in enumerate(member.part_names):
        body = one.triangles[member.part_of_triangle == number]
        edges = np.sort(np.concatenate([body[:, [0, 1]], body[:, [1, 2]], body[:, [2, 0]]]), axis=1)
        assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all(), name
        places = one.vertices[body]
        assert np.linalg.det(places - places[0, 0]).sum() > 0, name  # its normals lead outwards


@pytest.mark.parametrize("family", families.FAMILIES)
def test_the_same_seed_gives_the_same_member_and_another_seed_another(family: str) -> None:
    one, other = (families.family_member(family, seed).structure for seed in (1, 2))
    families.family_member.cache_clear()
    again = families.family_member(family, 1).structure
    assert again is not one
    assert again.vertices.tobytes() == one.vertices.tobytes()
    assert again.triangles.tobytes() == one.triangles.tobytes()
    assert np.abs(np.ptp(one.vertices, axis=0) - np.ptp(other.vertices, axis=0)).max() > 0.05


@pytest.mark.parametrize(
    ("family", "inspection"), [("lighthouse", "tower"), ("stayed_bridge", "pylon"), ("stadium", "bowl")]
)
def test_a_flight_keeps_its_distance_and_looks_at_its_part(family: str, inspection: str) -> None:
    flight = families.family_flight(family, 0, inspection)
    member = families.family_member(family, 0)
    assert clearance(member.structure, resampled(flight.positions, 0.05, 2, 1_000_000)) >= CLEARANCE_M - 0.01
    assert flight.positions[:, 2].min() > 1
    speed = np.linalg.norm(np.diff(flight.positions, axis=0), axis=1) / np.diff(flight.t_ns * 1e-9)
    assert 1.0 < np.median(speed) < 2.0
    reach, triangle, _ = scene_of(member.structure).cast(flight.positions, optical_axis(flight.quat_xyzw))
    met = np.isfinite(reach)
    names = np.array(member.part_names)[member.part_of_triangle[triangle[met]]]
    starts = families.FAMILIES[family].inspections[inspection].parts
    assert np.mean([name.startswith(starts) for name in names]) > 0.5
    assert met.mean() > 0.5 and np.median(reach[met]) < 25
    again = families.family_flight(family, 0, inspection)
    assert again.sha256 == flight.sha256


def test_pairs_are_of_one_family_and_strangers_of_two() -> None:
    order, strange = pairs(families=True), pairs(strangers=True, families=True)
    inspections = sum(len(family.inspections) for family in families.FAMILIES.values())
    assert len(order) == inspections * len(families.SOURCE_SEEDS) * len(families.TARGET_SEEDS)
    number = len(families.FAMILIES)
    assert len({pair.flight.part for pair in order[:number]}) == number
    assert all(pair.target.startswith(f"{pair.flight.group}-random-") for pair in order)
    assert not any(pair.target.startswith(f"{pair.flight.group}-random-") for pair in strange)
    assert {pair.half for pair in order} == {"tune", "report"}
    assert structure(order[0].target).kind == order[0].flight.group
