"""The sample fleet: closed surfaces, published dimensions, known correspondence."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from random_members import random_member
from true_counterparts import OUTER_ENGINES, parts, true_counterparts

from upplied.checks import check_id
from upplied.errors import InputError
from upplied.geometry.scene import scene_of
from upplied.samples.fleet import member, sample_structures
from upplied.samples.surfaces import Member

KINDS = ("airliner", "wind_turbine", "ship", "box", "bridge")
FLEET = [structure.structure_id for structure in sample_structures()]
MEMBERS = [*FLEET, *(f"{kind} {seed}" for kind in KINDS for seed in range(2))]


def named(name: str) -> Member:
    kind, _, seed = name.partition(" ")
    return random_member(kind, int(seed)) if seed else member(name)


def surface_points(one: Member, count: int = 400, seed: int = 0) -> np.ndarray:
    corners = one.structure.vertices[one.structure.triangles]
    rng = np.random.default_rng(seed)
    chosen = rng.integers(0, len(corners), count)
    weights = rng.dirichlet((1, 1, 1), count)
    return np.einsum("nk,nkj->nj", weights, corners[chosen])


@pytest.mark.parametrize("name", MEMBERS)
def test_every_edge_joins_two_triangles_that_agree(name: str) -> None:
    one = named(name)
    groups = [np.arange(len(one.structure.triangles))] if one.structure.kind == "box" else []
    for group in groups or [one.triangles_of(part) for part in one.part_names]:
        triangles = one.structure.triangles[group]
        edges = Counter(
            map(tuple, np.concatenate([triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]))
        )
        assert max(edges.values()) == 1
        assert all((b, a) in edges for a, b in edges)


@pytest.mark.parametrize("name", MEMBERS)
def test_normals_point_outwards(name: str) -> None:
    one = named(name)
    vertices = one.structure.vertices
    for part in one.part_names if one.structure.kind != "box" else ():
        a, b, c = (vertices[one.structure.triangles[one.triangles_of(part), k]] for k in range(3))
        assert np.einsum("ij,ij->i", a - a[0], np.cross(b - a, c - a)).sum() > 0, part
    # Seen from far away, every first hit shows its front.
    rng = np.random.default_rng(1)
    out = rng.normal(size=(2000, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    goals = surface_points(one, 2000)
    _, triangle, normal = scene_of(one.structure).cast(goals + 300 * out, -out)
    hit = triangle >= 0
    assert hit.sum() > 500
    assert (np.einsum("ij,ij->i", normal, out)[hit] > -1e-6).mean() > 0.999


@pytest.mark.parametrize("name", MEMBERS)
def test_a_structure_is_sound(name: str) -> None:
    structure = named(name).structure
    check_id(structure.structure_id, "structure id")
    assert np.isfinite(structure.vertices).all()
    assert structure.triangles.min() == 0
    assert structure.triangles.max() == len(structure.vertices) - 1
    assert 1000 < len(structure.triangles) < 15_000
    assert len(np.unique(np.sort(structure.triangles, axis=1), axis=0)) == len(structure.triangles)
    corners = structure.vertices[structure.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert area.min() > 1e-9
    assert structure.surroundings.ground_z_m == 0.0
    assert structure.vertices[:, 2].min() > (-2.0 if structure.kind == "ship" else -1e-9)
    assert len(structure.sha256) == 64


@pytest.mark.parametrize(
    ("structure_id", "length", "span", "height"),
    [  # airport planning documents of the makers
        ("a320-v1", 37.57, 34.10, 11.76),
        ("beluga-v1", 56.15, 44.84, 17.24),
        ("b747-v1", 70.66, 64.44, 19.41),
        ("b777-v1", 63.73, 60.93, 18.50),
    ],
)
def test_airliners_have_the_published_size(
    structure_id: str, length: float, span: float, height: float
) -> None:
    vertices = member(structure_id).structure.vertices
    assert np.ptp(vertices[:, 0]) == pytest.approx(length, rel=0.01)
    assert np.ptp(vertices[:, 1]) == pytest.approx(span, rel=0.015)
    assert vertices[:, 2].max() == pytest.approx(height, rel=0.015)
    assert 0.4 < vertices[:, 2].min() < 1.3  # the engines hang lowest


# A rotor turns one way.
@pytest.mark.parametrize("name", [name for name in MEMBERS if "turbine" not in name])
def test_left_mirrors_right(name: str) -> None:
    one = named(name)
    points = surface_points(one)
    mirrored = points * (1, -1, 1)
    # The diagonals of the facets are not mirrored.
    assert scene_of(one.structure).distance(mirrored).max() < 0.08


@pytest.mark.parametrize("kind", KINDS)
def test_members_of_a_kind_are_tessellated_alike(kind: str) -> None:
    members = [member(name) for name in FLEET if member(name).structure.kind == kind]
    members += [random_member(kind, seed) for seed in range(3)]
    for one in members[1:]:
        for part in set(one.part_names) & set(members[0].part_names):
            assert len(one.triangles_of(part)) == len(members[0].triangles_of(part)), part


@pytest.mark.parametrize("name", MEMBERS)
def test_a_structure_answers_to_itself(name: str) -> None:
    one = named(name)
    points = surface_points(one)
    assert np.linalg.norm(true_counterparts(one, one, points) - points, axis=1).max() < 1e-2


@pytest.mark.parametrize("kind", KINDS)
def test_counterparts_lie_on_the_target_and_lead_back(kind: str) -> None:
    names = [name for name in FLEET if member(name).structure.kind == kind]
    one, other = member(names[0]), member(names[1])
    points = surface_points(one)
    carried = true_counterparts(one, other, points)
    known = np.isfinite(carried).all(axis=1)
    assert known.mean() > 0.5
    assert scene_of(other.structure).distance(carried[known]).max() < 6e-3  # single precision
    # Where a point lies in several parts (a wing inside the fuselage), the way back may take the other part.
    back = true_counterparts(other, one, carried[known])
    assert (np.linalg.norm(back - points[known], axis=1) < 1e-2).mean() > 0.98


def test_counterparts_keep_part_and_side() -> None:
    a320, b747 = member("a320-v1"), member("b747-v1")
    names, owner = parts("a320-v1")
    engine = np.flatnonzero(owner == names.index("engine_left"))
    points = a320.structure.vertices[a320.structure.triangles[engine]].mean(axis=1)
    inner = true_counterparts("a320-v1", "b747-v1", points)
    outer = true_counterparts("a320-v1", "b747-v1", points, OUTER_ENGINES)
    where = b747.structure.landmarks
    assert np.linalg.norm(inner - where["engine_left"], axis=1).max() < 4.0
    assert np.linalg.norm(outer - where["engine_left_outer"], axis=1).max() < 4.0


def test_a_part_that_the_target_lacks_has_no_counterpart() -> None:
    a320 = member("a320-v1")
    winglet = a320.structure.triangles[a320.triangles_of("winglet_left")]
    tips = a320.structure.vertices[winglet].mean(axis=1)
    tips = tips[np.argsort(tips[:, 2])[-10:]]
    assert np.isnan(true_counterparts("a320-v1", "b777-v1", tips)).all()
    assert np.isfinite(true_counterparts("a320-v1", "b747-v1", tips)).all()


def test_counterparts_need_one_kind_and_known_names() -> None:
    with pytest.raises(InputError, match="kinds airliner and box"):
        true_counterparts("a320-v1", "cube-v1", np.zeros((1, 3)))
    with pytest.raises(InputError, match="is unknown"):
        parts("concorde-v1")
    with pytest.raises(InputError, match="is unknown"):
        random_member("submarine", 0)


@pytest.mark.parametrize("kind", KINDS)
def test_random_members_follow_their_seed(kind: str) -> None:
    same, again, other = (random_member(kind, seed).structure for seed in (3, 3, 4))
    assert same.sha256 == again.sha256
    assert np.array_equal(same.vertices, again.vertices)
    assert same.sha256 != other.sha256
