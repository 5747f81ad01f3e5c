"""What is said of each inspected part, and why: on boxes whose counterparts are given."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_clouds import boxes

from upplied.config import settings_for
from upplied.planning.carry import counterparts
from upplied.planning.carry.counterparts import (
    _both,
    _counterpart,
    _doubt,
    _is_one_there,
    _matched_parts,
    _no_part_twice,
    _not_repeated,
    _others_within,
    _probability,
    _Side,
    _without_flown,
    counterparts_of,
)
from upplied.planning.carry.forecast import doubts, missing_of, undecided
from upplied.planning.correspondence import certainty as probabilities
from upplied.planning.correspondence.fit import Fit
from upplied.planning.correspondence.never_scanned import NOTHING_MISSING, NeverScanned
from upplied.planning.demonstration.repetition import Attended, Take
from upplied.planning.surface.parts import parts_of
from upplied.records import Cloud, Correspondences, Counterpart, Floats, Frame, Ints, Registration

HULL, POD = ([0, -4, 0], [60, 8, 6]), [6, 2, 2]
LEFT, RIGHT = ([20, 9, 0], POD), ([20, -11, 0], POD)
SOURCE = boxes(HULL, LEFT, RIGHT, number=60)
SETTINGS = settings_for("recommended")


def side(cloud: Cloud, label: Ints | None = None, pieces: bool = True) -> _Side:
    mine = cloud.part if label is None else label
    assert mine is not None
    return _Side(parts_of(replace(cloud, part=mine)), mine, pieces)


def take(
    target: Cloud = SOURCE,
    matched: Ints | None = None,
    weight: Floats | None = None,
    skin: Ints | None = None,
    source: Cloud = SOURCE,
    part: int = -1,
    choice: int = -1,
    carried: bool = True,
    inferred: int = -1,
    missing: NeverScanned = NOTHING_MISSING,
) -> Attended:
    """A take whose source parts 0, 1 ... were matched with these of the target, -1 with none."""
    number = len(parts_of(target))
    matched = np.arange(len(parts_of(source))) if matched is None else matched
    classes = np.full(number, -1)
    classes[matched[matched >= 0]] = np.flatnonzero(matched >= 0)
    index = np.zeros(len(source), np.int64)
    match = Correspondences(index, np.zeros(len(source)), source.points, "", np.arange(len(matched)), classes)
    fit = Fit(
        source=source, target=target, correspondences=match, inferred=inferred,
        registration=Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True, acceptance=0.5, scanned=0.4),
        carried=np.zeros(len(target), np.int64) if carried else None,
    )  # fmt: skip
    pair = SimpleNamespace(
        surface=fit,
        source=SimpleNamespace(frame=Frame(), structure_id="here"),
        target=SimpleNamespace(structure_id="there"),
        missing=missing,
    )
    record = SimpleNamespace(
        pair=pair,
        weight=np.ones(len(source)) if weight is None else weight,
        stretch=source.part if skin is None else skin,
        part=part,
        choice=choice,
    )
    return cast(Attended, record)


def flown(*attended: Attended) -> list[Take]:
    return [cast(Take, SimpleNamespace(attended=one)) for one in attended]


ONE = Counterpart("part_1 (left)", 60.0, twins=1, found=2, flown=("a",), left_out=("b", "c"), probability=0.9)


def test_two_takes_of_one_part_are_told_together() -> None:
    other = replace(ONE, flown=("b", "a"), left_out=("c", "d"), probability=0.7, doubt="doubted")
    both = _both(ONE, other)
    assert both.flown == ("a", "b") and both.left_out == ("b", "c", "d")
    assert both.probability == 0.7 and both.doubt == "doubted" and both.inspected_pct == 60.0
    assert _both(replace(ONE, doubt="first"), other).doubt == "first"
    for unknown in (replace(other, probability=None), replace(other, probability=None, doubt="")):
        assert _both(ONE, unknown).probability is None and _both(unknown, ONE).probability is None


def test_what_another_take_flies_is_not_left_out() -> None:
    other = replace(ONE, flown=("b",), left_out=("a", "d"))
    actual = _without_flown([ONE, other], SETTINGS)
    assert [one.left_out for one in actual] == [
        ("c: not requested (--repeat each)",), ("d: not requested (--repeat each)",)
    ]  # fmt: skip
    each = settings_for("recommended", correspondence={"repeat": "mirror"})
    (sentence,) = _without_flown([ONE], each)[0].left_out[1:]
    assert sentence == "c: --repeat mirror flies what lies as the demonstrated part"


@pytest.mark.parametrize(
    ("known", "least", "refused"),
    [(0.79, 0.8, False), (0.21, 0.8, False), (0.19, 0.8, True), (0.45, 0.5, True), (0.01, 0.0, False)],
)
def test_a_part_that_none_is_like_is_refused_only_where_it_is_the_wrong_one(
    known: float, least: float, refused: bool
) -> None:
    settings = settings_for("recommended", correspondence={"least_probability": least})
    lone = replace(ONE, twins=0, found=1, probability=known, doubt="doubted")
    assert bool(undecided([lone], settings)) == refused
    assert undecided([replace(lone, twins=1)], settings)  # another part is like it
    assert not undecided([replace(lone, inspected_pct=19.0)], settings)


def test_why_it_is_not_certain() -> None:
    least = settings_for("recommended", correspondence={"least_probability": 0.6})
    assert _doubt(take(), "wing", 0.5, side(SOURCE), 0.6, least) == ""
    assert _doubt(take(), "wing", 0.523, side(SOURCE), 0.594, least) == (
        "wing, 52 % of what was inspected, has its counterpart on there with probability 0.59, less than "
        "0.6 (correspondence.least_probability)"
    )
    for pieces, why in ((True, "no part of it was matched"), (False, "its surface is one piece")):
        assert _doubt(take(), "wing", 0.5, side(SOURCE, pieces=pieces), None, least) == (
            f"wing, 50 % of what was inspected, cannot be distinguished on there: {why}, "
            "and what lies nearest may be another part"
        )


def test_the_matched_parts_and_of_one_piece_only_those_of_the_whole() -> None:
    known = take(matched=np.array([0, 2, -1]))
    assert [_matched_parts(known, part, side(SOURCE)) for part in range(3)] == [[0], [2], []]
    stretches = side(SOURCE, pieces=False)
    assert stretches.parts.area[0] > 0.5
    assert [_matched_parts(known, part, stretches) for part in range(3)] == [[0], [], []]


def test_a_counterpart_is_told_with_its_like() -> None:
    target = boxes(HULL, LEFT, RIGHT, ([40, 9, 0], POD), number=60)
    known = take(target, np.array([0, 3, 2]), carried=False)
    one = _counterpart(known, 1, 0.4321, side(SOURCE), side(target), SETTINGS)
    assert one.part.startswith("part_1 (") and one.inspected_pct == 43.21 and one.twins == 1
    assert one.found == 3 and [name[:6] for name in one.flown] == ["part_3"]
    assert sorted(name[:6] for name in one.left_out) == ["part_1", "part_2"]
    assert one.probability is None and one.doubt == ""


def test_what_was_never_scanned_of_a_part_is_said_in_percent_and_where_the_scan_ends_by_name() -> None:
    number = np.bincount(SOURCE.part)  # type: ignore[arg-type]
    left = np.flatnonzero(SOURCE.part == 1)
    gone = replace(
        NOTHING_MISSING, beyond=left[: len(left) // 2], opening=np.flatnonzero(SOURCE.part == 2)[:6]
    )
    known = take(carried=False, missing=gone)
    sides = side(SOURCE), side(SOURCE)
    match = known.pair.surface.correspondences
    match.target_index[gone.beyond] = -1
    actual = [_counterpart(known, part, 0.5, *sides, SETTINGS) for part in range(3)]
    share = SOURCE.areas[gone.beyond].sum() / SOURCE.areas[left].sum()
    assert actual[1].never_scanned_pct == pytest.approx(100 * share, abs=0.01) and actual[1].open == ()
    assert actual[2].never_scanned_pct == 0 and actual[2].open == actual[2].flown and number[2] > 6
    assert actual[0].never_scanned_pct == 0 and actual[0].open == ()
    assert not doubts(actual)
    sentences = missing_of(actual)
    assert len(sentences) == 2 and actual[1].part in sentences[0] and "was never scanned" in sentences[0]
    assert actual[2].part in sentences[1] and "the scan ends on part_2" in sentences[1]
    # What has a counterpart all the same, since it is flown elsewhere, is not missing.
    match.target_index[gone.beyond] = 0
    assert _counterpart(known, 1, 0.5, *sides, SETTINGS).never_scanned_pct == 0
    both = _both(actual[1], replace(actual[1], never_scanned_pct=90.0, open=("part_9 (low)",)))
    assert both.never_scanned_pct == 90 and both.open == ("part_9 (low)",)


def test_a_kind_of_which_fewer_lie_on_the_own_side_is_doubted_where_one_of_several_is_asked_for() -> None:
    third = boxes(HULL, LEFT, RIGHT, ([40, 9, 0], POD), number=60)
    each = settings_for("recommended", correspondence={"repeat": "each"})
    named = settings_for("recommended", correspondence={"counterparts": (("part_2", "outer"),)})
    known = take(third, np.array([0, 1, 2]), carried=False)
    for settings in (each, named):
        doubt = _counterpart(known, 2, 0.4, side(SOURCE), side(third), settings).doubt
        assert doubt.startswith("of parts like the inspected one 1 lie on its side of there and 2 on")
        # The left one has more: which of them is asked for is known.
        assert _counterpart(known, 1, 0.4, side(SOURCE), side(third), settings).doubt == ""
    assert _counterpart(known, 2, 0.4, side(SOURCE), side(third), SETTINGS).doubt == ""
    even = take(carried=False)
    assert _counterpart(even, 2, 0.4, side(SOURCE), side(SOURCE), each).doubt == ""
    # The right one is half gone and of no such size any more, but it was matched with the right one.
    cut = boxes(HULL, LEFT, ([20, -11, 0], [3, 2, 1]), number=60)
    for part in (1, 2):
        assert _counterpart(take(cut, carried=False), part, 0.4, side(SOURCE), side(cut), each).doubt == ""


def test_a_chosen_part_is_flown_where_its_own_part_is_repeated() -> None:
    target = boxes(HULL, LEFT, RIGHT, ([40, 9, 0], POD), number=60)
    for repeated, flown in ((1, "part_2"), (2, "part_3")):
        own = take(target, np.array([0, 3, 2]), part=repeated, choice=2, carried=False)
        one = _counterpart(own, 1, 0.4, side(SOURCE), side(target), SETTINGS)
        assert [name[:6] for name in one.flown] == [flown]


def test_a_part_without_a_partner_or_on_one_piece_is_told() -> None:
    target = boxes(HULL, LEFT, RIGHT, ([40, 9, 0], POD), number=60)
    none = _counterpart(
        take(target, np.array([0, -1, 2]), carried=False), 1, 0.4, side(SOURCE), side(target), SETTINGS
    )
    assert none.flown == () and "no part of it was matched" in none.doubt
    piece = _counterpart(
        take(target, np.array([0, 3, 2])), 1, 0.4, side(SOURCE), side(target, pieces=False), SETTINGS
    )
    assert piece.found == 1 and piece.left_out == ()


def test_each_of_a_kind_is_in_doubt_where_neither_tells_parts() -> None:
    whole = replace(SOURCE, part=np.zeros(len(SOURCE), np.int64))
    lone = take(whole, source=whole, skin=SOURCE.part)
    each = settings_for("recommended", correspondence={"repeat": "each"})
    hull = _counterpart(lone, 0, 0.4, side(SOURCE, pieces=False), side(whole, pieces=False), each)
    assert "cannot be distinguished on here: its surface is one piece" in hull.doubt
    once = _counterpart(lone, 0, 0.4, side(SOURCE, pieces=False), side(whole, pieces=False), SETTINGS)
    assert once.doubt == ""


def test_what_was_inspected_of_one_piece_is_one_and_no_twin_of_itself() -> None:
    wings = boxes(HULL, ([20, 9, 0], [20, 2, 2]), ([20, -11, 0], [20, 2, 2]), number=60)
    gaps = replace(NOTHING_MISSING, opening=np.array([3]))
    for cloud, least, missing, twins in (
        (wings, 1, NOTHING_MISSING, 0),
        (wings, 2, NOTHING_MISSING, 1),  # the other wing was not inspected
        (wings, 1, gaps, 1),
        (SOURCE, 1, NOTHING_MISSING, 1),  # of pods there may be more
    ):
        whole, shown = replace(cloud, part=np.zeros(len(cloud), np.int64)), cloud.part >= least
        flight = take(whole, source=whole, skin=cloud.part, weight=shown.astype(float), missing=missing)
        actual = _counterpart(flight, 2, 0.5, side(cloud, pieces=False), side(whole, pieces=False), SETTINGS)
        assert actual.twins == twins and "its surface is one piece" in actual.doubt
        assert bool(undecided([actual], SETTINGS)) == bool(twins)


def test_a_stretch_of_one_piece_is_flown_where_most_of_it_lies_if_that_is_like_it() -> None:
    whole = replace(SOURCE, part=np.zeros(len(SOURCE), np.int64))
    pod = take(SOURCE, np.array([0]), source=whole, skin=SOURCE.part, weight=(SOURCE.part == 1).astype(float))
    index, mine = pod.pair.surface.correspondences.target_index, np.flatnonzero(SOURCE.part == 1)
    for share, flown_to in ((0.6, ["part_2"]), (0.4, [])):  # the rest lies on the hull
        few = round(share * len(mine))
        index[mine[:few]] = np.flatnonzero(SOURCE.part == 2)[0]
        index[mine[few:]] = np.flatnonzero(SOURCE.part == 0)[0]
        actual = _counterpart(pod, 1, 1.0, side(SOURCE, pieces=False), side(SOURCE), SETTINGS)
        assert [name[:6] for name in actual.flown] == flown_to and "no part of it was matched" in actual.doubt
    lone = replace(actual, twins=0, found=1)
    assert undecided([lone], SETTINGS) and not undecided([replace(lone, flown=("part_2",))], SETTINGS)


def certain(of: dict[int, float], others: float, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Probabilities by the target's part, and of another of its kind beside a chosen one; who is asked."""
    calls: list[Any] = []
    monkeypatch.setattr(
        probabilities,
        "evidence_of_counterpart",
        lambda *arguments: calls.append(arguments[3:6]) or ("answer", arguments[3]),
    )
    monkeypatch.setattr(counterparts, "evidence_of_same_kind", lambda *arguments: ("other", arguments[1:3]))
    monkeypatch.setattr(probabilities, "probability", lambda evidence, *_: of[evidence[1][0]])
    monkeypatch.setattr(counterparts, "probability", lambda evidence, _: others)
    return calls


