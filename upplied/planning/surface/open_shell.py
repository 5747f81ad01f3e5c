"""The inside of a shell that is open where nothing was scanned: it can be seen, and is no outside.

Rays escape from both sides of a thin sheet, and from both sides of a shell next to a hole. So winding is
asked of scans alone, and only which side of a piece is its front: the one that mostly shows.
"""

from __future__ import annotations

import numpy as np

from upplied.planning.surface.escape import DIRECTIONS
from upplied.records import Bools, Floats, Ints, Structure
from upplied.scene import Scene
from upplied.vectors import area_vectors, sphere


def inside_open_shell(
    points: Floats, triangle: Ints, side: Floats, both: Bools, piece: Ints, structure: Structure, scene: Scene
) -> Bools:
    """Which sides (S,) that rays escape from lie inside a shell that is open where nothing was scanned.

    From there more rays meet backs than do not, on pieces that mostly show from one side alone. What is no
    scan has no such sides: the ducts and cabins of a model are open as they are meant to be.

    Parameters
    ----------
    points : array, shape (S, 3), m
        Where each side was sampled.
    triangle : array of int, shape (S,)
    side : array, shape (S,)
        +1 along the normal as wound, or -1.
    both : array of bool, shape (S,)
        Whether rays escape from the other side of the same place as well.
    piece : array of int, shape (T,)
        The piece of each triangle (`parts.mesh_pieces`).
    structure : Structure
    scene : Scene
        Of the same structure.
    """
    inside = np.zeros(len(points), bool)
    if not structure.is_scan or not both.any():
        return inside
    of, number = piece[triangle], int(piece.max()) + 1
    shown = np.bincount(of[~both], weights=side[~both], minlength=number)
    # A tank, a boat: what mostly shows from both sides is no shell that happens to be open.
    from_one, from_both = (np.bincount(of[some], minlength=number) for some in (~both, both & (side > 0)))
    front = np.where(from_one > from_both, np.sign(shown), 0)[piece]  # of each triangle, as wound
    asked = np.flatnonzero(both & (side * front[triangle] < 0))
    outward = area_vectors(structure.vertices[structure.triangles[triangle[asked]]])
    outward *= (side[asked] / np.linalg.norm(outward, axis=1))[:, None]
    directions = sphere(DIRECTIONS)
    owner, which = np.nonzero(outward @ directions.T > 0)
    starts = points[asked] + 1e-5 * structure.diagonal_m * outward
    _, met, wound = scene.cast(starts[owner], directions[which])
    along = np.einsum("ij,ij->i", wound, directions[which])
    back = (met >= 0) & (front[met] * along > 0)
    backs, others = (np.bincount(owner, weights=some, minlength=len(asked)) for some in (back, ~back))
    inside[asked] = backs > others
    return inside
