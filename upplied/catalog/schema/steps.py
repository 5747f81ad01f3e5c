"""Timed poses as rows of `poses` and `waypoints`, one row per step, and back."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.schema.tables import TABLES, Table
from upplied.errors import CatalogError
from upplied.records import Bools, Demonstration, Floats, Ints, Trajectory

Stated = Mapping[tuple[str, str], tuple[int, str]]  # owner and commit -> count and hash of its steps

POSE = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
_ZOOM = ("hfov_deg", "vfov_deg")
ORIGINS = ("demonstrated", "added")


def step_table(
    table: Table, paths: Sequence[tuple[str, Trajectory | Demonstration]], columns: Mapping[str, list[Any]]
) -> pa.Table:
    """Rows of a table of steps, but for their commit: paths with their owners' ids, and more columns."""
    if not paths:
        return table.schema.empty_table()
    names, flown = zip(*paths, strict=True)
    counts = [len(path.positions) for path in flown]
    unzoomed = np.full((max(counts), 2), np.nan)
    zooms = [unzoomed[: len(one.positions)] if one.fov_deg is None else one.fov_deg for one in flown]
    values: dict[str, Any] = {name: np.concatenate(parts) for name, parts in columns.items()}
    positions = np.concatenate([path.positions for path in flown]).astype(float, copy=False)
    quats = stored_quats(np.concatenate([path.quat_xyzw for path in flown]))
    values |= dict(zip(POSE, np.ascontiguousarray(np.column_stack([positions, quats]).T), strict=True))
    for name, angles in zip(_ZOOM, np.concatenate(zooms).T, strict=True):
        values[name] = pa.array(np.ascontiguousarray(angles), from_pandas=True)
    values["seq"] = np.concatenate([np.arange(count) for count in counts])
    values["commit_id"] = pa.repeat("", sum(counts))
    values[table.names[0]] = pa.array(names).take(pa.array(np.repeat(np.arange(len(counts)), counts)))
    return pa.table([pa.array(values[name]) for name in table.names], schema=table.schema)


def zoom_of(steps: pa.Table) -> Floats | None:
    """Fields of view (N, 2), deg, of rows in order; None where the camera does not zoom."""
    if any(name not in steps.column_names for name in _ZOOM):  # rows of before there were such columns
        return None
    angles = np.column_stack([steps[name].to_numpy(zero_copy_only=False) for name in _ZOOM]).astype(float)
    return None if np.isnan(angles).all() else angles


def added_of(steps: pa.Table) -> Bools | None:
    """Which rows of `waypoints` (N,) lie on added passes; None where that was not stored."""
    if "origin" not in steps.column_names or not pc.all(pc.is_in(steps["origin"], pa.array(ORIGINS))).as_py():
        return None
    return np.asarray(pc.equal(steps["origin"], ORIGINS[1]))


def stored_quats(quat_xyzw: Floats) -> Floats:
    """The same orientations with w >= 0; no other digit changes."""
    quats = np.asarray(quat_xyzw, float)
    return np.where(quats[:, 3:] < 0, -quats, quats) + 0.0  # and no negative zeros


def pose_arrays(steps: pa.Table) -> tuple[Floats, Floats]:
    """Positions (N, 3), m, and orientations (N, 4) of rows in order."""
    columns = [steps[name].to_numpy() for name in POSE]
    return np.column_stack(columns[:3]), np.column_stack(columns[3:])


def poses_sha256(
    t: Floats | Ints,
    positions: Floats,
    quat_xyzw: Floats,
    flags: Bools | None = None,
    fov_deg: Floats | None = None,
    added: Bools | None = None,
) -> str:
    """Hash of poses as they are stored, the same on every machine."""
    added = added if added is not None and added.any() else None  # paths without any hash as they always did
    poses = t, np.asarray(positions, float), stored_quats(quat_xyzw), flags, fov_deg, added
    return hashlib.sha256(b"".join(_bytes(part)[0] for part in poses if part is not None)).hexdigest()


