"""How certain a counterpart is: never more so for what speaks against it."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.correspondence.certainty import (
    ANSWERS,
    CAPS,
    OTHERS,
    evidence_of_answer,
    evidence_of_other,
    probability,
)
from upplied.records import Cloud

RNG = np.random.default_rng(0)


Size = tuple[float, float, float]


def cloud(*boxes: tuple[Size, Size]) -> Cloud:
    """Boxes by corner and size, 300 samples with normals and areas on each."""
    points, normals, area = [], [], []
    for low, size in boxes:
        each, axis, end = RNG.random((300, 3)), RNG.integers(3, size=300), RNG.integers(2, size=300)
        each[np.arange(300), axis] = end
        points.append(np.array(low) + each * size)
        normals.append((2 * end - 1)[:, None] * np.eye(3)[axis])
        a, b, c = size
        area.append(np.full(300, 2 * (a * b + b * c + c * a) / 300))
    label = np.repeat(np.arange(len(boxes)), 300)
    return Cloud(np.concatenate(points), np.concatenate(normals), np.concatenate(area), label)


ENGINES = cloud(((0, 0, 0), (60, 6, 6)), ((30, 12, 0), (5, 3, 3)), ((30, -9, 0), (5, 3, 3)))


@pytest.mark.parametrize("model", [ANSWERS, OTHERS])
def test_what_speaks_against_a_part_never_speaks_for_it(model):
    perfect = probability(np.zeros(len(CAPS)), model)
    assert perfect > 0.99
    for item, cap in enumerate(CAPS):
        worse = np.zeros(len(CAPS))
        worse[item] = cap
        assert probability(worse, model) <= perfect
    assert probability(np.array(CAPS), model) < 0.1


def test_a_part_is_sure_of_itself_and_not_of_another():
    carried = ENGINES.part
    own = evidence_of_answer(ENGINES, 1, ENGINES, [1], 0.0, False, carried)
    across = evidence_of_answer(ENGINES, 1, ENGINES, [2], 0.0, False, carried)
    whole = evidence_of_answer(ENGINES, 1, ENGINES, [0], 0.0, False, carried)
    assert probability(own, ANSWERS) > 0.99
    assert probability(across, ANSWERS) < probability(own, ANSWERS)
    assert probability(whole, ANSWERS) < 0.8


def test_another_of_a_kind_has_its_shape_and_size():
    twin = evidence_of_other(ENGINES, 1, 2, 0.0, False)
    body = evidence_of_other(ENGINES, 1, 0, 0.0, False)
    assert probability(twin, OTHERS) > 0.8 > probability(body, OTHERS)
