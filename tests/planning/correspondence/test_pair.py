"""What of a pair depends on what: turns, settings, keys, and whose parts are inferred from whose."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_clouds import boxes

from upplied.config import Settings, settings_for
from upplied.planning.correspondence import pair, registration
from upplied.planning.correspondence.fit import Fit, surface_settings, voxel_settings
from upplied.planning.correspondence.memo import content_key, no_memo, remembering, surface_key
from upplied.planning.correspondence.pair import study_pair
from upplied.planning.correspondence.registration import Declared
from upplied.planning.geometry.boxes import in_source_frame
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
    found = registration._declared_turn(structure("a", source), structure("b", target))
    angle = np.radians(turn)
    wanted = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    np.testing.assert_allclose(found, wanted, atol=1e-8)
    if turn == 0:
        assert np.array_equal(found, np.eye(3))


def test_rounding_of_headings_is_no_turn() -> None:
    a, b = structure("a", 30.0), structure("b", 30.0 + 1e-9)
    assert np.array_equal(registration._declared_turn(a, b), np.eye(3))
    assert np.array_equal(registration._declared_turn(b, a), np.eye(3))


def test_each_ruler_has_the_settings_of_its_preset_and_the_clouds_that_were_asked_for() -> None:
    clouds = replace(RECOMMENDED.clouds, seed=7)
    asked = settings_for("paper", clouds={"seed": 7}, correspondence={"counterparts": (("a", "b"),)})
    assert voxel_settings(asked) is asked and surface_settings(RECOMMENDED) is RECOMMENDED
    for found, preset in ((surface_settings(asked), RECOMMENDED),
                          (voxel_settings(replace(RECOMMENDED, clouds=clouds)), PAPER)):  # fmt: skip
        assert found.clouds == clouds and found.registration == preset.registration
        assert found.visibility == preset.visibility
    assert surface_settings(asked).correspondence == replace(
        RECOMMENDED.correspondence, counterparts=(("a", "b"),)
    )
    fits = cast(Any, SimpleNamespace(voxels="voxels", surface="surface"))
    assert pair.Pair.fit_for(fits, RECOMMENDED) == "surface" and pair.Pair.fit_for(fits, PAPER) == "voxels"


def test_a_key_holds_all_that_went_in() -> None:
    keys = [content_key(*parts) for parts in (("a", 1), ("a", 2), ("b", 1), ("a", 1, 1), (("a", 1),))]
    assert len(set(keys)) == 5 and content_key("a", 1) == keys[0]
    clouds = RECOMMENDED.clouds
    assert surface_key("hash", clouds) == content_key("surface", "hash", clouds)
    assert surface_key("hash", clouds) != surface_key("hash", replace(clouds, seed=1))


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


def test_crumbs_are_not_counted_as_parts() -> None:
    crumb = ([90, 0, 0], [1.9, 1.9, 1.9])  # 1.2 % of the hull's area, below 1 % with the fin's
    assert pair.number_of_parts(boxes(HULL, FIN, POD)) == 3
    assert (
        pair.number_of_parts(boxes(HULL, crumb)) == 2 and pair.number_of_parts(boxes(HULL, HULL, crumb)) == 2
    )


FIT = Registration(np.array([2.0, 1, 1]), np.eye(3), np.array([1.0, 0, 0]), 0.0, True)


def told_by(one: int, monkeypatch: pytest.MonkeyPatch, blades: bool = False) -> tuple[Fit, dict[str, Any]]:
    """The fit where the parts of one are inferred from the other's, and what everybody was asked."""
    clouds = boxes(HULL, FIN, number=40), boxes(HULL, POD, number=50)
    asked: dict[str, Any] = {"matched": []}
    label = np.arange(len(clouds[one])) % 2

    def parts_like(whole: Cloud, skin: Any, known: Cloud) -> Any:
        asked.update(whole=whole, skin=skin, known=known)
        return label

    def rotor_turned(known: Cloud, whole: Cloud) -> Cloud:
        asked.update(turned=(known, whole))
        return known

    def registered(both: Any, settings: Settings, declared: Declared, memo: Any, facts: Any) -> Registration:
        asked["registered"] = both, facts
        return replace(FIT, acceptance=0.5)

    def matched(both: Any, structures: Any, found: Registration, *rest: Any) -> Correspondences:
        asked["matched"].append((both, found, rest[3], rest[4]))
        return Correspondences(np.empty(0, np.int64), np.empty(0), np.empty((0, 3)))

    monkeypatch.setattr(pair, "parts_like", parts_like)

    def with_carried(fit: Fit, memo: Any, facts: Any) -> Fit:
        asked["carried"] = np.arange(len(fit.target))
        return replace(fit, carried=asked["carried"])

    monkeypatch.setattr(pair, "rotor_turned", rotor_turned)
    monkeypatch.setattr(pair, "_with_carried", with_carried)
    monkeypatch.setattr(pair, "skin_of", lambda *of: SimpleNamespace(of=lambda cloud: (of[0].sha256, of[2])))
    monkeypatch.setattr(pair, "middle_of", lambda stretch: stretch)
    monkeypatch.setattr(pair, "blades_of", lambda cloud: np.full(len(cloud), blades))
    monkeypatch.setattr(pair, "_registered", registered)
    monkeypatch.setattr(pair, "_matched", matched)
    structures = structure("s"), structure("t")
    fit = Fit(*clouds, FIT, pair.NOTHING)
    found = pair._fit_inferred(
        fit,
        one,
        structures,
        ("scene s", "scene t"),
        RECOMMENDED,
        Declared(),
        no_memo,
        ("facts",),  # type: ignore[arg-type]
    )
    asked.update(clouds=clouds, label=label, fit=found)
    return found, asked


