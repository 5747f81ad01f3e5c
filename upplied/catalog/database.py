"""The catalog: what is kept of structures, demonstrations and plans, and the way in and out.

A commit is whole or not there; rows of steps stand before the row that names them and their commit, so
nobody reads a trajectory without its points, or with those of a writer that was stopped half-way.
"""

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.compute as pc

from upplied.catalog.reading import OWNER
from upplied.catalog.schema import plan_rows
from upplied.catalog.schema.steps import POSE
from upplied.catalog.store.contents import Samples, StoredLooks
from upplied.catalog.verbs import custody, ordering, queries
from upplied.catalog.verbs.decisions import Deciding
from upplied.errors import RefusedError, SettingsError
from upplied.records import Bools, Floats, Ints, Plan, Structure, SupposedSurface, SurfaceStates, Trajectory

_FLIGHT = ["flight_id", "transfer_id", "kind", "flown_at", "operator"]
_LOOK = ["distance_m", "incidence_deg", "speed_mps", "t_s"]
_OF_PHOTO = ["patches", "gsd_mm", "blur_px", "overlap_pct"]
#: Of a row of `transfers`, what tells whether it may leave.
_JUDGED = (*OWNER, "demonstration_id", "target_id", "preset", "not_flyable", "imported_from")


def open_catalog(location: str | os.PathLike[str], cache: str | os.PathLike[str] | None = None) -> "Catalog":
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

    def trajectory(self, transfer_id: str, force: Collection[str] = ()) -> queries.PlannedTrajectory:
        """One planned trajectory, to be flown; it can be asked for its pose at any time.

        Plans that may not be flown are looked at through `plan` and `waypoints`.

        Parameters
        ----------
        transfer_id : str
        force : collection of str
            Rules that are overruled: ``preset``, ``verdict``, ``foreign``, ``altered``, ``rejected``,
            ``recalled``, ``superseded`` (docs/checks.md).

        Raises
        ------
        CatalogError
            If the transfer is not known, or has no trajectory because it was refused or failed, or its
            steps are not those that were planned.
        RefusedError
            If it is for comparison, falls short of its floors, was rejected or
            recalled, or another took its place.
        """
        row, broken = self.transfer(transfer_id, _JUDGED), dict[str, str]()
        path = self.path_of(row)  # compared with its hash: it is the one that its verdict is of
        if row["preset"] != "recommended":
            broken["preset"] = f"the plan is of preset {row['preset']}, which is for comparison"
        if row["not_flyable"]:
            broken["verdict"] = str(row["not_flyable"])
        if plan_rows.is_foreign(row):
            broken["foreign"] = custody.FOREIGN_PLAN[0]
        now = self.standing()
        state = now.of(transfer_id)
        for fault in custody.alterations(self, [transfer_id], now).values():
            broken["altered"] = fault
        if state in ("rejected", "recalled", "superseded"):
            broken[state] = f"the plan is {state}"
        elif state != "released" and ordering.superseded(self.tables["transfers"], [row]):
            broken["superseded"] = "a newer plan of this pair and preset took its place"
        left = {rule: reason for rule, reason in broken.items() if rule not in force}
        if left:
            names = ", ".join(f'"{rule}"' for rule in left)
            remedy = f"to look at it: plan() or waypoints(); to fly it all the same: force=[{names}]"
            words = "; ".join(f"{rule}: {reason}" for rule, reason in left.items())
            raise RefusedError(f"transfer {transfer_id}", words, "only what may be flown leaves", remedy)
        return path

    def plan(self, transfer_id: str) -> Plan:
        """One plan as it was made, but for what it sees of the surface; see `surface`."""
        row = self.transfer(transfer_id)
        plan = plan_rows.plan_of(row, queries.steps(self.tables["waypoints"], row))
        return replace(plan, supposed=self.supposed(transfer_id))

    def surface(self, transfer_id: str) -> SurfaceStates | None:
        """What one plan sees of its target; None where it was not kept."""
        if sha256 := self._sha256(transfer_id, "surface_sha256"):
            return self.surfaces.get(sha256)
        return self.cache.get("surface", SurfaceStates, transfer_id, nameless=True)  # of version 0.1.0

    def inspected(self, transfer_id: str) -> SurfaceStates | None:
        """What of its source structure the demonstration of a plan was about; None where it was not kept."""
        sha256 = self._sha256(transfer_id, "inspected_sha256")
        return self.surfaces.get(sha256) if sha256 else None

    def faces_labelled(self, structure: Structure, sha256: str, label: str) -> Bools:
        """Which faces (T,) of a structure have a label of those that are kept under a hash."""
        return self.contents["labels"].get(sha256).faces(structure, label)

    def flown(self, flight_sha256: str) -> Trajectory:
        """The path of one flight, by the hash in its row."""
        return self.contents["flown"].get(flight_sha256)

    def photos(self, transfer_id: str) -> pd.DataFrame:
        """The photos of a plan, one a row in the order of flight; none of a plan from a film.

        Columns ``t_s``, ``x_m`` to ``z_m``, ``qx`` to ``qw`` (camera to structure), ``patches`` that it shows
        sharply, ``gsd_mm`` and ``blur_px``, medians over these, and ``overlap_pct`` with the one before.
        """
        if not (sha256 := self._sha256(transfer_id, "photos_sha256")):
            return pd.DataFrame(columns=["t_s", *POSE, *_OF_PHOTO])
        photos = self.contents["photos"].get(sha256)
        table = pd.DataFrame(np.column_stack([photos.positions, photos.quat_xyzw]), columns=POSE)
        table.insert(0, "t_s", photos.t_s)
        return table.assign(**{name: getattr(photos, name) for name in _OF_PHOTO})

    def supposed(self, transfer_id: str) -> SupposedSurface | None:
        """What nobody scanned of a plan's target, where it was supposed when last judged; None: none."""
        where = (pc.field("transfer_id") == transfer_id) & (pc.field("state") == "rechecked")
        again = ordering.by_commit(self.tables["decisions"].read(where))
        sha256 = again[-1]["supposed_sha256"] if again else self._sha256(transfer_id, "supposed_sha256")
        return self.contents["supposed"].get(sha256) if sha256 else None

    def _sha256(self, transfer_id: str, column: str) -> str:
        return self.transfer(transfer_id, (column,))[column] or ""

    def looks_at(self, structure_id: str, place_m: Sequence[float], kind: str = "") -> pd.DataFrame:
        """How each flight round a structure saw the patch nearest to a place (m, structure frame).

        One row per flight in the order of flying: when, whether it saw the patch, and the nearest look at it
        (distance, incidence, speed); `patch_off_m` says how far the patch is from the place.
        """
        place = np.asarray(place_m, float)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise SettingsError("place", f"is {place_m}", "three coordinates, m, structure frame")
        read, where = [*_FLIGHT, "looks_sha256", *ordering.COMMIT], pc.field("target_id") == structure_id
        nearest: dict[str, tuple[int, float]] = {}
        flights = []
        for row in ordering.by_commit(self.tables["flights"].read(where, read)):
            if not row["looks_sha256"] or kind not in ("", row["kind"]):
                continue
            looks = self.looks.get(row["looks_sha256"]).certain
            if looks.samples_sha256 not in nearest:
                gap = np.linalg.norm(self.surfaces.points(looks.samples_sha256) - place, axis=1)
                nearest[looks.samples_sha256] = int(gap.argmin()), float(gap.min())
            patch, off = nearest[looks.samples_sha256]
            at = int(np.searchsorted(looks.patch, patch))
            seen = bool(at < len(looks.patch) and looks.patch[at] == patch)
            values = {name: row[name] for name in _FLIGHT} | {
                "seen": seen,
                "patch": patch,
                "patch_off_m": off,
            }
            values |= {name: float(getattr(looks, name)[at]) if seen else float("nan") for name in _LOOK}
            flights.append(values)
        table = pd.DataFrame(flights, columns=[*_FLIGHT, "seen", *_LOOK, "patch", "patch_off_m"])
        return table.sort_values("flown_at", kind="stable", ignore_index=True)

    def put_looks(
        self,
        points: Floats,
        normals: Floats | None,
        seen: Bools,
        values: Mapping[str, Floats],
        pictures: Ints | None = None,
        assumed: Bools | None = None,
        **inspected: Bools | None,
    ) -> str:
        """Keep how a flight saw the samples (N, 3) of a surface, all else (N,); returns the hash.

        `values` are `distance_m`, `incidence_deg`, `speed_mps`, `t_s`, and distance and incidence of the most
        frontal look; `assumed` was seen besides if the correction of the log is right; `inspected` and
        `inspected_if_corrected`: looked at as the plan asks.
        """
        samples = self.surfaces.samples.put(Samples(points, normals))
        besides = np.zeros(len(seen), bool) if assumed is None else assumed
        patch = np.flatnonzero(seen | besides)
        small: dict[str, Any] = {name: value[patch].astype(np.float32) for name, value in values.items()}
        small |= {k: flag[patch].astype(np.uint8) for k, flag in inspected.items() if flag is not None}
        small["pictures"] = None if pictures is None else np.minimum(pictures[patch], 65535).astype(np.uint16)
        small["assumed"] = besides[patch].astype(np.uint8) if besides.any() else None
        number: Any = patch.astype(np.int32)
        return self.looks.put(StoredLooks(samples, number, **small))

    def edits(self) -> pd.DataFrame:
        """What people changed of plans, and to which plans made later that was carried over."""
        return self.by_commit("edits")

    def add_edit(self, row: Mapping[str, Any]) -> int:
        """Keep a change of a plan: a row of `edits` without its commit; one that is known adds nothing."""
        return 0 if row["edit_id"] in set(self.edits()["edit_id"]) else self.add_rows("edits", [dict(row)])
