"""Structures that make planning hard, and flights at them, all drawn from a seed.

Narrow alleys, overhangs, thin poles, L-shapes, gates, what stands on the ground; with fences (some of them
notched), ceilings and keep-out boxes. Two structures of one family and close seeds are of one form: a flight
at the one is planned on the other.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from upplied.geometry.poses import look_at
from upplied.planning.surface.parts import mesh_pieces
from upplied.records import Camera, Demonstration, Floats, Ints, Structure, Surroundings

FAMILIES = ("alley", "overhang", "poles", "corner", "gate", "tower")
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
_BOX = np.array([t for a, b, c, d in _FACES for t in ((a, b, c), (a, c, d))])

Boxes = list[tuple[Sequence[float], Sequence[float]]]


def structure(family: str, seed: int, variant: int = 0) -> Structure:
    """One structure; other variants of the same seed are of the same form in other sizes."""
    shape = np.random.default_rng([FAMILIES.index(family), seed])
    size = np.random.default_rng([FAMILIES.index(family), seed, variant])

    def about(low: float, high: float) -> float:
        return float(shape.uniform(low, high) * (1.0 if variant == 0 else size.uniform(0.88, 1.14)))

    boxes, poles = _parts(family, about)
    vertices, triangles = [], []
    for low, high in boxes:
        triangles.append(_BOX + sum(map(len, vertices)))
        vertices.append(np.asarray(low, float) + _CORNERS * np.subtract(high, low))
    for x, y, radius, height in poles:
        points, faces = _pole(x, y, radius, height)
        triangles.append(faces + sum(map(len, vertices)))
        vertices.append(points)
    points = np.vstack(vertices)
    around = _surroundings(points, np.random.default_rng([FAMILIES.index(family), seed, variant, 7]))
    name = f"{family}-{seed}-{variant}"
    return Structure(name, family, points, np.vstack(triangles).astype(np.int64), surroundings=around)


def one_piece(of: Structure) -> Structure:
    """The same surface as one connected piece, as scans are: edges without width join its pieces."""
    piece = mesh_pieces(of)
    first = [of.triangles[np.flatnonzero(piece == each)[0], 0] for each in range(int(piece.max()) + 1)]
    bridges = np.array([[a, b, b] for a, b in itertools.pairwise(first)], np.int64).reshape(-1, 3)
    joined = np.concatenate([of.triangles, bridges])
    exact = replace(of, surface="scanned", surface_error_m=0.0, sha256="")
    return replace(exact, structure_id=f"{of.structure_id}-scan", triangles=joined)


def _parts(family: str, about) -> tuple[Boxes, list[tuple[float, float, float, float]]]:
    length, wide, high = about(14, 30), about(6, 12), about(8, 18)
    if family == "alley":  # two blocks, 4.6 to 8 m apart
        gap = about(4.6, 8)
        return [
            ((0, 0, 0), (length, wide, high)),
            ((0, wide + gap, 0), (length, 2 * wide + gap, 0.8 * high)),
        ], []
    if family == "overhang":  # a stem under a roof
        stem = about(2, 4)
        return [((0, 0, 0), (stem, stem, high)), ((-8, -6, high - 0.2), (8 + stem, 6 + stem, high + 1.5))], []
    if family == "poles":
        return [((0, 0, 0), (length, 2.5, 3))], [
            (0.2 * length * i, 1.2, about(0.06, 0.3), 3 + high) for i in range(1, 5)
        ]
    if family == "corner":
        return [((0, 0, 0), (length, wide, high)), ((0, 0, 0), (wide, length, high))], []
    if family == "gate":
        leg = about(2, 4)
        opening = about(7, 12)
        return [
            ((0, 0, 0), (leg, wide, high)),
            ((leg + opening, 0, 0), (2 * leg + opening, wide, high)),
            ((0, 0, high - 0.2), (2 * leg + opening, wide, high + 2)),
        ], []
    return [((0, 0, 0), (wide, wide, 1.8 * high)), ((-1.5, -1.5, 0), (wide + 1.5, wide + 1.5, 2))], []


def _pole(x: float, y: float, radius: float, height: float) -> tuple[Floats, Ints]:
    turn = np.arange(6) * np.pi / 3
    ring = np.column_stack([x + radius * np.cos(turn), y + radius * np.sin(turn)])
    points = np.vstack([np.column_stack([ring, np.full(6, z)]) for z in (2.8, height)])
    points = np.vstack([points, [[x, y, 2.8], [x, y, height]]])
    here, beside = np.arange(6), (np.arange(6) + 1) % 6
    sides = np.vstack(
        [np.column_stack([here, beside, here + 6]), np.column_stack([beside, beside + 6, here + 6])]
    )
    caps = np.vstack(
        [
            np.column_stack([beside, here, np.full(6, 12)]),
            np.column_stack([here + 6, beside + 6, np.full(6, 13)]),
        ]
    )
    return points, np.vstack([sides, caps])


def _surroundings(points: Floats, rng: np.random.Generator) -> Surroundings:
    low, high = points.min(axis=0), points.max(axis=0)
    fence, keep_out = np.empty((0, 2)), np.empty((0, 2, 3))
    if rng.random() < 0.5:
        west, south = low[:2] - rng.uniform(14, 25, 2)
        east, north = high[:2] + rng.uniform(14, 25, 2)
        fence = np.array([[west, south], [east, south], [east, north], [west, north]])
        if rng.random() < 0.5:  # a notch from the east, down to some metres before the structure
            y = (south + north) / 2
            deep = high[0] + rng.uniform(6, 10)
            fence = np.insert(
                fence, 2, [[east, y - 3], [deep, y - 3], [deep, y], [deep, y + 3], [east, y + 3]], axis=0
            )
    if rng.random() < 0.4:
        corner = np.array([rng.uniform(low[0], high[0]), high[1] + rng.uniform(3, 9), low[2]])
        keep_out = np.array([[corner, corner + rng.uniform(1, 5, 3)]])
    return Surroundings(
        ground_z_m=float(low[2]) if rng.random() < 0.8 else None,
        keep_out_m=keep_out,
        geofence_m=fence,
        ceiling_z_m=float(high[2] + rng.uniform(4, 15)) if rng.random() < 0.4 else None,
    )


def flight(of: Structure, seed: int) -> Demonstration:
    """A flight at a structure: round it, up and down one side of it, or along it and in between.

    It is flown by a hand that drifts, and with no respect for any rule.
    """
    rng = np.random.default_rng([seed, 11])
    low, high = of.vertices.min(axis=0), of.vertices.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    away = rng.uniform(3.5, 9)
    how = int(rng.integers(3))
    if how == 0:
        angle = np.linspace(0, 2 * np.pi * rng.uniform(0.7, 2), 400)
        reach = np.hypot(*half[:2]) + away
        height = np.linspace(low[2] + 2.0, high[2] + rng.uniform(-2, 3), 400)
        at = np.column_stack([middle[0] + reach * np.cos(angle), middle[1] + reach * np.sin(angle), height])
        aim = np.column_stack([np.full(400, middle[0]), np.full(400, middle[1]), height - 1])
    elif how == 1:
        rows = [
            np.column_stack([xs[::turn], np.full(60, low[1] - away), np.full(60, z)])
            for z, turn, xs in zip(
                np.linspace(low[2] + 2.5, high[2], 6),
                [1, -1] * 3,
                [np.linspace(low[0] - 2, high[0] + 2, 60)] * 6,
                strict=True,
            )
        ]
        at = np.vstack(rows)
        aim = np.add(at, [0, 10.0, 0])
    else:  # along the middle: through an alley or a gate, else over the top
        y = middle[1] if rng.random() < 0.7 else low[1] - away
        z = middle[2] + rng.uniform(-0.2, 0.5) * half[2]
        at = np.column_stack([np.linspace(low[0] - 10, high[0] + 10, 300), np.full(300, y), np.full(300, z)])
        aim = at + np.array([0.5, rng.choice([-3.0, 3.0]), -0.5])
    drift = np.cumsum(rng.normal(0, 0.02, at.shape), axis=0)
    at = at + drift - np.linspace(0, 1, len(at))[:, None] * drift[-1]
    step = np.linalg.norm(np.diff(at, axis=0), axis=1) / rng.uniform(0.6, 2.5)
    t_s = np.concatenate([[0.0], np.cumsum(np.maximum(step, 0.02))])
    return Demonstration(
        f"flight-{seed}", of.structure_id, (t_s * 1e9).astype(np.int64), at, look_at(at, aim), Camera()
    )
