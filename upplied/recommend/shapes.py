"""Features of the shapes in a catalog and the surface that flights saw, cached by content.

They are computed at the import of a file, so that queries need no mesh; few files contain thousands of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.config import digest, settings_for
from upplied.geometry.scene import scene_of
from upplied.planning.correspondence.memo import content_key, surface_key
from upplied.planning.surface.samples import surface_samples
from upplied.planning.visibility.observations import TRULY, Views, views
from upplied.recommend.features import (
    FEATURES_VERSION,
    ShapeFeatures,
    ShapeLibrary,
    library_of,
    shape_features,
)
from upplied.recommend.foresee import FORESIGHT_VERSION, Inspected, inspected
from upplied.records import Cloud, Demonstration, Structure

_BLOCKS = 64  # files of features: a new structure rewrites only one of them


class Shapes:
    """Features of the shapes in a catalog.

    Parameters
    ----------
    catalog : Catalog
        Results are stored in its cache; meshes and logs are read only if they are missing there.
    """

    def __init__(self, catalog: Catalog) -> None:
        self.catalog, self.clouds = catalog, settings_for("recommended").clouds
        self._known: dict[str, Cloud] = {}

    def learn(self, structure: Structure) -> None:
        """Compute and store the features of a structure from its record."""
        if not structure.sha256:
            return
        self._known[structure.sha256] = self._cloud(structure.sha256, lambda: structure)
        self.features(structure.structure_id, structure.sha256)

    def learn_flight(self, flight: Demonstration, structure: Structure) -> None:
        """Compute and store the surface that a demonstration saw, from the records of both."""
        self.learn(structure)
        if flight.sha256 and structure.sha256:
            self._inspected(flight.sha256, structure.sha256, lambda: (flight, structure))

    def cloud(self, structure_id: str, sha256: str) -> Cloud:
        """Surface samples of one structure, the same as in planning."""
        if sha256 not in self._known:
            self._known[sha256] = self._cloud(sha256, lambda: self.catalog.structure(structure_id))
        return self._known[sha256]

    def features(self, structure_id: str, sha256: str) -> ShapeFeatures:
        """Features of one structure."""
        return self.catalog.cache(
            "features",
            ShapeFeatures,
            self._key(sha256),
            lambda: shape_features(self.cloud(structure_id, sha256)),
        )

    def inspected(
        self, flight_id: str, flight_sha256: str, structure_id: str, structure_sha256: str
    ) -> Inspected:
        """The surface of its structure that a demonstration saw."""
        self.cloud(structure_id, structure_sha256)
        return self._inspected(
            flight_sha256,
            structure_sha256,
            lambda: (self.catalog.demonstration(flight_id), self.catalog.structure(structure_id)),
        )

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
        return self.catalog.cache(
            "features",
            ShapeLibrary,
            key,
            lambda: library_of([self.features(name, content) for name, content in sha256.items()]),
        )

    def _key(self, sha256: str) -> str:
        return content_key("features", FEATURES_VERSION, sha256, self.clouds)

    def _cloud(self, sha256: str, structure: Callable[[], Structure]) -> Cloud:
        def sampled() -> Cloud:
            known = structure()
            return surface_samples(known, scene_of(known), self.clouds)

        return self.catalog.cache("clouds", Cloud, surface_key(sha256, self.clouds), sampled)

    def _inspected(
        self, flight_sha256: str, structure_sha256: str, both: Callable[[], tuple[Demonstration, Structure]]
    ) -> Inspected:
        cloud, cache = self._known[structure_sha256], self.catalog.cache
        facts = (flight_sha256, structure_sha256, self.clouds)

        def seen() -> Views:
            flight, structure = both()
            return views(flight.trajectory, cloud, flight.camera, TRULY, scene_of(structure))

        return cache(
            "inspected",
            Inspected,
            content_key("inspected", FORESIGHT_VERSION, *facts),
            lambda: inspected(cloud, cache("views", Views, content_key("truly", *facts), seen)),
        )


def _blocks(names: Iterable[str]) -> list[list[str]]:
    """Names of structures by the file of their features, independent of the other structures."""
    blocks: dict[int, list[str]] = {}
    for name in sorted(names):
        blocks.setdefault(int(digest(name)[:8], 16) % _BLOCKS, []).append(name)
    return list(blocks.values())


def content_of(table: pd.DataFrame, stored: str) -> pd.Series:
    """The hash of each row's content: of the imported file, or else of the stored record."""
    return table["sha256"].where(table["sha256"] != "", table[stored])
