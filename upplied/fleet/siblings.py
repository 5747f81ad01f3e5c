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
        scans = table[~labelled.fillna(mesh)]
        self._scans = dict(zip(scans["structure_id"], scans["kind"], strict=True))
        self._sha256 = dict(zip(table["structure_id"], table["sha256"], strict=True))
        self._size = dict(zip(table["structure_id"], table[_SIZE].to_numpy(float), strict=True))
        known = table[mesh & labelled.fillna(True)].groupby("kind")
        self._known = {
            str(kind): (list(rows["structure_id"]), rows[_SIZE].to_numpy(float)) for kind, rows in known
        }
        self._nearest: dict[tuple[str, int], tuple[str, ...]] = {}

    def __call__(self, source_id: str, target_id: str, most: int) -> Siblings:
        """At most so many siblings of a target, by their ids; none where its own pieces tell its parts."""
        if most < 1 or target_id not in self._scans:
            return ()
        if (target_id, most) not in self._nearest:
            known = self._known.get(self._scans[target_id], ([], np.empty((0, 3))))
            # One more, since the source may be among them.
            nearest = nearest_in_proportions(self._size[target_id], *known, most + 1)
            self._nearest[target_id, most] = nearest
        chosen = [name for name in self._nearest[target_id, most] if name != source_id][:most]
        return tuple((name, self._sha256[name]) for name in sorted(chosen))
