"""The bench of perturbations: variants mean the same, the order is fair, the ruler is right, rows stay."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from upplied.geometry.poses import look_at
from upplied.planning.surface.parts import mesh_pieces
from upplied.records import Structure, SurfaceStates, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

BENCH = Path(__file__).parents[2] / "bench"
CUBE = member("cube-v1").structure


@pytest.fixture(autouse=True)
def bench(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(str(BENCH))
    monkeypatch.setenv("UPPLIED_REAL_DATA", str(tmp_path / "none"))


def area(one: Structure) -> float:
    corner = one.vertices[one.triangles]
    return float(
        np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum() / 2
    )


def volume(one: Structure) -> float:
    return float(np.linalg.det(one.vertices[one.triangles]).sum() / 6)


@pytest.mark.parametrize("variant", ["noise1", "noise2", "order", "divided", "rounded"])
def test_a_variant_of_the_mesh_has_the_same_surface(variant: str) -> None:
    from stability_variants import varied

    flight = fly(CUBE, "sides")
    target = replace(CUBE, sha256="a" * 64)
    changed = varied(flight, CUBE, target, variant).target
    assert changed.sha256 != target.sha256
    assert area(changed) == pytest.approx(area(CUBE), rel=1e-3)
    assert volume(changed) == pytest.approx(volume(CUBE), rel=1e-3)
    again = varied(flight, CUBE, target, variant).target
    assert again.vertices.tobytes() == changed.vertices.tobytes()
    if variant == "divided":
        assert len(changed.triangles) == 4 * len(CUBE.triangles)
    if variant == "order":
        assert not np.array_equal(changed.triangles, CUBE.triangles)


def test_welded_structures_are_one_piece_of_the_same_surface() -> None:
    from stability_variants import varied

    bridge, flight = member("bridge-1-v1").structure, fly(CUBE, "sides")
    assert mesh_pieces(bridge).max() > 2
    for variant, pieces in (("welded", (1, 0)), ("welded-source", (0, 1)), ("welded-both", (0, 0))):
        inputs = varied(flight, replace(bridge), replace(bridge), variant)
        both = inputs.source, inputs.target
        assert tuple(int(mesh_pieces(one).max() > 0) for one in both) == pieces
        assert [area(one) for one in both] == pytest.approx([area(bridge)] * 2, rel=1e-3)


def test_noise_moves_every_vertex_by_a_millimetre_and_keeps_welds() -> None:
    from stability_variants import varied

    twice = replace(CUBE, vertices=np.concatenate([CUBE.vertices, CUBE.vertices]))
    moved = varied(fly(CUBE, "sides"), CUBE, twice, "noise1").target.vertices
    off = np.abs(moved - twice.vertices)
    assert off.max() <= 1e-3
    assert (off.max(axis=1) > 0).all()
    number = len(CUBE.vertices)
    assert np.array_equal(moved[:number], moved[number:])


def test_the_flight_at_half_its_rate() -> None:
    from stability_variants import varied

    flight = replace(fly(CUBE, "sides"), breaks=np.array([7, 10]))
    half = varied(flight, CUBE, CUBE, "half").demonstration
    assert np.array_equal(half.t_ns, flight.t_ns[::2])
    assert half.breaks.tolist() == [4, 5]
    off = half.positions - flight.positions[::2]
    assert 0.01 < off.std() < 0.03


def test_every_beginning_of_the_order_is_a_fair_sample() -> None:
    from stability_pairs import pairs

    order = pairs(seed=1)
    assert len({pair.name for pair in order}) == len(order) > 100
    parts = [pair.flight.part for pair in order]
    assert len(set(parts[:7])) == 7
    assert [pair.name for pair in pairs(seed=1)] == [pair.name for pair in order]
    assert [pair.name for pair in pairs(seed=2)] != [pair.name for pair in order]
    halves = [pair.half for pair in order if pair.flight.part == "engine"]
    assert (
        abs(np.mean([half == "tune" for half in halves]) - np.mean([h == "tune" for h in halves[:6]])) < 0.34
    )
    assert len({(pair.target, pair.half) for pair in order}) == len({pair.target for pair in order})
    strange = pairs(strangers=True)
    assert not {pair.name for pair in strange} & {pair.name for pair in order}


def test_flights_round_other_structures_share_no_source(monkeypatch: pytest.MonkeyPatch) -> None:
    import stability_pairs as module

    names = {"airplane": ("a320_fr24", "a319_fr24", "crj200_fg"), "ship": ("ferry_88m", "tanker_240m")}
    paths = {one: Path(kind) / f"{one}.ply" for kind, some in names.items() for one in some}
    monkeypatch.setattr(module, "meshes", lambda: paths)
    for cached in (module.groups, module.flights):
        cached.cache_clear()
    try:
        others = module.pairs(unflown=True, seed=1)
        assert {pair.flight.source for pair in others} == {"a319_fr24", "crj200_fg", "tanker_240m"}
        assert {pair.flight.name for pair in others if pair.target == "ferry_88m"} == {"tanker_240m-hull"}
        assert len(others) == 2 * 3 * 2 + 1
        assert not {pair.flight.source for pair in module.pairs() if not pair.generated} & {"a319_fr24"}
    finally:
        module.groups.cache_clear()
        module.flights.cache_clear()


def test_the_ruler_measures_a_cube() -> None:
    from stability_rows import axis_share, clearance, packed, resampled, unpacked

    half = 6.0
    place = np.array([[half + 3.0, 0.0, half], [half + 8.0, 0.0, half]])
    assert clearance(CUBE, place) == pytest.approx(3.0, abs=1e-4)
    quats = look_at(place, np.array([[0.0, 0.0, half], [half + 17.0, 0.0, half]]))
    path = Trajectory(np.array([0.0, 1.0]), place, quats)
    states = SurfaceStates(np.array([[half, 0.0, half], [-half, 0.0, half]]), np.array([1, 0]))
    assert axis_share(CUBE, path, states, ("shown",)) == pytest.approx(0.5)
    assert axis_share(CUBE, path, states, ("missed",)) is None
    dense = resampled(place, 0.5, 2, 1000)
    assert len(dense) == 11
    assert np.allclose(unpacked(packed(dense)), dense, atol=1e-6)


def row(pair: str, variant: str, inspected: float, **more: object) -> dict[str, object]:
    from stability_rows import packed

    path = np.column_stack([np.linspace(0, 9, 10), np.full(10, more.pop("aside", 0.0)), np.zeros(10)])
    measures = {"coverage_inspected_pct": inspected, "inspected_unattainable_pct": 0.0}
    known = {
        "pair": pair, "kind": "sides", "half": "tune", "generated": True, "stranger": False, "cold": True,
        "variant": variant, "status": "ok", "reason": "", "measures": measures, "path": packed(path),
        "standoff_m": 10.0, "clearance_m": 2.5, "promised_m": 2.0, "cpu_s": 1.0,
    }  # fmt: skip
    return {**known, **more}


def test_the_table_counts_what_changes(tmp_path: Path) -> None:
    from stability_read import compared
    from stability_table import figures

    rows = [
        row("a > b", "given", 95.0, box_inspected_pct=97.0),
        row("a > b", "noise1", 93.0, aside=1.0),
        row("a > b", "noise2", 95.5),
        row("a > b", "order", 95.0, status="refused", clearance_m=1.5),
        row("c > d", "given", 99.0, status="crash"),
        row("a > e", "given", 0.0, status="ok", stranger=True),
    ]
    file = tmp_path / "rows.jsonl"
    file.write_text("\n".join(json.dumps(one) for one in rows) + '\n{"pair": "cut of')
    table = {name.strip(): value for name, value in figures(compared(file)).items()}
    assert table["pairs / rows / crashed"] == "1/6/1"
    assert table["FLIPS of variants, % (<= 1)"] == "33.3"
    assert table["INSPECTED within 1 point of given, % (>= 95)"] == "50.0"
    assert table["largest difference, points (<= 3)"] == "2.0"
    assert table["largest (<= 20)"] == "10.0"
    assert table["BELOW BOX by > 1 point (0)"] == "1/1"
    assert table["STRANGERS accepted (0)"] == "1/1"
    assert table["CLEARANCE short of promise (0)"] == "1/4"


@pytest.mark.slow
def test_a_run_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    out = tmp_path / "rows.jsonl"
    command = [sys.executable, str(BENCH / "stability.py")]
    chosen = ["--pairs", "box-random-9000-sides > box-random-9100", "--variants"]
    for variants in ("given", "given,order"):
        process = subprocess.run(
            [*command, "run", str(out), *chosen, variants], capture_output=True, text=True, timeout=300
        )
        assert process.returncode == 0, process.stderr
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    assert [one["variant"] for one in rows] == ["given", "order"]
    assert all(one["status"] == "ok" for one in rows)
    assert rows[0]["clearance_m"] >= 2 - 0.01
    assert rows[0]["axis_demonstration"] > 0.5
    printed = subprocess.run(
        [*command, "table", str(out), str(out)], capture_output=True, text=True, timeout=60
    )
    assert "2 rows in both" in printed.stdout, printed.stderr
