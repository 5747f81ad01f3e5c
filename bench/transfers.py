"""The paper's fifteen transfers (Tables I and II), and the structures that stand for its models."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from real_data import real_folder, real_structure

from upplied.records import Demonstration, Structure
from upplied.samples.fleet import member
from upplied.samples.pilot import fly


@dataclass(frozen=True)
class Published:
    """One row of the paper's tables."""

    title: str
    source: str
    target: str
    inspection: str
    coverage_pct: float
    baseline_pct: float
    frechet: float


PUBLISHED = (
    Published("A320 fuselage > Beluga", "a320", "beluga", "fuselage", 98.3, 88.8, 0.70),
    Published("A320 fuselage > 747", "a320", "b747", "fuselage", 99.8, 98.8, 1.09),
    Published("A320 fuselage > 777", "a320", "b777", "fuselage", 98.3, 72.8, 0.75),
    Published("A320 wings > Beluga", "a320", "beluga", "wings", 96.61, 86.6, 0.74),
    Published("A320 wings > 747", "a320", "b747", "wings", 99.5, 99.2, 0.58),
    Published("A320 wings > 777", "a320", "b777", "wings", 94.3, 78.9, 0.74),
    Published("A320 engine > Beluga", "a320", "beluga", "engine_left", 92.8, 83.6, 1.45),
    Published("A320 engine > 747", "a320", "b747", "engine_left", 99.9, 98.6, 1.90),
    Published("A320 engine > 777", "a320", "b777", "engine_left", 92.8, 83.6, 1.47),
    Published("turbine 1 tower > turbine 2", "turbine-1", "turbine-2", "tower", 99.7, 98.7, 0.63),
    Published("turbine 1 tower > turbine 3", "turbine-1", "turbine-3", "tower", 100.0, 98.0, 0.75),
    Published("cruise hull > yacht 1", "cruise", "yacht-1", "hull", 99.5, 99.5, 1.85),
    Published("cruise hull > yacht 2", "cruise", "yacht-2", "hull", 100.0, 100.0, 1.05),
    Published("cube sides > cuboid", "cube", "cuboid", "sides", 100.0, 100.0, 0.54),
    Published("bridge 1 piers > bridge 2", "bridge-1", "bridge-2", "piers", 99.8, 98.4, 0.73),
)
# Real meshes that stand for the paper's models; the boxes are boxes.
REAL = {
    "a320": "airplane/a320_fr24",
    "beluga": "airplane/beluga_fr24",
    "b747": "airplane/b744_fr24",
    "b777": "airplane/b772_fr24",
    "turbine-1": "wind_turbine/enercon_e82_98m",
    "turbine-2": "wind_turbine/vestas_v112_119m",
    "turbine-3": "wind_turbine/vestas_v90_105m",
    "cruise": "ship/cruise_ship_219m",
    "yacht-1": "yacht/motor_yacht_22m",
    "yacht-2": "yacht/catamaran_18m",
    "bridge-1": "bridge/larics_bridge",
    "bridge-2": "bridge/osijek_suspension",
}


@dataclass(frozen=True)
class Transfer:
    """A row of the tables with what it needs."""

    published: Published
    demonstration: Demonstration
    source: Structure
    target: Structure


def transfers(real: bool = False, only: str = "") -> Iterator[Transfer]:
    """The fifteen transfers on the samples or on real meshes; `only` keeps rows whose title contains it."""
    for row in PUBLISHED:
        if only.lower() in row.title.lower():
            source = structure_for(row.source, real)
            yield Transfer(
                row, flown(row.source, row.inspection, real), source, structure_for(row.target, real)
            )


@cache
def structure_for(name: str, real: bool) -> Structure:
    """The structure that stands for a model of the paper."""
    folder = real_folder()
    if real and folder is not None and name in REAL:
        return real_structure(folder, REAL[name])
    return member(f"{name}-v1").structure


@cache
def flown(name: str, inspection: str, real: bool) -> Demonstration:
    """The simulated pilot's demonstration on it."""
    return fly(structure_for(name, real), inspection, seed=len(inspection))
