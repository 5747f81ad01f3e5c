"""What of a pair depends on what: turns, settings, keys, and whose parts are inferred from whose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_clouds import boxes

from upplied.config import settings_for
from upplied.planning.correspondence import fit as pair_fits
from upplied.planning.correspondence import pair, registration
from upplied.planning.correspondence.fit import Fit, named_by_displacement, surface_settings, voxel_settings
from upplied.planning.correspondence.memo import content_key, no_memo, remembering
from upplied.planning.correspondence.pair import Task, study_pair
from upplied.planning.correspondence.registration import Declared
from upplied.planning.geometry.clouds import in_source_frame
from upplied.planning.surface.parts import labels_of
from upplied.records import Cloud, Correspondences, Floats, Frame, Registration, Structure

RECOMMENDED, PAPER = settings_for("recommended"), settings_for("paper")
HULL, FIN, POD = ([0, -4, 0], [60, 8, 6]), ([50, -1, 6], [8, 2, 9]), ([20, 6, 0], [6, 2, 2])


def structure(name: str, heading_deg: float = 0.0, is_scan: bool = False) -> Structure:
    frame, marks = Frame(np.radians(heading_deg)), {f"mark of {name}": (1.0, 2, 3)}
    return cast(Structure, SimpleNamespace(sha256=name, frame=frame, landmarks=marks, is_scan=is_scan))


def fit_of(source: Cloud, target: Cloud, here: list[int] | None, there: list[int] | None) -> Fit:
    classes = [None if of is None else np.array(of) for of in (here, there)]
    match = Correspondences(np.empty(0, np.int64), np.empty(0), np.empty((0, 3)), "", *classes)
    return Fit(source, target, Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True), match)


@pytest.mark.parametrize(
    ("source", "target", "turn"),
    [(0.0, 0.0, 0.0), (30.0, 30.0, 0.0), (30.0, 75.0, 45.0), (75.0, 30.0, -45.0), (-180.0, 180.0, 0.0)],
)
def test_the_declared_turn_is_from_the_targets_axes_to_the_sources(
    source: float, target: float, turn: float
) -> None:
    actual = registration.declared_for(structure("a", source), structure("b", target)).turn
    angle = np.radians(turn)
    expected = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    np.testing.assert_allclose(actual, expected, atol=1e-8)
    if turn == 0:
        assert np.array_equal(actual, np.eye(3))


def test_rounding_of_headings_is_no_turn() -> None:
    a, b = structure("a", 30.0), structure("b", 30.0 + 1e-9)
    assert np.array_equal(registration.declared_for(a, b).turn, np.eye(3))
    assert np.array_equal(registration.declared_for(b, a).turn, np.eye(3))


def test_each_ruler_has_the_settings_of_its_preset_and_the_clouds_that_were_asked_for() -> None:
    clouds = replace(RECOMMENDED.clouds, seed=7)
    chosen = settings_for("paper", clouds={"seed": 7}, correspondence={"counterparts": (("a", "b"),)})
    assert voxel_settings(chosen) is chosen and surface_settings(RECOMMENDED) is RECOMMENDED
    for settings, preset in ((surface_settings(chosen), RECOMMENDED),
                          (voxel_settings(replace(RECOMMENDED, clouds=clouds)), PAPER)):  # fmt: skip
        assert settings.clouds == clouds and settings.registration == preset.registration
        assert settings.visibility == preset.visibility
    assert surface_settings(chosen).correspondence == replace(
        RECOMMENDED.correspondence, counterparts=(("a", "b"),)
    )
    fits = cast(Any, SimpleNamespace(voxels="voxels", surface="surface"))
    assert pair.Pair.fit_for(fits, RECOMMENDED) == "surface" and pair.Pair.fit_for(fits, PAPER) == "voxels"


def test_a_key_holds_all_that_went_in() -> None:
    keys = [content_key(*parts) for parts in (("a", 1), ("a", 2), ("b", 1), ("a", 1, 1), (("a", 1),))]
    assert len(set(keys)) == 5 and content_key("a", 1) == keys[0]
    clouds = RECOMMENDED.clouds
    key, other = (content_key("surface", "hash", one) for one in (clouds, replace(clouds, seed=1)))
    assert key == content_key("surface", "hash", clouds) != other


def test_what_has_no_hash_is_not_remembered() -> None:
    def memo(stage: str, record_type: type, key: str, compute: Any) -> Any:
        return "remembered"

    assert remembering(memo, "a", "b")("", str, "", lambda: "made") == "remembered"
    assert remembering(memo, "a", "")("", str, "", lambda: "made") == "made"
    assert no_memo("", str, "", lambda: "made") == "made"


def test_explained_is_the_share_on_matched_parts_of_the_structure_with_less_of_it() -> None:
    cloud = boxes(HULL, FIN, POD)
    area = [2 * (a * b + b * c + c * a) for _, (a, b, c) in (HULL, FIN, POD)]
    whole = sum(area)
    assert pair.explained(fit_of(cloud, cloud, [0, 1, 2], [0, -1, 1])) == pytest.approx(1 - area[1] / whole)
    assert pair.explained(fit_of(cloud, cloud, [-1, 0, -1], [0, 1, 2])) == pytest.approx(area[1] / whole)
    assert pair.explained(fit_of(cloud, cloud, None, None)) == 0


def test_concentration_is_the_chance_that_two_places_lie_on_one_part() -> None:
    area = np.array([2 * (a * b + b * c + c * a) for _, (a, b, c) in (HULL, FIN, POD)])
    assert pair.concentration(boxes(HULL)) == pytest.approx(1)
    expected = (area**2).sum() / area.sum() ** 2
    assert pair.concentration(boxes(HULL, FIN, POD)) == pytest.approx(expected)
    crumbs = [([90 + 3 * k, 0, 0], [1, 1, 1]) for k in range(8)]
    assert pair.concentration(boxes(HULL, *crumbs)) == pytest.approx(1, abs=0.1)  # many, and no finer


FIT = Registration(np.array([2.0, 1, 1]), np.eye(3), np.array([1.0, 0, 0]), 0.0, True)


def task_of(source: Cloud, target: Cloud, scans: tuple[bool, bool] = (False, False), **choices: Any) -> Task:
    both = structure("s", is_scan=scans[0]), structure("t", is_scan=scans[1])
    settings = settings_for("recommended", correspondence=choices)
    return Task(*both, settings, no_memo, (source, target), Declared(), ("surface",))


def inferred_from_other(
    one: int, monkeypatch: pytest.MonkeyPatch, blades: bool = False
) -> tuple[Fit, dict[str, Any]]:
    """The fit where the parts of one are inferred from the other's, and what everybody was given."""
    clouds = boxes(HULL, FIN, number=40), boxes(HULL, POD, number=50)
    calls: dict[str, Any] = {"clouds": clouds, "label": np.arange(len(clouds[one])) % 2}

    def parts_like(whole: Cloud, skin: Any, known: Cloud) -> Any:
        calls.update(whole=whole, skin=skin, known=known)
        return calls["label"]

    def rotor_turned(known: Cloud, whole: Cloud) -> Cloud:
        calls.update(turned=(known, whole))
        return known

    def register(*of: Any) -> Registration:
        calls["registered"] = of[:2]
        return replace(FIT, acceptance=0.5)

    def correspond(source: Cloud, target: Cloud, registration: Registration, *rest: Any) -> Correspondences:
        calls["matched"] = (source, target), registration, rest[0].counterparts, rest[-1]
        return pair_fits.NOTHING

    monkeypatch.setattr(pair, "parts_like", parts_like)
    monkeypatch.setattr(pair, "rotor_turned", rotor_turned)
    monkeypatch.setattr(pair, "carried", lambda whole, known: np.arange(len(whole)))
    monkeypatch.setattr(pair, "scene_of", lambda each: f"scene of {each.sha256}")
    monkeypatch.setattr(pair, "skin_of", lambda *of: SimpleNamespace(of=lambda cloud: (of[1], of[2])))
    monkeypatch.setattr(pair, "middle_of", lambda stretch: stretch)
    monkeypatch.setattr(pair, "blades_of", lambda cloud: np.full(len(cloud), blades))
    monkeypatch.setattr(pair, "register", register)
    monkeypatch.setattr(pair, "correspond", correspond)
    task = pair._with_inferred_parts(task_of(*clouds, counterparts=(("a", "b"),)), Fit(*clouds, FIT), one)
    assert len(task.names) == 2  # nothing of these clouds is remembered as of those without parts
    return task.fit_labelled(one, FIT), calls


