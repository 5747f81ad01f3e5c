"""The continuous Frechet distance against three independent formulations and its laws."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from upplied.errors import InputError
from upplied.planning.geometry.frechet import frechet, frechet_floored, frechet_z, zscored
from upplied.records import Floats


def subdivided(path: Floats, pieces: int) -> Floats:
    """The same polyline with each leg cut into equal pieces."""
    share = np.arange(pieces)[:, None] / pieces
    legs = [a + share * (b - a) for a, b in itertools.pairwise(path)]
    return np.vstack([*legs, path[-1:]])


def discrete(first: Floats, second: Floats) -> float:
    """Eiter and Mannila's recurrence in plain Python."""
    table = np.linalg.norm(first[:, None] - second[None], axis=2)
    for i, j in itertools.product(*map(range, table.shape)):
        before = [table[a, b] for a, b in ((i - 1, j), (i, j - 1), (i - 1, j - 1)) if a >= 0 and b >= 0]
        if before:
            table[i, j] = max(table[i, j], min(before))
    return float(table[-1, -1])


def by_critical_values(first: Floats, second: Floats) -> float:
    """Alt and Godau's other way: the smallest critical value for which a monotone walk exists.

    The walk is searched on the graph of cell edges by a recursion over reachable intervals that
    shares nothing with the code under test; all critical values of types a, b and c are listed.
    """
    values = {np.linalg.norm(first[0] - second[0]), np.linalg.norm(first[-1] - second[-1])}
    for one, other in ((first, second), (second, first)):
        for start, end in itertools.pairwise(other):
            for point in one:
                values.add(_to_segment(point, start, end))
            for a, b in itertools.combinations(one, 2):
                values.add(_bisector(a, b, start, end))
    low = max(np.linalg.norm(first[0] - second[0]), np.linalg.norm(first[-1] - second[-1]))
    ordered = sorted(float(value) for value in values if value >= low)
    lower, upper = 0, len(ordered) - 1
    while lower < upper:
        middle = (lower + upper) // 2
        if _walk_exists(first, second, ordered[middle] * (1 + 1e-12) + 1e-12):
            upper = middle
        else:
            lower = middle + 1
    return ordered[lower]


def _to_segment(point: Floats, start: Floats, end: Floats) -> float:
    leg = end - start
    share = np.clip((point - start) @ leg / max(leg @ leg, 1e-300), 0, 1)
    return float(np.linalg.norm(point - start - share * leg))


def _bisector(a: Floats, b: Floats, start: Floats, end: Floats) -> float:
    """Distance at which the free intervals of two vertices on one leg just meet; inf if nowhere."""
    along = (end - start) @ (b - a)
    if abs(along) < 1e-14:
        return np.inf
    share = ((a + b) / 2 - start) @ (b - a) / along
    return float(np.linalg.norm(start + share * (end - start) - a)) if 0 <= share <= 1 else np.inf


def _walk_exists(first: Floats, second: Floats, leash: float) -> bool:
    """Reachability over exact free intervals, by dictionaries of edges."""
    rows, columns = len(first) - 1, len(second) - 1

    def free(point: Floats, start: Floats, end: Floats) -> tuple[float, float] | None:
        leg, gap = end - start, start - point
        a, b, c = leg @ leg, leg @ gap, gap @ gap - leash**2
        root = b * b - a * c
        if root < 0:
            return None
        low, high = (-b - np.sqrt(root)) / a, (-b + np.sqrt(root)) / a
        return (max(low, 0.0), min(high, 1.0)) if high >= 0 and low <= 1 else None

    left: dict[tuple[int, int], tuple[float, float]] = {}
    lower: dict[tuple[int, int], tuple[float, float]] = {}
    for i, j in itertools.product(range(rows + 1), range(columns + 1)):
        if i < rows:
            here = free(second[j], first[i], first[i + 1])
            if here is not None:
                if j == 0:
                    if here[0] == 0 and (i == 0 or left.get((i - 1, 0), (0, 0))[1] == 1):
                        left[i, 0] = here
                elif (i, j - 1) in lower:
                    left[i, j] = here
                elif (i, j - 1) in left and left[i, j - 1][0] <= here[1]:
                    left[i, j] = (max(here[0], left[i, j - 1][0]), here[1])
        if j < columns:
            here = free(first[i], second[j], second[j + 1])
            if here is not None:
                if i == 0:
                    if here[0] == 0 and (j == 0 or lower.get((0, j - 1), (0, 0))[1] == 1):
                        lower[0, j] = here
                elif (i - 1, j) in left:
                    lower[i, j] = here
                elif (i - 1, j) in lower and lower[i - 1, j][0] <= here[1]:
                    lower[i, j] = (max(here[0], lower[i - 1, j][0]), here[1])
    ends = (left.get((rows - 1, columns)), lower.get((rows, columns - 1)))
    return any(end is not None and end[1] >= 1 - 1e-12 for end in ends)


