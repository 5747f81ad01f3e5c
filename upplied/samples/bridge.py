"""Parametric beam bridges: a deck with parapets on two piers between two abutments, the road along X."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.samples.surfaces import Member, assemble, block, pillar


@dataclass(frozen=True)
class BridgeShape:
    """Parameters of a bridge."""

    length_m: float
    width_m: float
    deck_z_m: float  # underside of the deck above the ground
    deck_m: float  # thickness of the deck
    spacing_m: float  # between the two piers
    pier_m: tuple[float, float]  # size of a pier along and across the road
    pier_exponent: float  # 2 round, 6 nearly square
    taper: float = 0.0  # share by which a pier is narrower at its top


def bridge(shape: BridgeShape, structure_id: str) -> Member:
    """The mesh of a bridge whose middle stands on the origin."""
    half, wide = shape.length_m / 2, shape.width_m / 2
    low, top = shape.deck_z_m, shape.deck_z_m + shape.deck_m
    parts = [
        block("deck", (-half, -wide, low), (half, wide, top), cells=16),
        block("parapet_left", (-half, wide - 0.4, top - 0.1), (half, wide, top + 1.1), cells=8),
        block("parapet_right", (-half, -wide, top - 0.1), (half, 0.4 - wide, top + 1.1), cells=8),
    ]
    level = np.linspace(0, 1, 15)
    pier = np.array(shape.pier_m) / 2 * (1 - shape.taper * level[:, None])
    along, across = shape.pier_m[0] / 2 + 0.4, min(wide - 0.3, shape.pier_m[1] / 2 + 1.2)
    for number, x in enumerate((-shape.spacing_m / 2, shape.spacing_m / 2), start=1):
        parts += [
            pillar(f"pier_{number}", np.array([x, 0.0]), level * low, pier, shape.pier_exponent, around=32),
            block(f"cap_{number}", (x - along, -across, low - 1.2), (x + along, across, low + 0.1), cells=3),
        ]
    wide, top = wide + 0.3, low + shape.deck_m / 2
    parts += [
        block("abutment_back", (-half - 4.0, -wide, 0.0), (-half + 1.0, wide, top), cells=6),
        block("abutment_front", (half - 1.0, -wide, 0.0), (half + 4.0, wide, top), cells=6),
    ]
    return assemble(structure_id, "bridge", parts, "parametric beam bridge", landmarks=("pier",))
