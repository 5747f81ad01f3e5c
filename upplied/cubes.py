"""Points sorted by the cube of space that they lie in, and the neighbours of each that lie about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.records import Bools, Floats, Ints, Record
from upplied.vectors import bounds

_ASKED = 32  # points whose neighbours tell how wide cubes are to be
_ROOMY = 1.35  # of the distance to the last neighbour: wider cubes hold more points that are none
_FARTHER = 2  # cubes to each side, for points that stand more thinly
_MANY = 40  # times the neighbours that are sought: where so many points lie about, a tree is faster


@dataclass(frozen=True, eq=False, repr=False)
class Cubes(Record):
    """Points by the cubes that hold them, cubes by their place along x, y and z."""

    points: Floats  # (N, 3) m, sorted
    index: Ints  # (N,) of each before it was sorted
    low: Floats  # (3,) m, corner of the cube at 0, 0, 0
    wide: float  # m, edge of a cube
    count: Ints  # (3,) cubes along each axis
    name: Ints  # (C,) of each that is not empty, increasing
    first: Ints  # (C + 1,) point of each

    @classmethod
    def of(cls, points: Floats, wide: float) -> Cubes:
        """The points (N, 3), m, in cubes of such an edge, or one that their number allows to count."""
        low, high = bounds(points)
        wide = max(wide, 1e-6 * float((high - low).max()), 1e-12)
        cell = np.floor((points - low) / wide).astype(np.int64)
        count = bounds(cell)[1] + 1
        name = (cell[:, 0] * count[1] + cell[:, 1]) * count[2] + cell[:, 2]
        index = np.argsort(name, kind="stable")
        name = name[index]
        first = np.flatnonzero(np.diff(name, prepend=-1))
        ends = np.append(first, len(index))
        return cls(np.ascontiguousarray(points[index], float), index, low, wide, count, name[first], ends)

    def nearest(self, count: int) -> tuple[Floats, Ints, Bools]:
        """Distances (N, count), m, and indices of the nearest to each, and which (N,) are certain.

        A row is certain where it and no other could be the answer: where the cubes that were asked hold
        all of them, and no two are as far. Rows stand in the order that the points had.
        """
        away, nearest = np.empty((len(self.points), count)), np.empty((len(self.points), count), np.int64)
        certain = np.zeros(len(self.points), bool)
        cubes = self.points, self.index, self.low, self.wide, self.count, self.name, self.first
        for around in (1, _FARTHER):
            _nearest(*cubes, around, _MANY * count, away, nearest, certain)
        return away, nearest, certain

    def facing(self, normals: Floats, reach_m: float) -> tuple[Ints, Ints, Ints, Floats]:
        """Pairs of points that are nearer than a cube is wide and whose normals (N, 3) agree by sign.

        Parameters
        ----------
        normals : array, shape (N, 3)
            In the order that the points had.
        reach_m : float
            At most the width of a cube.

        Returns
        -------
        begin, end : array of int, shape (N,)
            Where the pairs of each point with later ones stand.
        later : array of int, shape (P,)
        distance_m : array, shape (P,)
        """
        turned = np.ascontiguousarray(normals[self.index], float)
        return _facing(self.points, turned, self.index, self.count, self.name, self.first, reach_m)


def nearest_of_all(points: Floats, count: int) -> tuple[Floats, Ints]:
    """Distances (N, count), m, and indices of the nearest of the points (N, 3) to each, itself the first."""
    from scipy.spatial import cKDTree

    cubes = Cubes.of(points, _width_for(points, count))
    away, nearest, certain = cubes.nearest(count)
    left = cubes.index[~certain[cubes.index]]  # as they lie in space: the tree's nodes stay in the cache
    if len(left):
        away[left], nearest[left] = cKDTree(points).query(points[left], k=[*range(1, count + 1)])
    return away, nearest


def _width_for(points: Floats, count: int) -> float:
    """How wide cubes are to be for most points to have so many neighbours in those about theirs, m."""
    asked = np.linspace(0, len(points) - 1, _ASKED).astype(np.int64)
    return _ROOMY * float(np.median(_farthest(np.ascontiguousarray(points, float), asked, count)))


@njit(cache=True)
def _farthest(points: Floats, asked: Ints, count: int) -> Floats:
    """Distance of some points to the last of so many neighbours, m."""
    far, square = np.empty(len(asked)), np.empty(count)
    for row in range(len(asked)):
        square[:] = np.inf
        at_x, at_y, at_z = points[asked[row]]
        for other in range(len(points)):
            away, place = _square(at_x, at_y, at_z, points, other), count - 1
            if away < square[place]:
                while place > 0 and square[place - 1] > away:
                    square[place] = square[place - 1]
                    place -= 1
                square[place] = away
        far[row] = np.sqrt(square[count - 1])
    return far


@njit(cache=True)
def _square(at_x: float, at_y: float, at_z: float, points: Floats, other: int) -> float:
    x, y, z = at_x - points[other, 0], at_y - points[other, 1], at_z - points[other, 2]
    return x * x + y * y + z * z


@njit(cache=True)
def _place(name: int, count: Ints, cube: Ints) -> None:
    """Write where a cube stands along x, y and z."""
    cube[2] = name % count[2]
    cube[1] = name // count[2] % count[1]
    cube[0] = name // count[2] // count[1]


@njit(cache=True)
def _columns(cube: Ints, around: int, count: Ints, name: Ints, first: Ints, start: Ints, stop: Ints) -> int:
    """Write where the points in the cubes about one begin and end, for each column of them; how many."""
    columns = 0
    low, high = max(cube[2] - around, 0), min(cube[2] + around, count[2] - 1)
    for x in range(max(cube[0] - around, 0), min(cube[0] + around, count[0] - 1) + 1):
        for y in range(max(cube[1] - around, 0), min(cube[1] + around, count[1] - 1) + 1):
            column = (x * count[1] + y) * count[2]
            begin = np.searchsorted(name, column + low)
            end = begin
            while end < len(name) and name[end] <= column + high:
                end += 1
            if end > begin:
                start[columns], stop[columns] = first[begin], first[end]
                columns += 1
    return columns


@njit(cache=True)
def _nearest(
    points: Floats,
    index: Ints,
    low: Floats,
    wide: float,
    count: Ints,
    name: Ints,
    first: Ints,
    around: int,
    many: int,
    away: Floats,
    nearest: Ints,
    certain: Bools,
) -> None:
    """Fill the rows that are not certain yet by the points in the cubes about each."""
    most = away.shape[1]
    start, stop = np.empty((2 * around + 1) ** 2, np.int64), np.empty((2 * around + 1) ** 2, np.int64)
    square, which, cube = np.empty(many), np.empty(many, np.int64), np.empty(3, np.int64)
    by_rank = np.empty(many, np.int64)
    for box in range(len(name)):
        _place(name[box], count, cube)
        columns = -1
        for row in range(first[box], first[box + 1]):
            if certain[index[row]]:
                continue
            if columns < 0:
                columns = _columns(cube, around, count, name, first, start, stop)
                if (stop[:columns] - start[:columns]).sum() > many:
                    break
            within = np.inf  # m, where all are known
            for axis in range(3):
                off = points[row, axis] - low[axis] - cube[axis] * wide
                within = min(within, off + around * wide, (around + 1) * wide - off)
            within = max(within - 1e-9 * wide, 0.0) ** 2
            known = 0
            at_x, at_y, at_z = points[row]
            for limit in (min(within, wide * wide), within):  # the first holds enough of most
                if known < most:
                    known = 0
                    for column in range(columns):
                        for other in range(start[column], stop[column]):
                            square[known], which[known] = _square(at_x, at_y, at_z, points, other), other
                            known += square[known] < limit
            if known < most:
                continue
            by_rank[: most + 1] = -1
            for one in range(known):
                rank = 0  # where two are as far, the next rank is nobody's
                for other in range(known):
                    rank += square[other] < square[one]
                by_rank[rank] = one
            if by_rank[: min(known, most + 1)].min() < 0:
                continue
            certain[index[row]] = True
            for rank in range(most):
                away[index[row], rank] = np.sqrt(square[by_rank[rank]])
                nearest[index[row], rank] = index[which[by_rank[rank]]]


@njit(cache=True)
def _facing(
    points: Floats, normals: Floats, index: Ints, count: Ints, name: Ints, first: Ints, reach: float
) -> tuple[Ints, Ints, Ints, Floats]:
    """See `Cubes.facing`."""
    begin, end = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    later, distance = np.empty(32 * len(points), np.int64), np.empty(32 * len(points))
    start, stop, cube = np.empty(9, np.int64), np.empty(9, np.int64), np.empty(3, np.int64)
    most, pairs = 1.0001 * reach * reach, 0
    for box in range(len(name)):
        _place(name[box], count, cube)
        columns = _columns(cube, 1, count, name, first, start, stop)
        room = (first[box + 1] - first[box]) * (stop[:columns] - start[:columns]).sum()
        if pairs + room > len(later):
            more = pairs + room + len(later)
            later = np.append(later[:pairs], np.empty(more, np.int64))
            distance = np.append(distance[:pairs], np.empty(more))
        for row in range(first[box], first[box + 1]):
            one = index[row]
            begin[one] = pairs
            at_x, at_y, at_z = points[row]
            normal_x, normal_y, normal_z = normals[row]
            for column in range(columns):
                for other in range(start[column], stop[column]):
                    square = _square(at_x, at_y, at_z, points, other)
                    if square > most or index[other] <= one:
                        continue
                    facing = normal_x * normals[other, 0] + normal_y * normals[other, 1]
                    facing += normal_z * normals[other, 2]
                    if facing > 0:
                        later[pairs], distance[pairs] = index[other], np.sqrt(square)
                        pairs += 1
            end[one] = pairs
    return begin, end, later[:pairs], distance[:pairs]
