"""Trajectories as text files of TUM's format, which ``evo`` reads.

A line is ``t x y z qx qy qz qw``: s, m, camera frame (x forward) to structure frame.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from upplied.catalog.database import Catalog
from upplied.catalog.verbs.exporting import new_folder, splits_of
from upplied.errors import InputError
from upplied.files import replace_file
from upplied.outputs.learning.episodes import with_path
from upplied.records import Trajectory


def export_tum(
    catalog: Catalog, folder: str | os.PathLike[str], transfers: pd.DataFrame | Sequence[str]
) -> dict[str, int]:
    """Write plans, and every demonstration in use, as one text file each, with ``splits.json``.

    Parameters are those of `export_dataset`; plans without a trajectory are left out. Returns the number of
    plans and demonstrations.
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
    replace_file(place / "splits.json", json.dumps(splits_of(catalog, rows), indent=1))
    return {"plans": len(rows), "demonstrations": len(flights)}


def _write(path: Path, t_s: Any, steps: Trajectory) -> None:
    text = StringIO()
    np.savetxt(text, np.column_stack([t_s, steps.positions, steps.quat_xyzw]), fmt="%.9f")
    replace_file(path, text.getvalue())
