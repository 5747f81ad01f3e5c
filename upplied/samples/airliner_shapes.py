"""What tells one airliner from another, and four of them.

Lengths count from the nose aft along the fuselage and up from the ground. The dimensions are those
the makers publish for airport planning (length, span, height, fuselage, engine positions); chords
and fillets in between are drawn to match them.
"""

from __future__ import annotations

from dataclasses import dataclass


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
    """Everything that tells one airliner from another."""

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


A320 = AirlinerShape(
    length_m=37.57, width_m=3.95, height_m=4.14, axis_z_m=3.85, nose_m=5.4, tail_m=12.5,
    wing=Wing(11.0, 2.75, 16.95, (7.2, 3.9, 1.55), 0.38, 27.5, 5.1, (0.15, 0.11), 1.1),
    stabiliser=Wing(31.2, 4.75, 6.22, (4.1, 2.8, 1.3), 0.5, 33.0, 6.0, (0.11, 0.09)),
    fin=Wing(28.6, 5.3, 6.46, (6.3, 4.2, 1.95), 0.5, 40.0, 0.0, (0.11, 0.09)),
    engines=(Engine(5.75, 10.9, 2.37, 4.4, 0.56),),
)  # fmt: skip

BELUGA = AirlinerShape(
    length_m=56.15, width_m=5.64, height_m=5.64, axis_z_m=4.75, nose_m=6.5, tail_m=18.5,
    wing=Wing(16.2, 3.4, 22.0, (10.8, 6.3, 2.7), 0.36, 31.0, 5.4, (0.15, 0.105), 1.4),
    stabiliser=Wing(46.2, 6.4, 9.6, (5.9, 4.2, 2.4), 0.5, 37.0, 5.0, (0.11, 0.09)),
    fin=Wing(41.6, 6.4, 10.84, (10.6, 6.9, 3.5), 0.5, 42.5, 0.0, (0.12, 0.09)),
    engines=(Engine(7.95, 15.6, 2.95, 5.7, 0.95),),
    hump=Hump(3.0, 7.4, 7.3, (2.8, 10.2, 33.0, 52.0)), endplate_m=4.6,
)  # fmt: skip

B747 = AirlinerShape(
    length_m=70.66, width_m=6.5, height_m=6.6, axis_z_m=5.4, nose_m=8.6, tail_m=23.0,
    wing=Wing(17.0, 3.7, 31.6, (16.6, 10.0, 4.0), 0.36, 41.5, 7.0, (0.13, 0.085), 1.9),
    stabiliser=Wing(57.5, 6.9, 11.08, (9.6, 6.2, 2.7), 0.5, 42.0, 7.0, (0.10, 0.08)),
    fin=Wing(53.4, 7.9, 11.5, (12.6, 8.4, 4.1), 0.5, 49.0, 0.0, (0.11, 0.09)),
    engines=(Engine(11.7, 22.6, 2.95, 5.9, 1.1), Engine(20.8, 31.0, 2.95, 5.9, 1.9, "_outer")),
    hump=Hump(2.05, 5.3, 5.0, (1.5, 8.0, 18.5, 29.0)),
)  # fmt: skip

B777 = AirlinerShape(
    length_m=63.73, width_m=6.2, height_m=6.2, axis_z_m=5.2, nose_m=8.4, tail_m=21.0,
    wing=Wing(18.4, 3.6, 30.46, (14.2, 7.6, 2.0), 0.34, 34.5, 6.5, (0.14, 0.09)),
    stabiliser=Wing(53.0, 6.4, 10.76, (7.6, 5.0, 2.3), 0.5, 39.0, 7.0, (0.10, 0.08)),
    fin=Wing(49.6, 7.5, 11.0, (9.7, 6.6, 3.1), 0.5, 44.0, 0.0, (0.11, 0.09)),
    engines=(Engine(9.6, 18.6, 3.95, 7.3, 0.95),),
)  # fmt: skip
