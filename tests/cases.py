"""Cases of a test of which a few tell in the continuous integration, and all of them before a release."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def slow_after(first: int, cases: Iterable[Any]) -> list[Any]:
    """The cases, those after the first few marked slow."""
    every = list(cases)
    rest = (case if isinstance(case, tuple) else (case,) for case in every[first:])
    return [*every[:first], *(pytest.param(*case, marks=pytest.mark.slow) for case in rest)]
