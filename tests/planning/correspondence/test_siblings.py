"""A sibling tells the parts of scans: where it fits better, and never against the source in silence."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_structures import one_piece

from upplied import simulate
from upplied.config import settings_for
from upplied.geometry.scene import scene_of
from upplied.planning import plan as planning
from upplied.planning.correspondence import certainty as probabilities
from upplied.planning.correspondence import siblings as telling
from upplied.planning.correspondence.certainty import certainty, named_by
from upplied.planning.correspondence.fit import Fit, Labelling
from upplied.planning.correspondence.label_transfer import has_parts
from upplied.planning.correspondence.pair import Task, study_pair, surfaces_of
from upplied.planning.correspondence.siblings import nearest_in_proportions, study
from upplied.planning.plan import decided, transfer_key
from upplied.planning.surface.parts import labels_of
from upplied.records import Cloud, Correspondences, Counterpart, Plan
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

SETTINGS = settings_for("recommended")


class Memory(dict):
    """Remembers, as a catalog does."""

    def __call__(self, stage: str, record_type: type, key: str, compute: Any) -> Any:
        if (stage, key) not in self:
            self[stage, key] = compute()
        return self[stage, key]


MEMO = Memory()


def model(name: str, called: str = "") -> Any:
    structure = member(name).structure
    return replace(structure, structure_id=called or name)


def scan(name: str) -> Any:
    """A sample whose mesh is one piece."""
    shell = one_piece(member(name).structure)
    return replace(shell, structure_id=f"{name}-scan", sha256=f"{name}-scan", landmarks={})


A320, B747, B777, TURBINE = (model(name) for name in ("a320-v1", "b747-v1", "b777-v1", "turbine-1-v1"))
SCAN, ANOTHER = scan("b747-v1"), scan("a320-v1")


def studied(source: Any, target: Any, siblings: Any) -> Fit:
    return study(source, target, SETTINGS, MEMO, siblings).surface


def most_named(structure_id: str, points: Any) -> str:
    of = member(structure_id)
    names = np.array(of.part_names)[of.part_of_triangle[scene_of(of.structure, 1).closest(points)[1]]]
    each, count = np.unique(names, return_counts=True)
    return str(each[count.argmax()])


@pytest.mark.slow
def test_of_two_scans_only_a_sibling_tells_parts() -> None:
    assert not has_parts(studied(ANOTHER, SCAN, ()).target)
    fit = studied(ANOTHER, SCAN, [B777])
    assert fit.labelling is not None and fit.labelling.sibling_id == "b777-v1"
    engines = [
        part
        for part in range(labels_of(fit.source).max() + 1)
        if most_named("a320-v1", fit.source.points[labels_of(fit.source) == part]) == "engine_left"
    ]
    assert len(engines) == 1
    (there,) = fit.correspondences.target_parts(engines[0])
    assert most_named("b747-v1", fit.target.points[labels_of(fit.target) == there]) == "engine_left"
    assert certainty(fit, engines[0], [int(there)]) > SETTINGS.correspondence.least_probability


@pytest.mark.ci
def test_a_sibling_with_four_engines_tells_all_of_a_scan() -> None:
    fit = studied(A320, SCAN, [model("b747-v1", "another-747")])
    assert fit.labelling is not None and fit.labelling.by_source is not None
    names = [
        most_named("b747-v1", fit.target.points[labels_of(fit.target) == part])
        for part in range(labels_of(fit.target).max() + 1)
    ]
    assert sorted(name for name in names if "engine" in name) == [
        "engine_left",
        "engine_left_outer",
        "engine_right",
        "engine_right_outer",
    ]


def test_siblings_may_come_in_any_order() -> None:
    some = [B777, model("beluga-v1"), model("b747-v1", "another-747")]
    first = studied(A320, SCAN, some)
    assert first.labelling is not None
    for order in permutations(some):
        again = studied(A320, SCAN, order)
        assert again.labelling is not None and again.labelling.sibling_id == first.labelling.sibling_id
        assert np.array_equal(labels_of(again.target), labels_of(first.target))


@pytest.mark.parametrize(
    "sibling",
    [
        replace(TURBINE, kind="airliner"),  # fits badly
        replace(model("b747-v1", "another-747"), kind="glider"),
        replace(SCAN, structure_id="another-scan", sha256="another-scan"),  # of one piece itself
        SCAN,
        replace(A320, structure_id="another-320"),  # no better than the source, which it equals
    ],
    ids=["odd", "kind", "scan", "itself", "no better"],
)
def test_what_tells_no_more_is_not_asked(sibling: Any) -> None:
    plain = study_pair(A320, SCAN, SETTINGS, MEMO).surface
    fit = studied(A320, SCAN, [sibling])
    assert fit.labelling is None
    assert np.array_equal(labels_of(fit.target), labels_of(plain.target))


def test_a_target_that_tells_its_parts_needs_no_sibling() -> None:
    fit = studied(A320, B747, [model("b747-v1", "another-747")])
    assert fit.labelling is None and fit.inferred == -1


@given(st.permutations(range(5)), st.floats(0.1, 10), st.integers(0, 6))
def test_proportions_know_neither_size_nor_order(order: list[int], scale: float, most: int) -> None:
    sizes = np.array([(10.0 + 7 * k, 10.0, 5.0 + k % 2) for k in range(5)])
    names = [f"s{k}" for k in range(5)]
    expected = nearest_in_proportions((24.0, 10.0, 5.0), names, sizes, most)
    others = [names[k] for k in order]
    assert nearest_in_proportions((24.0, 10.0, 5.0), others, scale * sizes[order], most) == expected
    assert len(expected) == min(most, 5) and expected[:1] == ("s2",)[:most]


def believed(by_source: float, by_way: float, agrees: tuple[bool, bool], monkeypatch: Any) -> float:
    """How certain a counterpart is that the pair says with 0.7, where others say what is given."""
    cloud = Cloud(np.arange(12.0).reshape(4, 3), None, np.ones(4), np.array([0, 0, 1, 1]))
    some = {True: np.array([True, True, False, False]), False: np.array([False, False, True, True])}
    monkeypatch.setattr(probabilities, "_by_fit", lambda *_: 0.7)
    monkeypatch.setattr(probabilities, "_by_source", lambda *_: (some[agrees[0]], by_source))
    monkeypatch.setattr(probabilities, "_by_way_of_sibling", lambda *_: (some[agrees[1]], by_way))
    return certainty(SimpleNamespace(labelling=True, target=cloud, carried=1), 0, [0])  # type: ignore[arg-type]


def test_two_that_agree_are_more_certain_and_two_that_do_not_less(monkeypatch: pytest.MonkeyPatch) -> None:
    assert believed(0.0, 0.0, (False, False), monkeypatch) == 0.7  # nobody says anything
    assert believed(0.9, 0.0, (True, False), monkeypatch) == 0.9
    assert believed(0.6, 0.0, (True, False), monkeypatch) == 0.7
    assert believed(0.0, 0.9, (False, True), monkeypatch) == pytest.approx(0.63 / 0.66)
    assert believed(0.0, 0.3, (False, True), monkeypatch) == 0.7  # what knows little lowers nothing
    for sure in (0.05, 0.5, 0.95):
        for other in (0.0, 0.99):
            assert believed(other, sure, (True, False), monkeypatch) <= 0.4
            assert believed(sure, other, (False, True), monkeypatch) <= 0.4
    assert believed(0.95, 0.95, (False, False), monkeypatch) < 0.01


def told_fit(route: dict[int, list[int]], back: bool = False) -> Any:
    """A fit by way of a sibling whose part 5 corresponds to the source's part 0, and its parts as given."""

    def fit(match: dict[int, list[int]], number: int) -> Any:
        cloud = Cloud(np.zeros((number, 3)), None, np.ones(number), np.arange(number))
        correspondences = SimpleNamespace(target_parts=lambda part: np.array(match.get(part, []), np.int64))
        return SimpleNamespace(source=cloud, target=cloud, correspondences=correspondences)

    first = fit({5: [0]} if back else {0: [5]}, 6)
    return Labelling("s", "s", fit(route, 6), None if back else first, first if back else None, None)


