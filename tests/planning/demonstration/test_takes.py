"""Flights repeated and joined, and the parts that a demonstration is about: each by its definition."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_clouds import boxes

from upplied.config import settings_for
from upplied.errors import SettingsError
from upplied.geometry.poses import from_yaw_pitch, yaw_pitch
from upplied.planning.correspondence.fit import Fit
from upplied.planning.correspondence.pair import Pair
from upplied.planning.demonstration import repetition
from upplied.planning.demonstration.repetition import (
    Attended,
    Take,
    _on_this_side,
    _shows_each,
    begins_of,
    breaks_of,
    choices_in,
    demonstrated_part,
    inspected_parts,
    inspected_states,
    joined,
    mirrored,
    takes_of,
)
from upplied.planning.surface.parts import parts_of
from upplied.records import (
    Cloud,
    Correspondences,
    Demonstration,
    Floats,
    Frame,
    Registration,
    Structure,
    Trajectory,
    Visibility,
)


def flight(number: int, start_s: float = 0.0) -> Trajectory:
    at = np.column_stack([np.arange(number), np.zeros((number, 2))]).astype(float)
    return Trajectory(start_s + 2.0 * np.arange(number), at, np.tile([0.0, 0, 0, 1], (number, 1)))


def take(
    own: Trajectory | None = None,
    breaks: list[int] | None = None,
    source: Cloud | None = None,
    target: Cloud | None = None,
    weight: Floats | None = None,
    index: Floats | None = None,
    seen: Floats | None = None,
    **match: Any,
) -> Take:
    source = boxes(([0, 0, 0], [1, 1, 1]), number=9) if source is None else source
    known = np.arange(len(source)) if index is None else index
    inspection = SimpleNamespace(
        flight=flight(2) if own is None else own,
        breaks=np.array(breaks or [], np.int64),
        attention=SimpleNamespace(weight=weight),
        visibility=None if seen is None else Visibility(seen),
    )
    fit = Fit(
        source=source,
        target=source if target is None else target,
        registration=Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True),
        correspondences=Correspondences(known, np.zeros(len(known)), source.points, "", **match),
    )
    pair = SimpleNamespace(surface=fit, source=SimpleNamespace(frame=Frame()))
    return cast(Take, SimpleNamespace(inspection=inspection, pair=pair))


def attended(source: Cloud, weight: Floats, **more: Any) -> Attended:
    """A flight as even samples tell."""
    pair = take(source=source, **more).pair
    return cast(Attended, SimpleNamespace(pair=pair, weight=weight))


def test_flights_follow_one_another_after_ten_seconds() -> None:
    one, two = flight(3, 5.0), flight(2, 100.0)
    both = joined([one, two])
    assert both.t_s.tolist() == [0, 2, 4, 14, 16]
    assert both.positions[:, 0].tolist() == [0, 1, 2, 0, 1]
    assert begins_of([one, two]).tolist() == [0, 14]
    assert begins_of([one]).tolist() == [0]


def test_a_joined_flight_breaks_where_takes_meet_and_where_their_logs_have_gaps() -> None:
    takes = [take(flight(5), [2, 4]), take(flight(3)), take(flight(4), [1])]
    assert breaks_of(takes).tolist() == [2, 4, 5, 8, 9]
    assert breaks_of(takes[1:2]).tolist() == []


def test_what_was_inspected_is_shown_in_three_steps_and_what_of_it_has_no_counterpart() -> None:
    weight = np.array([0.05, 0.1, 0.39, 0.4, 0.69, 0.7, 1.0, 0.1, 0.09])
    index = np.array([0, 1, 2, 3, 4, 5, 0, -1, -1])
    states = inspected_states(take(weight=weight, index=index))
    assert states.state.tolist() == [0, 5, 5, 6, 6, 7, 7, 4, 0]


TWO = boxes(([0, 0, 0], [10, 10, 10]), ([30, 0, 0], [2, 2, 2]), number=60)


def test_the_demonstrated_part_has_most_of_what_was_inspected() -> None:
    """Little of a large part near by, against most of a small one far off."""
    weight = np.zeros(120)
    weight[60:] = 1.0
    assert TWO.area_m2 is not None
    for share in (0, 1, 2, 60):
        weight[:share] = 1.0
        areas = TWO.area_m2[:share].sum(), TWO.area_m2[60:].sum()
        assert demonstrated_part(attended(TWO, weight)) == int(np.argmax(areas))
    assert demonstrated_part(attended(TWO, np.zeros(120))) == 0


def test_parts_with_a_tenth_of_what_was_inspected_are_asked_about_the_most_inspected_first() -> None:
    label = np.repeat([0, 1, 2, 3], [2, 3, 3, 1])
    weight = np.array([1.0, 0, 1, 1, 1, 0.2, 0.2, 0, 0])
    source = Cloud(np.zeros((9, 3)), None, np.array([2.0, 1, 1, 1, 3, 1, 1, 1, 1]), label)
    whole = 2 + 5 + 0.4
    inspected = inspected_parts(attended(source, weight), label)
    assert [part for part, _ in inspected] == [1, 0]
    assert [share for _, share in inspected] == pytest.approx([5 / whole, 2 / whole])
    plain = Cloud(source.points, None, None, label)
    inspected = inspected_parts(attended(plain, weight), label)
    assert inspected == [(1, pytest.approx(3 / 4.4)), (0, pytest.approx(1 / 4.4))]
    assert inspected_parts(attended(source, np.zeros(9)), label) == []
    many = np.arange(30)
    even = Cloud(np.zeros((30, 3)), None, None, many)
    assert len(inspected_parts(attended(even, np.ones(30)), many)) == 30  # each below a tenth


def demonstration(positions: Floats, quats: Floats, sha256: str = "abc") -> Demonstration:
    record = SimpleNamespace(positions=positions, quat_xyzw=quats, sha256=sha256)
    return cast(Demonstration, record)


@pytest.mark.parametrize(("quarter", "across"), [(0.0, 1), (90.0, 0)])
def test_a_mirrored_flight_is_on_the_other_side_of_the_middle_plane(
    quarter: float, across: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    turn = np.radians(quarter)
    axes = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    monkeypatch.setattr(repetition, "named_axes", lambda frame: axes)
    monkeypatch.setattr(repetition, "replace", lambda of, **new: SimpleNamespace(**{**vars(of), **new}))
    vertices = np.array([[2.0, 10, 0], [8, 20, 5]])
    source = cast(Structure, SimpleNamespace(frame=None, vertices=vertices))
    rng = np.random.default_rng(0)
    yaw, pitch = rng.uniform(-3, 3, 20), rng.uniform(-1.4, 1.4, 20)
    flown = demonstration(rng.normal(0, 9, (20, 3)), from_yaw_pitch(yaw, pitch))
    mirror = mirrored(flown, source)
    expected = flown.positions.copy()
    expected[:, across] = vertices[:, across].sum() - expected[:, across]
    np.testing.assert_allclose(mirror.positions, expected)
    new_yaw, new_pitch = yaw_pitch(mirror.quat_xyzw)
    np.testing.assert_allclose(new_pitch, pitch, atol=1e-9)
    flip = np.array([-1.0, 1]) if across == 0 else np.array([1.0, -1])
    before = np.column_stack([np.cos(yaw), np.sin(yaw)]) * flip
    np.testing.assert_allclose(np.column_stack([np.cos(new_yaw), np.sin(new_yaw)]), before, atol=1e-9)
    assert mirror.sha256 == "abc-mirrored"
    assert mirrored(demonstration(flown.positions, flown.quat_xyzw, ""), source).sha256 == ""


HULL, POD = ([0, -4, 0], [60, 8, 6]), [6, 2, 2]
LEFT, RIGHT, TOP = ([20, 9, 0], POD), ([20, -11, 0], POD), ([20, -1, 12], POD)


def pods(*places: Any) -> Cloud:
    return boxes(HULL, *places, number=60)


def about(weights: dict[int, float], answers: list[int]) -> Attended:
    """A flight at some pods of a hull with two, to one with three; the parts that correspond are given."""
    source, target = pods(LEFT, RIGHT), pods(LEFT, RIGHT, TOP)
    weight = np.array([weights.get(int(part), 0.0) for part in source.part])  # type: ignore[union-attr]
    answering = np.array([answers.index(part) if part in answers else -1 for part in range(4)])
    return attended(source, weight, target=target, target_class=answering, source_class=np.arange(3))


def test_a_flight_shows_each_where_every_part_of_the_kind_was_inspected() -> None:
    assert not _shows_each(about({1: 1.0}, [0, 1, 2]))  # one of two
    assert not _shows_each(about({1: 1.0, 2: 1.0}, [0, 1, 2]))  # a third has no counterpart
    two = about({1: 1.0, 2: 1.0}, [0, 1, 2])
    source = two.pair.surface.source
    fewer = attended(source, two.weight, source_class=np.arange(3), target_class=np.arange(3))
    assert _shows_each(fewer)


def test_a_part_is_repeated_on_its_side_and_in_the_middle() -> None:
    take = about({1: 1.0}, [0, 1, 2])
    assert sorted(_on_this_side(1, cast(Pair, take.pair))) == [1, 3]
    assert sorted(_on_this_side(2, cast(Pair, take.pair))) == [2, 3]


def test_what_corresponds_to_another_kind_is_no_choice() -> None:
    """A third pod of the target is the hull's tail, which has the size of a pod."""
    source, target = pods(LEFT, RIGHT), pods(LEFT, RIGHT, TOP)
    here, there = parts_of(source), parts_of(target).on(parts_of(source))

    def choices(part: int, *classes: int) -> list[int]:
        known = {"source_class": np.array(classes[:3]), "target_class": np.array(classes[3:])}
        pair = take(source=source, target=target, **known).pair
        return sorted(choices_in(pair, here, part, there, [1]).tolist())

    assert choices(1, 0, 1, 2, 0, 1, 2, -1) == [1, 2, 3]
    assert choices(1, 0, 1, 2, 0, 1, 2, 0) == [1, 2]  # with the hull
    assert choices(1, 0, 1, 2, 0, 1, 2, 2) == [1, 2, 3]  # with the other pod
    assert choices(1, -1, 1, 2, 0, 1, 2, -1) == [1, 2, 3]  # the hull corresponds to nothing
    assert sorted(choices_in(take(source=source, target=target).pair, here, 1, there, [1]).tolist()) == [
        1,
        2,
        3,
    ]


