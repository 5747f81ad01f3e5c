"""Features of the shapes in a catalog and the surface that flights saw, cached by content.

The features of a structure are a few numbers, for fast comparison of thousands. They predict
`upplied.planning.correspondence.misfit` without a registration, and are computed at the import of a file, so
that queries need no mesh; few files contain thousands of them.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.ndimage import binary_dilation

from upplied.catalog import Catalog
from upplied.config import CloudSettings, digest, settings_for
from upplied.geometry.scene import scene_of
from upplied.planning.correspondence.memo import content_key
from upplied.planning.surface.samples import surface_samples
from upplied.planning.visibility.observations import TRULY, Views, views
from upplied.recommend.foresee import FORESIGHT_VERSION, Inspected, inspected
from upplied.records import Bools, Cloud, Demonstration, Floats, Ints, Record, Rows, Structure, Surroundings

FEATURES_VERSION = 1  # increased with every change of a feature

_CELLS = 12  # along each axis of the box
_WORDS = _CELLS**3 // 64
_FACES = 5  # along each axis: bins of the mean facing, area by the component of the normal
# Each term is 1, the acceptance limit, for a missing overlap of 0.45, an uneven stretch of e^6, or half of
# the surface with another direction.
_OVERLAP, _STRETCH, _FACING = 1 / 0.45, 1 / 6, 1 / 0.5
_BLOCKS = 64  # files of features: a new structure rewrites only one of them


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
    """Features of a structure from its surface samples with normals and areas, structure frame.

    Except for `extent_m` they do not change with shift and scaling; an uneven scaling changes `facing`.
    """
    if cloud.normals is None or cloud.area_m2 is None:
        raise ValueError("features need samples with normals and areas")
    low, size = cloud.points.min(axis=0), np.maximum(np.ptp(cloud.points, axis=0), 1e-9)
    cell = np.clip(((cloud.points - low) / size * _CELLS).astype(int), 0, _CELLS - 1)
    occupied = np.zeros((_CELLS,) * 3, bool)
    occupied[tuple(cell.T)] = True
    share = cloud.area_m2 / cloud.area_m2.sum()
    bins = np.clip(((cloud.normals + 1) / 2 * _FACES).astype(int), 0, _FACES - 1)
    facing = np.concatenate([np.bincount(axis, weights=share, minlength=_FACES) for axis in bins.T])
    return _features(np.ptp(cloud.points, axis=0), occupied, facing)


def _features(extent_m: Floats, occupied: Bools, facing: Floats) -> ShapeFeatures:
    grids = (occupied, binary_dilation(occupied))
    cells, near = (np.packbits(grid.reshape(-1)).view(np.int64) for grid in grids)
    return ShapeFeatures(extent_m, cells, near, facing)


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


def _count(words: Ints) -> Ints:
    return np.asarray(np.bitwise_count(words.view(np.uint64)).sum(axis=-1), np.int64)


def turned(shape: ShapeFeatures, turn: Floats) -> ShapeFeatures:
    """The features of a structure after quarter turns (3, 3), of -1, 0 and 1, without its samples."""
    order = np.argmax(np.abs(turn), axis=1)
    flipped = tuple(np.flatnonzero(turn[np.arange(3), order] < 0).tolist())
    cells = np.unpackbits(shape.occupied.view(np.uint8)).reshape((_CELLS,) * 3).astype(bool)
    occupied = np.flip(cells.transpose(order), axis=flipped)
    facing = shape.facing.reshape(3, _FACES)[order]
    facing[list(flipped)] = facing[list(flipped)][:, ::-1]
    return _features(shape.extent_m[order], occupied, facing.reshape(-1))


def features_of(structure: Structure, clouds: CloudSettings) -> ShapeFeatures:
    """Features of all of a structure, also of what lies under its ground: its axes may be wrong."""
    whole = replace(structure, surroundings=Surroundings())
    return shape_features(surface_samples(whole, scene_of(whole), clouds))


class Shapes:
    """Features of the shapes in a catalog, by its cache; meshes and logs are read where they lack there."""

    def __init__(self, catalog: Catalog) -> None:
        self.catalog, self.clouds = catalog, settings_for("recommended").clouds
        self._known: dict[str, Cloud] = {}

    def learn(self, structure: Structure) -> None:
        """Compute and store the features of a structure from its record."""
        if not structure.sha256:
            return
        self.features(structure.structure_id, structure.sha256, structure)
        self.cloud(structure.structure_id, structure.sha256, structure)

    def learn_flight(self, flight: Demonstration, structure: Structure) -> None:
        """Compute and store the surface that a demonstration saw, from the records of both."""
        self.learn(structure)
        if flight.sha256 and structure.sha256:
            self._inspected(flight.sha256, structure.sha256, lambda: (flight, structure))

    def cloud(self, structure_id: str, sha256: str, structure: Structure | None = None) -> Cloud:
        """Surface samples of one structure, the same as in planning; its record, where it is at hand."""

        def sampled() -> Cloud:
            known = structure or self.catalog.structure(structure_id)
            return surface_samples(known, scene_of(known), self.clouds)

        if sha256 not in self._known:
            key = content_key("surface", sha256, self.clouds)
            self._known[sha256] = self.catalog.cache("clouds", Cloud, key, sampled)
        return self._known[sha256]

    def features(self, structure_id: str, sha256: str, structure: Structure | None = None) -> ShapeFeatures:
        """Features of all of one structure; its record, where it is at hand."""

        def whole() -> ShapeFeatures:
            known = structure or self.catalog.structure(structure_id)
            if known.buried(known.vertices).any():
                return features_of(known, self.clouds)
            return shape_features(self.cloud(structure_id, sha256, known))

        return self.catalog.cache("features", ShapeFeatures, self._key(sha256), whole)

    def inspected(self, flight_id: str, flight_sha256: str, structure_id: str, its_sha256: str) -> Inspected:
        """The surface of its structure that a demonstration saw."""
        self.cloud(structure_id, its_sha256)

        def both() -> tuple[Demonstration, Structure]:
            return self.catalog.demonstration(flight_id), self.catalog.structure(structure_id)

        return self._inspected(flight_sha256, its_sha256, both)

    def library(self, sha256: Mapping[str, str]) -> ShapeLibrary:
        """Features of many structures, in the order of the mapping from id to hash."""
        blocks = _blocks(sha256)
        known = [self._block({name: sha256[name] for name in block}) for block in blocks]
        place = {name: row for row, name in enumerate(name for block in blocks for name in block)}
        order = np.array([place[name] for name in sha256], np.int64)
        return ShapeLibrary.stacked(known).rows(order) if known else library_of([])

    def gather(self, sha256: Mapping[str, str]) -> None:
        """Write the files that `library` reads, if all their features are cached."""
        for block in _blocks(sha256):
            named = {name: sha256[name] for name in block}
            cache = self.catalog.cache
            if all(cache.path("features", self._key(content)).exists() for content in named.values()):
                self._block(named)

    def _block(self, sha256: Mapping[str, str]) -> ShapeLibrary:
        key = content_key("library", FEATURES_VERSION, list(sha256.values()), self.clouds)

        def read() -> ShapeLibrary:
            return library_of([self.features(name, content) for name, content in sha256.items()])

        return self.catalog.cache("features", ShapeLibrary, key, read)

    def _key(self, sha256: str) -> str:
        return content_key("features", FEATURES_VERSION, sha256, self.clouds)

    def _inspected(
        self, flight_sha256: str, structure_sha256: str, both: Callable[[], tuple[Demonstration, Structure]]
    ) -> Inspected:
        cloud, cache = self._known[structure_sha256], self.catalog.cache
        facts = (flight_sha256, structure_sha256, self.clouds)

        def seen() -> Views:
            flight, structure = both()
            return views(flight.trajectory, cloud, flight.camera, TRULY, scene_of(structure))

        def surface() -> Inspected:
            return inspected(cloud, cache("views", Views, content_key("truly", *facts), seen))

        return cache("inspected", Inspected, content_key("inspected", FORESIGHT_VERSION, *facts), surface)


def _blocks(names: Iterable[str]) -> list[list[str]]:
    """Names of structures by the file of their features, independent of the other structures."""
    blocks: dict[int, list[str]] = {}
    for name in sorted(names):
        blocks.setdefault(int(digest(name)[:8], 16) % _BLOCKS, []).append(name)
    return list(blocks.values())


def content_of(table: pd.DataFrame, stored: str) -> pd.Series:
    """The hash of each row's content: of the imported file, or else of the stored record."""
    return table["sha256"].where(table["sha256"] != "", table[stored])
