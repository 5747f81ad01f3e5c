"""The catalog: what is kept of structures, demonstrations and plans, and the way in and out.

A commit is whole or it is not there. The rows of `waypoints` and `poses` are committed before the
row that names them, and that row says by which commit they came, so nobody ever reads a trajectory
without its points, or with the points of a writer that was stopped half-way.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from upplied.catalog.reading import OWNER, Reading
from upplied.catalog.store.labels import labelled
from upplied.catalog.verbs import adding, belonging, decisions, looks, required
from upplied.catalog.verbs.adding import Planned
from upplied.catalog.verbs.frames import frame
from upplied.catalog.verbs.leaving import ASKED, check_leaves
from upplied.catalog.verbs.queries import PlannedTrajectory
from upplied.records import Demonstration, Plan, Structure, Trajectory

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


class Catalog(Reading):
    """A catalog at a location; see `open_catalog`.

    Every question is answered with a DataFrame whose units are in ``frame.attrs["units"]``, or with
    a record. A moment may be a datetime or a text such as ``2026-11-21T02:00Z`` (UTC where no zone
    is said); `as_of` asks how the catalog stood then.
    """

    # --- asking: tables ------------------------------------------------------------------------

    def in_force(self, *, structure: str | None = None, kind: str | None = None) -> pd.DataFrame:
        """The plans in force, as `transfers` has them, with two columns more.

        `newer_draft` is the newest plan of the same pair and preset where that is another one, and
        `target_changed` tells that the structure is not as it was when the plan was last judged.
        """
        return decisions.in_force(self, structure=structure, kind=kind)

    def recalled(self, *, structure: str | None = None) -> pd.DataFrame:
        """Plans that were recalled and in whose place nobody released another."""
        return decisions.recalled(self, structure)

    def decisions(self, transfer_id: str | None = None) -> pd.DataFrame:
        """What was decided about plans, in the order of commits; about one, or all."""
        return decisions.decisions(self, transfer_id)

    # --- asking: records -----------------------------------------------------------------------

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

    # --- adding --------------------------------------------------------------------------------

    def add_structures(self, structures: Sequence[Structure]) -> int:
        """Add structures in one commit; returns how many were new or changed.

        One that says the same as its current version adds nothing. The mesh is kept before the row
        that names it.
        """
        return adding.add_structures(self, structures)

    def add_demonstrations(self, demonstrations: Sequence[Demonstration]) -> int:
        """Add demonstrations in one commit; returns how many were new or changed."""
        return adding.add_demonstrations(self, demonstrations)

    def add_plans(self, plans: Sequence[Planned]) -> int:
        """Add plans in one commit; returns how many rows came of it.

        Parameters
        ----------
        plans : sequence of (key, plan, provenance)
            The key is the hash of everything the plan depends on; one that is known adds nothing,
            with two exceptions: a failure makes way for a later result and for the failure of another
            run, and a plan that had been followed by another of its pair becomes current again. For the
            provenance see `upplied.catalog.schema.plan_rows.transfer_row`; hashes it leaves out are those of
            the current versions in the catalog.
        """
        return adding.add_plans(self, plans)

    def keep_surface(self, plan: Plan) -> Plan:
        """Keep what a plan sees of its target; returns the plan with the hash of it, still to be added.

        A process that plans does so, and sends the rest to the one that commits.
        """
        return adding.keep_surface(self, plan)

    def add_flight(self, row: Mapping[str, Any], path: Trajectory) -> int:
        """Add one flight of a plan: a row of `flights` without its commit and hash, and what was flown."""
        return adding.add_flight(self, row, path)

    def add_overruled(self, given: Sequence[Mapping[str, Any]]) -> int:
        """Keep which rules of the gate a person overruled; what is known already adds nothing.

        Parameters
        ----------
        given : sequence of mappings
            Rows of `overruled`, without their id and commit.
        """
        return adding.add_overruled(self, given)

    def retire_structures(self, structure_ids: Sequence[str]) -> int:
        """Take structures out of the fleet; their history stays. Returns how many were taken out."""
        return adding.retire(self, "structures", structure_ids)

    def retire_demonstrations(self, demonstration_ids: Sequence[str]) -> int:
        """Take demonstrations out of use; their history stays. Returns how many were taken out."""
        return adding.retire(self, "demonstrations", demonstration_ids)

    # --- settings of things --------------------------------------------------------------------

    def set(self, scope: str, owner: str, values: Mapping[str, Any], by: str, note: str = "") -> int:
        """Say settings of a kind or a structure, which its plans are then made with.

        Parameters
        ----------
        scope : {"kind", "structure"}
        owner : str
            The kind, or the id of the structure.
        values : mapping
            Setting to value, as ``{"route.clearance_m": 3.0}``; None takes it back.
        by : str
            Who says so.
        note : str
        """
        return belonging.say(self, scope, owner, values, by, note)

    def said_settings(self) -> pd.DataFrame:
        """What was ever said of settings of kinds and structures, in the order of commits."""
        found = frame(self.tables["settings"].read()).sort_values("commit_version", kind="stable")
        return found.reset_index(drop=True)

    def settings_of(self, structure_id: str) -> pd.DataFrame:
        """Every setting that plans of a structure are made with, its value and where that comes from."""
        return belonging.settings_of(self, structure_id)

    def require(
        self,
        scope: str,
        owner: str,
        name: str,
        zones: Sequence[Mapping[str, Any]],
        by: str,
        note: str = "",
    ) -> int:
        """Say which zones of a structure, or of all of a kind, must be seen: the next version of a set.

        Parameters
        ----------
        scope : {"kind", "structure"}
        owner : str
            The kind, or the id of the structure.
        name : str
            Of the set.
        zones : sequence of mapping
            Each with `zone` (its name), `where` (landmarks, part_0, "box X Y Z X Y Z", "ball X Y Z R", m,
            "labels HASH LABEL" of `add_labels`), `on`, and what is asked: `looks`, `gsd_mm`,
            `incidence_deg`, `max_age_days`. None takes the set back.
        by : str
            Who asks.
        note : str
        """
        return required.require(self, scope, owner, name, zones, by, note)

    def add_labels(self, structure_id: str, labels: Sequence[str]) -> str:
        """Keep the label of each face of a structure's mesh, in their order; returns the hash.

        A zone is then ``labels HASH LABEL``: the faces that have it.
        """
        return self.labels.put(labelled(self.structure(structure_id), labels))

    def requirements(self, every: bool = False) -> pd.DataFrame:
        """Sets of requirements, the newest version of each; with `every`, older and taken back ones too."""
        return required.requirements(self, every)

    # --- changes of plans ----------------------------------------------------------------------

    def edits(self) -> pd.DataFrame:
        """What people changed of plans, and to which plans made later that was carried over."""
        found = frame(self.tables["edits"].read()).sort_values("commit_version", kind="stable")
        return found.reset_index(drop=True)

    def add_edit(self, row: Mapping[str, Any]) -> int:
        """Keep a change of a plan: a row of `edits` without its commit; one that is known adds nothing."""
        known = set(self.edits()["edit_id"])
        return 0 if row["edit_id"] in known else adding.add_rows(self, "edits", [dict(row)])

    # --- deciding ------------------------------------------------------------------------------

    def review(self, transfer_id: str, by: str, note: str = "") -> str:
        """Say that somebody looked at a plan and found nothing against it; the name of the decision."""
        return decisions.review(self, transfer_id, by, note)

    def reject(self, transfer_id: str, by: str, note: str = "") -> str:
        """Say that a plan must not be flown; where it was in force, none is then."""
        return decisions.reject(self, transfer_id, by, note)

    def release(
        self, transfer_id: str, by: str, note: str = "", force: Sequence[str] = (), after: str | None = None
    ) -> str:
        """Put a plan in force for its demonstration and target, until a person releases another.

        Parameters
        ----------
        transfer_id : str
        by : str
            Who releases it.
        note : str
        force : sequence of str
            Rules that are overruled: preset, verdict, rejected, recalled, changed.
        after : str, optional
            The last decision about the pair that the person knew of; none: the last there is now.

        Returns
        -------
        str
            The name of the decision.

        Raises
        ------
        RefusedError
            If the plan has no path, is an experiment, breaks a rule that is not overruled, or somebody
            else decided about the pair meanwhile.
        """
        return decisions.release(self, transfer_id, by, note, force, after)
