"""Samples on boxes: surfaces whose normals, areas and parts are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.planning.correspondence.part_assignment import Matching
from upplied.records import Cloud, Floats

BoxOf = tuple[Sequence[float], Sequence[float]]  # corner and size, m


def box(
    low: Sequence[float] | Floats, size: Sequence[float] | Floats, number: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Points of a box, of which the first eight are its corners, and their outward normals."""
    at, axis, end = rng.random((number, 3)), np.arange(number) % 3, np.arange(number) // 3 % 2
    at[np.arange(number), axis] = end
    at[:8] = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    return np.asarray(low) + at * size, (2.0 * end - 1)[:, None] * np.eye(3)[axis]


def boxes(*shapes: BoxOf, number: int = 900, seed: int = 0) -> Cloud:
    """So many samples of each box, with true areas; each box is a part."""
    rng = np.random.default_rng(seed)
    samples = [box(low, size, number, rng) for low, size in shapes]
    points, normals = (np.concatenate(of) for of in zip(*samples, strict=True))
    whole = np.array([2 * (a * b + b * c + c * a) for _, (a, b, c) in shapes])
    return Cloud(
        points,
        normals,
        np.repeat(whole / number, number),
        np.repeat(np.arange(len(shapes)), number),
    )


def counterparts(matching: Matching, part: int) -> list[int]:
    """The target parts in the class of a source part; none where it is in no class."""
    kind = matching.source_class[part]
    return np.flatnonzero((matching.target_class == kind) & (kind >= 0)).tolist()
