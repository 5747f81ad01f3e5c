"""Clouds and shape features of a catalog's structures, remembered; thousands of them in a few files."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from upplied.catalog import Catalog
from upplied.config import digest, settings_for
from upplied.planning.features import (
    FEATURES_VERSION,
    ShapeFeatures,
    ShapeLibrary,
    joined,
    library_of,
    shape_features,
)
from upplied.planning.pair import content_key, surface_key
from upplied.planning.surface import surface_samples
from upplied.records import Cloud
from upplied.scene import scene_of

_BLOCKS = 64  # files of features: one structure more makes one of them anew, not all


class Shapes:
    """What is known of the shapes in a catalog.

    Parameters
    ----------
    catalog : Catalog
        Its cache keeps what is found; its meshes are read only where that is missing.
    """

    def __init__(self, catalog: Catalog) -> None:
        self.catalog, self.clouds = catalog, settings_for("recommended").clouds
        self._known: dict[str, Cloud] = {}

    def cloud(self, structure_id: str, sha256: str) -> Cloud:
        """Surface samples of one structure, the same that plans are made on."""
        if sha256 not in self._known:
            self._known[sha256] = self.catalog.cache(
                "clouds", Cloud, surface_key(sha256, self.clouds), lambda: self._sampled(structure_id)
            )
        return self._known[sha256]

    def features(self, structure_id: str, sha256: str) -> ShapeFeatures:
        """Features of one structure."""
        key = content_key("features", FEATURES_VERSION, sha256, self.clouds)
        return self.catalog.cache(
            "features", ShapeFeatures, key, lambda: shape_features(self.cloud(structure_id, sha256))
        )

    def library(self, sha256: Mapping[str, str]) -> ShapeLibrary:
        """Features of many structures, in the order of the mapping from id to hash."""
        names = list(sha256)
        blocks: dict[int, list[int]] = {}
        for row, name in enumerate(names):
            blocks.setdefault(int(digest(name)[:8], 16) % _BLOCKS, []).append(row)
        parts = [self._block({names[row]: sha256[names[row]] for row in rows}) for rows in blocks.values()]
        order = np.argsort(np.array([row for rows in blocks.values() for row in rows], np.int64))
        found = joined(parts)
        return ShapeLibrary(
            found.extent_m[order], found.occupied[order], found.near[order], found.facing[order]
        )

    def _block(self, sha256: Mapping[str, str]) -> ShapeLibrary:
        key = content_key("library", FEATURES_VERSION, list(sha256.values()), self.clouds)
        return self.catalog.cache(
            "features",
            ShapeLibrary,
            key,
            lambda: library_of([self.features(name, content) for name, content in sha256.items()]),
        )

    def _sampled(self, structure_id: str) -> Cloud:
        structure = self.catalog.structure(structure_id)
        return surface_samples(structure, scene_of(structure), self.clouds)
