"""How certain a counterpart is: never more so for what speaks against it."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.correspondence.certainty import (
    CAPS,
    COUNTERPART,
    SAME_KIND,
    evidence_of_counterpart,
    evidence_of_same_kind,
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


@pytest.mark.parametrize("model", [COUNTERPART, SAME_KIND])
def test_what_speaks_against_a_part_never_speaks_for_it(model):
    perfect = probability(np.zeros(len(CAPS) + 1), model)
    assert perfect > 0.99
    for item, cap in enumerate(CAPS):
        worse = np.zeros(len(CAPS) + 1)
        worse[item] = cap
        assert probability(worse, model) <= perfect
    assert probability(np.array([*CAPS, 1.0]), model) < 0.1


def test_a_part_is_sure_of_itself_and_not_of_another():
    carried = ENGINES.part
    own = evidence_of_counterpart(ENGINES, [1], ENGINES, [1], 0.0, False, carried)
    across = evidence_of_counterpart(ENGINES, [1], ENGINES, [2], 0.0, False, carried)
    whole = evidence_of_counterpart(ENGINES, [1], ENGINES, [0], 0.0, False, carried)
    assert probability(own, COUNTERPART) > 0.99
    assert probability(across, COUNTERPART) < probability(own, COUNTERPART)
    assert probability(whole, COUNTERPART) < 0.8


def test_another_of_a_kind_has_its_shape_and_size():
    twin = evidence_of_same_kind(ENGINES, 1, 2, 0.0, False)
    body = evidence_of_same_kind(ENGINES, 1, 0, 0.0, False)
    assert probability(twin, SAME_KIND) > 0.8 > probability(body, SAME_KIND)


def test_the_evidence_of_an_answer_is_counted_by_area() -> None:
    label = np.repeat([0, 1, 2], [4, 3, 3])
    area = np.arange(1.0, 11.0)
    points = RNG.normal(size=(10, 3))
    one = Cloud(points, np.tile([0.0, 0, 1], (10, 1)), area, label)
    carried = np.array([1, 1, 0, 0, 1, 0, 1, 1, 2, 2])
    evidence = evidence_of_counterpart(one, [1], one, [1, 2], 0.7, True, carried)
    both = area[[4, 6, 7]].sum()
    assert evidence[5] == pytest.approx(1 - both / area[4:].sum())
    assert evidence[1] == pytest.approx(1 - both / area[carried == 1].sum())
    assert evidence[2:4].tolist() == [1.0, 0.7]
    assert evidence[4] == pytest.approx(np.log(area[4:].sum() / area[4:7].sum()))
    assert evidence_of_counterpart(one, [1], one, [2], np.nan, False, carried)[2:4].tolist() == [0.0, 3.0]
    nothing = evidence_of_counterpart(one, [1], one, [7], 0.7, False, carried)
    assert nothing[0] == CAPS[0] and nothing[1] == nothing[5] == 1
    other = evidence_of_same_kind(one, 1, 2, np.inf, True)
    assert other[1:4].tolist() == [0.0, 1.0, 3.0] and other[5] == 0
    assert other[4] == pytest.approx(np.log(area[7:].sum() / area[4:7].sum()))
    plain = Cloud(points, one.normals, None, label)
    assert (
        evidence_of_same_kind(plain, 1, 2, 0.0, False)[4] == 0
        and evidence_of_same_kind(plain, 0, 1, 0.0, False)[4] > 0.2
    )


def test_the_probability_is_logistic_up_to_the_caps() -> None:
    evidence = np.array([0.3, 0.5, 1.0, 0.4, 0.1, 0.2])
    against = sum(weight * each for weight, each in zip(COUNTERPART[1:], evidence, strict=False))
    assert probability(evidence, COUNTERPART) == pytest.approx(1 / (1 + np.exp(against - COUNTERPART[0])))
    beyond = np.array([9.0, 0.5, 1.0, 9.0, 9.0, 0.2])
    within = np.minimum(beyond, [*CAPS, 1.0])
    assert probability(beyond, COUNTERPART) == probability(within, COUNTERPART)


@pytest.mark.parametrize("item", [1, 5])
def test_what_the_displacement_lays_elsewhere_is_disputed(item: int) -> None:
    evidence = np.zeros(6)
    evidence[item] = 0.6
    assert probability(evidence, COUNTERPART) > 0.9
    evidence[item] = 0.61
    assert probability(evidence, COUNTERPART) == 0.4
    evidence[0] = 2.0
    assert probability(evidence, COUNTERPART) < 0.4 or COUNTERPART[1] * 2 < COUNTERPART[0]
