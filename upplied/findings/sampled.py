"""The samples of a structure with their places on others, and which of them are about a place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from upplied.geometry.vectors import with_normals
from upplied.records import Floats, Ints, Record

_NEIGHBOURS, _NEAR, _ALIKE = 8, 2.2, 0.3  # samples about one: how many, spacings off, cosine between normals


@dataclass(frozen=True, eq=False, repr=False)
class Carried(Record):
    """The samples of a structure with their places on another, each in its declared frame.

    A map is what all samples of a part of the pair's source have in common.
    """

    point: Floats  # (N, 3) m
    normal: Floats  # (N, 3) unit, outward
    own_part: Ints  # (N,) of the structure
    part: Ints  # (N,) of the other one; -1 for none
    place: Floats  # (N, 3) m; NaN for none
    towards: Floats  # (N, 3) unit, outward
    error_m: Floats  # (N,) how far off the place may be in 95 % of cases
    map: Ints  # (N,) of each sample
    linear: Floats  # (P, 3, 3) of each map: how offsets from a sample are carried
    probability: Floats  # (P,) of each map: that it leads to the right part; NaN where that cannot be known
    step_m: float  # spacing of the samples

    def inverse(self) -> Self:
        """The samples that have a place, carried back from there."""
        there = np.isfinite(self.place[:, 0])
        stretch = np.abs(np.linalg.det(self.linear)) ** (1 / 3)
        scale = stretch[self.map[there]]
        return replace(
            self,
            point=self.place[there],
            normal=self.towards[there],
            own_part=self.part[there],
            part=self.own_part[there],
            place=self.point[there],
            towards=self.normal[there],
            error_m=self.error_m[there] / scale,
            map=self.map[there],
            linear=np.asarray(np.linalg.inv(self.linear), np.float64),
            step_m=self.step_m * float(np.median(scale)) if there.any() else self.step_m,
        )


@dataclass(frozen=True, eq=False, repr=False)
class Near(Record):
    """The samples about each of N spots, the one that stands for it first."""

    samples: Ints  # (N, 1 + K)
    weight: Floats  # (N, 1 + K) 0 if far or facing away
    away_m: Floats  # (N, 1 + K)


@dataclass(frozen=True, eq=False, repr=False)
class CarriedGroup(Record):
    """The samples of one structure on S others, of those on which the same samples are carried."""

    members: tuple[str, ...]
    carried: Carried  # N samples on the first of them, then on the next

    @classmethod
    def of(cls, parts: Mapping[str, Carried]) -> Self:
        """Of some structures, one at least, those whose samples are those of the first."""
        first, shared = next(iter(parts.values())), ("point", "normal", "own_part", "map")
        same = {name: part for name, part in parts.items()
                if all(np.array_equal(getattr(part, it), getattr(first, it)) for it in shared)}  # fmt: skip
        columns = {name: np.concatenate([getattr(part, name) for part in same.values()])
                   for name in vars(first) if name != "step_m"}  # fmt: skip
        columns["map"] += np.repeat(len(first.probability) * np.arange(len(same)), len(first.point))
        return cls(tuple(same), Carried(**columns, step_m=first.step_m))

    def near(self, spots: Floats, members: Ints) -> Near:
        """The samples about spots (K, 6) on some members (M,), one after the other, (M K,)."""
        count, one = len(self.carried.point) // len(self.members), self.carried
        near = about(spots, one.point[:count], one.normal[:count], one.step_m)
        samples = (near.samples + count * members[:, None, None]).reshape(-1, near.samples.shape[1])
        return Near(samples, *(np.tile(each, (len(members), 1)) for each in (near.weight, near.away_m)))


def about(spots: Floats, points: Floats, normals: Floats, step_m: float) -> Near:
    """The samples about spots, places with normals (N, 6); the first is on their side of a thin plate.

    Of spots that have no place they are any.
    """
    spots = np.nan_to_num(spots)
    nearest = _tree(with_normals(points, normals, 2 * step_m)).query(
        with_normals(spots[:, :3], spots[:, 3:], 2 * step_m)
    )[1]
    others = _tree(points).query(spots[:, :3], min(1 + _NEIGHBOURS, len(points)))[1].reshape(len(spots), -1)
    samples = np.column_stack([nearest, others])
    away = np.linalg.norm(spots[:, None, :3] - points[samples], axis=2)
    cosine = np.einsum("nki,ni->nk", normals[samples], spots[:, 3:])
    weight = np.where((away < _NEAR * step_m) & (cosine > _ALIKE), 1 / (away + 0.1 * step_m) ** 2, 0.0)
    weight[:, 0] = 1e-9  # it counts where no other does
    return Near(samples, weight, away)


def _tree(points: Floats) -> cKDTree:
    """For few queries: built in less than half the time of a balanced one."""
    return cKDTree(points, balanced_tree=False, compact_nodes=False)
