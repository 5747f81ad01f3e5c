"""Which structures of a kind are asked for the parts of a scan: those nearest to it in proportions."""

from __future__ import annotations

import numpy as np
import pandas as pd

from upplied.planning.correspondence.siblings import nearest_in_proportions

Siblings = tuple[tuple[str, str], ...]  # id and hash of each

_SIZE = ["size_x_m", "size_y_m", "size_z_m"]


class SiblingsOf:
    """The siblings of each structure of a catalog, by its table of structures alone.

    A structure of which it was never asked whether its pieces tell its parts is a scan if it is a cloud, and
    if it is a mesh one that may know: planning asks it again.
    """

    def __init__(self, structures: pd.DataFrame) -> None:
        table = structures.sort_values("structure_id")
        labelled = table["tells_parts"].astype("boolean")
        mesh = table["n_triangles"] > 0
        self._scans = dict(zip(table["structure_id"], table["kind"], strict=True))
        self._scans = {
            name: kind
            for (name, kind), scan in zip(self._scans.items(), ~labelled.fillna(mesh), strict=True)
            if scan
        }
        self._sha256 = dict(zip(table["structure_id"], table["sha256"], strict=True))
        self._size = dict(zip(table["structure_id"], table[_SIZE].to_numpy(float), strict=True))
        known = table[mesh & labelled.fillna(True)]
        self._known = {str(kind): list(rows["structure_id"]) for kind, rows in known.groupby("kind")}
        self._sizes = {
            kind: np.array([self._size[name] for name in names]) for kind, names in self._known.items()
        }
        self._nearest: dict[tuple[str, int], tuple[str, ...]] = {}

    def __call__(self, source_id: str, target_id: str, most: int) -> Siblings:
        """At most so many siblings of a target, by their ids; none where its own pieces tell its parts."""
        if most < 1 or target_id not in self._scans:
            return ()
        kind = self._scans[target_id]
        if (target_id, most) not in self._nearest:
            names, sizes = self._known.get(kind, []), self._sizes.get(kind, np.empty((0, 3)))
            # One more, since the source may be among them.
            nearest = nearest_in_proportions(self._size[target_id], names, sizes, most + 1)
            self._nearest[target_id, most] = nearest
        chosen = [name for name in self._nearest[target_id, most] if name != source_id][:most]
        return tuple((name, self._sha256[name]) for name in sorted(chosen))
