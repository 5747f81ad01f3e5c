"""Polylines: lengths that hold under any motion, values that meet their vertices, and even choices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.geometry.polylines import arc_length, chosen_evenly, cumulated, interpolated, leg_lengths


@pytest.mark.parametrize("seed", range(5))
def test_lengths_do_not_change_with_the_axes_and_grow_with_the_scale(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path, turn = rng.normal(0, 9, (12, 3)), Rotation.random(random_state=seed)
    along = arc_length(path)
    assert along[0] == 0 and (np.diff(along) == pytest.approx(leg_lengths(path)))
    assert arc_length(turn.apply(path) + 7.0) == pytest.approx(along)
    assert arc_length(3 * path) == pytest.approx(3 * along)
    assert arc_length(path[::-1]) == pytest.approx(along[-1] - along[::-1])
    assert leg_lengths(path[:1]).shape == (0,) and arc_length(path[:1]).tolist() == [0.0]


def test_steps_add_up() -> None:
    assert cumulated(np.array([2.0, 0.0, 3.5])).tolist() == [0.0, 2.0, 2.0, 5.5]
    assert cumulated(np.empty(0)).tolist() == [0.0]


def test_values_are_met_at_their_places_and_lie_on_the_line_between() -> None:
    rng = np.random.default_rng(0)
    where, values = np.cumsum(rng.random(8)), rng.normal(size=(8, 4))
    assert np.array_equal(interpolated(where, where, values), values)
    middle = (where[1:] + where[:-1]) / 2
    assert interpolated(middle, where, values) == pytest.approx((values[1:] + values[:-1]) / 2)
    assert np.array_equal(interpolated(np.array([-9.0, 99.0]), where, values), values[[0, -1]])


@pytest.mark.parametrize(("count", "most"), [(1, 1), (5, 9), (9, 5), (100, 7), (7, 7), (4000, 1500)])
def test_a_choice_has_both_ends_and_even_gaps(count: int, most: int) -> None:
    chosen = chosen_evenly(count, most)
    assert len(chosen) == min(count, most) and chosen[0] == 0 and chosen[-1] == (count - 1 if most > 1 else 0)
    gaps = np.diff(chosen)
    assert len(gaps) == 0 or (gaps.min() >= 1 and gaps.max() - gaps.min() <= 1)


def test_of_nothing_nothing_is_chosen() -> None:
    assert len(chosen_evenly(0, 5)) == 0
