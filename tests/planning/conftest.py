"""Tests of planning share what is found out about equal inputs; see `tests/remembered.py`."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import remembered

from upplied.planning import plan as planning


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Before its fixtures of any scope."""
    anew = item.get_closest_marker("anew") or "monkeypatch" in getattr(item, "fixturenames", ())
    planning._planned = remembered._plan if anew else remembered.planned


@pytest.fixture(scope="package", autouse=True)
def whole_planning_afterwards() -> Iterator[None]:
    """Tests of other folders in this process plan as the program does."""
    yield
    planning._planned = remembered._plan
