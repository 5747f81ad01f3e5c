"""What plans see of their targets: ``surfaces/<sha256>.parquet``, and the samples that many share.

A surface is a state for each of a target's samples; the samples, a hundred times as large, are the same
for all plans to it and lie once in ``samples/<sha256>.parquet``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from upplied.catalog.store.contents import ContentStore
from upplied.records import Floats, Ints, Record, SurfaceStates

REMEDY = "take it from a backup, or plan it again"
SUPPOSED = "supposed"  # folder of what was never scanned of targets, by content
PHOTOS = "photos"  # of the photos of plans, likewise


@dataclass(frozen=True, eq=False, repr=False)
class Samples(Record):
    """Where a target's surface was sampled."""

    points: Floats  # (N, 3) m, target frame
    normals: Floats | None = None  # (N, 3) unit, outward


@dataclass(frozen=True, eq=False, repr=False)
class States(Record):
    """What became of each sample."""

    samples_sha256: str
    state: Ints  # (N,) index into SURFACE_STATES, as small numbers


#: The columns of `transfers` that name a surface.
SURFACES = ("surface_sha256", "inspected_sha256")


class SurfaceStore:
    """The surfaces of one catalog.

    Parameters
    ----------
    root : str
        Folder or object-store URI of the catalog.
    """

    def __init__(self, root: str) -> None:
        self.states = ContentStore(root, "surfaces", States, REMEDY)
        self.samples = ContentStore(root, "samples", Samples, REMEDY)
        self._samples = lru_cache(4)(self.samples.get)

    def put(self, surface: SurfaceStates) -> str:
        """Keep a surface; returns the hash of its states, which name their samples."""
        samples = self.put_samples(surface.points, surface.normals)
        state = np.asarray(surface.state)
        small: Any = state.astype(np.int8)
        return self.states.put(States(samples, small if np.array_equal(small, state) else state))

    def put_samples(self, points: Floats, normals: Floats | None) -> str:
        """Keep where a surface is sampled; returns the hash."""
        return self.samples.put(Samples(points, normals))

    def points(self, samples_sha256: str) -> Floats:
        """Where samples are, (N, 3), m."""
        return self._samples(samples_sha256).points

    def nearest(self, samples_sha256: str, place: Floats, normal: Floats) -> int:
        """The sample nearest to a place (3,), m, of those that face as its normal (3,) does."""
        samples = self._samples(samples_sha256)
        away = np.linalg.norm(samples.points - place, axis=1)
        if samples.normals is not None and (facing := samples.normals @ normal > 0).any():
            away = np.where(facing, away, np.inf)
        return int(away.argmin())

    def get(self, sha256: str) -> SurfaceStates:
        """The surface of a hash.

        Raises
        ------
        CatalogError
            If it is not there, or is damaged.
        """
        states = self.states.get(sha256)
        samples = self._samples(states.samples_sha256)
        return SurfaceStates(samples.points, states.state.astype(np.int64), samples.normals)
