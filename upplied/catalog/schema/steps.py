"""Timed poses as rows of `poses` and `waypoints`, one row per step, and back."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import pyarrow as pa

from upplied.catalog.schema.columns import Table
from upplied.records import Bools, Floats, Ints

_POSITION = ("x_m", "y_m", "z_m")
_QUATERNION = ("qx", "qy", "qz", "qw")


def step_table(table: Table, columns: dict[str, Any], positions: Floats, quat_xyzw: Floats) -> pa.Table:
    """Rows of a table of steps: columns by name (a text stands for every row), positions, orientations."""
    count = len(positions)
    quats = stored_quats(quat_xyzw)
    columns = {
        **columns,
        "seq": np.arange(count),
        **dict(zip(_POSITION, np.asarray(positions, float).T, strict=True)),
        **dict(zip(_QUATERNION, quats.T, strict=True)),
    }
    arrays = [
        pa.repeat(values, count) if isinstance(values, str) else pa.array(np.ascontiguousarray(values))
        for values in (columns[name] for name in table.names)
    ]
    return pa.table(arrays, schema=table.schema)


def stored_quats(quat_xyzw: Floats) -> Floats:
    """The same orientations with w >= 0; no other digit changes."""
    quats = np.asarray(quat_xyzw, float)
    return np.where(quats[:, 3:] < 0, -quats, quats) + 0.0  # and no negative zeros


def pose_arrays(steps: pa.Table) -> tuple[Floats, Floats]:
    """Positions (N, 3), m, and orientations (N, 4) of rows in order."""
    return (
        np.column_stack([steps[name].to_numpy() for name in _POSITION]),
        np.column_stack([steps[name].to_numpy() for name in _QUATERNION]),
    )


def poses_sha256(t: Floats | Ints, positions: Floats, quat_xyzw: Floats, flags: Bools | None = None) -> str:
    """Hash of poses as they are stored, the same on every machine."""
    hashed = hashlib.sha256()
    parts: list[Any] = [t, np.asarray(positions, float), stored_quats(quat_xyzw)]
    for part in parts + ([] if flags is None else [flags]):
        values = np.ascontiguousarray(part)
        hashed.update(values.astype(values.dtype.newbyteorder("<"), copy=False).tobytes())
    return hashed.hexdigest()
