"""Which sides of a surface rays escape from: what can be seen from outside, whatever the mesh's winding.

Uses the floor.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.planning.surface.floor import Floor
from upplied.records import Bools, Floats, Ints
from upplied.scene import Scene
from upplied.vectors import sphere

ESCAPE = 0.06  # least share of a side's rays that escape: inlets reach 0.1, cabins behind a hole 0.03
DIRECTIONS = 64  # over the whole sphere: half of them for each side of a surface
_FEW = 16  # of those, for samples whose neighbours were asked thoroughly
_LEVEL = 0.1  # least cosine of a ray and the normal
_ROUNDS = (2, 2, 4, 8, 16)  # rays of each side, cast together


def lets_out(
    origins: Floats, normals: Floats, reach_m: float, scene: Scene, floor: Floor, few: bool = False
) -> Bools:
    """Whether enough rays from just above each side escape.

    They are cast until the answer is known, those along the normal first: most sides on the outside
    take two.

    Parameters
    ----------
    origins, normals : array, shape (N, 3), m and unit
    reach_m : float
        How far a ray goes that escapes.
    scene : Scene
    floor : Floor
        What goes down through it does not escape.
    few : bool
        With a quarter of the rays.

    Returns
    -------
    array of bool, shape (N,)
    """
    directions = sphere(DIRECTIONS)[:: DIRECTIONS // _FEW if few else 1]
    facing = normals @ directions.T
    left = (facing > _LEVEL).sum(axis=1)
    need = np.ceil(ESCAPE * left).astype(np.int64)
    need[left == 0] = 1
    order, nearest = np.argsort(-(directions @ directions.T), axis=1, kind="stable"), facing.argmax(axis=1)
    along, local = np.zeros(len(origins), np.int64), np.ascontiguousarray(origins - scene.origin)
    sides = local, origins[:, 2] > floor.z_m, normals, nearest, along, left
    lid = floor.grid(scene.origin)
    for number in (*_ROUNDS, DIRECTIONS):
        doubt = np.flatnonzero((need > 0) & (left >= need))
        if not len(doubt):
            break
        rays = np.empty((len(doubt) * min(number, len(directions)), 6), np.float32)
        owner = np.empty(len(rays), np.int64)
        count = _next_rays(doubt, number, *sides, directions, order, reach_m, *lid, rays, owner)
        free = ~scene.blocked(rays[:count], slack=0.0)
        need -= np.bincount(owner[:count][free], minlength=len(need))
    return np.asarray(need <= 0, bool)


@njit(cache=True)
def _next_rays(
    doubt: Ints,
    number: int,
    local: Floats,
    above: Bools,
    normals: Floats,
    nearest: Ints,
    along: Ints,
    left: Ints,
    directions: Floats,
    order: Ints,
    reach_m: float,
    lid: float,
    low: Floats,
    cell: float,
    enclosed: Bools,
    rays: Floats,
    owner: Ints,
) -> int:
    """Write the next rays of each side in doubt that do not meet the floor; how many there are."""
    count = 0
    for side in doubt:
        asked = 0
        while asked < number and along[side] < len(directions):
            way = directions[order[nearest[side], along[side]]]
            along[side] += 1
            facing = normals[side, 0] * way[0] + normals[side, 1] * way[1] + normals[side, 2] * way[2]
            if facing <= _LEVEL:
                continue
            asked += 1
            left[side] -= 1
            start = local[side]
            if above[side] and way[2] < 0:
                far = (lid - start[2]) / way[2]
                x, y = (start[0] + far * way[0] - low[0]) / cell, (start[1] + far * way[1] - low[1]) / cell
                if 0 <= x < enclosed.shape[0] and 0 <= y < enclosed.shape[1] and enclosed[int(x), int(y)]:
                    continue
            for axis in range(3):
                rays[count, axis], rays[count, 3 + axis] = start[axis], reach_m * way[axis]
            owner[count] = side
            count += 1
    return count


def escapes(origins: Floats, normals: Floats, reach_m: float, scene: Scene) -> Floats:
    """Share of the rays from just above each side that leave the structure, (N,)."""
    directions = sphere(DIRECTIONS)
    few = np.arange(DIRECTIONS) % (DIRECTIONS // _FEW) == 0
    cast, free = _count(origins, normals, directions[few], reach_m, scene)
    doubt = np.flatnonzero(free < np.maximum(2, 2 * ESCAPE * cast))
    more_cast, more_free = _count(origins[doubt], normals[doubt], directions[~few], reach_m, scene)
    cast[doubt] += more_cast
    free[doubt] += more_free
    return np.asarray(free / np.maximum(cast, 1))


def _count(
    origins: Floats, normals: Floats, directions: Floats, reach_m: float, scene: Scene
) -> tuple[Ints, Ints]:
    """How many rays were cast from each side, and how many escaped."""
    owner, which = np.nonzero(normals @ directions.T > _LEVEL)
    starts, rays = origins[owner], directions[which]
    free = ~scene.occluded(starts, starts + reach_m * rays, slack=0.0)
    number = len(origins)
    return np.bincount(owner, minlength=number), np.bincount(owner[free], minlength=number)
