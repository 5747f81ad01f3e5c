"""What a mesh file holds, before anything is converted or repaired."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from upplied.records import Floats, Ints, Record


@dataclass(frozen=True, eq=False, repr=False)
class RawMesh(Record):
    """Vertices and triangles as in the file: its units, its axes, scenes flattened."""

    vertices: Floats  # (V, 3) units of the file
    triangles: Ints  # (T, 3); (0, 3) for a point cloud
    normals: Floats | None = None  # (V, 3) as given, for point clouds
    part: Ints = field(default_factory=lambda: np.empty(0, np.int64))  # (T,) index into part_names
    part_names: tuple[str, ...] = ()
    unit_m: float | None = None  # what the file declares; None where it does not
    up: str = ""  # axis that the file declares to be up; empty where it does not
    remarks: tuple[str, ...] = ()  # what was triangulated, flattened or skipped, in words
