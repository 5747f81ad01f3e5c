"""The evidence for a transfer, on made pairs where each piece of it is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from upplied.planning.carry.forecast import (
    CAPS,
    OFFSET,
    WEIGHTS,
    Evidence,
    evidence_of,
    unlikely,
)
from upplied.planning.correspondence.fit import Fit
from upplied.planning.demonstration.repetition import Take
from upplied.records import Cloud, Correspondences, Floats, Ints, Registration

STEP = 0.5
GRID = np.array([[x, y, 0.0] for x in np.arange(0, 20, STEP) for y in np.arange(0, 10, STEP)])
COUNT = len(GRID)
UP = np.tile([0.0, 0, 1], (COUNT, 1))
AREA = np.full(COUNT, STEP**2)
SAME = Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True, acceptance=0.3)
REGION = (GRID[:, 0] < 8).astype(float)  # what was inspected: 8 of 20 m


def take(
    weight: Floats = REGION,
    target: Cloud | None = None,
    index: Ints | None = None,
    points: Floats | None = None,
    fit: Registration = SAME,
    source: Cloud | None = None,
) -> Take:
    source = Cloud(GRID, UP, AREA) if source is None else source
    there = Cloud(GRID, UP, AREA) if target is None else target
    index = np.arange(COUNT) if index is None else index
    points = there.points[index] if points is None else points
    known = Correspondences(index, np.zeros(len(index)), points)
    surface = Fit(source, there, fit, known)
    inspection = SimpleNamespace(attention=SimpleNamespace(weight=weight))
    return cast(Take, SimpleNamespace(pair=SimpleNamespace(surface=surface), inspection=inspection))


def evidence(**changes: Any) -> Evidence:
    return evidence_of(take(**changes))


def test_a_structure_speaks_for_itself() -> None:
    actual = evidence()
    assert actual.values == pytest.approx([0, 0, 0.3], abs=1e-6)
    assert actual.probability > 0.95


def test_what_has_no_counterpart_is_counted_by_weight_and_area() -> None:
    index = np.arange(COUNT)
    index[GRID[:, 0] < 2] = -1
    weight = np.where(GRID[:, 0] < 2, 0.5, REGION)
    assert evidence(index=index, weight=weight).without == pytest.approx(1 / 7)
    points = GRID.copy()
    points[GRID[:, 0] < 2] = np.nan
    assert evidence(points=points, weight=weight).without == pytest.approx(1 / 7)


def test_nothing_known_has_all_against_it() -> None:
    all_against = [1, 1, 0.3]
    assert evidence(weight=np.zeros(COUNT)).values.tolist() == all_against
    index = np.full(COUNT, -1)
    index[:15] = np.arange(15)
    assert evidence(index=index).values.tolist() == all_against
    index[:16] = np.arange(16)
    assert evidence(index=index).without == pytest.approx(1 - 16 / REGION.sum())
    odd = Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True)
    assert evidence(fit=odd).misfit == 3.0
    far = Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True, acceptance=99.0)
    assert evidence(fit=far).misfit == 10.0


def test_a_scaling_bends_nothing_and_a_wave_does() -> None:
    scaled = evidence(points=GRID * [2.0, 0.5, 1.0] + [7, 8, 9])
    assert scaled.bent == pytest.approx(0, abs=1e-9)
    height = np.where(np.round(GRID[:, 0] / STEP).astype(int) % 2 == 0, 0.2, -0.2)
    wavy = evidence(points=GRID + height[:, None] * [0, 0, 1])
    low, high = np.quantile(GRID[REGION > 0], [0.05, 0.95], axis=0)
    size = np.linalg.norm(np.append((high - low)[:2], 0.4))
    assert wavy.bent == pytest.approx(0.2 / size, rel=0.08)


def test_the_probability_is_logistic_and_capped() -> None:
    actual = Evidence(0.1, 0.05, 0.9)
    against = sum(weight * value for weight, value in zip(WEIGHTS, actual.values, strict=True))
    assert actual.probability == pytest.approx(1 / (1 + np.exp(against - OFFSET)))
    assert Evidence(*np.full(3, 99.0)).probability == Evidence(*CAPS).probability < 0.01
    assert actual.values.tolist() == [0.1, 0.05, 0.9]


def test_the_evidence_in_words() -> None:
    actual = Evidence(0.1, 0.05, 0.9)
    assert actual.in_words == (
        "matched surface 90 %, deviation from the best scaling 5 % of the region's size; "
        "residual of the whole structures 0.90"
    )
    nothing = Evidence(1.0, *actual.values[1:])
    assert nothing.in_words == (
        "no inspected surface has a counterpart; residual of the whole structures 0.90"
    )
    sentence = unlikely(nothing, 0.6, SAME)
    assert sentence == (
        f"what was inspected cannot be shown here: probability {nothing.probability:.2f}, 0.6 is required "
        f"(registration.least_probability); {nothing.in_words}"
    )
    refused = Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, False, reason="no fit")
    assert unlikely(nothing, 0.6, refused) == f"{sentence}; no fit"
