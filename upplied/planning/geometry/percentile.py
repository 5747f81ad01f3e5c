"""Percentiles of weighted values."""

from __future__ import annotations

import numpy as np

from upplied.records import Floats


def weighted_percentile(values: Floats, weights: Floats, percent: float) -> float:
    """The least value up to which at least so many percent of the weight lie; NaN for none.

    Examples
    --------
    >>> weighted_percentile(np.array([1.0, 5.0]), np.array([3.0, 1.0]), 50)
    1.0
    """
    whole = float(np.sum(weights))
    if len(values) == 0 or whole <= 0:
        return float("nan")
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order]) / whole
    rank = int(np.searchsorted(share, percent / 100))
    return float(values[order][min(rank, len(values) - 1)])
