"""Parametric wind turbines: tower, nacelle, hub and three blades, the hub along +X."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.records import Floats
from upplied.samples.surfaces import Member, Part, airfoil, assemble, loft, pillar, revolve, superellipse


@dataclass(frozen=True)
class TurbineShape:
    """Parameters of a turbine."""

    hub_height_m: float
    rotor_m: float  # diameter
    tower_m: tuple[float, float]  # diameter at the base and at the top
    nacelle_m: tuple[float, float, float]  # length, width, height
    nacelle_exponent: float  # 2 an egg, 6 nearly a box
    chord_m: float  # widest of a blade
    overhang_m: float  # from the tower's axis forward to the middle of the hub
    tilt_deg: float = 5.0  # of the rotor's axis, upwards
    azimuth_deg: float = 0.0  # of the first blade from upright
    flare: float = 1.0  # how quickly the tower narrows: 1 a cone, more a wide foot


def turbine(shape: TurbineShape, structure_id: str) -> Member:
    """The mesh of a wind turbine whose tower stands on the origin."""
    tilt = np.radians(shape.tilt_deg)
    axis = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    hub = np.array([shape.overhang_m, 0.0, shape.hub_height_m])
    blades = [_blade(shape, hub, axis, number) for number in range(3)]
    return assemble(
        structure_id,
        "wind_turbine",
        [_tower(shape), _nacelle(shape, hub, axis), _hub(shape, hub, axis), *blades],
        "parametric wind turbine",
        landmarks=("hub",),
    )


def _tower(shape: TurbineShape) -> Part:
    share = np.linspace(0, 1, 29)
    foot, top = shape.tower_m
    radius = (top + (foot - top) * (1 - share) ** shape.flare) / 2
    height = shape.hub_height_m - 0.35 * shape.nacelle_m[2]
    return pillar("tower", np.zeros(2), share * height, np.stack([radius, radius], 1), 2.0)


def _nacelle(shape: TurbineShape, hub: Floats, axis: Floats) -> Part:
    length, width, height = shape.nacelle_m
    lift = np.array([-axis[2], 0.0, axis[0]])
    along = np.cos(np.linspace(0, np.pi, 17))[1:-1]
    swell = (1 - np.abs(along) ** (shape.nacelle_exponent + 1)) ** (1 / (shape.nacelle_exponent + 1))
    outline = superellipse(28, shape.nacelle_exponent)
    middle = hub - (length / 2 + 0.10 * length) * axis + 0.06 * height * lift
    rings = (
        (middle + along[:, None] * length / 2 * axis)[:, None]
        + swell[:, None, None] * width / 2 * outline[None, :, :1] * np.array([0.0, 1.0, 0.0])
        + swell[:, None, None] * height / 2 * outline[None, :, 1:] * lift
    )
    return loft("nacelle", rings, (middle + length / 2 * axis, middle - length / 2 * axis))


def _hub(shape: TurbineShape, hub: Floats, axis: Floats) -> Part:
    radius = 0.36 * shape.nacelle_m[2] + 0.1 * shape.chord_m
    angle = np.linspace(0, np.pi, 13)
    profile = np.stack([-np.cos(angle) * 1.15 * radius, np.sin(angle) * radius], axis=1)
    return revolve("hub", profile, hub, axis)


def _blade(shape: TurbineShape, hub: Floats, axis: Floats, number: int) -> Part:
    """A blade from its round root over the widest chord to the tip, twisted towards the wind."""
    angle = np.radians(shape.azimuth_deg + 120.0 * number)
    lift = np.array([-axis[2], 0.0, axis[0]])
    out = np.cos(angle) * lift + np.sin(angle) * np.array([0.0, 1.0, 0.0])
    edge = np.cross(axis, out)  # the direction in which the blade turns
    share = np.array(
        [0.03, 0.06, 0.09, 0.13, 0.18, 0.23, 0.3, 0.38, 0.47, 0.57, 0.67, 0.77, 0.86, 0.94, 0.985, 1]
    )
    round_share = 1 - np.interp(share, (0.08, 0.22), (0.0, 1.0))
    chord = shape.chord_m * np.interp(
        share, (0, 0.08, 0.22, 0.5, 0.9, 0.97, 1), (0.62, 0.62, 1, 0.66, 0.27, 0.18, 0.06)
    )
    thick = np.interp(share, (0.2, 0.5, 1.0), (0.34, 0.22, 0.15))
    twist = np.radians(np.interp(share, (0.1, 0.25, 0.6, 1.0), (16, 13, 3, 0)))
    foil = airfoil(12, 0.02)
    turn = 2 * np.pi * np.arange(len(foil)) / len(foil)
    circle = np.stack([0.5 + 0.5 * np.cos(turn), 0.5 * np.sin(turn)], axis=1)
    rings = np.empty((len(share), len(foil), 3))
    for row in range(len(share)):
        outline = round_share[row] * circle + (1 - round_share[row]) * foil * (1, thick[row])
        outline = outline - (0.5 * round_share[row] + 0.3 * (1 - round_share[row]), 0)
        aft = -np.cos(twist[row]) * edge - np.sin(twist[row]) * axis
        wind = np.cos(twist[row]) * axis - np.sin(twist[row]) * edge
        middle = hub + share[row] * shape.rotor_m / 2 * out
        rings[row] = middle + chord[row] * (outline[:, :1] * aft + outline[:, 1:] * wind)
    return loft(f"blade_{number + 1}", rings)
