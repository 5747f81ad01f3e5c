"""Trajectories as text files of TUM's format, which ``evo`` reads, and how to split them for learning.

A line is ``t x y z qx qy qz qw``: s, m, camera frame (x forward) to structure frame.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from upplied.catalog.store.files import replace_file
from upplied.catalog.verbs.dataset_files import new_folder, with_path
from upplied.errors import InputError
from upplied.records import Trajectory

if TYPE_CHECKING:
    from upplied.catalog.database import Catalog

SHARES = {"train": 0.8, "validation": 0.1, "test": 0.1}


def export_tum(
    catalog: Catalog, folder: str | os.PathLike[str], transfers: pd.DataFrame | Sequence[str]
) -> dict[str, int]:
    """Write plans, and every demonstration in use, as one text file each, with ``splits.json``.

    Parameters
    ----------
    catalog : Catalog
    folder : path
        New, or empty.
    transfers : DataFrame or sequence of str
        Rows of `Catalog.transfers`, or names of plans; those without a trajectory are left out.

    Returns
    -------
    dict
        Number of plans and demonstrations.
    """
    place = new_folder(folder)
    rows = with_path(catalog, transfers)
    flights = list(catalog.demonstrations()["demonstration_id"])
    if not rows and not flights:
        raise InputError("trajectories", "there are none", "at least one plan or demonstration")
    for row in rows:
        path = catalog.path_of(row)
        _write(place / "plans" / f"{row['transfer_id']}.txt", path.t_s, path)
    for name in flights:
        flown = catalog.demonstration(name)
        _write(place / "demonstrations" / f"{name}.txt", flown.t_ns * 1e-9, flown.trajectory)
    write_splits(catalog, place, rows)
    return {"plans": len(rows), "demonstrations": len(flights)}


def _write(path: Path, t_s: Any, steps: Trajectory) -> None:
    text = StringIO()
    np.savetxt(text, np.column_stack([t_s, steps.positions, steps.quat_xyzw]), fmt="%.9f")
    replace_file(path, text.getvalue().encode())


def write_splits(
    catalog: Catalog,
    place: Path,
    rows: Iterable[Mapping[str, Any]],
    demonstrations: Iterable[str] | None = None,
    episodes: Sequence[Mapping[str, Any]] = (),
) -> None:
    """Write ``splits.json``: which structures, plans, demonstrations and episodes are for training.

    By structure: none on two sides, each kind on all where it has enough members; by kind: one after the
    other left out.
    """
    kinds, flights = kinds_of(catalog), catalog.demonstrations()
    on = dict(zip(flights["demonstration_id"], flights["structure_id"], strict=True))
    on = on if demonstrations is None else {name: on[name] for name in demonstrations}
    plans = {str(row["transfer_id"]): str(row["target_id"]) for row in rows}
    owned = {"plans": plans, "demonstrations": on}  # by name, with their structures

    def parted(side_of: Mapping[str, str], held: Mapping[str, Mapping[str, str]], column: str) -> Any:
        """What of structures with each value there is, by the value; episodes by a column of theirs."""
        values = SHARES if column == "split" else sorted(set(side_of.values()))
        sides: dict[str, dict[str, list[Any]]] = {}
        for value in values:
            sides[value] = {
                name: sorted(k for k, at in where.items() if side_of.get(at) == value)
                for name, where in held.items()
            }
            if episodes:
                sides[value]["episodes"] = [e["episode_index"] for e in episodes if e[column] == value]
        return sides

    every = {"structures": {name: name for name in kinds}, **owned}
    splits = {
        "by_structure": parted(split_of(kinds), every, "split"),
        "by_kind": parted(kinds, owned, "kind"),
    }
    replace_file(place / "splits.json", (json.dumps(splits, indent=1) + "\n").encode())


def kinds_of(catalog: Catalog) -> dict[str, str]:
    """The kind of each structure in the fleet."""
    structures = catalog.structures()
    return dict(zip(structures["structure_id"], structures["kind"], strict=True))


def split_of(kinds: Mapping[str, str]) -> dict[str, str]:
    """The side of each structure, the same on every machine: by the hash of its name, kind by kind."""
    sides: dict[str, str] = {}
    for kind in sorted(set(kinds.values())):
        names = [name for name in kinds if kinds[name] == kind]
        names.sort(key=lambda name: sha256(name.encode()).hexdigest())
        held_out = round(len(names) * SHARES["test"]) or int(len(names) >= 3)
        validated = round(len(names) * SHARES["validation"]) or int(len(names) >= 3)
        for at, name in enumerate(names):
            beyond = "validation" if at < held_out + validated else "train"
            sides[name] = "test" if at < held_out else beyond
    return sides
