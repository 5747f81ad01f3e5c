"""The terms of the optimisation, a file each: a value, and its slope with respect to the flown path."""

from __future__ import annotations

from typing import Protocol

from upplied.planning.trajectory.state import Flown


class Term(Protocol):
    """What a path is asked for, as a number that is to become small."""

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """The number in the term's unit, and its slope: derivatives by positions, yaw and pitch."""
        ...
