"""Structures of each kind that nobody built, for tests and benchmarks: the same for the same seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from upplied.errors import InputError
from upplied.samples.airliner import airliner
from upplied.samples.fleet import SHAPES, shape_of
from upplied.samples.parametric import BridgeShape, ShipShape, TurbineShape, bridge, ship, turbine
from upplied.samples.surfaces import Member, box, stamped


def random_member(kind: str, seed: int) -> Member:
    """A structure of the kind that is not in the fleet, the same for the same seed."""
    if kind not in _RANDOM:
        raise InputError(f"kind {kind!r}", "is unknown", f"one of {', '.join(sorted(_RANDOM))}")
    return _RANDOM[kind](f"{kind}-random-{seed}", np.random.default_rng(seed))


def random_airliner(structure_id: str, rng: np.random.Generator) -> Member:
    """An airliner that nobody built: a sample at another size, with another wing and tail."""
    base = shape_of(list(SHAPES["airliner"])[rng.integers(4)])
    wing, stabiliser, fin = base.wing, base.stabiliser, base.fin
    other = airliner(
        replace(
            base,
            wing=replace(
                wing,
                span_m=wing.span_m * rng.uniform(0.88, 1.12),
                sweep_deg=wing.sweep_deg + rng.uniform(-3, 3),
                dihedral_deg=wing.dihedral_deg + rng.uniform(-1.5, 1.5),
            ),
            stabiliser=replace(stabiliser, span_m=stabiliser.span_m * rng.uniform(0.9, 1.1)),
            fin=replace(fin, span_m=fin.span_m * rng.uniform(0.9, 1.1)),
            engines=tuple(
                replace(engine, diameter_m=engine.diameter_m * rng.uniform(0.9, 1.08))
                for engine in base.engines
            ),
        ),
        structure_id,
    )
    size = float(rng.uniform(0.85, 1.2))
    landmarks = {
        name: (size * x, size * y, size * z) for name, (x, y, z) in other.structure.landmarks.items()
    }
    grown = replace(other.structure, vertices=size * other.structure.vertices, landmarks=landmarks)
    return replace(other, structure=stamped(grown))


def random_turbine(structure_id: str, rng: np.random.Generator) -> Member:
    """A turbine that nobody built."""
    hub = rng.uniform(60, 140)
    rotor = hub * rng.uniform(0.8, 1.25)
    size = rotor / 90
    return turbine(
        TurbineShape(
            hub,
            rotor,
            (rng.uniform(4, 7), rng.uniform(2.2, 3.2)),
            (size * rng.uniform(8, 12), size * rng.uniform(3.2, 4.6), size * rng.uniform(3.4, 4.6)),
            rng.uniform(2.2, 6),
            size * rng.uniform(3.0, 4.0),
            size * rng.uniform(3.8, 5.0),
            rng.uniform(3, 6),
            flare=rng.uniform(1.0, 2.0),
        ),
        structure_id,
    )


def random_ship(structure_id: str, rng: np.random.Generator) -> Member:
    """A ship that nobody built."""
    length = float(np.exp(rng.uniform(np.log(20), np.log(200))))
    beam = length * rng.uniform(0.14, 0.22) * (1 - 0.15 * np.log(length / 20) / np.log(10))
    freeboard = beam * rng.uniform(0.3, 0.4)
    decks, stern, bow = [], rng.uniform(0.08, 0.2), rng.uniform(0.68, 0.84)
    for tier in range(3):
        decks.append((stern, bow, rng.uniform(0.84, 0.92) - 0.12 * tier, beam * rng.uniform(0.18, 0.26)))
        stern, bow = stern + rng.uniform(0.03, 0.1), bow - rng.uniform(0.04, 0.1)
    return ship(
        ShipShape(
            length,
            beam,
            freeboard,
            0.1 * freeboard,
            0.3 * freeboard,
            length * rng.uniform(0.05, 0.1),
            rng.uniform(0.08, 0.16),
            rng.uniform(0.32, 0.46),
            tuple(decks),
            0.4 * freeboard,
        ),
        structure_id,
    )


def random_box(structure_id: str, rng: np.random.Generator) -> Member:
    """A box of random size."""
    x, y, z = rng.uniform(8, 30, 3)
    return box((float(x), float(y), float(z)), structure_id)


def random_bridge(structure_id: str, rng: np.random.Generator) -> Member:
    """A bridge that nobody built."""
    spacing = rng.uniform(24, 50)
    return bridge(
        BridgeShape(
            spacing * rng.uniform(2.2, 2.9),
            rng.uniform(9, 16),
            rng.uniform(12, 24),
            rng.uniform(1.0, 2.4),
            spacing,
            (rng.uniform(2.0, 4.5), rng.uniform(5.0, 8.0)),
            rng.uniform(2.0, 6.0),
            rng.uniform(0.0, 0.25),
        ),
        structure_id,
    )


_RANDOM: dict[str, Callable[[str, np.random.Generator], Member]] = {
    "airliner": random_airliner,
    "wind_turbine": random_turbine,
    "ship": random_ship,
    "box": random_box,
    "bridge": random_bridge,
}
