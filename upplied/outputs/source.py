"""What reports read: a catalog, or anything that answers like one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import pandas as pd

from upplied.records import Demonstration, Structure, SurfaceStates
from upplied.records.plans import SupposedSurface


class Source(Protocol):
    """What reports read: the catalog, or anything that answers like it."""

    def transfers(
        self,
        *,
        every: bool = False,
        demonstration: str | None = None,
        structure: str | None = None,
        ids: Sequence[str] | None = None,
        columns: Sequence[str] | None = None,
    ) -> pd.DataFrame:
        """One row per plan, refused and failed ones too; with `every`, the older ones as well.

        Of a demonstration, a target, or plans by their ids; some columns, or all.
        """

    def structures(self) -> pd.DataFrame:
        """One row per structure, with its `sha256`."""

    def demonstrations(self) -> pd.DataFrame:
        """One row per demonstration, with its `sha256`."""

    def waypoints(self, transfer_id: str) -> pd.DataFrame:
        """The steps of one plan, in order."""

    def surface(self, transfer_id: str) -> SurfaceStates | None:
        """What one plan sees of its target, where that is still known."""

    def inspected(self, transfer_id: str) -> SurfaceStates | None:
        """What of its source the demonstration of one plan was about, where that is still known."""

    def supposed(self, transfer_id: str) -> SupposedSurface | None:
        """What of the target of one plan was never scanned; None where nothing is missing."""

    def structure(self, structure_id: str) -> Structure:
        """One structure with its mesh."""

    def demonstration(self, demonstration_id: str) -> Demonstration:
        """One demonstrated flight."""