@pytest.mark.parametrize("back", [False, True])
def test_the_way_by_a_sibling_is_as_certain_as_both_steps(
    back: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(probabilities, "_by_fit", lambda *_: 0.9)
    there, sure = probabilities._by_way_of_sibling(told_fit({5: [2, 3]}, back), 0)
    assert np.flatnonzero(there).tolist() == [2, 3] and sure == pytest.approx(0.81)
    there, sure = probabilities._by_way_of_sibling(told_fit({}, back), 0)  # the target has none, it says
    assert not there.any() and sure == pytest.approx(0.9)
    there, sure = probabilities._by_way_of_sibling(told_fit({5: [2]}, back), 1)  # it knows of no such part
    assert not there.any() and sure == 0


def test_what_a_sibling_names_lies_on_the_part_that_corresponds() -> None:
    match = Correspondences(
        np.empty(0, np.int64),
        np.empty(0),
        np.empty((0, 3)),
        source_class=np.array([0, -1, 1]),
        target_class=np.array([0, 1]),
    )
    cloud = Cloud(np.zeros((5, 3)), None, None, np.array([0, 0, 1, 1, 0]))
    fit = Fit(cloud, cloud, None, match, carried=np.array([0, 2, 2, 1, -1]))  # type: ignore[arg-type]
    assert named_by(fit).tolist() == [True, False, True, False, False]


def test_the_key_of_a_plan_holds_the_siblings() -> None:
    flight = fly(A320, "engine_left", seed=2)
    arguments = flight, A320, SCAN, SETTINGS
    some = [("one", "1"), ("two", "2")]
    assert transfer_key(*arguments) == transfer_key(*arguments, ())
    assert transfer_key(*arguments, some) == transfer_key(*arguments, some[::-1])
    assert len({transfer_key(*arguments, each) for each in ((), some[:1], some[1:], some)}) == 4


@pytest.mark.slow
def test_a_flight_round_a_scanned_engine_is_planned_on_another_scan() -> None:
    flight = replace(fly(A320, "engine_left", seed=2), structure_id=ANOTHER.structure_id)
    each = settings_for("recommended", correspondence={"repeat": "each"})
    without, _ = decided(flight, ANOTHER, SCAN, each, MEMO)
    assert without.status == "refused" and without.parts_told_by == ""
    plan, _ = decided(flight, ANOTHER, SCAN, each, MEMO, [B777, TURBINE])
    assert plan.parts_told_by == "b777-v1"
    assert plan.status == "ok" and len(plan.counterparts) == 2
    assert all(len(one.flown) == 2 and not one.doubt for one in plan.counterparts)


def outcome(status: str, doubt: str = "", told_by: str = "", **more: Any) -> Any:
    part = Counterpart("part_1", 100.0, 1, 1, ("part_2",), probability=0.5, doubt=doubt)
    fields = {"registration": "found", "counterparts": (part,), "reason": status} | more
    return Plan("d", "s", "t", "k", "recommended", status, parts_told_by=told_by, **fields), ()


def take(carried: Any) -> Any:
    return SimpleNamespace(pair=SimpleNamespace(surface=SimpleNamespace(carried=carried)))


PLAIN = {
    "ok": outcome("ok"),
    "refused": outcome("refused", "which one?"),
    "warned": outcome("ok", "which one?"),
    "another number": outcome("refused"),
    "ambiguous": outcome("refused", registration=None, counterparts=()),
    "unlike": outcome("refused", counterparts=()),
    "unlike with parts": (outcome("refused", counterparts=())[0], (take(1),)),
    "unlike without parts": (outcome("refused", counterparts=())[0], (take(None),)),
    "ok without parts": (outcome("ok")[0], (take(None),)),
}
PLANS = {
    "sure": outcome("ok", told_by="b777-v1"),
    "in doubt": outcome("ok", "which one?", "b777-v1"),
    "refused": outcome("refused", told_by="b777-v1"),
    "untold": outcome("ok"),
}


@pytest.mark.parametrize("by_sibling", PLANS)
@pytest.mark.parametrize("plain", PLAIN)
def test_a_sibling_is_asked_in_doubt_and_heard_where_it_leaves_none(
    plain: str, by_sibling: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def on_pair(*arguments: Any) -> Any:
        calls.append(arguments[6:])
        return PLANS[by_sibling] if arguments[6:] else PLAIN[plain]

    monkeypatch.setattr(planning, "_on_pair", on_pair)
    flight = fly(A320, "engine_left", seed=2)
    plan = planning.decided(flight, A320, SCAN, SETTINGS, MEMO, [B777])
    sure = plain in ("ok", "unlike", "unlike with parts", "ok without parts")
    assert calls == ([()] if sure else [(), ([B777],)])
    assert plan is (PLANS["sure"] if by_sibling == "sure" and not sure else PLAIN[plain])


def test_a_flown_path_is_measured_by_the_sibling_that_told_the_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    class Interruption(Exception):
        pass

    def study_with(*arguments: Any) -> None:
        raise Interruption(*arguments[4])

    monkeypatch.setattr(simulate, "study", study_with)
    flight = fly(A320, "engine_left", seed=2)
    for told_by, expected in (("b777-v1", (B777,)), ("", ())):
        plan = replace(outcome("ok")[0], parts_told_by=told_by)
        with pytest.raises(Interruption) as interruption:
            simulate.measure_flown(
                flight.trajectory, plan, flight, A320, SCAN, SETTINGS, siblings=[TURBINE, B777]
            )
        assert interruption.value.args == expected


def test_of_many_alike_those_that_come_first_by_name_are_the_nearest() -> None:
    names = [f"s{k:02}" for k in range(30)]
    sizes = np.tile([30.0, 30, 10], (30, 1))
    sizes[20] = [31, 30, 10]
    assert nearest_in_proportions((3.0, 3, 1), names[::-1], sizes, 2) == ("s00", "s01")
    assert nearest_in_proportions((31.0, 30, 10), names, sizes, 2) == ("s20", "s00")
    assert nearest_in_proportions((31.0, 30, 10), names, sizes, 0) == ()


@pytest.mark.parametrize(
    ("modelled", "overlaps", "expected"),
    [
        (True, {"s": 0.5, "one": 0.41, "two": 0.45}, None),  # not clearly better than the source
        (True, {"s": 0.5, "one": 0.39, "two": 0.3}, "two"),
        (True, {"s": 0.5, "one": 0.39, "two": -0.3}, "one"),  # the other is refused
        (False, {"one": 0.9, "two": 0.8}, "two"),  # two scans: nothing to be better than
        (False, {"one": 0.9, "two": -0.8}, "one"),
    ],
)
def test_the_sibling_that_lies_best_is_taken(
    modelled: bool, overlaps: dict[str, float], expected: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def task(one: str) -> Any:
        lies = SimpleNamespace(scanned=abs(overlaps[one]), accepted=overlaps[one] > 0)
        return SimpleNamespace(registration=lambda: lies)

    names, scans = ("one", "two"), 1 if modelled else 2
    least = 0.8 * overlaps["s"] if modelled else np.inf
    best = telling._best([[task(one)] * scans for one in names], least)
    assert (None if best is None else names[best]) == expected


@pytest.mark.parametrize(("lost", "area", "expected"), [(-1, 0.3, False), (-1, 0.005, True), (1, 0.3, True)])
def test_a_sibling_must_lose_no_part_that_the_source_finds(
    lost: int, area: float, expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = np.array([1000, 1000 * area / (1 - area)]).astype(int)
    cloud = Cloud(np.random.default_rng(0).random((count.sum(), 3)), None, None, np.repeat([0, 1], count))

    def fit(classes: list[int]) -> Any:
        match = Correspondences(
            np.empty(0, np.int64), np.empty(0), np.empty((0, 3)), source_class=np.array(classes)
        )
        return Fit(cloud, cloud, None, match)  # type: ignore[arg-type]

    monkeypatch.setattr(telling, "_best", lambda *_: 0)
    monkeypatch.setattr(telling, "surface_fit", lambda _: fit([0, 1]))
    monkeypatch.setattr(Task, "fit_labelled", lambda *_: fit([0, lost]))
    task = surfaces_of(A320, SCAN, SETTINGS, MEMO)
    labelled = telling._labelled_by_best([B777], task, SETTINGS, MEMO)
    assert (labelled is not None) == expected


def test_of_equal_siblings_the_first_by_name_is_asked_in_whatever_order_they_come() -> None:
    some = [model("b747-v1", "y"), model("b747-v1", "x")]
    for order in (some, some[::-1]):
        fit = studied(A320, SCAN, order)
        assert fit.labelling is not None and fit.labelling.sibling_id == "x"