def same_points(one: Cloud, other: Floats) -> bool:
    return bool(np.allclose(one.points, other))


@pytest.mark.parametrize("one", [0, 1])
def test_the_parts_of_one_are_told_in_the_frame_of_the_source(
    one: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, asked = told_by(one, monkeypatch)
    clouds = asked["clouds"]
    frames = clouds[0].points, in_source_frame(clouds[1], FIT).points
    assert same_points(asked["whole"], frames[one]) and same_points(asked["known"], frames[1 - one])
    assert same_points(asked["turned"][0], frames[1 - one]) and same_points(asked["turned"][1], frames[one])
    assert asked["skin"] == ("st"[one], clouds[one])
    assert found.inferred == one and found.registration is FIT
    both = found.source, found.target
    assert np.array_equal(both[one].part, asked["label"]) and both[1 - one] is clouds[1 - one]
    assert np.array_equal(both[one].points, clouds[one].points)
    ((given, fit, facts, named),) = asked["matched"]
    assert given == both and fit is FIT and facts == ("parts inferred", "facts")
    assert np.array_equal(named, asked["carried"]) and found.carried is named


def test_where_a_rotor_stopped_otherwise_the_registration_is_made_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, asked = told_by(1, monkeypatch, blades=True)
    assert found.registration.acceptance == 0.5
    assert asked["registered"] == ((found.source, found.target), ("parts inferred", "facts"))
    assert asked["matched"][0][1] is found.registration


def test_a_fit_depends_on_its_turn_where_there_is_one() -> None:
    both = structure("s"), structure("t")
    plain = pair._facts("surface", both, RECOMMENDED, Declared())
    assert plain == ("surface", "s", "t", RECOMMENDED.clouds, RECOMMENDED.registration)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert pair._facts("surface", both, RECOMMENDED, Declared(turn)) == (*plain, turn.tolist())


def told_or_not(
    known: tuple[bool, bool],
    explained: list[float],
    monkeypatch: pytest.MonkeyPatch,
    scans: tuple[bool, bool] = (False, False),
    **asked: Any,
) -> tuple[Fit, list[Any]]:
    """The fit of the surfaces where parts are known of some, and so much of them is matched, one by one."""
    clouds = tuple(boxes(HULL, FIN, POD, number=60) if has else boxes(HULL, number=60) for has in known)
    calls: list[Any] = []
    shares = iter(explained)

    def fit_told(fit: Fit, one: int, *rest: Any) -> Fit:
        calls.append(("inferred", one, rest[2].correspondence.counterparts))
        return replace(fit, inferred=one)

    def matched(both: Any, structures: Any, found: Registration, settings: Settings, *rest: Any) -> Any:
        calls.append(("matched", settings.correspondence.counterparts, rest[2][0]))
        return pair.NOTHING

    monkeypatch.setattr(pair, "_registered", lambda *_: FIT)
    monkeypatch.setattr(pair, "_matched", matched)
    monkeypatch.setattr(pair, "_fit_inferred", fit_told)
    monkeypatch.setattr(pair, "pieces_tell_parts", pair.has_parts)
    monkeypatch.setattr(pair, "explained", lambda _: next(shares))
    monkeypatch.setattr(pair, "_with_carried", lambda fit, *_: replace(fit, carried=np.zeros(1, np.int64)))
    settings = settings_for("recommended", correspondence=asked)
    both = structure("s", is_scan=scans[0]), structure("t", is_scan=scans[1])
    fit = pair._surface_fit(clouds, both, (None, None), settings, Declared(), no_memo)  # type: ignore[arg-type]
    return fit, calls


PLAIN = ("matched", (), "surface")


def test_pieces_that_explain_most_are_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, calls = told_or_not((True, True), [0.6], monkeypatch, scans=(True, True))
    assert calls == [PLAIN] and fit.inferred == -1 and fit.carried is not None


def test_pieces_of_what_was_drawn_are_believed_however_little_they_explain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fit, calls = told_or_not((True, True), [0.0], monkeypatch)
    assert calls == [PLAIN] and fit.inferred == -1 and fit.carried is not None


@pytest.mark.parametrize("scans", [(True, False), (False, True)])
@pytest.mark.parametrize(("inferred", "taken"), [(0.61, False), (0.62, True)])
def test_parts_of_a_scan_told_by_geometry_must_explain_clearly_more(
    inferred: float, taken: bool, scans: tuple[bool, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, calls = told_or_not((True, True), [0.49, inferred, 0.49], monkeypatch, scans)
    assert calls == [PLAIN, ("inferred", 1, ())] and fit.inferred == (1 if taken else -1)


@pytest.mark.parametrize(("known", "one"), [((True, False), 1), ((False, True), 0)])
def test_a_surface_of_one_piece_has_its_parts_told_by_the_other(
    known: tuple[bool, bool], one: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, calls = told_or_not(known, [0.0], monkeypatch, counterparts=(("a", "b"),))
    assert calls == [("inferred", one, ()), ("matched", (("a", "b"),), "parts inferred")]
    assert fit.inferred == one and fit.carried is None


def test_two_surfaces_of_one_piece_have_no_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, calls = told_or_not((False, False), [], monkeypatch)
    assert calls == [PLAIN] and fit.inferred == -1 and fit.carried is None


def test_what_is_published_stands_as_the_surfaces_do(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    half = quarter @ quarter
    surface = replace(FIT, rotation=quarter, turn=half)
    monkeypatch.setattr(pair, "scene_of", lambda each: f"scene of {each.sha256}")
    monkeypatch.setattr(pair, "_voxels", lambda each, *_: f"voxels of {each.sha256}")
    monkeypatch.setattr(pair, "samples_of", lambda each, *_: f"samples of {each.sha256}")
    monkeypatch.setattr(
        pair, "_surface_fit", lambda *of: asked.update(surface=of) or Fit("", "", surface, "")
    )  # type: ignore[arg-type]
    monkeypatch.setattr(pair, "_fit", lambda *of: asked.update(voxels=of) or "published")
    monkeypatch.setattr(pair, "missing_from", lambda *_: "missing")
    monkeypatch.setattr(pair, "without", lambda match, *_: match)
    monkeypatch.setattr(pair, "supposed_surface", lambda missing: f"what is {missing}")
    monkeypatch.setattr(pair, "with_supposed", lambda scene, supposed: f"{scene} and {supposed}")
    for settings, turn in ((RECOMMENDED, quarter @ half), (PAPER, np.eye(3))):
        found = study_pair(structure("s"), structure("t"), settings)
        assert found.voxels == "published" and found.surface.registration is surface
        assert found.source_scene == "scene of s"
        assert found.target_scene == "scene of t and what is missing"
        assert asked["surface"][0] == ("samples of s", "samples of t")
        assert asked["surface"][2] == ("scene of s", "scene of t")
        assert asked["voxels"][1] == ("voxels of s", "voxels of t")
        assert np.array_equal(asked["voxels"][4].turn, turn)
        assert np.array_equal(asked["surface"][4].turn, np.eye(3))
