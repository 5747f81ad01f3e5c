"""Parts of a structure: engines, blades, decks, from the pieces that its mesh is made of.

Real meshes come in a hundred pieces and more, cut where it suited the modeller. Small pieces join
their neighbours and pieces of one compact body (the front and the rear of a nacelle) each other.
What pieces there are then is only a proposal: `correspondence.part_assignment` accepts a part where
the other structure has one like it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.planning.constants import LEAST_PART, MAJORITY, SAME_FACE, SAME_SIZE, SLENDER, TOLERANCE
from upplied.planning.geometry.clouds import spacing
from upplied.planning.surface.pieces import CONTACT, contacts_of, corners_of, near_others
from upplied.records import Bools, Cloud, Floats, Ints, Record

_MIRRORED = 0.8  # share of the samples whose mirror images lie on the surface, if it is its own mirror image
_CONTINUED = 0.3  # share of the near pairs that face the same way, by which a skin is continued


@dataclass(frozen=True, eq=False, repr=False)
class Parts(Record):
    """The parts of one structure, row by row."""

    low: Floats  # (K, 3) m, corner of the bounding box of its samples
    high: Floats  # (K, 3) m
    area: Floats  # (K,) share of the whole surface
    touching: Bools  # (K, K) whose samples come near each other
    extent: Floats  # (K, 3) m, along its own principal axes, longest first
    body: Bools  # (K,) stands on its neighbours; others continue their skin, as a belly fairing does
    side: Floats  # (K, 2) where it lies from front to rear and from left to right, see `sides`
    blade: Bools  # (K,) see `blades`
    registered: Floats | None = None  # (2, 3) m, box of the structure on which they are registered

    def __len__(self) -> int:
        return len(self.low)

    @property
    def middle(self) -> Floats:
        """(K, 3) m, centre of each box."""
        return (self.low + self.high) / 2

    def in_axes(self, quarters: Floats) -> Parts:
        """The same parts in axes turned by right angles, ``p' = quarters @ p``; about the vertical."""
        ends = self.low @ quarters.T, self.high @ quarters.T
        axis = np.abs(quarters[:2, :2]).argmax(axis=1)
        sign = quarters[[0, 1], axis]
        side = self.side[:, axis] * sign
        return replace(self, low=np.minimum(*ends), high=np.maximum(*ends), side=side)

    @property
    def box(self) -> Floats:
        """(2, 3) m, corners of the box in which places are named: the structure's."""
        if self.registered is not None:
            return self.registered
        return np.stack([self.low.min(axis=0), self.high.max(axis=0)])

    def on(self, source: Parts) -> Parts:
        """The same parts, registered on a source: what was never scanned of them shifts no middle."""
        return replace(self, registered=source.box)


def sides(low: Floats, high: Floats, whole_low: Floats, whole_high: Floats) -> Floats:
    """Where boxes lie in a whole, (K, 2), front to rear and left to right.

    0 for what is balanced about the middle, about 1 to 2 for what lies on one side of it.
    """
    middle, half = (whole_low + whole_high)[:2] / 2, (whole_high - whole_low)[:2] / 2
    low, high = low[:, :2] - middle, high[:, :2] - middle
    reach = np.maximum(np.abs(low), np.abs(high)) + TOLERANCE * half
    return np.asarray((low + high) / np.maximum(reach, 1e-9))


def parts_of(cloud: Cloud) -> Parts:
    """Boxes, areas and contacts of the labelled parts of a cloud; one part where it has no labels."""
    return cloud.derived("parts", lambda: _measured(cloud))


def _measured(cloud: Cloud) -> Parts:
    points, label, area = cloud.points, labels_of(cloud), cloud.areas
    number = int(label.max()) + 1
    low, high = corners_of(points, label)
    side = sides(low, high, points.min(axis=0), points.max(axis=0))
    pairs = near_others(points, label)
    share = np.bincount(label, weights=area) / area.sum()
    extent = np.array([extent_of(points[label == part]) for part in range(number)])
    return Parts(
        low=low,
        high=high,
        area=share,
        touching=contacts_of(pairs, label)[0] > 0,
        body=_bodies(cloud, label, pairs),
        extent=extent,
        side=np.where(_mirrored(cloud, label, area), side, np.nan),
        blade=blades(extent, share, (low + high) / 2),
    )


def pieces_tell_parts(cloud: Cloud) -> bool:
    """Whether the pieces of a surface are parts: enough of it lies on pieces that touch others.

    A scan of which much is missing falls into pieces that lie apart, as little as one piece tells parts.
    """
    parts = parts_of(cloud)
    return bool(parts.area[parts.touching.any(axis=1)].sum() > 1 - MAJORITY)


def parts_of_both(source: Cloud, registered: Cloud, words: Floats) -> tuple[Parts, Parts]:
    """The parts of a source and of a registered target, in the axes (3, 3) in which places are named."""
    here = parts_of(source).in_axes(words)
    return here, parts_of(registered).in_axes(words).on(here)


