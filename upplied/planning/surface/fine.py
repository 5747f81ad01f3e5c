"""Fine samples where it matters: on what was inspected, and on its counterpart, however small it is.

A structure's even samples tell how it is built and what stands in the way; an engine has some dozens of them,
each one to four hundredths of it. What is measured and planned for has samples of its own.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from upplied.planning.constants import TOUCH
from upplied.planning.geometry.boxes import spacing
from upplied.planning.surface.lattice import lattice, spacing_for
from upplied.planning.surface.skin import normals_like, outside_like
from upplied.planning.surface.thinning import shares, thin
from upplied.records import Bools, Cloud, Floats, Ints, Structure
from upplied.scene import Scene
from upplied.vectors import with_normals

FINE = 1500  # samples of what was inspected, and of its counterpart, at least
_MOST = 4000  # of them and of what is beside them
_SPARE = 2  # candidates for each sample that is kept
_CLOSE = 1.5  # spacings of even samples: what lies farther from all of a region's is not in it


def beside(cloud: Cloud, region: Bools) -> Bools:
    """A region (N,) of a cloud with the samples next to it."""
    if not region.any() or region.all():
        return region
    near = cKDTree(cloud.points[region]).query(cloud.points)[0]
    return np.asarray(region | (near < TOUCH * spacing(cloud)), bool)


def with_fine(
    structure: Structure, scene: Scene, cloud: Cloud, meant: Bools, seed: int
) -> tuple[Cloud, Ints]:
    """A structure's samples, finer where something is meant.

    Parameters
    ----------
    structure : Structure
    scene : Scene
        Of the same structure.
    cloud : Cloud
        Its N even samples.
    meant : array of bool, shape (N,)
        Which of them lie on what is to have at least `FINE` samples.
    seed : int

    Returns
    -------
    Cloud
        M samples; the even ones stay elsewhere. Parts are those of the even samples.
    array of int, shape (M,)
        The even sample that each is, or lies nearest to and faces like.
    """
    own = np.arange(len(cloud))
    if not meant.any() or meant.sum() >= FINE:
        return cloud, own
    region = beside(cloud, meant)
    area = cloud.areas
    number = min(FINE * area[region].sum() / area[meant].sum(), _MOST)
    if len(structure.triangles):
        points, normals, like, weight, chosen = _on_mesh(structure, scene, cloud, region, number)
    else:
        points, normals, like, weight = _of_points(structure, scene, cloud, region, int(number), seed)
        chosen = thin(points, normals, int(number), float(weight.sum()))
    if len(chosen) <= region.sum():
        return cloud, own
    fine_area = shares(points, normals, weight, chosen)
    chosen, fine_area = chosen[fine_area > 0], fine_area[fine_area > 0]
    even = np.flatnonzero(~region)
    if cloud.part is not None:  # no part is lost of which no fine sample lies nearest
        even = np.union1d(even, np.flatnonzero(~np.isin(cloud.part, cloud.part[[*even, *like[chosen]]])))
    index = np.concatenate([even, like[chosen]])
    return (
        Cloud(
            np.concatenate([cloud.points[even], points[chosen]]),
            np.concatenate([cloud.outward[even], normals[chosen]]),
            np.concatenate([area[even], fine_area]),
            None if cloud.part is None else cloud.part[index],
            open=None if cloud.open is None else cloud.open[index],
        ),
        index,
    )


def _on_mesh(
    structure: Structure, scene: Scene, cloud: Cloud, region: Bools, number: float
) -> tuple[Floats, Floats, Ints, Floats, Ints]:
    """Candidates in a region of a mesh: points, outward normals, the even sample of each, area; some kept."""
    near, tree, reach_m = _near(structure, cloud, region), cKDTree(cloud.points[region]), spacing(cloud)
    # No fewer than asked for: the next narrower of the spacings.
    spacing_m = spacing_for(structure, float(cloud.areas[region].sum()), _SPARE * number * 2**0.25)
    lines = lattice(structure, spacing_m, near)
    close = np.flatnonzero(np.isfinite(tree.query(lines.points, distance_upper_bound=_CLOSE * reach_m)[0]))
    points, triangle = lines.points[close], lines.triangle[close]
    index, outward, like = outside_like(points, triangle, structure, scene, cloud)
    mine = region[like]
    index, outward, like = index[mine], outward[mine], like[mine]
    chosen = close[index]
    return points[index], outward, like, lines.area[chosen], np.flatnonzero(lines.coarse[chosen])


def _near(structure: Structure, cloud: Cloud, region: Bools) -> Ints:
    """The triangles that may lie in a region."""
    corners = structure.vertices[structure.triangles]
    middle = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1) + _CLOSE * spacing(cloud)
    away = cKDTree(cloud.points[region]).query(middle, distance_upper_bound=float(reach.max()))[0]
    return np.flatnonzero(away <= reach)


def _of_points(
    structure: Structure, scene: Scene, cloud: Cloud, region: Bools, number: int, seed: int
) -> tuple[Floats, Floats, Ints, Floats]:
    """The same of a structure given as points: those of its points that lie there."""
    points = structure.vertices
    tree = cKDTree(cloud.points)
    like = tree.query(points)[1]
    chosen = np.flatnonzero(region[like])
    chosen = np.sort(np.random.default_rng(seed).permutation(chosen)[: int(_SPARE * number)])
    if structure.normals is not None:
        outward = structure.normals[chosen]
        weight = TOUCH * spacing(cloud)
        known = cKDTree(with_normals(cloud.points, cloud.outward, weight))
        like = known.query(with_normals(points[chosen], outward, weight))[1]
    else:
        like = like[chosen]
        outward = normals_like(points, chosen, cloud.outward[like])
    mine = region[like]
    count = np.maximum(np.bincount(like[mine], minlength=len(cloud)), 1)
    area = (cloud.areas / count)[like[mine]]
    return points[chosen][mine], outward[mine], like[mine], area
