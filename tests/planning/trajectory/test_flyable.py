"""A path that takes too long is drawn back towards its start, as little as is needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from upplied.config import settings_for
from upplied.errors import RefusedError
from upplied.planning.trajectory.flyable import Flyable, Result
from upplied.planning.trajectory.state import Flown

NONE = np.zeros(0, np.int64), np.zeros(0, bool)


@dataclass(frozen=True)
class Drawn:
    """A result of which so much is flown."""

    share: float = 1.0

    def partly(self, share: float) -> Drawn:
        return Drawn(share)


def in_time(seconds: Callable[[float], float], limit_s: float) -> Result:
    class Stub(Flyable):
        def finished(self, result: Any, origin: Any, added: Any) -> Any:
            return result.share

        def seconds(self, path: Any) -> float:
            return seconds(path)

        def shown(self, result: Any, path: Any) -> float:
            return 0.5 + path / 2

    nothing: Any = None
    return Stub(nothing, nothing, nothing, nothing).in_time(Drawn(), *NONE, limit_s)  # type: ignore[arg-type]


def test_what_fits_is_flown_as_it_is() -> None:
    whole = in_time(lambda share: 100 * share, 100.0)
    assert whole.taken_s == 100 and whole.shown == 1


def test_what_takes_too_long_is_drawn_back_to_within_a_sixteenth() -> None:
    fitting = in_time(lambda share: 100 + 100 * share, 163.0)
    assert fitting.taken_s == pytest.approx(162.5) and fitting.shown == 0.5 + 0.625 / 2
    fitting = in_time(lambda share: 100 + 100 * share, 157.0)
    assert 157 - 100 / 16 < fitting.taken_s <= 157


def test_what_takes_a_percent_longer_has_to_show_a_percent_more() -> None:
    """The stub shows half a percent more for each percent of the way: at 30 s for it, or 80, in 100 s."""
    whole = in_time(lambda share: 75 + 30 * share, 100.0)
    assert whole.taken_s == 105 and whole.worth(100.0) == pytest.approx(0.95)
    fitting = in_time(lambda share: 30 + 80 * share, 100.0)
    assert fitting.taken_s == 100 and fitting.worth(100.0) == fitting.shown == 0.5 + 0.875 / 2


def test_among_paths_worth_as_much_within_a_point_the_whole_is_flown() -> None:
    """Drawn back a sixteenth both are in time and show 0.969; the whole is worth 0.965, or 0.94."""
    whole = in_time(lambda share: 47.5 + 56 * share, 100.0)
    assert whole.worth(100.0) == pytest.approx(0.965) and whole.shown == 1
    fitting = in_time(lambda share: 10 + 96 * share, 100.0)
    assert fitting.taken_s == 100 and fitting.shown == 0.5 + 15 / 32


def test_where_the_start_takes_longer_already_what_is_flown_is_worth_most() -> None:
    assert in_time(lambda share: 300 + 100 * share, 250.0).taken_s == 400
    fitting = in_time(lambda share: 300 + 100 * share, 150.0)
    assert fitting.taken_s == pytest.approx(300 + 100 / 16) and fitting.shown == 0.5 + 1 / 32


def test_with_no_time_at_all_the_shortest_is_flown() -> None:
    fitting = in_time(lambda share: 100 + 100 * share, 0.0)
    assert fitting.taken_s == pytest.approx(100 + 100 / 16)


def test_a_part_that_cannot_be_made_safe_is_passed_by_and_the_whole_says_why() -> None:
    def seconds(share: float) -> float:
        if share == 0.5:
            raise RefusedError("the path", "leads through the structure", "it may not", "fly elsewhere")
        return 100 + 100 * share

    fitting = in_time(seconds, 120.0)
    assert 100 < fitting.taken_s <= 120 and fitting.shown < 0.75

    def never(share: float) -> float:
        raise RefusedError("the path", "leads through the structure", "it may not", "fly elsewhere")

    with pytest.raises(RefusedError, match="leads through"):
        in_time(never, 180.0)


def test_a_carried_flight_that_takes_longer_than_usual_has_some_more_time_too() -> None:
    """Else it would be flown as it is, or not be drawn back, as a hundredth of a second says."""

    def allowed_s(carried_s: float, zones: float = 1.0) -> float:
        class Stub(Flyable):
            def seconds_of(self, longer: Any) -> float:
                return carried_s

        flight = SimpleNamespace(t_s=np.array([3.0, 103.0]))
        carried = SimpleNamespace(take=SimpleNamespace(inspection=SimpleNamespace(flight=flight)))
        goal = SimpleNamespace(area_ratio=0.5, inspected=SimpleNamespace(need=np.array([1.0, 1, 0])))
        view = SimpleNamespace(
            cloud=SimpleNamespace(areas=np.array([1.0, 1, 2 * (zones - 1)])), inspected=np.ones(3, bool)
        )
        nothing: Any = None
        made: Any = Stub(carried, goal, settings_for("recommended"), nothing)
        return float(made.allowed_s(view, Flown(np.zeros((2, 3)), np.zeros(2), np.zeros(2))))

    assert allowed_s(60.0) == allowed_s(99.9) == pytest.approx(125)
    assert allowed_s(100.1) == pytest.approx(125.125) and allowed_s(200.0) == pytest.approx(250)
    assert allowed_s(200.0, zones=3.0) == pytest.approx(375)
