"""Samples with normals on the outside surface of a structure.

Real meshes carry hidden interiors, duplicate faces and flipped patches, and few are watertight. So
neither winding nor inside tests are used: a side of a surface counts where rays from it escape. Of shells
that are open where nothing was scanned the inside does not count (`surface.escape`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from upplied.config import CloudSettings
from upplied.planning.surface.escape import ESCAPE, escapes, inside_open_shell, lets_out, shows_inside
from upplied.planning.surface.floor import Floor, floor_of
from upplied.planning.surface.lattice import Lattice, lattice, spacing_for
from upplied.planning.surface.parts import mesh_pieces, part_labels
from upplied.planning.surface.thinning import shares, thin
from upplied.records import Bools, Cloud, Floats, Ints, Structure
from upplied.scene import Scene, discs_of
from upplied.vectors import area_vectors, plane_normals, triangle_areas

_AREA = 9  # points, each with its nearest, whose circle tells the area that a point stands for
_SPARE = 2  # candidates on the outside for each sample: all lines of a lattice for every second one


def surface_samples(structure: Structure, scene: Scene, settings: CloudSettings) -> Cloud:
    """About `settings.surface_samples` evenly spaced samples on what can be seen from outside.

    A thin sheet has a sample on each side. An open bottom (hulls, houses) counts as closed by the
    floor, so that their inside does not count.

    Parameters
    ----------
    structure : Structure
    scene : Scene
        Of the same structure.
    settings : CloudSettings

    Returns
    -------
    Cloud
        `points` (N, 3), m, structure frame; outward `normals` (N, 3); `area_m2` (N,), whose sum is
        the outside area; `part` (N,), 0 the largest; `open` (N,) of a scan. Every beginning of
        them is spread evenly (`surface.lattice`).
    """
    sampled = _from_triangles if len(structure.triangles) else _from_points
    cloud = sampled(structure, scene, settings)
    if not structure.is_scan:
        return cloud
    return replace(cloud, open=shows_inside(structure, scene, cloud))


def _from_triangles(structure: Structure, scene: Scene, settings: CloudSettings) -> Cloud:
    floor, piece = floor_of(structure), mesh_pieces(structure)
    wanted = _SPARE * settings.surface_samples
    spacing = spacing_for(structure, float(triangle_areas(structure).sum()), wanted / _SPARE)
    few = lattice(structure, spacing)
    # A hidden inside takes some of them: so many more are needed.
    seen = _outside(few, piece, structure, scene, floor)[0]
    outside = float(few.area[seen].sum())
    lines = lattice(structure, spacing_for(structure, outside, wanted))
    index, normals = _outside(lines, piece, structure, scene, floor)
    chosen = np.flatnonzero(lines.coarse[index])
    points, area = lines.points[index], lines.area[index]
    return _standing_for(points, normals, area, piece[lines.triangle[index]], chosen)


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
        starts = _above_floor(points[mine] + sign * gap * normals[mine], scene, floor)
        free = lets_out(starts, sign * normals[mine], 2 * structure.diagonal_m, scene, floor)
        owner.append(mine[free])
        side.append(np.full(len(owner[-1]), sign))
    index, sign_of = np.concatenate(owner), np.concatenate(side)
    both = np.bincount(index, minlength=len(points))[index] > 1
    inside = inside_open_shell(points[index], triangle[index], sign_of, both, piece, structure, scene)
    order = np.argsort(index[~inside], kind="stable")
    index, sign_of = index[~inside][order], sign_of[~inside][order]
    return index, sign_of[:, None] * normals[index]


def _above_floor(origins: Floats, scene: Scene, floor: Floor) -> Floats:
    """The same points, but those inside an open bottom are lifted to the height that closes it."""
    under = np.flatnonzero(floor.beneath(origins))
    lifted = origins[under].copy()
    lifted[:, 2] = floor.z_m
    inside = ~scene.occluded(origins[under], lifted)
    starts = origins.copy()
    starts[under[inside], 2] = np.nextafter(floor.z_m, np.inf)
    return starts


def _standing_for(points: Floats, normals: Floats, area: Floats, piece: Ints, chosen: Ints) -> Cloud:
    """The chosen candidates, which stand for all, but those that lie where another one does."""
    share = shares(points, normals, area, chosen)
    chosen, share = chosen[share > 0], share[share > 0]
    # By all candidates: a piece is not cut off, or joined, by where some of them were left out.
    return Cloud(points[chosen], normals[chosen], share, part_labels(points, area, piece)[chosen])


def _thinned(points: Floats, normals: Floats, area: Floats, number: int) -> Cloud:
    chosen = thin(points, normals, number, float(area.sum()))
    chosen = np.random.default_rng(0).permutation(chosen)  # so that every beginning of them is spread evenly
    return _standing_for(points, normals, area, np.zeros(len(points), np.int64), chosen)


def _from_points(structure: Structure, scene: Scene, settings: CloudSettings) -> Cloud:
    """Samples of a structure given as a point cloud: of the points that its discs lie at, thinned."""
    discs = discs_of(structure)
    points, distance, neighbours = discs.points, discs.away[:, :_AREA], discs.nearest[:, :_AREA]
    area = np.pi * distance[:, -1] ** 2 / max(distance.shape[1] - 1, 1)
    if structure.normals is not None:
        return _thinned(points, discs.normals, area, settings.surface_samples)
    normals = plane_normals(points, neighbours)
    gap = float(np.median(distance[:, 1]))
    reach = 2 * structure.diagonal_m
    ahead = escapes(points + gap * normals, normals, reach, scene)
    behind = escapes(points - gap * normals, -normals, reach, scene)
    outward = np.where((behind > ahead)[:, None], -normals, normals)
    seen: Bools = np.maximum(ahead, behind) >= ESCAPE
    return _thinned(points[seen], outward[seen], area[seen], settings.surface_samples)
