"""What the pages are made of: meshes to show, values along a path, and what a person should see first."""

from __future__ import annotations

import base64
import json
from dataclasses import asdict, replace

import numpy as np
import pandas as pd
import pytest
from fake_catalog import FakeCatalog, box_structure, orbit
from hypothesis import given
from hypothesis import strategies as st

from upplied.geometry.poses import look_at
from upplied.geometry.scene import scene_of, simplified
from upplied.outputs.display import display_mesh, display_states, packed, structure_data
from upplied.outputs.pages import inert_json
from upplied.outputs.pair_page import _parts, profile, speeds
from upplied.outputs.pairs import battery_pct, change, meaning, pairs_of, shown_status
from upplied.outputs.reports import Reader, quality_data
from upplied.records import Camera, Counterpart, Plan, Structure, SurfaceStates, Trajectory


def area(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def sphere(rings: int) -> tuple[np.ndarray, np.ndarray]:
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.arange(rings) * 2 * np.pi / rings, indexing="ij"
    )
    vertices = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(rings), np.arange(rings), indexing="ij"))
    a, b = i * rings + j, i * rings + (j + 1) % rings
    quads = np.concatenate([np.stack([a, a + rings, b], 1), np.stack([b, a + rings, b + rings], 1)])
    return vertices.reshape(-1, 3), quads


def test_splitting_large_triangles_changes_neither_area_nor_extent():
    box = box_structure("box", (30.0, 8.0, 12.0))
    mesh = display_mesh(box)
    assert area(mesh.vertices, mesh.triangles) == pytest.approx(area(box.vertices, box.triangles))
    assert np.allclose(np.ptp(mesh.vertices, axis=0), [30, 8, 12])
    edges = mesh.vertices[mesh.triangles] - mesh.vertices[np.roll(mesh.triangles, -1, axis=1)]
    assert np.linalg.norm(edges, axis=2).max() <= 2 * box.diagonal_m / 50


def test_a_fine_mesh_is_simplified_and_keeps_its_shape():
    vertices, triangles = sphere(150)
    coarse, fewer = simplified(vertices, triangles, 3000)
    assert len(fewer) <= 3600 and area(coarse, fewer) == pytest.approx(4 * np.pi, rel=0.01)
    assert np.allclose(np.linalg.norm(coarse, axis=1), 1, atol=0.02)
    same = simplified(vertices, triangles, 10**6)
    assert same[0] is vertices and same[1] is triangles


def test_a_mesh_with_doubled_faces_is_not_torn():
    vertices, triangles = sphere(100)
    doubled = np.concatenate([triangles, triangles[:, ::-1], triangles[::3]])
    coarse, fewer = simplified(vertices, doubled, 3000)
    assert len(fewer) <= 3600 and np.linalg.norm(coarse, axis=1).max() < 1.05


def test_each_triangle_has_the_state_of_its_own_side():
    plate = box_structure("plate", (10.0, 10.0, 0.05))
    grid = np.stack(np.meshgrid(*[np.linspace(-5, 5, 30)] * 2), axis=-1).reshape(-1, 2)
    points = np.concatenate([np.c_[grid, np.full(900, z)] for z in (0.05, 0.0)])
    normals = np.repeat([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], 900, axis=0)
    mesh = display_mesh(plate)
    codes = display_states(mesh, SurfaceStates(points, np.repeat([1, 2], 900), normals))
    corners = mesh.vertices[mesh.triangles]
    up = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert (codes[up > 1e-6] == 1).all() and (codes[up < -1e-6] == 2).all()


def test_one_sample_that_differs_from_its_neighbours_is_outvoted():
    box = box_structure("box", (10.0, 10.0, 10.0))
    points = np.random.default_rng(0).uniform(-5, 5, (500, 3)) + np.array([0, 0, 5])
    state = np.ones(500, np.int64)
    state[7] = 3
    assert set(display_states(display_mesh(box), SurfaceStates(points, state))) == {1}
    assert set(display_states(display_mesh(box), SurfaceStates(np.empty((0, 3)), np.empty(0, np.int64)))) == {
        0
    }


def test_a_point_cloud_is_shown_as_points():
    points = np.random.default_rng(0).normal(size=(20_000, 3))
    cloud = Structure("cloud", "statue", points, np.empty((0, 3), int))
    mesh = display_mesh(cloud)
    assert len(mesh.vertices) == 12_000 and not len(mesh.triangles)
    assert structure_data(cloud, mesh)["triangles"]["data"] == ""


