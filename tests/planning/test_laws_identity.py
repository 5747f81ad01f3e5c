"""Laws of the expert's flight: on its own structure it comes back as flown, however it was logged."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import slow_after
from moved_scenes import ANY
from planning_ruler import clearance

from upplied.config import settings_for
from upplied.geometry.poses import interpolate, look_at
from upplied.planning.plan import plan_transfer
from upplied.records import Camera, Demonstration, Floats, Plan, Structure, Trajectory
from upplied.samples.fleet import sample_structures
from upplied.samples.pilot import fly

FAST = ("cube-v1", "sides", 0)
LONG = [
    ("a320-v1", "engine_left", 1),
    ("a320-v1", "fuselage", 0),
    ("a320-v1", "wings", 0),
    ("turbine-1-v1", "tower", 0),
    ("cruise-v1", "hull", 0),
    ("bridge-1-v1", "piers", 2),
    ("cube-v1", "sides", 5),
    ("yacht-1-v1", "hull", 3),
]
FLIGHTS = [
    pytest.param(*FAST, marks=pytest.mark.ci),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in LONG),
]


@cache
def fleet() -> dict[str, Structure]:
    return {structure.structure_id: structure for structure in sample_structures()}


@cache
def flown(structure: str, inspection: str, seed: int) -> Demonstration:
    return fly(fleet()[structure], inspection, seed=seed)


@cache
def planned(structure: str, inspection: str, seed: int, preset: str) -> Plan:
    of = fleet()[structure]
    plan = plan_transfer(flown(structure, inspection, seed), of, of, settings_for(preset, verdict=ANY))
    assert plan.status == "ok", plan.reason
    return plan


def frechet(first: Floats, second: Floats) -> float:
    """Discrete Frechet distance of two densely sampled paths, by the textbook recurrence."""
    apart = np.linalg.norm(first[:, None] - second, axis=2)
    row = np.maximum.accumulate(apart[0])
    for distances in apart[1:]:
        before, row = row, np.empty_like(row)
        row[0] = max(before[0], distances[0])
        reach = np.minimum(before[1:], before[:-1])
        for index in range(1, len(row)):
            row[index] = max(min(reach[index - 1], row[index - 1]), distances[index])
    return float(row[-1])


def even(positions: Floats, number: int = 1200) -> Floats:
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    places = np.linspace(0, along[-1], number)
    return np.column_stack([np.interp(places, along, axis) for axis in positions.T])


def longest_stays(
    flight: Trajectory, within_m: float = 0.4, least_s: float = 4.5
) -> list[tuple[Floats, float]]:
    """Place and duration of each time spent within a small ball for long, away from both ends."""
    stays, index = [], 0
    last = len(flight) - 1
    while index <= last:
        away = np.linalg.norm(flight.positions[index:] - flight.positions[index], axis=1) > within_m
        stop = index + int(away.argmax()) if away.any() else last + 1
        spent = flight.t_s[min(stop, last)] - flight.t_s[index]
        if spent >= least_s and index > 0 and stop <= last:
            stays.append((flight.positions[index:stop].mean(axis=0), float(spent)))
            index = stop
        else:
            index += 1
    return stays


@pytest.mark.parametrize(("structure", "inspection", "seed"), FLIGHTS)
def test_identity(structure: str, inspection: str, seed: int) -> None:
    """`recommended` strays no further than `baseline` and 0.1 m, sees as much, and keeps every hover."""
    demonstration = flown(structure, inspection, seed)
    ours, box = (planned(structure, inspection, seed, preset) for preset in ("recommended", "baseline"))
    assert ours.flyable, ours.not_flyable
    assert ours.measures.frechet_m <= box.measures.frechet_m + 0.1
    line = even(demonstration.positions)
    assert (
        frechet(even(ours.trajectory.positions), line)
        <= 0.1 + 0.15 + np.linalg.norm(np.diff(line, axis=0), axis=1).max()
    )
    assert (
        ours.measures.coverage_inspected_pct >= box.measures.coverage_inspected_pct - 0.3
    )  # what a denoised flight shows less than its jitter did
    # Of all that is ever in a picture, what stands at its rim for four frames or fewer may go with the
    # trembling of the camera: a fifth of a degree, up to 5 of 1500 samples (round the wings).
    assert ours.measures.coverage_seen_pct >= box.measures.coverage_seen_pct - 0.6
    assert ours.measures.standoff_ratio_p50 == pytest.approx(1, abs=0.02)
    assert ours.measures.duration_s == pytest.approx(demonstration.trajectory.t_s[-1], rel=0.07)


WALL = np.array([[-40.0, 0, 0], [40, 0, 0], [40, 0, 36], [-40, 0, 36]])


def hall() -> Structure:
    cube = fleet()["cuboid-v1"]
    return replace(cube, structure_id="hall", vertices=cube.vertices * 4, sha256="")


def close_up(depth_m: float, hover_s: float, second_look: bool, noise_m: float = 0.01) -> Demonstration:
    """Along a hall 12 m off, in to a nearer place, a hover, perhaps a second pass, and on."""
    of, rate = hall(), 10.0
    low, high = of.vertices.min(axis=0), of.vertices.max(axis=0)
    at = np.array([low[0], low[1] - 12.0, (low[2] + high[2]) / 2])
    moves = [(40.0, 0.0), (0.0, depth_m), (0.0, 0.0), (0.0, -depth_m)]
    moves += [(-15.0, 0.0), (15.0, 0.0)] if second_look else []
    moves += [(high[0] - low[0] - 40.0, 0.0)]
    pieces = []
    for along, across in moves:
        count = round((abs(along) + abs(across) or hover_s) * rate)
        pieces.append(at + np.linspace(0, 1, count, endpoint=False)[:, None] * np.array([along, across, 0]))
        at = at + np.array([along, across, 0])
    path = np.vstack([*pieces, at[None]])
    path = path + np.random.default_rng(0).normal(0, noise_m, path.shape)
    times = np.round(np.arange(len(path)) / rate * 1e9).astype(np.int64)
    return Demonstration("close-up", "hall", times, path, look_at(path, np.add(path, [0, 10, 0])), Camera())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("depth", "hover", "second"), slow_after(1, [(5.0, 6.0, False), (2.0, 8.0, True), (8.0, 4.0, True)])
)
def test_close_ups_hovers_and_second_passes_are_kept(depth: float, hover: float, second: bool) -> None:
    demonstration, of = close_up(depth, hover, second), hall()
    plan = plan_transfer(demonstration, of, of, settings_for("recommended", verdict=ANY))
    assert plan.status == "ok", plan.reason
    wall = of.vertices[:, 1].min()
    off = wall - plan.trajectory.positions[:, 1]
    assert off.min() == pytest.approx(12 - depth, rel=0.1)
    ours, theirs = longest_stays(plan.trajectory, 0.3, 2.0), longest_stays(demonstration.trajectory, 0.3, 2.0)
    (stay,) = (spent for place, spent in ours if wall - place[1] < 12 - depth + 0.5)
    (expected,) = (spent for place, spent in theirs if wall - place[1] < 12 - depth + 0.5)
    assert stay == pytest.approx(expected, rel=0.1)
    length = [
        np.linalg.norm(np.diff(even(path, 4000), axis=0), axis=1).sum()
        for path in (plan.trajectory.positions,)
    ]
    assert length[0] == pytest.approx(80 + 2 * depth + (30 if second else 0), rel=0.02)


@pytest.mark.slow
def test_a_long_flight_in_close_rows_is_followed_as_well_as_a_short_one() -> None:
    of = hall()
    low, high = of.vertices.min(axis=0), of.vertices.max(axis=0)
    rows = []
    for number, z in enumerate(np.arange(low[2] + 2, high[2] - 12, 1.5)):
        xs = np.linspace(low[0], high[0], 120)[:: 1 if number % 2 == 0 else -1]
        rows.append(np.column_stack([xs, np.full(120, low[1] - 4.0), np.full(120, z)]))
    path = np.vstack(rows)
    camera = Camera(hfov_deg=24, vfov_deg=20, min_range_m=1, max_range_m=8)
    times = np.arange(len(path)) * 330_000_000
    mown = Demonstration("rows", "hall", times, path, look_at(path, np.add(path, [0, 10, 0])), camera)
    ours, box = (
        plan_transfer(mown, of, of, settings_for(preset, verdict=ANY))
        for preset in ("recommended", "baseline")
    )
    assert ours.status == "ok", ours.reason
    assert ours.measures.frechet_m <= box.measures.frechet_m + 0.1
    assert ours.measures.coverage_seen_pct >= box.measures.coverage_seen_pct - 0.1
    assert ours.measures.path_length_m == pytest.approx(box.measures.path_length_m, rel=0.01)


def logged_at(demonstration: Demonstration, factor: float) -> Demonstration:
    flight = demonstration.trajectory
    times = np.linspace(0, flight.t_s[-1], int(len(flight) * factor))
    other = interpolate(flight, times)
    stamps = demonstration.t_ns[0] + np.round(times * 1e9).astype(np.int64)
    return replace(
        demonstration, t_ns=stamps, positions=other.positions, quat_xyzw=other.quat_xyzw, sha256=""
    )


def shaken(demonstration: Demonstration, noise_m: float, seed: int) -> Demonstration:
    noise = np.random.default_rng(seed).normal(0, noise_m, demonstration.positions.shape)
    return replace(demonstration, positions=demonstration.positions + noise, sha256="")


PLAIN = ("cube-v1", "sides", "cuboid-v1")
PAIRS = [
    ("a320-v1", "fuselage", "b747-v1"),
    ("cruise-v1", "hull", "yacht-1-v1"),
    ("bridge-1-v1", "piers", "bridge-2-v1"),
]
RATES, NOISE = ("twice the rate", "half the rate"), "5 cm of noise"
DOUBLED = [(*pair, how) for pair in (PLAIN, *PAIRS) for how in (NOISE, *RATES)]


@pytest.mark.slow
@pytest.mark.parametrize(("source", "inspection", "target", "how"), slow_after(1, DOUBLED))
def test_doubling(source: str, inspection: str, target: str, how: str) -> None:
    """A flight logged at another rate, or with noise, gives the same plan."""
    plain = flown(source, inspection, 0)
    other = {
        "twice the rate": lambda: logged_at(plain, 2.0),
        "half the rate": lambda: logged_at(plain, 0.5),
        "5 cm of noise": lambda: shaken(plain, 0.05, 4),
    }[how]()
    settings = settings_for("recommended", verdict=ANY)
    one, two = (plan_transfer(item, fleet()[source], fleet()[target], settings) for item in (plain, other))
    assert one.status == two.status == "ok" and one.flyable == two.flyable
    assert two.measures.coverage_seen_pct == pytest.approx(one.measures.coverage_seen_pct, abs=0.5)
    near = [clearance(fleet()[target], plan.trajectory) for plan in (one, two)]
    assert near[1] == pytest.approx(near[0], abs=0.2)
    assert two.measures.duration_s == pytest.approx(one.measures.duration_s, rel=0.05)