def flown_again(
    repeat: str, monkeypatch: pytest.MonkeyPatch, **known: Any
) -> list[tuple[str, Any, Any, int, int]]:
    """Which flights are flown, with which pair and counterparts, part and choice."""
    choices = known.get("choices", {4: [7, 8], 5: [9]})
    changed = {
        "skin_of": lambda *of: None,
        "attended_by": lambda flown, *of: (None, SimpleNamespace(weight=None, part=None)),
        "_with_fine_samples": lambda flights, *of: flights,
        "mirrored": lambda flown, source: f"{flown} mirrored",
        "demonstrated_part": lambda one: 5 if "mirrored" in one.flight else 4,
        "_shows_each": lambda one: known.get("shows_each", False),
        "_on_this_side": lambda part, pair: choices[part],
        "_matched_anew": lambda pair, settings, memo: ("anew", settings.correspondence.counterparts),
    }
    for name, changes in changed.items():
        monkeypatch.setattr(repetition, name, changes)
    method = known.get("method", "parts")
    settings = settings_for("recommended", correspondence={"repeat": repeat})
    settings = replace(settings, correspondence=replace(settings.correspondence, method=method))
    pair = cast(Pair, SimpleNamespace(source=None, source_scene=None, surface=SimpleNamespace(source=None)))
    takes = takes_of(cast(Demonstration, "flight"), pair, settings)
    return [
        (one.flight, *(one.pair if isinstance(one.pair, tuple) else (one.pair, ())), one.part, one.choice)  # type: ignore[attr-defined]
        for one in takes
    ]


def test_each_part_is_flown_from_its_side(monkeypatch: pytest.MonkeyPatch) -> None:
    takes = flown_again("each", monkeypatch)
    assert takes == [
        ("flight", "anew", (("part_4", "part_7"),), 4, 7),
        ("flight", "anew", (("part_4", "part_8"),), 4, 8),
        ("flight mirrored", "anew", (("part_5", "part_9"),), 5, 9),
    ]


def test_without_repetition_or_where_nothing_is_like_it_the_flight_is_flown_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for repeat, known in (("", {}), ("each", {"shows_each": True}), ("each", {"choices": {4: [], 5: []}})):
        ((flown, pair, pinned, part, choice),) = flown_again(repeat, monkeypatch, **known)
        assert (flown, part, choice, pinned) == ("flight", -1, -1, ()) and pair != "anew"
    mirror = flown_again("mirror", monkeypatch, shows_each=True)
    assert [one[0] for one in mirror] == ["flight", "flight mirrored"]
    with pytest.raises(SettingsError, match="preset 'recommended' only"):
        flown_again("each", monkeypatch, method="nearest")
    assert len(flown_again("", monkeypatch, method="nearest")) == 1