@given(st.lists(st.floats(-1e6, 1e6, width=32), max_size=20))
def test_packed_arrays_unpack_to_themselves(values):
    array = np.array(values, np.float32)
    content = packed(array)
    assert content["type"] == "f4" and np.array_equal(
        np.frombuffer(base64.b64decode(content["data"]), "<f4"), array
    )


@given(
    st.recursive(
        st.none() | st.floats() | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
        max_leaves=8,
    )
)
def test_data_in_a_page_is_never_markup(value):
    text = inert_json(value)
    assert not set("<>&") & set(text)
    json.loads(text, parse_constant=lambda name: pytest.fail(name))


def test_values_along_an_orbit_are_those_of_its_geometry():
    box = box_structure("box", (8.0, 8.0, 8.0))
    positions = np.array([[20.0, y, 4.0] for y in np.linspace(-3, 3, 13)])
    path = Trajectory(np.arange(13) * 0.25, positions, look_at(positions, positions - [1.0, 0, 0]))
    along = profile(path, scene_of(box))
    assert np.allclose(along.speed_mps, 2.0) and np.allclose(along.standoff_m, 16, atol=1e-4)
    assert np.allclose(along.clearance_m, 16, atol=1e-4)
    away = Trajectory(path.t_s, positions, look_at(positions, positions + np.array([1.0, 0, 0])))
    past = profile(away, scene_of(box))
    assert np.allclose(past.standoff_m, past.clearance_m), "a camera that looks past it: the nearest surface"
    wide = profile(path, scene_of(box), Camera(hfov_deg=60, vfov_deg=60))
    assert np.allclose(wide.standoff_m, 16, atol=1e-4), "the middle of the picture comes first"
    assert len(profile(orbit(box, count=5000), scene_of(box)).path) == 600
    assert speeds(Trajectory(np.zeros(1), np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]))).tolist() == [0]


def row(
    target: str,
    status: str = "ok",
    seen: float = 90.0,
    preset: str = "recommended",
    at: str = "2026-01-01",
    **more,
):
    values = {
        "transfer_id": f"{target}{preset}{at}",
        "demonstration_id": "d",
        "source_id": "s",
        "target_id": target,
    }
    values |= {
        "kind": "k",
        "preset": preset,
        "status": status,
        "reason": "",
        "planned_at": pd.Timestamp(at, tz="UTC"),
        "purpose": "",
        "state": "draft",
        "state_at": None,
    }
    return values | {"coverage_seen_pct": seen, "min_clearance_m": 3.0} | more


def test_pictures_are_as_fine_as_their_distance_says():
    """A wall of the box, flown past at 1 m/s in 8 m: one side is inspected, the other is not."""
    box, camera = box_structure("box", (12.0, 8.0, 10.0)), Camera(60.0, 45.0, 1.0, 40.0, 4000, 3000)
    x = np.linspace(-6.0, 6.0, 49)
    positions = np.stack([x, 0 * x - 12.0, 0 * x + 5.0], axis=1)
    path = Trajectory(np.arange(49) * 0.25, positions, look_at(positions, positions + np.array([0, 1.0, 0])))
    u, v = np.meshgrid(np.linspace(-5.5, 5.5, 12), np.linspace(1.0, 9.0, 9))
    front = np.stack([u, 0 * u - 4.0, v], axis=-1).reshape(-1, 3)
    points = np.concatenate([front, front * [1, -1, 1]])
    normals = np.repeat([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]], len(front), axis=0)
    surface = SurfaceStates(points, np.repeat([1, 0], len(front)), normals)
    plan = Plan("d", "s", "box", "cube", "recommended", "ok", trajectory=path, surface=surface)
    mesh = display_mesh(box)
    data = quality_data(plan, camera, scene_of(box), mesh, "{}")
    assert [each["name"] for each in data] == [
        "resolution (mm/px)",
        "motion blur (px)",
        "time in sharp view (s)",
    ]
    codes = {each["name"]: np.frombuffer(base64.b64decode(each["codes"]["data"]), np.uint8) for each in data}
    middle, focal = mesh.vertices[mesh.triangles].mean(axis=1), 2000 / np.tan(np.radians(30.0))
    near, far = (np.abs(middle - [0.0, y, 5.0]).max(axis=1) < 1.5 for y in (-4.0, 4.0))
    fine, blur, _ = (each["step"] * codes[each["name"]][near] for each in data)
    assert near.any() and np.allclose(fine, 8e3 / focal, rtol=0.05)
    assert np.allclose(blur, 1.0 / 8.0 * focal / 500, rtol=0.05)
    assert all((each[far] == 255).all() for each in codes.values())
    assert quality_data(replace(plan, surface=None), camera, scene_of(box), mesh, "{}") == []


