"""Each floor of the verdict at its very limit, for a flight and an airspace that are known."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from upplied.config import Settings, settings_for
from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import Airspace
from upplied.planning.correspondence.misfit import sizes_beyond
from upplied.planning.demonstration.repetition import Take
from upplied.planning.measures import verdict
from upplied.planning.measures.verdict import shortfalls
from upplied.records import Measures, Structure, Surroundings, Trajectory

SETTINGS = settings_for(
    "recommended",
    verdict={"longest_path": 3.0, "longest_time": 4.0, "least_inspected_pct": 60.0},
    route={"clearance_m": 2.0},
    retime={"max_speed_mps": 8.0, "max_acceleration_mps2": 2.0},
)
FAR = Scene(np.array([[0.0, 0, -900], [1, 0, -900], [0, 1, -900]]), np.array([[0, 1, 2]]), 1)
#: 100 m in 40 s; carried to the target 200 m.
FLOWN = Trajectory(
    np.array([10.0, 30, 50]), np.array([[0.0, 0, 9], [60, 0, 9], [60, 40, 9]]), np.zeros((3, 4))
)
GOOD = Measures(coverage_inspected_pct=60.0, min_clearance_m=1.99, path_length_m=650.0, duration_s=380.0,
                peak_speed_mps=8.4, peak_acceleration_mps2=2.1)  # fmt: skip


def take(stretch: float = 2.0, larger: float = 1.0) -> Take:
    inspection = SimpleNamespace(by_frustum=SimpleNamespace(stations=FLOWN))
    return cast(Take, SimpleNamespace(inspection=inspection, pair=None, stretch=stretch, larger=larger))


@pytest.fixture(autouse=True)
def open_air(monkeypatch: pytest.MonkeyPatch) -> None:
    air = Airspace(FAR, 2.0, Surroundings(ceiling_z_m=20.0))
    monkeypatch.setattr(verdict, "airspace_of", lambda pair, settings: air)
    monkeypatch.setattr(verdict, "demonstrated_on_target", lambda one: one.stretch * FLOWN.positions)
    monkeypatch.setattr(verdict, "inspected_by", lambda one, settings: one.larger)
    monkeypatch.setattr(verdict, "area_ratio", lambda takes, larger: larger)


def short(
    settings: Settings = SETTINGS, path: Trajectory = FLOWN, takes: list[Take] | None = None, **change: float
) -> tuple[str, ...]:
    return shortfalls(path, replace(GOOD, **change), [take()] if takes is None else takes, settings)


def test_limits_themselves_are_kept() -> None:
    assert short() == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"coverage_inspected_pct": 59.99},
            "shows 60.0 % of what was inspected at least as well, 60 % are required",
        ),
        ({"min_clearance_m": 1.989}, "comes within 1.99 m of the structure, 2 m are required"),
        ({"path_length_m": 650.1}, "flies 650 m where the demonstration is 200 m long at this size, 3 times"),
        ({"duration_s": 380.1}, "takes 380 s where the demonstration takes 80 s at this size, 4 times"),
        ({"peak_speed_mps": 8.41}, "flies 8.4 m/s, 8 m/s are allowed"),
        ({"peak_acceleration_mps2": 2.11}, "asks for 2.1 m/s2, 2 m/s2 are allowed"),
        ({"frechet_m": np.inf}, "a measure is not finite"),
    ],
)
def test_beyond_a_limit_it_is_said(change: dict[str, float], words: str) -> None:
    (sentence,) = short(**change)
    assert sentence.startswith(words)


def test_a_smaller_target_is_given_the_way_and_the_time_of_the_demonstration() -> None:
    small = [take(0.5)]
    assert short(takes=small, path_length_m=350.0, duration_s=220.0) == ()
    assert len(short(takes=small, path_length_m=350.1, duration_s=220.1)) == 2


def test_an_area_that_is_larger_is_given_the_way_and_the_time_for_its_passes() -> None:
    """Four times the area: 400 m and 160 s count as the demonstration's, where its shape is twice as long."""
    assert short(takes=[take(larger=4.0)], path_length_m=1250.0, duration_s=700.0) == ()
    (sentence,) = short(takes=[take(larger=4.0)], path_length_m=1250.1)
    assert "where the demonstration is 400 m long" in sentence
    (sentence,) = short(takes=[take(larger=4.0)], duration_s=700.1)
    assert "where the demonstration takes 160 s" in sentence


def test_several_takes_add_up() -> None:
    both = [take(), take(0.5)]
    assert short(takes=both, path_length_m=1000.0, duration_s=600.0) == ()
    assert len(short(takes=both, path_length_m=1000.1, duration_s=600.1)) == 2


def test_a_place_that_is_not_allowed_is_named() -> None:
    high = replace(FLOWN, positions=FLOWN.positions + np.array([0, 0, 11.04]))
    assert short(path=high) == ("above the ceiling of 20.00 m at [0.0, 0.0, 20.0] m",)
    near = short(path=high, min_clearance_m=1.0)
    assert len(near) == 1 and near[0].startswith("comes within")


def test_what_was_not_measured_is_short_where_it_is_asked_for() -> None:
    unknown = {"coverage_inspected_pct": float("nan")}
    assert short(**unknown) == ("what of the inspected surface it shows was not measured",)
    free = replace(SETTINGS, verdict=replace(SETTINGS.verdict, least_inspected_pct=0.0))
    assert short(free, **unknown) == ()


def test_what_is_no_place_comes_first() -> None:
    for name in ("t_s", "positions", "quat_xyzw"):
        values = np.array(getattr(FLOWN, name))
        values.flat[-1] = np.nan
        changed: Any = {name: values}
        assert short(path=replace(FLOWN, **changed), frechet_m=np.inf) == ("a waypoint is not finite",)


def cube(size: float) -> Structure:
    return Structure(
        "cube", "box", np.array([[0.0, 0, 0], [size, 0, 0], [0, size, size]]), np.array([[0, 1, 2]])
    )


@pytest.mark.parametrize("setting", ["most_size_ratio", "odd_size_ratio"])
def test_sizes_are_compared_both_ways(setting: str) -> None:
    ratio = getattr(SETTINGS.verdict, setting)
    beyond = partial(sizes_beyond, most=ratio, setting=setting)
    for pair in ((1.0, ratio * 0.999), (ratio * 0.999, 1.0)):
        assert beyond(cube(pair[0]), cube(pair[1])) == ""
    words = beyond(cube(1.0), cube(ratio * 1.001))
    assert f"more than {ratio:g} (verdict.{setting}); check their units" in words
    assert words.startswith(
        f"the target is {ratio * 1.001 * np.sqrt(3):.3g} m across, the source 1.73 m: {ratio:.1f} times"
    )
    assert beyond(cube(ratio * 1.001), cube(1.0))
