"""Tests of missions share where photos are taken: that follows from plan, scene and options alone."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
import remembered

from upplied.geometry.scene import Scene
from upplied.outputs.missions import mission

_made = mission.shots_of
_PROBES = np.random.default_rng(0).uniform(-1.0, 1.0, (300, 3))


def shots_of(name: str, path: Any, viewpoints: Any, scene: Scene, *given: Any) -> Any:
    """The same, found out once for equal inputs; scenes are compared by their box and 300 distances."""
    shape = (scene.box, scene.distance(scene.origin + _PROBES * np.ptp(scene.box, axis=0)))
    key = remembered.content(name, path, viewpoints, shape, *given)
    return remembered.once("shots", object, key, partial(_made, name, path, viewpoints, scene, *given))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Before its fixtures of any scope."""
    anew = item.get_closest_marker("anew") or "monkeypatch" in getattr(item, "fixturenames", ())
    mission.shots_of = _made if anew else shots_of


@pytest.fixture(scope="package", autouse=True)
def photos_anew_afterwards() -> Iterator[None]:
    """Tests of other folders in this process compute everything."""
    yield
    mission.shots_of = _made
