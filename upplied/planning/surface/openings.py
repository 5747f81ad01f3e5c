"""Where a scan is open: the inside of its surface shows, since something was never scanned.

Uses rays that escape from the inner side. A closed surface has no such place, and a model may have: ducts,
sheets, hulls without a deck. So a structure is asked about beside another one of its kind.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from upplied.planning.constants import TOUCH
from upplied.planning.geometry.boxes import spacing
from upplied.planning.surface.escape import ESCAPE, escapes
from upplied.records import Bools, Cloud, Structure
from upplied.scene import Scene

_AROUND = 8  # neighbours of a sample, of which half must show their inside as well
_ITSELF = 0.85  # of the way back to the surface, from which what is met on it is the surface itself


def shows_inside(structure: Structure, scene: Scene, cloud: Cloud) -> Bools:
    """Which samples of a surface can be seen from behind, from outside.

    Where a cloud is thinner than it is sampled nobody can tell, and no sample counts.

    Parameters
    ----------
    structure : Structure
    scene : Scene
        Of the same structure.
    cloud : Cloud
        Its N surface samples with normals.

    Returns
    -------
    array of bool, shape (N,)
    """
    shows, inward = np.zeros(len(cloud), bool), -cloud.outward
    gap = scene.grain_m or 1e-5 * structure.diagonal_m
    starts, asked = cloud.points + gap * inward, np.arange(len(cloud))
    if scene.grain_m:
        asked = np.flatnonzero(scene.cast(starts, -inward)[0] > _ITSELF * gap)
    open_ = escapes(starts[asked], inward[asked], 2 * structure.diagonal_m, scene) > ESCAPE
    at, reach = cloud.points[asked], TOUCH * spacing(cloud)
    near = cKDTree(at).query(at, k=range(2, 2 + _AROUND), distance_upper_bound=reach)[1]
    while True:  # what shows here and there, between discs at an edge, is no opening
        joined = open_ & (2 * np.append(open_, False)[near].sum(axis=1) >= _AROUND)
        if np.array_equal(joined, open_):
            shows[asked] = open_
            return shows
        open_ = joined
