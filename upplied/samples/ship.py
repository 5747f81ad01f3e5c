"""Parametric ships: a flared hull with raked bow and transom, and decks on top; the waterline at z = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.records import Floats
from upplied.samples.surfaces import Member, Part, assemble, block, loft, revolve, superellipse


@dataclass(frozen=True)
class ShipShape:
    """Parameters of a ship; shares count from the stern (0) to the bow (1)."""

    length_m: float
    beam_m: float
    freeboard_m: float  # of the deck amidships above the water
    draught_m: float  # of the hull shown below the water
    sheer_m: float  # rise of the deck towards the bow
    rake_m: float  # how far the deck overhangs the waterline at the bow
    flare: float  # share by which the waterline is narrower than the deck
    fullness: float  # 0.3 a sharp bow, 0.7 a blunt one
    decks: tuple[tuple[float, float, float, float], ...]  # stern and bow share, share of beam, height m
    mast_m: float
    funnel: tuple[float, float, float] | None = None  # share, length m, height m
    lifeboats: int = 0  # on each side


def ship(shape: ShipShape, structure_id: str) -> Member:
    """The mesh of a ship whose waterline has its middle on the origin."""
    parts = [_hull(shape)]
    floor = shape.freeboard_m - 0.15
    for number, (stern, bow, wide, high) in enumerate(shape.decks, start=1):
        parts.append(_deck(shape, f"deck_{number}", (stern, bow), wide, floor, high))
        floor += high
    parts.append(_mast(shape, floor))
    if shape.funnel is not None:
        parts.append(_funnel(shape, floor))
    parts += _lifeboats(shape)
    return assemble(structure_id, "ship", parts, "parametric ship, from the waterline up")


def _hull(shape: ShipShape) -> Part:
    """Stations from the transom to the stem; each a keel-to-deck outline of fixed grid."""
    share = 1 - (1 - np.linspace(0, 1, 41)) ** 1.5
    level = np.array([0.0, 0.12, 0.3, 0.5, 0.7, 0.88, 1.0])
    deck_z = shape.freeboard_m + shape.sheer_m * np.clip((share - 0.45) / 0.55, 0, 1) ** 2
    low_z = -shape.draught_m
    beam_deck = shape.beam_m / 2 * _plan(share, shape.fullness, 0.92)
    beam_low = shape.beam_m / 2 * (1 - shape.flare) * _plan(share, shape.fullness + 0.14, 0.84)
    rings = np.empty((len(share), 2 * len(level) + 6, 3))
    for row, at in enumerate(share):
        half = beam_low[row] + (beam_deck[row] - beam_low[row]) * level**1.4
        z = low_z + level * (deck_z[row] - low_z)
        shift = -shape.length_m / 2 + at * (shape.length_m - shape.rake_m * (1 - level**1.2))
        inner = np.array([0.66, 0.0, -0.66])
        deck = np.column_stack([np.full(3, shift[-1]), inner * half[-1], np.full(3, z[-1])])
        keel = np.column_stack([np.full(3, shift[0]), -inner * half[0], np.full(3, z[0])])
        left = np.column_stack([shift, half, z])
        right = np.column_stack([shift, -half, z])[::-1]
        rings[row] = np.concatenate([left, deck, right, keel])
    return loft("hull", rings)


def _plan(share: Floats, fullness: float, transom: float) -> Floats:
    """Half breadth along the ship as a share of the largest: the transom, full amidships, the bow."""
    bow = np.clip((share - (1 - fullness * 1.15)) / (fullness * 1.15), 0, 1)
    stern = np.clip(1 - share / 0.25, 0, 1)
    return np.maximum((1 - bow**2.0) * (1 - (1 - transom) * stern**2), 0.012)


def _deck(
    shape: ShipShape, name: str, ends: tuple[float, float], wide: float, floor: float, high: float
) -> Part:
    """One tier of the superstructure, rounded at its ends and leaning back at the front."""
    stern, bow = (shape.length_m * (share - 0.5) for share in ends)
    outline, up = superellipse(48, 5.0), np.linspace(0, 1, 7)[:, None]
    lean = 0.7 * high * up
    x = (stern + bow - lean) / 2 + (bow - stern - lean) / 2 * outline[:, 0]
    breadth = _plan(x / shape.length_m + 0.5, shape.fullness, 0.92)
    y = wide * (1 - 0.05 * up) * shape.beam_m / 2 * breadth * outline[:, 1]
    z = np.broadcast_to(floor + high * up - 0.1 * (up == 0), x.shape)
    return loft(name, np.stack([x, y, z], axis=-1))


def _mast(shape: ShipShape, floor: float) -> Part:
    share = float(np.mean(shape.decks[-1][:2]))
    radius = 0.035 * shape.mast_m + 0.08
    top = shape.mast_m
    profile = np.array(
        [(-0.3, 0.0), (-0.29, 1.6 * radius), (top / 2, radius), (top, 0.6 * radius), (top + 0.01, 0.0)]
    )
    origin = np.array([shape.length_m * (share - 0.5), 0.0, floor])
    return revolve("mast", profile, origin, np.array([0.0, 0.0, 1.0]), around=12)


def _funnel(shape: ShipShape, floor: float) -> Part:
    assert shape.funnel is not None
    share, length, height = shape.funnel
    outline, up = superellipse(32, 2.6), np.linspace(0, 1, 6)[:, None]
    narrow = 1 - 0.2 * up
    x = shape.length_m * (share - 0.5) - 0.3 * height * up + length / 2 * narrow * outline[:, 0]
    y = 0.3 * length * narrow * outline[:, 1]
    z = np.broadcast_to(floor - 0.2 + up * height, x.shape)
    return loft("funnel", np.stack([x, y, z], axis=-1))


def _lifeboats(shape: ShipShape) -> list[Part]:
    boats = []
    for side, name in ((1.0, "left"), (-1.0, "right")):
        for number in range(shape.lifeboats):
            x = shape.length_m * (-0.28 + 0.5 * number / max(shape.lifeboats - 1, 1))
            y = side * shape.beam_m * 0.5
            z = shape.freeboard_m + 2.2
            size = np.array([4.6, 1.3, 1.3])
            low, high = np.array([x, y, z]) - size, np.array([x, y, z]) + size
            boats.append(block(f"lifeboat_{name}_{number + 1}", low.tolist(), high.tolist(), 2))
    return boats
