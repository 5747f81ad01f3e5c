"""The catalog: what is kept of structures, demonstrations and plans, and the way in and out.

A commit is whole or it is not there. The rows of `waypoints` and `poses` are committed before the
row that names them, and that row says by which commit they came, so nobody ever reads a trajectory
without its points, or with the points of a writer that was stopped half-way.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from upplied.catalog.reading import OWNER
from upplied.catalog.verbs import looks
from upplied.catalog.verbs.decisions import Deciding
from upplied.catalog.verbs.leaving import ASKED, check_leaves
from upplied.catalog.verbs.queries import PlannedTrajectory

if TYPE_CHECKING:
    import pandas as pd


def open_catalog(location: str | os.PathLike[str], cache: str | os.PathLike[str] | None = None) -> Catalog:
    """Open a catalog; a new one is made when the first row is added, and asking before is an error.

    Parameters
    ----------
    location : path or str
        A folder, or the URI of an object store (``s3://bucket/prefix``). Credentials and endpoint of
        a store are read from the environment (``AWS_ACCESS_KEY_ID``, ``AWS_ENDPOINT_URL``, ...) only.
    cache : path, optional
        Folder of the cache; by default ``cache/`` in the catalog's folder, and for an object store
        a folder in the user's cache directory.

    Examples
    --------
    >>> catalog = open_catalog("catalog")              # doctest: +SKIP
    >>> catalog.transfers(kind="airliner").head()      # doctest: +SKIP
    """
    return Catalog(location, cache)


class Catalog(Deciding):
    """A catalog at a location; see `open_catalog`.

    Every question is answered with a DataFrame whose units are in ``frame.attrs["units"]``, or with
    a record. A moment may be a datetime or a text such as ``2026-11-21T02:00Z`` (UTC where no zone
    is said); `as_of` asks how the catalog stood then.
    """

    def trajectory(self, transfer_id: str, force: Collection[str] = ()) -> PlannedTrajectory:
        """One planned trajectory, to be flown; it can be asked for its pose at any time.

        Plans that may not be flown are looked at through `plan` and `waypoints`.

        Parameters
        ----------
        transfer_id : str
        force : collection of str
            Rules that are overruled: ``preset``, ``verdict``, ``rejected``, ``recalled``, ``superseded``
            (docs/checks.md).

        Raises
        ------
        CatalogError
            If the transfer is not known, or has no trajectory because it was refused or failed, or its
            steps are not those that were planned.
        RefusedError
            If it is for comparison, falls short of its floors, was rejected or
            recalled, or another took its place.
        """
        row = self.transfer(transfer_id, [*OWNER, *ASKED])
        path = self.path_of(row)
        check_leaves(self, row, force)
        return path

    def looks_at(self, structure_id: str, place_m: Sequence[float], kind: str = "") -> pd.DataFrame:
        """How each flight round a structure saw the patch nearest to a place (m, structure frame).

        One row per flight in the order of flying: when, whether it saw the patch, and the nearest look at it
        (distance, incidence, speed); `patch_off_m` says how far the patch is from the place.
        """
        return looks.looks_at(self, structure_id, place_m, kind)

    def edits(self) -> pd.DataFrame:
        """What people changed of plans, and to which plans made later that was carried over."""
        return self.by_commit("edits")

    def add_edit(self, row: Mapping[str, Any]) -> int:
        """Keep a change of a plan: a row of `edits` without its commit; one that is known adds nothing."""
        known = set(self.edits()["edit_id"])
        return 0 if row["edit_id"] in known else self.add_rows("edits", [dict(row)])