def test_the_probability_of_a_chosen_part_is_that_of_any_of_its_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = certain({1: 0.3, 2: 0.8, 3: 0.9}, 0.5, monkeypatch)
    pinned = settings_for("recommended", correspondence={"counterparts": (("a", "b"),)})
    assert _probability(take(), 1, [1], [1, 2, 3], SETTINGS) == 0.3
    assert _probability(take(), 1, [1], [1, 2, 3], pinned) == 0.45
    assert _probability(take(choice=1), 1, [1], [1, 2], SETTINGS) == 0.4
    assert _probability(take(choice=0), 1, [1], [1, 2], SETTINGS) == 0.4
    assert _probability(take(choice=1), 1, [2], [1, 2], SETTINGS) == 0.8  # its own is more
    assert _probability(take(choice=1), 1, [1, 2], [1, 2, 3], SETTINGS) == 0.3
    assert _probability(take(carried=False), 1, [1], [1], SETTINGS) is None
    calls.clear()
    for inferred, known in ((-1, False), (0, True), (1, True)):
        _probability(take(inferred=inferred), 1, [1], [1], SETTINGS)
        assert calls.pop() == ([1], 0.4, known)


def within(inspected: list[int], weight: float = 1.0, places: list[Any] | None = None, part: int = 0) -> int:
    """How many like stretches a part of hull and pods has, where some of them were inspected."""
    cloud = boxes(HULL, *(places or [LEFT, RIGHT, ([40, 9, 0], POD)]), number=60)
    skin = cloud.part
    assert skin is not None
    whole = replace(cloud, part=np.zeros(len(cloud), np.int64))
    own = take(source=whole, target=whole, weight=weight * np.isin(skin, inspected), skin=skin)
    return _others_within(own, part, side(whole), side(whole), [])