@pytest.mark.parametrize("seed", range(60))
def test_equals_the_smallest_critical_value(seed: int) -> None:
    rng = np.random.default_rng(seed)
    dimension = int(rng.integers(1, 4))
    first, second = (rng.normal(size=(int(rng.integers(2, 9)), dimension)) for _ in range(2))
    assert frechet(first, second) == pytest.approx(by_critical_values(first, second), rel=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_lies_between_bounds_from_fine_subdivision(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    first, second = np.round(2 * rng.normal(size=(5, 3))), np.round(2 * rng.normal(size=(4, 3)))
    fine = [subdivided(path, 24) for path in (first, second)]
    step = max(np.linalg.norm(np.diff(path, axis=0), axis=1).max() for path in fine)
    upper = discrete(*fine)
    assert upper - step / 2 - 1e-9 <= frechet(first, second) <= upper + 1e-9


def test_cases_known_by_geometry() -> None:
    line = np.array([[0.0, 0], [10, 0]])
    assert frechet(line, np.add(line, [0, 3])) == pytest.approx(3, rel=1e-9)
    assert frechet(line, line[::-1]) == pytest.approx(10, rel=1e-9)
    assert frechet(line, np.array([[0.0, 0], [5, 4], [10, 0]])) == pytest.approx(4, rel=1e-9)
    # back and forth along a line: the other must wait in the middle of the way back
    zigzag = np.array([[0.0, 0], [7, 0], [3, 0], [10, 0]])
    assert frechet(line, zigzag) == pytest.approx(2, rel=1e-9)
    # the same set of points in another order is far away, which Hausdorff's distance would not see
    loop = np.array([[0.0, 0], [0, 6], [6, 6], [6, 0], [0, 0]])
    assert frechet(loop, loop[::-1]) >= 5.9


def test_curves_of_one_vertex_and_repeated_vertices() -> None:
    point, line = np.array([[1.0, 1, 1]]), np.array([[1.0, 1, 1], [4, 5, 1]])
    assert frechet(point, line) == frechet(line, point) == pytest.approx(5)
    assert frechet(point, point) == 0
    hovering = np.repeat(line, 3, axis=0)
    assert frechet(hovering, line) < 1e-12
    assert frechet(hovering, line + 2) == pytest.approx(np.sqrt(12))


PATHS = st.integers(0, 2**31).map(lambda seed: np.random.default_rng(seed))


@pytest.mark.ci
@settings(max_examples=40, deadline=None)
@given(PATHS, st.sampled_from([1e-2, 1e-4, 1e-5]))
def test_a_share_asked_for_is_kept_and_never_below(rng: np.random.Generator, share: float) -> None:
    """Curves of hundreds of vertices, smooth and rough, near and far, there and back."""
    at = np.linspace(0, 1, int(rng.integers(30, 400)))
    a = np.column_stack([np.cos(6 * at), np.sin(6 * at), at]) * rng.uniform(1, 60)
    waves = np.column_stack([np.sin(rng.uniform(1, 20) * at) for _ in range(3)])
    b = a + rng.uniform(0, 10) * waves + rng.uniform(0, 0.2) * rng.normal(size=a.shape)
    b = np.concatenate([b, b[:: -int(rng.integers(1, 3))]]) if rng.random() < 0.3 else b
    true = frechet(a, b)
    assert true * (1 - 1e-9) <= frechet(a, b, share) <= true * (1 + share)


@settings(max_examples=40, deadline=None)
@given(PATHS)
def test_laws(rng: np.random.Generator) -> None:
    a, b, c = (np.cumsum(rng.normal(size=(int(rng.integers(2, 30)), 3)), axis=0) for _ in range(3))
    distance = frechet(a, b)
    assert frechet(b, a) == pytest.approx(distance, rel=1e-9)
    assert frechet(a[::-1], b[::-1]) == pytest.approx(distance, rel=1e-9)
    assert frechet(subdivided(a, 3), b) == pytest.approx(distance, rel=1e-9)
    assert frechet(a, c) <= distance + frechet(b, c) + 1e-9
    assert frechet(a, subdivided(a, 5)) < 1e-9
    shift = rng.normal(size=3)
    assert frechet(a + shift, b + shift) == pytest.approx(distance, rel=1e-8)
    assert frechet(a, a + shift) <= np.linalg.norm(shift) + 1e-9
    assert distance <= discrete(a, b) + 1e-9
    assert distance >= max(np.linalg.norm(a[0] - b[0]), np.linalg.norm(a[-1] - b[-1])) - 1e-9


def test_third_coordinate_counts() -> None:
    t = np.linspace(0, 1, 50)
    flat = np.column_stack([t, np.sin(5 * t), np.zeros(50)])
    assert frechet(flat, np.add(flat, [0, 0, 2.5])) == pytest.approx(2.5, rel=1e-9)


def test_zscores_follow_the_curve_and_not_its_vertices() -> None:
    rng = np.random.default_rng(5)
    path = np.cumsum(rng.normal(size=(40, 3)), axis=0)
    scored = zscored(path)
    fine = subdivided(scored, 4000)
    weight = np.repeat(np.linalg.norm(np.diff(path, axis=0), axis=1), 4000)
    middle = (fine[1:] + fine[:-1]) / 2
    mean = np.average(middle, axis=0, weights=weight)
    assert mean == pytest.approx(np.zeros(3), abs=1e-6)
    assert np.average((middle - mean) ** 2, axis=0, weights=weight) == pytest.approx(np.ones(3), rel=1e-5)
    hovering = np.insert(path, 7, np.repeat(path[7:8], 200, axis=0), axis=0)
    assert frechet_z(hovering, subdivided(path, 7)) < 1e-9


def test_zscored_distance_ignores_shift_and_scale_of_each_axis() -> None:
    rng = np.random.default_rng(6)
    a, b = np.cumsum(rng.normal(size=(2, 30, 3)), axis=1)
    moved = b * [2.0, 2.0, 2.0] + [5.0, -3.0, 100.0]
    assert frechet_z(a, moved) == pytest.approx(frechet_z(a, b), rel=1e-9)


def test_the_plain_distance_divides_each_axis_by_its_own_deviation() -> None:
    angle = np.linspace(0, 2 * np.pi, 400)
    flat = np.column_stack([30 * np.cos(angle), 10 * np.sin(angle), 0.01 * np.cos(3 * angle)])
    other = flat * [1, 1, -1]  # upside down, by a centimetre
    plain = [(path - path.mean(axis=0)) / path.std(axis=0) for path in (flat, other)]
    assert frechet_z(flat, other) == pytest.approx(frechet(*plain), rel=0.1)
    assert frechet_z(flat, other) > 10 * frechet_floored(flat, other)


def test_a_level_flight_is_not_ruled_by_its_unsteadiness() -> None:
    x = np.linspace(0, 60, 200)
    rng = np.random.default_rng(7)
    level = np.column_stack([x, 10 * np.sin(x / 8), np.full(200, 12.0)])
    unsteady = level + np.column_stack([np.zeros((200, 2)), 0.05 * rng.normal(size=200)])
    assert frechet_floored(level, unsteady) < 0.15
    assert frechet_z(level + [0, 0, 1e-3] * np.sin(x)[:, None], unsteady) > 2  # divided by its own 5 cm
    assert frechet_floored(level, np.add(level, [0, 0, 4])) < 1e-9
    assert frechet_z(level, np.add(level, [0, 0, 4])) < 1e-9
    assert zscored(np.ones((4, 3))) == pytest.approx(np.zeros((4, 3)))


@pytest.mark.parametrize("bad", [np.empty((0, 3)), np.full((3, 3), np.nan), np.zeros(3), np.zeros((3, 2))])
def test_what_is_no_curve_is_refused_in_words(bad: Floats) -> None:
    with pytest.raises(InputError, match="curve"):
        frechet(np.zeros((3, 3)), bad)