def _bytes(values: Any) -> tuple[memoryview, int]:
    """The bytes of values of N rows, the same on every machine, and how many a row has."""
    little = np.ascontiguousarray(values, np.asarray(values).dtype.newbyteorder("<"))
    return little.reshape(-1).view(np.uint8).data, little.nbytes // max(len(little), 1)


def unlike(name: str, steps: pa.Table, stated: Stated) -> Iterator[tuple[str, str]]:
    """Owners whose ordered steps (`poses` or `waypoints`) are not of the count and hash `stated`, and why."""
    key = [TABLES[name].names[0], "commit_id"]
    starts = run_starts(steps, key)
    firsts = steps.select(key).take(pa.array(starts))
    names = list(zip(*(column.to_pylist() for column in firsts.columns), strict=True))
    stops = np.append(starts[1:], len(steps))
    there = dict(zip(names, (stops - starts).tolist(), strict=True))
    miscounted = {owner for owner, (count, _) in stated.items() if there.get(owner, 0) != count}
    for owner in filter(miscounted.__contains__, stated):
        yield owner[0], f"{there.get(owner, 0)} steps are stored, the row says {stated[owner][0]}"
    if not len(steps):
        return
    times, zooms = steps["t_s" if name == "waypoints" else "t_ns"].to_numpy(), zoom_of(steps)
    wrong = steps["seq"].to_numpy() != np.arange(len(steps)) - np.repeat(starts, stops - starts)
    late = np.diff(times, prepend=0) <= 0
    late[starts] = False
    misnumbered, unordered = np.logical_or.reduceat(wrong, starts), np.logical_or.reduceat(late, starts)
    positions, quats = pose_arrays(steps)
    every = [True] * len(names)
    hashed = [(*_bytes(part), every) for part in (times, positions, stored_quats(quats))]
    if name == "waypoints":
        hashed.append((*_bytes(np.asarray(steps["is_viewpoint"])), every))
    if zooms is not None:  # those of the owners that zoom
        zooming = np.logical_or.reduceat(~np.isnan(zooms).all(axis=1), starts)
        hashed.append((*_bytes(zooms), zooming.tolist()))
    if "origin" in steps.column_names:  # of each owner by itself: plans of other presets store no origin
        added = np.asarray(pc.equal(steps["origin"], ORIGINS[1]).combine_chunks().fill_null(False))
        hashed.append((*_bytes(added), np.logical_or.reduceat(added, starts).tolist()))
    for at, (owner, first, end) in enumerate(zip(names, starts.tolist(), stops.tolist(), strict=True)):
        if owner in miscounted:
            continue
        if misnumbered[at]:
            yield owner[0], "the steps are not numbered 0, 1, 2 ..."
        elif unordered[at]:
            yield owner[0], "time does not increase"
        else:
            content = b"".join([part[first * n : end * n] for part, n, counts in hashed if counts[at]])
            if hashlib.sha256(content).hexdigest() != stated[owner][1]:
                yield owner[0], "the steps do not match the hash in their row"


def checked(name: str, steps: pa.Table, stated: Stated) -> pa.Table:
    """Ordered steps; where they are `unlike` what the rows of their owners say, an error."""
    for owner, wrong in unlike(name, steps, stated):
        remedy = "take the damaged files (upplied catalog verify) from a backup; nothing was written"
        raise CatalogError(f"{name} of {owner}", wrong, "", remedy)
    return steps


def run_starts(rows: pa.Table, names: Sequence[str]) -> Ints:
    """Where one of these texts is another one than in the row before: rows of one owner lie together."""
    if not len(rows):
        return np.empty(0, np.int64)
    differs = np.zeros(len(rows), bool)
    differs[0] = True
    for name in names:
        column = rows[name]
        differs[1:] |= pc.not_equal(column.slice(1), column.slice(0, len(rows) - 1)).to_numpy()
    return np.flatnonzero(differs)
