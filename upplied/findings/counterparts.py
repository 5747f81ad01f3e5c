"""Places of one structure on another: carried as the samples about them, with how far off they may be."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree

from upplied.findings.looks import plane_axes
from upplied.geometry.vectors import with_normals
from upplied.records import Bools, Floats, Ints, Record, Rows

_LEAST = 0.9  # probability of the part, below which a counterpart is doubtful
# Of the target's diagonal: a place with a larger stated error is doubtful. Errors have long tails: of places
# with this one, one of some thousand is more than 2 % off (bench/findings.py, on the other half).
FARTHEST = 0.0105
_BELOW = 0.3  # spacings below the samples' surface, from which on a place lies inside of other parts
_NEIGHBOURS, _NEAR, _ALIKE = 8, 2.2, 0.3  # samples about one: how many, spacings off, cosine between normals


@dataclass(frozen=True, eq=False, repr=False)
class Counterparts(Rows):
    """Where N spots of one structure are on another; what has no counterpart has no place."""

    part: Ints  # (N,) of the target; -1: none, or its parts are not known
    place: Floats  # (N, 3) m, frame of the target; NaN where there is none
    normal: Floats  # (N, 3) unit, outward
    turn: Floats  # (N, 3, 3) directions about the spot to those about its counterpart; mirrored ones mirror
    probability: Floats  # (N,) that it is the right part; NaN where that cannot be known
    error_m: Floats  # (N,) how far off it may be in 95 % of cases
    doubtful: Bools  # (N,)

    def doubt(self, at: int) -> str:
        """Why a counterpart is not certain, in words; empty where it is."""
        if not np.isfinite(self.place[at, 0]):
            return "the place has no counterpart there"
        if not self.doubtful[at]:
            return ""
        part = f"the right part with probability {self.probability[at]:.2f}"
        part = "parts cannot be distinguished" if np.isnan(self.probability[at]) else part
        return f"doubtful: {part}, may be {self.error_m[at]:.2f} m off"

    @property
    def spots(self) -> Floats:
        """Places with normals (N, 6), to be carried on."""
        return np.hstack([self.place, self.normal])


def carried_spots(
    spots: Floats, carried: "Carried", size_m: float | Floats, near: "Near | None" = None
) -> Counterparts:
    """Places with normals (N, 6), carried as the samples about them onto a structure, or N, of that size, m.

    Of the samples, those count that face alike and belong to the part of the nearest one; where another part
    is as near, the place may be where that one leads. A place that no sample is near, or that lies below
    them, is inside of other parts, and is uncertain: samples are where surface can be seen.
    """
    if not len(carried.point):
        return nowhere(len(spots))
    near = near or about(spots, carried.point, carried.normal, carried.step_m)
    others, first = near.samples, near.samples[:, 0]
    there = np.isfinite(carried.place[others, 0])
    same = carried.own_part[others] == carried.own_part[first][:, None]
    weight = np.where(there & there[:, :1] & same, near.weight, 0.0)
    offset = spots[:, None, :3] - carried.point[others]
    places, towards = np.nan_to_num(carried.place[others]), carried.towards[others]
    moved = places + np.einsum("nkij,nkj->nki", carried.linear[carried.map[others]], offset)
    share = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    place, normal = (np.einsum("nk,nki->ni", share, each) for each in (moved, towards))
    normal = np.where(there[:, :1], normal, towards[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    above = np.einsum("nki,nki->nk", towards, place[:, None] - places)  # of the samples' tangent planes
    away, up = near.away_m[:, 0], carried.normal[first]
    below = np.abs(np.einsum("ni,ni->n", offset[:, 0], up)) > _BELOW * carried.step_m
    hidden = (away > carried.step_m) | (np.einsum("ni,ni->n", spots[:, 3:], up) <= 0) | below
    onto = np.where(hidden, 0.0, (share * above).sum(axis=1))
    place = np.where(there[:, :1], place - onto[:, None] * normal, np.nan)
    apart = np.linalg.norm(moved - place[:, None], axis=2)
    seam = np.where(there & ~same & (near.away_m <= carried.step_m), np.nan_to_num(apart), 0.0).max(axis=1)
    stretch = np.abs(np.linalg.det(carried.linear)) ** (1 / 3)
    stated = (share * carried.error_m[others]).sum(axis=1)  # its jumps between neighbours mean nothing
    inside = np.where(hidden, 2 * stretch[carried.map[first]] * np.maximum(away, carried.step_m), 0.0)
    error, sure = np.maximum(stated + inside, seam), carried.probability[carried.map[first]]
    doubtful = ~(sure >= _LEAST) | ~there[:, 0] | (error > FARTHEST * size_m)
    turn = _turn(spots, -offset, np.nan_to_num(places - place[:, None]), normal, weight[:, 1:] > 0)
    return Counterparts(carried.part[first], place, normal, turn, sure, error, doubtful)


def themselves(places: Floats, error_m: Floats, size_m: float) -> Counterparts:
    """Places of a structure on itself, off by that much."""
    count, doubtful = len(places), error_m > FARTHEST * size_m
    part, turn = np.full(count, -1, np.int64), np.repeat(np.eye(3)[None], count, axis=0)
    return Counterparts(part, places[:, :3], places[:, 3:], turn, np.ones(count), error_m, doubtful)


def nowhere(count: int) -> Counterparts:
    """What has no counterpart."""
    lost = np.full((count, 3, 3), np.nan)
    part, doubtful = np.full(count, -1, np.int64), np.ones(count, bool)
    return Counterparts(part, lost[:, 0], lost[:, 0], lost, lost[:, 0, 0], lost[:, 0, 0], doubtful)


def _turn(spots: Floats, ring: Floats, carried: Floats, normal: Floats, known: Bools) -> Floats:
    """Matrices (N, 3, 3) that turn directions about spots into those about their counterparts."""
    # In the plane they are the orthogonal factor of the linear map of the ring of samples about a spot.
    here, there = (np.stack([*plane_axes(up), up], axis=-1) for up in (spots[:, 3:], normal))
    flat, moved = (np.einsum("nki,nij->nkj", each[:, 1:], axes)[..., :2] * known[..., None]
                   for each, axes in ((ring, here), (carried, there)))  # fmt: skip
    inverse = np.linalg.pinv(np.einsum("nki,nkj->nij", flat, flat), hermitian=True)
    left, size, right = np.linalg.svd(np.einsum("nki,nkj->nij", moved, flat) @ inverse)
    plane = np.repeat(np.eye(3)[None], len(spots), axis=0)
    enough = (known.sum(axis=1) >= 3) & (size[:, 1] > 0)
    plane[enough, :2, :2] = (left @ right)[enough]
    return np.asarray(there @ plane @ here.transpose(0, 2, 1))


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
        turned = {"point": "place", "normal": "towards", "own_part": "part", "map": "map"}
        turned |= {other: name for name, other in turned.items()}
        columns: dict[str, Any] = {name: getattr(self, other)[there] for name, other in turned.items()}
        columns["linear"] = np.asarray(np.linalg.inv(self.linear), np.float64)
        step_m = self.step_m * float(np.median(scale)) if there.any() else self.step_m
        return replace(self, **columns, error_m=self.error_m[there] / scale, step_m=step_m)


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
    goals = with_normals(spots[:, :3], spots[:, 3:], 2 * step_m)
    nearest = _tree(with_normals(points, normals, 2 * step_m)).query(goals)[1]
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