def test_those_that_need_a_person_come_first():
    rows = [
        row("good", seen=99.0),
        row("poor", seen=60.0),
        row("no", "refused", np.nan),
        row("broken", "failed", np.nan),
    ]
    rows.append(row("good", seen=10.0, preset="baseline"))
    pairs = pairs_of(pd.DataFrame(rows), pd.DataFrame(rows))
    assert [pair.target_id for pair in pairs] == ["broken", "no", "poor", "good"]
    assert set(pairs[-1].plans) == {"recommended", "baseline"} and pairs[-1].main["coverage_seen_pct"] == 99.0


@pytest.mark.parametrize(
    ("before", "after", "difference"),
    [
        ({"status": "ok"}, {"status": "refused"}, "ok → refused"),
        ({"seen": 90.0}, {"seen": 92.5}, "coverage +2.5%"),
        ({"min_clearance_m": 3.0}, {"min_clearance_m": 2.0}, "clearance -1.0 m"),
        ({}, {}, ""),
    ],
)
def test_what_changed_is_told_against_the_plan_before(before, after, difference):
    old, new = row("t", at="2026-01-01", **before), row("t", at="2026-01-02", **after)
    (pair,) = pairs_of(pd.DataFrame([new]), pd.DataFrame([old, new]))
    assert change(pair) == difference
    (pair,) = pairs_of(pd.DataFrame([old]), pd.DataFrame([old]))
    assert change(pair) == ""


def test_a_refusal_is_told_in_plain_words():
    assert (
        "more in shape" in meaning("refused", "the clouds do not fit: score 2 m^2")
        and meaning("ok", "") == ""
    )
    assert "clearance" in meaning("refused", "clearance 0.4 m at [1, 2, 3]")
    assert "error" in meaning("failed", "worker was killed") and "reason" in meaning(
        "refused", "something new"
    )


def test_each_mesh_is_simplified_once():
    calls: list = []

    def cache(stage, record_type, key, compute):
        calls.append((stage, record_type.__name__, key))
        return compute()

    source = FakeCatalog(targets=1)
    source.cache = cache
    reader = Reader(source)
    first, again = reader.structure_data("cube"), reader.structure_data("cube")
    assert first is again and [call[:2] for call in calls] == [("display", "DisplayMesh")]
    source._structures["cube"] = replace(source._structures["cube"], sha256="other")
    Reader(source).structure_data("cube")
    assert len({key for *_, key in calls}) == 2


def test_a_comparison_that_must_not_be_flown_is_no_ok():
    row = {"status": "ok", "flyable": False, "not_flyable": "comes within 0.00 m of the structure"}
    assert shown_status(row) == "not flyable" and "Do not fly" in meaning("not flyable", "")
    assert shown_status(row | {"flyable": True, "not_flyable": ""}) == "ok"
    assert (
        shown_status({"status": "ok", "flyable": None, "not_flyable": None}) == "ok"
    )  # planned before it was asked
    assert shown_status(row | {"status": "refused"}) == "refused"


@pytest.mark.parametrize(
    ("probability", "sure", "percent"),
    [(0.98, "sure", "98 %"), (0.95, "sure", "95 %"), (0.9, "likely", "90 %"), (0.8, "likely", "80 %"),
     (0.42, "doubtful", "42 %"), (None, "unknown", "unknown")],
)  # fmt: skip
def test_a_counterpart_is_shown_with_how_sure_it_is(probability, sure, percent):
    part = Counterpart("part_5 (left low)", 61.4, 1, 4, ("part_6 (left)",), ("part_7: why",), probability)
    (shown,) = _parts(json.dumps([asdict(part)]))
    assert (shown["certainty"], shown["probability"]) == (sure, percent)
    assert (shown["inspected"], shown["similar"], shown["flown"]) == ("61 %", "4", "part_6 (left)")
    assert shown["left_out"] == "part_7: why" and not shown["doubt"]


@pytest.mark.parametrize("stored", ["", None, float("nan"), "[", "[1]", '[{"part": 1}]'])
def test_where_no_counterparts_are_kept_none_are_shown(stored):
    assert _parts(stored) == []


@pytest.mark.parametrize(
    ("endurance_s", "share"), [(1200.0, 25.0), (None, None), (0.0, None), ("x", None), (float("nan"), None)]
)
def test_the_battery_that_an_inspection_takes_is_known_where_its_endurance_is(endurance_s, share):
    settings = json.dumps({"vehicle": {"endurance_s": endurance_s}})
    assert battery_pct({"duration_s": 300.0, "settings_json": settings}) == share
    assert battery_pct({"duration_s": 300.0, "settings_json": ""}) is None