def same_points(one: Cloud, other: Floats) -> bool:
    return bool(np.allclose(one.points, other))


@pytest.mark.parametrize("one", [0, 1])
def test_the_parts_of_one_are_inferred_in_the_frame_of_the_source(
    one: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, calls = inferred_from_other(one, monkeypatch)
    clouds = calls["clouds"]
    frames = clouds[0].points, in_source_frame(clouds[1], FIT).points
    assert same_points(calls["whole"], frames[one]) and same_points(calls["known"], frames[1 - one])
    assert same_points(calls["turned"][0], frames[1 - one]) and same_points(calls["turned"][1], frames[one])
    assert calls["skin"] == (f"scene of {'st'[one]}", clouds[one])
    assert fit.inferred == one and fit.registration is FIT and "registered" not in calls
    both = fit.source, fit.target
    assert np.array_equal(both[one].part, calls["label"]) and both[1 - one] is clouds[1 - one]
    assert np.array_equal(both[one].points, clouds[one].points)
    matched, registration_of, counterparts, named = calls["matched"]
    assert matched == both and registration_of is FIT and counterparts == ()
    assert np.array_equal(named, np.arange(len(clouds[1]))) and fit.carried is named


def test_where_a_rotor_stopped_otherwise_the_registration_is_made_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fit, calls = inferred_from_other(1, monkeypatch, blades=True)
    assert fit.registration.acceptance == 0.5
    assert calls["registered"] == (fit.source, fit.target)
    assert calls["matched"][1] is fit.registration


def test_what_is_remembered_of_a_fit_depends_on_all_that_went_in() -> None:
    keys: list[str] = []

    def memo(stage: str, kind: type, key: str, compute: Any) -> Any:
        keys.append(key)
        return compute()

    cloud = boxes(HULL)
    task = replace(task_of(cloud, cloud), memo=memo)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    others = (
        task,
        replace(task, declared=Declared(turn)),
        replace(task, source=task.target),
        replace(task, settings=replace(task.settings, clouds=replace(task.settings.clouds, seed=9))),
        task.labelled(task.clouds, "sibling"),
    )
    for each in others:
        each.remembered("stage", int, lambda: 1)
    task.remembered("stage", int, lambda: 1, "more")
    task.remembered("other", int, lambda: 1)
    task.remembered("stage", int, lambda: 1)
    assert len(set(keys)) == len(keys) - 1 and keys[-1] == keys[0]


def fitted(
    known: tuple[bool, bool],
    explained: list[float],
    monkeypatch: pytest.MonkeyPatch,
    scans: tuple[bool, bool] = (False, False),
    clouds: Sequence[Cloud] = (),
    **choices: Any,
) -> tuple[Fit, list[Any]]:
    """The fit of the surfaces where parts are known of some, and so much of them is matched, one by one."""
    clouds = clouds or [boxes(HULL, FIN, POD, number=60) if has else boxes(HULL, number=60) for has in known]
    calls: list[Any] = []
    shares = iter(explained)

    def fit_labelled(task: Task, one: int, registration: Registration) -> Fit:
        calls.append(("inferred", one))
        return Fit(*task.clouds, registration, inferred=one)

    def matched(task: Task, fit: Fit, named: Any = None) -> Fit:
        calls.append(("matched", task.settings.correspondence.counterparts, len(task.names)))
        return fit

    monkeypatch.setattr(Task, "registration", lambda _: FIT)
    monkeypatch.setattr(Task, "matched", matched)
    monkeypatch.setattr(Task, "fit_labelled", fit_labelled)
    monkeypatch.setattr(pair, "_with_inferred_parts", lambda task, fit, _: task.labelled(task.clouds, "it"))
    monkeypatch.setattr(pair, "pieces_tell_parts", pair.has_parts)
    monkeypatch.setattr(pair, "explained", lambda _: next(shares))
    monkeypatch.setattr(Task, "with_carried", lambda _, fit: replace(fit, carried=np.zeros(1, np.int64)))
    return pair.surface_fit(task_of(clouds[0], clouds[1], scans, **choices)), calls


PLAIN = ("matched", (), 1)


def test_pieces_that_explain_most_are_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, calls = fitted((True, True), [0.6], monkeypatch, scans=(True, True))
    assert calls == [PLAIN] and fit.inferred == -1 and fit.carried is not None


COARSE, FINE, CRUMBED = (
    boxes(HULL, POD),
    boxes(HULL, FIN, POD, ([0, 4, 0], [60, 8, 6]), ([0, 12, 0], [60, 8, 6])),
    boxes(HULL, *(([70 + 3 * k, 0, 0], [2, 2, 2]) for k in range(7))),
)


@pytest.mark.parametrize(
    ("source", "target", "one"),
    [(FINE, COARSE, 1), (COARSE, FINE, 0), (FINE, CRUMBED, 1), (CRUMBED, FINE, 0), (FINE, FINE, 1)],
)
def test_the_structure_that_is_divided_more_finely_tells_the_parts(
    source: Cloud, target: Cloud, one: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """How many parts there are tells nothing: an airliner of 15 may have fuselage and wings in one."""
    fit, _ = fitted((True, True), [0.1, 0.9, 0.1], monkeypatch, clouds=[source, target])
    assert fit.inferred == one


def test_among_structures_that_are_divided_alike_the_source_tells_the_parts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """So no millimetre decides which."""
    longer = boxes(([0, -4, 0], [62, 8, 6]), FIN, POD)
    for clouds in ([boxes(HULL, FIN, POD), longer], [longer, boxes(HULL, FIN, POD)]):
        fit, _ = fitted((True, True), [0.1, 0.9, 0.1], monkeypatch, clouds=clouds)
        assert fit.inferred == 1


@pytest.mark.parametrize("scans", [(True, False), (False, True), (False, False)])
@pytest.mark.parametrize(("inferred", "taken"), [(0.61, False), (0.62, True)])
def test_inferred_parts_must_explain_clearly_more_than_pieces_whether_drawn_or_scanned(
    inferred: float, taken: bool, scans: tuple[bool, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, calls = fitted((True, True), [0.49, inferred, 0.49], monkeypatch, scans)
    assert calls == [PLAIN, ("inferred", 1)] and fit.inferred == (1 if taken else -1)


@pytest.mark.parametrize(("known", "one"), [((True, False), 1), ((False, True), 0)])
def test_a_surface_of_one_piece_has_its_parts_told_by_the_other(
    known: tuple[bool, bool], one: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, calls = fitted(known, [0.0], monkeypatch, counterparts=(("a", "b"),))
    assert calls == [("inferred", one), ("matched", (("a", "b"),), 2)]
    assert fit.inferred == one and fit.carried is None


@pytest.mark.parametrize(("part", "name"), [(0, -1), (2, 2), (-1, -1)])
def test_a_part_that_boxes_left_is_named_by_what_is_brought_there(part: int, name: int) -> None:
    """If that was left too: a nacelle that was drawn with its pylon here, and without it there."""
    cloud = boxes(HULL, FIN, POD)
    label = labels_of(cloud)
    fit = fit_of(cloud, cloud, [0, 1, -1], [0, 1, -1])
    named = named_by_displacement(replace(fit, carried=np.where(label == 2, part, label)))
    assert (named == np.where(label == 2, name, -1)).all()
    assert (named_by_displacement(fit) == -1).all()


def test_two_surfaces_of_one_piece_have_no_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, calls = fitted((False, False), [], monkeypatch)
    assert calls == [PLAIN] and fit.inferred == -1 and fit.carried is None


def test_what_is_published_stands_as_the_surfaces_do(monkeypatch: pytest.MonkeyPatch) -> None:
    tasks: dict[str, Any] = {}
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    half = quarter @ quarter
    cloud = boxes(HULL, number=60)
    surface = Fit(cloud, cloud, replace(FIT, rotation=quarter, turn=half))
    supposed = SimpleNamespace(supposed="what is missing")

    def registration_of(task: Task) -> Registration:
        tasks[task.names] = task
        return FIT

    monkeypatch.setattr(pair, "scene_of", lambda each: f"scene of {each.sha256}")
    monkeypatch.setattr(pair, "_voxels", lambda each, *_: cloud)
    monkeypatch.setattr(pair, "samples_of", lambda each, *_: cloud)
    monkeypatch.setattr(pair, "surface_fit", lambda _: surface)
    monkeypatch.setattr(Task, "registration", registration_of)
    monkeypatch.setattr(Task, "matched", lambda _, fit: fit)
    monkeypatch.setattr(Task, "missing", lambda *_: supposed)
    monkeypatch.setattr(pair, "without", lambda match, *_: match)
    monkeypatch.setattr(pair, "with_supposed", lambda scene, supposed: f"{scene} and {supposed}")
    for settings, turn in ((RECOMMENDED, quarter @ half), (PAPER, np.eye(3))):
        study = study_pair(structure("s"), structure("t"), settings)
        assert study.surface.registration is surface.registration and study.source_scene == "scene of s"
        assert study.target_scene == "scene of t and what is missing" and study.supposed == "what is missing"
        assert np.array_equal(tasks[("voxels",)].declared.turn, turn)
