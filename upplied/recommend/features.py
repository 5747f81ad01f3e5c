"""The shape of a structure in a few numbers, for fast comparison of thousands.

They predict `upplied.planning.correspondence.misfit` without a registration: boxes are scaled to the same
size, occupied space is one bit per cell, and the directions of the surface are a histogram. Similar
structures are then registered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from upplied.records import Bools, Cloud, Floats, Ints, Record, Rows

FEATURES_VERSION = 1  # increased with every change of a feature

_CELLS = 12  # along each axis of the box
_WORDS = _CELLS**3 // 64
_FACES = 5  # along each axis: bins of the mean facing, area by the component of the normal
# Each term is 1, the acceptance limit, for a missing overlap of 0.45, an uneven stretch of e^6, or half of
# the surface with another direction.
_OVERLAP, _STRETCH, _FACING = 1 / 0.45, 1 / 6, 1 / 0.5


@dataclass(frozen=True, eq=False, repr=False)
class ShapeFeatures(Record):
    """One structure in its own box."""

    extent_m: Floats  # (3,) m, of the bounding box
    occupied: Ints  # (W,) bits, 64 per word: cells of the box with surface
    near: Ints  # (W,) bits: those cells and their six neighbours
    facing: Floats  # (F,) shares of the area by the direction of the normal along x, y and z; sum 3


@dataclass(frozen=True, eq=False, repr=False)
class ShapeLibrary(Rows):
    """The features of S structures, row by row."""

    extent_m: Floats  # (S, 3)
    occupied: Ints  # (S, W)
    near: Ints  # (S, W)
    facing: Floats  # (S, F)


def shape_features(cloud: Cloud) -> ShapeFeatures:
    """Features of a structure from its surface samples.

    Except for `extent_m` they do not change with shift and scaling; an uneven scaling changes `facing`.

    Parameters
    ----------
    cloud : Cloud
        With normals and areas, structure frame.
    """
    if cloud.normals is None or cloud.area_m2 is None:
        raise ValueError("features need samples with normals and areas")
    occupied = _occupied(cloud.points)
    share = cloud.area_m2 / cloud.area_m2.sum()
    bins = np.clip(((cloud.normals + 1) / 2 * _FACES).astype(int), 0, _FACES - 1)
    return ShapeFeatures(
        extent_m=np.ptp(cloud.points, axis=0),
        occupied=_packed(occupied),
        near=_packed(ndimage.binary_dilation(occupied)),
        facing=np.concatenate([np.bincount(axis, weights=share, minlength=_FACES) for axis in bins.T]),
    )


def library_of(features: list[ShapeFeatures]) -> ShapeLibrary:
    """Features of several structures, stacked in the order given."""
    return ShapeLibrary(
        np.array([one.extent_m for one in features], float).reshape(-1, 3),
        np.array([one.occupied for one in features], np.int64).reshape(-1, _WORDS),
        np.array([one.near for one in features], np.int64).reshape(-1, _WORDS),
        np.array([one.facing for one in features], float).reshape(-1, 3 * _FACES),
    )


def unlikeness(shape: ShapeFeatures, library: ShapeLibrary) -> Floats:
    """Difference of a structure from each of S others, (S,), in units of the acceptance limit; 0 for itself.

    Symmetric. It has three terms without a unit, as in `planning.correspondence.misfit.misfit_of`: space that
    is not common, uneven stretch of the boxes, and different directions of the surface.
    """
    forth = _count(library.near & shape.occupied) / max(int(_count(shape.occupied)), 1)
    back = _count(library.occupied & shape.near) / np.maximum(_count(library.occupied), 1)
    flat = 1e-6 * float(shape.extent_m.max())
    logs = np.sort(np.log(np.maximum(library.extent_m, flat) / np.maximum(shape.extent_m, flat)), axis=1)
    stretch = np.maximum(logs[:, 2] - logs[:, 1], logs[:, 1] - logs[:, 0])
    facing = np.abs(library.facing - shape.facing).sum(axis=1) / 6
    return np.asarray(_OVERLAP * (1 - (forth + back) / 2) + _STRETCH * stretch + _FACING * facing, float)


def _occupied(points: Floats) -> Bools:
    low, size = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1e-9)
    cell = np.clip(((points - low) / size * _CELLS).astype(int), 0, _CELLS - 1)
    grid = np.zeros((_CELLS,) * 3, bool)
    grid[cell[:, 0], cell[:, 1], cell[:, 2]] = True
    return grid


def _packed(grid: Bools) -> Ints:
    return np.packbits(grid.reshape(-1)).view(np.int64)


def _count(words: Ints) -> Ints:
    return np.asarray(np.bitwise_count(words.view(np.uint64)).sum(axis=-1), np.int64)


def turned(shape: ShapeFeatures, turn: Floats) -> ShapeFeatures:
    """The features of a structure after quarter turns, without its samples.

    Parameters
    ----------
    shape : ShapeFeatures
    turn : array, shape (3, 3)
        Proper, each entry -1, 0 or 1.
    """
    order, signs = np.argmax(np.abs(turn), axis=1), turn[np.arange(3), np.argmax(np.abs(turn), axis=1)]
    flipped = tuple(np.flatnonzero(signs < 0).tolist())
    occupied = np.flip(_unpacked(shape.occupied).transpose(order), axis=flipped)
    facing = shape.facing.reshape(3, _FACES)[order]
    facing[list(flipped)] = facing[list(flipped)][:, ::-1]
    return ShapeFeatures(
        extent_m=shape.extent_m[order],
        occupied=_packed(occupied),
        near=_packed(ndimage.binary_dilation(occupied)),
        facing=facing.reshape(-1),
    )


def _unpacked(words: Ints) -> Bools:
    return np.unpackbits(words.view(np.uint8)).reshape((_CELLS,) * 3).astype(bool)
