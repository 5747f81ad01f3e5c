"""Parameters of an airliner; `shapes.toml` has four of them.

Lengths count from the nose aft along the fuselage and up from the ground. The dimensions are those
the makers publish for airport planning (length, span, height, fuselage, engine positions); chords
and fillets in between are drawn to match them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Hump:
    """A second lobe on top of the fuselage: the upper deck of a 747, the hold of a Beluga."""

    rise_m: float  # of its middle above the middle of the fuselage
    width_m: float
    height_m: float
    span_m: tuple[float, float, float, float]  # begins, full, full until, gone; from the nose


@dataclass(frozen=True)
class Wing:
    """A half wing, fin or stabiliser, by its straight leading edge and three chords."""

    apex_m: float  # leading edge at the root, from the nose
    root_z_m: float  # above the ground
    span_m: float  # of this half
    chords_m: tuple[float, float, float]  # root, kink, tip
    kink: float  # share of the half span
    sweep_deg: float  # of the leading edge
    dihedral_deg: float = 0.0
    thickness: tuple[float, float] = (0.14, 0.10)  # root, tip
    winglet_m: float = 0.0  # its height, 0: none


@dataclass(frozen=True)
class Engine:
    """A pair of engines, one under each wing."""

    out_m: float  # distance from the plane of symmetry
    front_m: float  # intake lip, from the nose
    diameter_m: float
    length_m: float
    clearance_m: float  # of the cowl above the ground
    suffix: str = ""  # of the part's name: "" or "_outer"


@dataclass(frozen=True)
class AirlinerShape:
    """Parameters of an airliner."""

    length_m: float
    width_m: float  # of the fuselage
    height_m: float  # of the fuselage
    axis_z_m: float  # of the fuselage's middle above the ground
    nose_m: float  # length of the nose
    tail_m: float  # length of the tail cone
    wing: Wing
    stabiliser: Wing
    fin: Wing
    engines: tuple[Engine, ...]
    hump: Hump | None = None
    endplate_m: float = 0.0  # height of the fins at the stabiliser's tips, 0: none

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> AirlinerShape:
        """The shape of a table of `shapes.toml`."""
        wings = {name: Wing(**values[name]) for name in ("wing", "stabiliser", "fin")}
        hump = Hump(**values["hump"]) if "hump" in values else None
        engines = tuple(Engine(**engine) for engine in values["engines"])
        return cls(**{**values, **wings, "engines": engines, "hump": hump})