def blades(extent: Floats, area: Floats, middle: Floats) -> Bools:
    """Which parts (K,) are blades: long ones of one length that lie round a hub, and may point anywhere.

    By their extents (K, 3), m, longest first, their shares of the surface (K,) and their middles (K, 3), m.
    """
    length, width = extent[:, 0], extent[:, 1]
    slender = (length > SLENDER * width) & (area > LEAST_PART) & (np.arange(len(area)) > 0)
    log = np.log(np.maximum(length, 1e-9))
    alike = (np.abs(log[:, None] - log[None, :]) < np.log(SAME_SIZE)) & slender
    number = alike.sum(axis=1)
    away = np.linalg.norm(middle - alike @ middle / np.maximum(number, 1)[:, None], axis=1)
    # The parapets of a bridge are as long as each other as well, but lie side by side.
    return np.asarray(slender & (number > 1) & (away > length / SLENDER), bool)


def blades_of(cloud: Cloud) -> Bools:
    """Which samples (N,) lie on blades."""
    return np.asarray(parts_of(cloud).blade[labels_of(cloud)], bool)


def labels_of(cloud: Cloud) -> Ints:
    """The part of each sample, all 0 where the cloud has none."""
    return np.zeros(len(cloud), np.int64) if cloud.part is None else cloud.part


def names_of(cloud: Cloud, named: Ints) -> Ints:
    """What most of each part (K,) of a cloud is named, of what has a name; -1 where too little has one.

    `named` (N,) is the name of each sample, -1 for none.
    """
    label, known = labels_of(cloud), named >= 0
    area = np.zeros((int(label.max()) + 1, int(named.max(initial=0)) + 1))
    np.add.at(area, (label[known], named[known]), cloud.areas[known])
    some = area.sum(axis=1) > (1 - MAJORITY) * np.bincount(label, weights=cloud.areas)
    return np.where(some & (area.max(axis=1) > MAJORITY * area.sum(axis=1)), area.argmax(axis=1), -1)


def mirror_images(parts: Parts, axis: int) -> Ints:
    """The part (K,) at the mirror image of each, across an axis (0 or 1); -1 where there is none."""
    low, high = parts.low.copy(), parts.high.copy()
    whole = parts.low.min(axis=0), parts.high.max(axis=0)
    low[:, axis], high[:, axis] = (whole[0] + whole[1])[axis] - np.stack([high[:, axis], low[:, axis]])
    off = np.abs(
        np.concatenate([low, high], axis=1)[:, None] - np.concatenate([parts.low, parts.high], axis=1)
    )
    off = off.max(axis=2)
    near = off.min(axis=1) < CONTACT * np.linalg.norm(whole[1] - whole[0])
    return np.where(near & np.isfinite(parts.side[:, axis]), off.argmin(axis=1), -1)


def extent_of(points: Floats) -> Floats:
    """Extents (3,) of points along their own principal axes, m, longest first."""
    offset = points - points.mean(axis=0)
    return np.ptp(offset @ np.linalg.eigh(offset.T @ offset)[1], axis=0)[::-1]


def _mirrored(cloud: Cloud, label: Ints, area: Floats) -> Bools:
    """Which parts (K, 2) have a mirror image on a structure that is mostly its own mirror image."""
    points, tree = cloud.points, cKDTree(cloud.points)
    low, high = points.min(axis=0), points.max(axis=0)
    reach = max(CONTACT * float(np.linalg.norm(high - low)), spacing(cloud))
    mirrored = np.empty((int(label.max()) + 1, 2), bool)
    for axis in (0, 1):
        image = points.copy()
        image[:, axis] = low[axis] + high[axis] - image[:, axis]
        near = tree.query(image, distance_upper_bound=reach)[0] < reach
        whole = area[near].sum() > _MIRRORED * area.sum()
        mirrored[:, axis] = whole & (np.bincount(label, weights=near) > _MIRRORED * np.bincount(label))
    return mirrored


def _bodies(cloud: Cloud, label: Ints, pairs: Ints) -> Bools:
    """Which parts (K,) are closed, or face another way than their neighbours where they come near them."""
    number = int(label.max()) + 1
    if cloud.normals is None:
        return np.ones(number, bool)
    count = np.bincount(label)
    facing = np.column_stack([np.bincount(label, weights=axis) for axis in cloud.normals.T])
    one, other = cloud.normals[pairs[:, 0]], cloud.normals[pairs[:, 1]]
    alike = pairs[np.einsum("ij,ij->i", one, other) > SAME_FACE]
    near, continued = (np.bincount(label[ends].reshape(-1), minlength=number) for ends in (pairs, alike))
    return (np.linalg.norm(facing, axis=1) < (1 - MAJORITY) * count) | (continued <= _CONTINUED * near)
