"""What is refused, and what is said, of counterparts that are known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from upplied.config import Settings, ViewpointSettings, settings_for
from upplied.planning.carry.forecast import doubts, least_probability, undecided
from upplied.planning.correspondence.pair import Pair
from upplied.planning.demonstration.inspection import Inspection, find_viewpoints, nothing_shown, prepared
from upplied.records import Counterpart, Demonstration, Trajectory, Visibility

SURE = Counterpart("part_1 (left)", 60.0, twins=1, found=4, flown=("part_2 (left)",), probability=0.99)
DOUBTED = replace(SURE, probability=0.4, doubt="it is doubted")


def settings_of(**correspondence: object) -> Settings:
    return settings_for("recommended", correspondence=correspondence)


def test_what_is_sure_is_not_refused() -> None:
    assert undecided([SURE], settings_of()) == "" and doubts([SURE]) == ()
    assert undecided([], settings_of()) == "" and undecided([], settings_of(expect=3)) == ""


@pytest.mark.parametrize(
    ("change", "refused"),
    [
        ({}, True),
        ({"inspected_pct": 25.0}, True),
        ({"inspected_pct": 24.9}, False),
        ({"twins": 0}, True),  # four like it on the target
        ({"twins": 0, "found": 1}, False),
        ({"twins": 0, "found": 1, "flown": ()}, True),
        ({"twins": 0, "found": 0, "flown": ()}, False),
        ({"twins": 1, "found": 0}, True),
    ],
)
def test_a_doubt_about_much_refuses_where_there_are_others(change: dict[str, object], refused: bool) -> None:
    one = replace(DOUBTED, **change)  # type: ignore[arg-type]
    reason = undecided([SURE, one], settings_of())
    assert bool(reason) == refused
    like = "1 more like it on the source" if one.twins else "none like it on the source"
    sentence = f"it is doubted ({like}, {one.found} on the target, as far as its parts are known)"
    assert doubts([SURE, one]) == (sentence,) and reason in ("", sentence)


def test_doubts_about_several_parts_add_up() -> None:
    """Of four legs of a platform two look alike each: one alone is too small to refuse, both are not."""
    legs = [replace(DOUBTED, part=f"part_{n}", inspected_pct=pct) for n, pct in ((1, 14.0), (2, 15.0))]
    lone = replace(DOUBTED, part="part_3", inspected_pct=24.0, twins=0, found=1)
    assert undecided([lone, legs[0]], settings_of()) == ""  # a part that none is like may be unsure
    reason = undecided([SURE, lone, *legs], settings_of())
    assert reason == f"{doubts(legs[1:])[0]}; doubts about 2 parts concern 29 % of what was inspected"


def test_a_repetition_of_what_is_doubted_is_refused() -> None:
    alone = replace(DOUBTED, twins=0, found=1)
    assert undecided([alone], settings_of(repeat="each")) == "--repeat each was requested and it is doubted"


def test_another_number_than_expected_is_told_of_the_most_inspected() -> None:
    other = replace(SURE, part="part_7", found=2)
    assert undecided([SURE, other], settings_of(expect=4)) == ""
    assert undecided([other, SURE], settings_of(expect=4)) == (
        "2 parts like part_7 are on the target, 4 are expected (correspondence.expect)"
    )
    little = replace(DOUBTED, inspected_pct=20.0)
    assert undecided([little], settings_of(expect=3)) == (
        "4 parts like part_1 (left) are on the target, 3 are expected (correspondence.expect); it is doubted"
    )


def test_the_least_certain_speaks() -> None:
    assert least_probability([SURE, DOUBTED, replace(SURE, probability=None)]) == 0.4
    assert np.isnan(least_probability([replace(SURE, probability=None)])) and np.isnan(least_probability([]))


def shown(seen: list[int], known: list[int]) -> str:
    view = np.zeros((2, 4), bool)
    view[1, seen] = True
    index = np.full(4, -1)
    index[known] = 0
    fit = SimpleNamespace(correspondences=SimpleNamespace(target_index=index))
    here, there = SimpleNamespace(structure_id="here"), SimpleNamespace(structure_id="there")
    pair = SimpleNamespace(fit_for=lambda settings: fit, source=here, target=there)
    inspection = SimpleNamespace(visibility=Visibility(view))
    return nothing_shown(cast(Inspection, inspection), cast(Pair, pair), settings_of())


def test_a_flight_that_shows_nothing_known_is_refused_in_words() -> None:
    assert shown([1, 2], [2]) == ""
    assert shown([], [2]).startswith("the demonstration shows nothing of here: no pose has any")
    assert shown([1], [2, 3]) == "nothing of what the demonstration shows has a counterpart on there"


def flown(count: int, breaks: list[int]) -> Demonstration:
    quats = np.tile([0.0, 0, 0, 1], (count, 1))
    return Demonstration("d", "s", np.arange(count) * 10**9, np.arange(3.0 * count).reshape(-1, 3), quats,
                         breaks=np.array(breaks, np.int64))  # fmt: skip


def test_the_papers_flight_is_taken_as_it_is_up_to_its_number_of_poses() -> None:
    paper = settings_for("paper", viewpoints={"most_poses": 10})
    flight, breaks = prepared(flown(10, [4]), paper)
    assert np.array_equal(flight.positions, flown(10, []).positions) and breaks.tolist() == [4]
    thin, breaks = prepared(flown(28, [0, 1, 9, 10, 27]), paper)
    own = np.arange(0, 28, 3)
    assert thin.t_s == pytest.approx(own) and np.array_equal(thin.positions, flown(28, []).positions[own])
    assert breaks.tolist() == [1, 3, 4, 9]
    assert prepared(flown(28, []), paper)[1].tolist() == []


def test_viewpoints_are_the_means_of_their_segments() -> None:
    rng = np.random.default_rng(0)
    seen = np.zeros((6, 4), bool)
    seen[:2, :2] = seen[2:5, 1:4] = True
    quats = np.tile([0.0, 0, 0, 1], (6, 1))
    flight = Trajectory(np.array([0.0, 1, 2, 4, 8, 9]), rng.normal(size=(6, 3)), quats)
    viewpoints = find_viewpoints(flight, Visibility(seen), ViewpointSettings(method="segments", shared=0.6))
    assert viewpoints.start.tolist() == [0, 2, 5] and viewpoints.stop.tolist() == [2, 5, 6]
    for row, (a, b) in enumerate(((0, 2), (2, 5), (5, 6))):
        assert viewpoints.positions[row] == pytest.approx(flight.positions[a:b].mean(axis=0))
        assert viewpoints.seen[row].tolist() == seen[a:b].any(axis=0).tolist()
        assert viewpoints.t_s[row] == pytest.approx(flight.t_s[a:b].mean())
    assert viewpoints.middle.tolist() == [0, 3, 5]
    each = find_viewpoints(flight, Visibility(seen), ViewpointSettings(method="poses"))
    assert each.positions == pytest.approx(flight.positions) and each.start.tolist() == list(range(6))
