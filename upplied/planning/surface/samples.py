"""Samples with normals on the outside surface of a structure: even ones, and fine ones where it matters.

Real meshes carry hidden interiors, duplicate faces and flipped patches, and few are watertight. So
neither winding nor inside tests are used: a side of a surface counts where rays from it escape. Of shells
that are open where nothing was scanned the inside does not count (`surface.escape`).

The even samples tell how a structure is built and what stands in the way; an engine has some dozens of them,
each one to four hundredths of it. What was inspected, and its counterpart, have fine ones however small.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import CloudSettings
from upplied.errors import RefusedError
from upplied.geometry.scene import Scene, discs_of
from upplied.geometry.vectors import area_vectors, plane_normals, triangle_areas, with_normals
from upplied.planning.constants import TOUCH
from upplied.planning.geometry.clouds import spacing
from upplied.planning.surface.escape import (
    ESCAPE,
    Floor,
    escapes,
    floor_of,
    inside_open_shell,
    lets_out,
    shows_inside,
)
from upplied.planning.surface.lattice import Lattice, lattice, shares, spacing_for, thin
from upplied.planning.surface.parts import mesh_pieces, part_labels
from upplied.planning.surface.skin import outside_like, outward_of_points
from upplied.records import Bools, Cloud, Floats, Ints, Structure

_AREA = 9  # points, each with its nearest, whose circle tells the area that a point stands for
_SPARE = 2  # candidates for each sample: all lines of a lattice for every second one
FINE = 1500  # samples of what was inspected, and of its counterpart, at least
_MOST = 4000  # of them and of what is beside them
_CLOSE = 1.5  # spacings of even samples: what lies farther from all of a region's is not in it


def surface_samples(structure: Structure, scene: Scene, settings: CloudSettings) -> Cloud:
    """About `settings.surface_samples` evenly spaced samples on what can be seen from outside.

    A thin sheet has a sample on each side. An open bottom (hulls, houses) counts as closed by the
    floor, so that their inside does not count.

    Parameters
    ----------
    scene : Scene
        Of the same structure.

    Returns
    -------
    Cloud
        `points` (N, 3), m, structure frame; outward `normals` (N, 3); `area_m2` (N,), whose sum is
        the outside area; `part` (N,), 0 the largest; `open` (N,) of a scan. Every beginning of
        them is spread evenly (`surface.lattice`).

    Raises
    ------
    RefusedError
        If all of it lies under its declared ground.
    """
    if structure.buried(structure.vertices).all():
        rule = "nobody sees what lies under the ground", "check ground_z, units and the axis up"
        raise RefusedError(structure.structure_id, "all of it lies under its ground_z", *rule)
    if len(structure.triangles):
        floor, pieces = floor_of(structure), mesh_pieces(structure)
        number = _SPARE * settings.surface_samples
        spacing_m = spacing_for(structure, float(triangle_areas(structure).sum()), number / _SPARE)
        few = lattice(structure, spacing_m)
        # A hidden inside takes some of them: so many more are needed.
        outside = float(few.area[_outside(few, pieces, structure, scene, floor)[0]].sum())
        lines = lattice(structure, spacing_for(structure, outside, number))
        index, normals = _outside(lines, pieces, structure, scene, floor)
        chosen = np.flatnonzero(lines.coarse[index])
        points, area, piece = lines.points[index], lines.area[index], pieces[lines.triangle[index]]
    else:  # of the points that its discs lie at, thinned
        points, normals, area = _of_discs(structure, scene)
        piece = np.zeros(len(points), np.int64)
        chosen = thin(points, normals, settings.surface_samples, float(area.sum()))
        # So that every beginning of them is spread evenly.
        chosen = np.random.default_rng(0).permutation(chosen)
    # The chosen candidates stand for all, but those that lie where another one does.
    share = shares(points, normals, area, chosen)
    chosen, share = chosen[share > 0], share[share > 0]
    # By all candidates: a piece is not cut off, or joined, by where some of them were left out.
    part = part_labels(points, area, piece)[chosen]
    cloud = Cloud(points[chosen], normals[chosen], share, part)
    return replace(cloud, open=shows_inside(structure, scene, cloud)) if structure.is_scan else cloud


def _outside(
    lines: Lattice, piece: Ints, structure: Structure, scene: Scene, floor: Floor
) -> tuple[Ints, Floats]:
    """The candidates' sides that count: which candidate, and the outward normal."""
    points, triangle = lines.points, lines.triangle
    normals = area_vectors(structure.vertices[structure.triangles[triangle]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    gap = 1e-5 * structure.diagonal_m
    owner, side = [], []
    for sign in (1.0, -1.0):
        # Copies of a face lie at one place: only the one that a ray from outside meets first counts.
        hit = scene.cast(points + sign * gap * normals, -sign * normals)[1]
        mine = np.flatnonzero(hit == triangle)
        starts = points[mine] + sign * gap * normals[mine]
        # From inside an open bottom rays start at the height that closes it.
        under = np.flatnonzero(floor.beneath(starts))
        lifted = starts[under]
        lifted[:, 2] = floor.z_m
        starts[under[~scene.occluded(starts[under], lifted)], 2] = np.nextafter(floor.z_m, np.inf)
        free = lets_out(starts, sign * normals[mine], 2 * structure.diagonal_m, scene, floor)
        owner.append(mine[free])
        side.append(np.full(len(owner[-1]), sign))
    index, sign_of = np.concatenate(owner), np.concatenate(side)
    both = np.bincount(index, minlength=len(points))[index] > 1
    inside = inside_open_shell(points[index], triangle[index], sign_of, both, piece, structure, scene)
    order = np.argsort(index[~inside], kind="stable")
    index, sign_of = index[~inside][order], sign_of[~inside][order]
    return index, sign_of[:, None] * normals[index]


def _of_discs(structure: Structure, scene: Scene) -> tuple[Floats, Floats, Floats]:
    """The points that the discs of a point cloud lie at and that are seen, their normals and areas."""
    discs = discs_of(structure)
    points, normals, distance = discs.points, discs.normals, discs.away[:, :_AREA]
    area = np.pi * distance[:, -1] ** 2 / max(distance.shape[1] - 1, 1)
    seen = ~structure.buried(points)
    if structure.normals is None:
        normals = plane_normals(points, discs.nearest[:, :_AREA])
        gap, reach = float(np.median(distance[:, 1])), 2 * structure.diagonal_m
        ahead = escapes(points + gap * normals, normals, reach, scene)
        behind = escapes(points - gap * normals, -normals, reach, scene)
        normals = np.where((behind > ahead)[:, None], -normals, normals)
        seen &= np.maximum(ahead, behind) >= ESCAPE
    return points[seen], normals[seen], area[seen]


def beside(cloud: Cloud, region: Bools) -> Bools:
    """A region (N,) of a cloud with the samples next to it."""
    if not region.any() or region.all():
        return region
    near = cKDTree(cloud.points[region]).query(cloud.points)[0]
    return np.asarray(region | (near < TOUCH * spacing(cloud)), bool)


def with_fine(structure: Structure, scene: Scene, cloud: Cloud, zone: Bools) -> tuple[Cloud, Ints]:
    """A structure's samples, with at least `FINE` on what is meant, (N,) of the even samples `cloud`.

    Returns
    -------
    Cloud
        M samples; the even ones stay elsewhere. Parts are those of the even samples.
    array of int, shape (M,)
        The even sample that each is, or lies nearest to and faces like.
    """
    own = np.arange(len(cloud))
    if not zone.any() or zone.sum() >= FINE:
        return cloud, own
    region = beside(cloud, zone)
    area = cloud.areas
    number = min(FINE * area[region].sum() / area[zone].sum(), _MOST)
    if len(structure.triangles):
        points, normals, like, weight, chosen = _on_mesh(structure, scene, cloud, region, number)
    else:
        points, normals, like, weight = _of_points(structure, cloud, region, int(number))
        chosen = thin(points, normals, int(number), float(weight.sum()))
    if len(chosen) <= region.sum():
        return cloud, own
    fine_area = shares(points, normals, weight, chosen)
    chosen, fine_area = chosen[fine_area > 0], fine_area[fine_area > 0]
    even = np.flatnonzero(~region)
    if cloud.part is not None:  # no part is lost of which no fine sample lies nearest
        even = np.union1d(even, np.flatnonzero(~np.isin(cloud.part, cloud.part[[*even, *like[chosen]]])))
    # Both sorts by turns, so that every beginning of all is spread evenly over either.
    share = [(np.arange(len(each)) + 0.5) / max(len(each), 1) for each in (even, chosen)]
    order = np.argsort(np.concatenate(share), kind="stable")
    index = np.concatenate([even, like[chosen]])[order]
    return (
        Cloud(
            np.concatenate([cloud.points[even], points[chosen]])[order],
            np.concatenate([cloud.outward[even], normals[chosen]])[order],
            np.concatenate([area[even], fine_area])[order],
            None if cloud.part is None else cloud.part[index],
            open=None if cloud.open is None else cloud.open[index],
        ),
        index,
    )


def _on_mesh(
    structure: Structure, scene: Scene, cloud: Cloud, region: Bools, number: float
) -> tuple[Floats, Floats, Ints, Floats, Ints]:
    """Candidates in a region of a mesh: points, outward normals, the even sample of each, area; some kept."""
    tree, reach_m = cKDTree(cloud.points[region]), _CLOSE * spacing(cloud)
    corners = structure.vertices[structure.triangles]
    middle = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1) + reach_m
    near = np.flatnonzero(tree.query(middle, distance_upper_bound=float(reach.max()))[0] <= reach)
    # No fewer than asked for: the next narrower of the spacings.
    spacing_m = spacing_for(structure, float(cloud.areas[region].sum()), _SPARE * number * 2**0.25)
    lines = lattice(structure, spacing_m, near)
    close = np.flatnonzero(np.isfinite(tree.query(lines.points, distance_upper_bound=reach_m)[0]))
    points, triangle = lines.points[close], lines.triangle[close]
    index, outward, like = outside_like(points, triangle, structure, scene, cloud)
    mine = region[like]
    index, outward, like = index[mine], outward[mine], like[mine]
    chosen = close[index]
    return points[index], outward, like, lines.area[chosen], np.flatnonzero(lines.coarse[chosen])


def _of_points(
    structure: Structure, cloud: Cloud, region: Bools, number: int
) -> tuple[Floats, Floats, Ints, Floats]:
    """The same of a structure given as points: those of its points that lie there."""
    points = structure.vertices
    like = cKDTree(cloud.points).query(points)[1]
    chosen = np.flatnonzero(region[like] & ~structure.buried(points))
    chosen = np.sort(np.random.default_rng(0).permutation(chosen)[: _SPARE * number])
    points, like, outward = points[chosen], like[chosen], outward_of_points(structure, chosen, cloud)
    if structure.normals is not None:
        weight = TOUCH * spacing(cloud)
        known = cKDTree(with_normals(cloud.points, cloud.outward, weight))
        like = known.query(with_normals(points, outward, weight))[1]
    mine = region[like]
    count = np.maximum(np.bincount(like[mine], minlength=len(cloud)), 1)
    area = (cloud.areas / count)[like[mine]]
    return points[mine], outward[mine], like[mine], area
