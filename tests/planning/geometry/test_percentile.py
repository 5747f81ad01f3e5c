"""Weighted percentiles against those of repeated values."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.geometry.clouds import weighted_percentile


@pytest.mark.parametrize("percent", [0.1, 5, 25, 50, 73, 95, 100])
@pytest.mark.parametrize("seed", range(4))
def test_weights_count_as_repetitions(percent: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    values, times = rng.normal(size=9), rng.integers(1, 6, 9)
    repeated = np.sort(np.repeat(values, times))
    known = repeated[int(np.ceil(len(repeated) * percent / 100 - 1e-9)) - 1]
    assert weighted_percentile(values, times.astype(float), percent) == known


def test_nothing_has_no_percentile() -> None:
    assert np.isnan(weighted_percentile(np.empty(0), np.empty(0), 50))
    assert np.isnan(weighted_percentile(np.ones(2), np.zeros(2), 50))


def test_the_last_value_answers_what_rounding_leaves_over() -> None:
    values, weights = np.arange(3.0), np.full(3, 0.1)
    assert weighted_percentile(values, weights, 100 * (1 + 1e-12)) == 2.0
    assert weighted_percentile(values, np.array([0.5, 0.25, 0.25]), 50) == 0.0
