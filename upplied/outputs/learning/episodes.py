"""Plans and demonstrations as episodes: each with what it is to do, how it did and where it came from.

As text files of TUM's format, which ``evo`` reads, they are paths alone.
"""

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from upplied.catalog.database import Catalog
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs.exporting import kinds_of, names_of, new_folder, splits_of
from upplied.errors import InputError
from upplied.files import replace_file
from upplied.records import Trajectory

_PART_PCT = 10  # share of what was inspected from which on a part is named in the task
_FIGURES = ("hfov_deg", "vfov_deg", "path_length_m", "duration_s")
# Of plans alone, words and figures.
_WORDS = [
    "transfer_id", "preset", "state", "not_flyable", "code_version", "method_version", "sources_sha256",
    "libraries", "source_sha256", "target_sha256", "settings_sha256",
]  # fmt: skip
_MEASURED = [
    "coverage_inspected_pct", "coverage_seen_pct", "coverage_attainable_pct", "min_clearance_m", "frechet_z",
    "gsd_mm_p95", "standoff_kept_pct", "acceptance_probability", "counterpart_probability",
    "never_scanned_m2",
]  # fmt: skip


@dataclass(frozen=True)
class Episode:
    """A plan, or an unbroken stretch of a demonstration, and what is said of it."""

    path: Trajectory
    task: str
    about: Mapping[str, Any]  # columns of its row
    split: str


def with_path(catalog: Catalog, transfers: pd.DataFrame | Sequence[str]) -> list[Row]:
    """The rows of some plans, those with a trajectory."""
    return [row for row in map(catalog.transfer, names_of(transfers)) if row["n_waypoints"]]


def of_plans(
    catalog: Catalog, rows: Sequence[Row], flown: Mapping[str, Row], side: Mapping[str, str]
) -> Iterator[Episode]:
    ids = [str(row["transfer_id"]) for row in rows]
    now = catalog.transfers(every=True, ids=ids, columns=["transfer_id", "state"])  # by what people decided
    states = dict(zip(now["transfer_id"], now["state"], strict=True))
    for row in sorted(rows, key=lambda row: str(row["transfer_id"])):
        target, name = str(row["target_id"]), str(row["demonstration_id"])
        about = _facts(flown.get(name, {}), "plan", name, row["source_id"], target, row["kind"])
        about |= {key: row[key] for key in (*_WORDS, *_MEASURED, "path_length_m", "duration_s")}
        about |= {"state": states[row["transfer_id"]], "demonstration_sha256": row["demonstration_sha256"]}
        task = _task(about, row["counterparts"])
        yield Episode(catalog.path_of(row), task, about, side.get(target, "train"))


def of_demonstrations(
    catalog: Catalog, flown: Mapping[str, Row], rows: Sequence[Row], side: Mapping[str, str], fps: int
) -> Iterator[Episode]:
    """What was recorded; nothing is made up for a gap, and what is shorter than two frames is left out."""
    kinds, parts = kinds_of(catalog), {row["demonstration_id"]: row["counterparts"] for row in rows}
    for name, row in sorted(flown.items()):
        record, place = catalog.demonstration(name), str(row["structure_id"])
        about = _facts(row, "demonstration", name, place, place, kinds.get(place, ""))
        about |= dict.fromkeys(_WORDS, "") | dict.fromkeys(_MEASURED, math.nan)
        task = _task(about, parts.get(name, ""), row["about"])
        for begin, end in pairwise([0, *(int(at) for at in record.breaks), len(record.t_ns)]):
            t_s = (record.t_ns[begin:end] - record.t_ns[begin]) * 1e-9
            if len(t_s) and t_s[-1] * fps >= 1:
                path = replace(record.trajectory.take(slice(begin, end)), t_s=t_s)
                yield Episode(path, task, about, side.get(place, "train"))


def _facts(row: Row, origin: str, name: str, source: str, structure: str, kind: str) -> dict[str, Any]:
    """What episodes of plans and of demonstrations both say; the camera is the demonstration's."""
    ids = {"origin": origin, "demonstration_id": name, "source_id": source, "structure_id": structure}
    figures = {key: float(row.get(key, math.nan)) for key in _FIGURES}
    operator, sha256 = (str(row.get(key) or "") for key in ("operator", "sha256"))
    return {**ids, "kind": kind, "operator": operator, **figures, "demonstration_sha256": sha256}


def _task(facts: Mapping[str, Any], counterparts: str, about: str = "") -> str:
    """What is to be done, in words: of a demonstration and of all plans that follow from it the same."""
    known = json.loads(counterparts or "[]")
    named = [one["part"].partition(" (")[2].rstrip(")") for one in known if one["inspected_pct"] >= _PART_PCT]
    parts = " and ".join(f"({place})" for place in named if place)
    what = f"its {'parts' if ' and ' in parts else 'part'} {parts}" if parts else about
    kind, name = facts["kind"].replace("_", " ") or "structure", facts["demonstration_id"]
    return f"Fly the camera round the {kind} and inspect {what or 'what the expert did'}, as {name} shows."


def export_tum(
    catalog: Catalog, folder: str | os.PathLike[str], transfers: pd.DataFrame | Sequence[str]
) -> dict[str, int]:
    """Write plans, and every demonstration in use, as one text file each, with ``splits.json``.

    A line is ``t x y z qx qy qz qw``: s, m, camera frame (x forward) to structure frame. Parameters are those
    of `export_dataset`; plans without a trajectory are left out. Returns the numbers of both.
    """
    place, rows = new_folder(folder), with_path(catalog, transfers)
    flights = list(catalog.demonstrations()["demonstration_id"])
    if not rows and not flights:
        raise InputError("trajectories", "there are none", "at least one plan or demonstration")
    for row in rows:
        path = catalog.path_of(row)
        _write_tum(place / "plans" / f"{row['transfer_id']}.txt", path.t_s, path)
    for name in flights:
        flown = catalog.demonstration(name)
        _write_tum(place / "demonstrations" / f"{name}.txt", flown.t_ns * 1e-9, flown.trajectory)
    replace_file(place / "splits.json", json.dumps(splits_of(catalog, rows), indent=1))
    return {"plans": len(rows), "demonstrations": len(flights)}


def _write_tum(path: Path, t_s: Any, steps: Trajectory) -> None:
    text = StringIO()
    np.savetxt(text, np.column_stack([t_s, steps.positions, steps.quat_xyzw]), fmt="%.9f")
    replace_file(path, text.getvalue())