def test_other_stretches_like_the_inspected_piece_of_a_part_are_counted() -> None:
    assert within([1]) == 2 and within([1, 2]) == 1 and within([1, 2, 3]) == 0
    assert within([1], weight=0.39) == 2  # nothing was inspected from two fifths on: the others stay open
    halves = [([20, 9, 0], [8, 1, 2]), ([20, 10.05, 0], [8, 1, 2])]
    assert within([1], places=halves) == 0  # the other half of one pod is no other pod
    assert within([0]) == 0  # most of the part
    assert (
        within([1], places=[([20, 9, 0], [17, 2, 2]), ([20, -11, 0], [17, 2, 2])]) == 0
    )  # as long as a hull
    assert within([1], places=[([20, 9, 0], [11, 2, 2]), ([20, -11, 0], [11, 2, 2])]) == 1
    pieces = take(weight=np.zeros(180), skin=SOURCE.part)
    assert _others_within(pieces, 0, side(SOURCE, pieces=False), side(SOURCE), []) == 0


def test_what_other_parts_have_of_a_kind_their_counterparts_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = boxes(HULL, LEFT, ([0, 46, 0], HULL[1]), ([20, 59, 0], POD), number=60)
    skin = cloud.part
    assert skin is not None
    whole = replace(cloud, part=skin // 2)  # two hulls, a pod on each
    own = take(source=whole, target=whole, weight=(skin == 1).astype(float), skin=skin)
    for there, others in ((True, 0), (False, 1)):
        monkeypatch.setattr(counterparts, "_is_one_there", lambda *_, there=there: there)
        assert _others_within(own, 0, side(whole), side(whole), [0]) == others
        assert within([1]) == 2  # of one part it tells nothing
        one = replace(cloud, part=np.where(skin == 2, 1, 0))  # both pods are the first hull's
        both = take(source=one, target=one, weight=(skin == 1).astype(float), skin=skin)
        assert _others_within(both, 0, side(one), side(one), [0]) == 1


def test_of_a_lattice_no_single_bar_was_meant() -> None:
    bars = [LEFT, ([20, 20, 0], [2, 6, 2]), ([30, 20, 0], [2, 2, 6]), ([40, 20, 0], [3, 3, 3]), RIGHT]
    assert within([1, 2, 3, 4], places=bars) == 0
    assert within([1], places=bars) > 0


@pytest.mark.parametrize(
    ("label", "to", "there"),
    [
        ([0, 1, 2], 1, True),
        ([0, 1, 1], 1, True),  # of which it is a piece
        ([0, 1, 2], 0, False),  # as long as the hull
        ([0, 1, 2], -1, False),  # no counterpart
    ],
)
def test_a_stretch_is_told_by_its_part_that_has_one_like_it(
    label: list[int], to: int, there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    skin = SOURCE.part
    assert skin is not None
    monkeypatch.setattr(counterparts, "scene_of", lambda _: None)
    monkeypatch.setattr(
        counterparts, "skin_parts", lambda *_: SimpleNamespace(label=np.array(label)[skin].copy())
    )
    own = take(matched=np.array([0, 1, 2]))
    index = np.full(len(SOURCE), -1)
    index[skin == 1] = np.flatnonzero(skin == to) if to >= 0 else -1
    match = replace(own.pair.surface.correspondences, target_index=index)
    own.pair.surface = replace(own.pair.surface, correspondences=match)  # type: ignore[misc]
    stretches = parts_of(SOURCE)
    assert _is_one_there(own, stretches, 1, side(SOURCE), [0, 1]) == there
    assert not _is_one_there(own, stretches, 1, side(SOURCE), [0])  # it lies on another part
    if label == [0, 1, 2]:
        assert not _is_one_there(own, stretches, 1, side(SOURCE), [0, 1, 2])  # that has two


def test_parts_on_a_side_for_which_nothing_is_flown_are_told() -> None:
    left = take(part=1, choice=1)
    (missing,) = _not_repeated([left])
    assert missing.part.startswith("part_2 (") and missing.found == 0 and missing.twins == 1
    assert missing.doubt == f"no part like {missing.part} is on its side of there"
    assert missing.inspected_pct == 100.0 and missing.flown == ()
    assert _not_repeated([left, take(part=2, choice=2)]) == [] and _not_repeated([take()]) == []


def test_a_side_for_which_nothing_is_flown_is_told_where_nothing_could_be_repeated() -> None:
    """The flight was flown as it is, since nothing of its kind was found; the other engine is not flown."""
    one = take(matched=np.array([0, 1, -1]), weight=(SOURCE.part == 1).astype(float))
    (missing,) = _not_repeated([one])
    assert missing.part.startswith("part_2 (") and missing.found == 0 and missing.doubt
    assert _not_repeated([take(matched=np.array([0, -1, -1]), weight=(SOURCE.part == 1).astype(float))]) == []


def test_the_most_inspected_part_comes_first() -> None:
    weight = np.repeat([0.0, 0.4, 1.0], 60)
    own = take(weight=weight, skin=SOURCE.part, carried=False)
    actual = counterparts_of(flown(own), SETTINGS)
    assert [one.part[:6] for one in actual] == ["part_2", "part_1"]
    assert [one.inspected_pct for one in actual] == pytest.approx([100 / 1.4, 40 / 1.4], abs=0.01)
    only = take(weight=weight, skin=SOURCE.part, carried=False, part=1, choice=1)
    assert [one.part[:6] for one in counterparts_of(flown(only), SETTINGS)] == ["part_1"]
    assert counterparts_of(flown(own), settings_for("paper")) == ()
    each = settings_for("recommended", correspondence={"repeat": "each"})
    actual = counterparts_of(flown(only), each)
    assert [one.part[:6] for one in actual] == ["part_2", "part_1"] and actual[0].doubt
    second = take(weight=weight, skin=SOURCE.part, part=1, choice=2, carried=False)
    twice = counterparts_of(flown(only, second), SETTINGS)
    assert len(twice) == 1 and len(twice[0].flown) == 2 and twice[0].left_out == ()


def test_one_part_of_the_target_is_not_flown_for_two_of_the_source() -> None:
    left = replace(ONE, part="part_1 (left)", flown=("part_7 (left)", "part_5 (low)"))
    right = replace(ONE, part="part_2 (right)", flown=("part_6 (right)", "part_5 (low)"))
    other = replace(ONE, part="part_3", flown=("part_8",))
    actual = _no_part_twice({one.part: one for one in (left, right, other)}, "there")
    sentence = "part_5 (low) of there is taken for several parts of the source"
    assert [one.doubt for one in actual.values()] == [sentence, sentence, ""]
    known = {"a": replace(left, doubt="known before"), "b": right}
    assert _no_part_twice(known, "there")["a"].doubt == "known before"
    apart = {"a": left, "b": replace(right, flown=("part_6 (right)",))}
    assert _no_part_twice(apart, "there") is apart
