"""Parametric ships, wind turbines and beam bridges.

A ship has a flared hull with raked bow and transom, and decks on top; its waterline is at z = 0. A turbine
has a tower, a nacelle, a hub and three blades, the hub along +X. A bridge is a deck with parapets on
piers between two abutments, the road along X.
"""

from dataclasses import dataclass

import numpy as np

from upplied.records import Floats
from upplied.samples.surfaces import Member, Part, airfoil, assemble, block, loft, revolve, superellipse


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
        parts.append(_funnel(shape.length_m, *shape.funnel, floor))
    for side, name in ((1.0, "left"), (-1.0, "right")):
        for number in range(shape.lifeboats):
            x = shape.length_m * (-0.28 + 0.5 * number / max(shape.lifeboats - 1, 1))
            middle, size = np.array([x, side * shape.beam_m * 0.5, shape.freeboard_m + 2.2]), (4.6, 1.3, 1.3)
            parts.append(block(f"lifeboat_{name}_{number + 1}", middle - size, middle + size, 2))
    return assemble(structure_id, "ship", parts, "parametric ship, from the waterline up")


def _hull(shape: ShipShape) -> Part:
    """Stations from the transom to the stem; each a keel-to-deck outline of fixed grid."""
    share = 1 - (1 - np.linspace(0, 1, 41)) ** 1.5
    level, inner = np.array([0.0, 0.12, 0.3, 0.5, 0.7, 0.88, 1.0]), np.array([0.66, 0.0, -0.66])
    deck_z = shape.freeboard_m + shape.sheer_m * np.clip((share - 0.45) / 0.55, 0, 1) ** 2
    beam_deck = shape.beam_m / 2 * _plan(share, shape.fullness, 0.92)
    beam_low = shape.beam_m / 2 * (1 - shape.flare) * _plan(share, shape.fullness + 0.14, 0.84)
    rings = np.empty((len(share), 2 * len(level) + 6, 3))
    for row, at in enumerate(share):
        half = beam_low[row] + (beam_deck[row] - beam_low[row]) * level**1.4
        z = -shape.draught_m + level * (deck_z[row] + shape.draught_m)
        shift = -shape.length_m / 2 + at * (shape.length_m - shape.rake_m * (1 - level**1.2))
        deck = np.column_stack([np.full(3, shift[-1]), inner * half[-1], np.full(3, z[-1])])
        keel = np.column_stack([np.full(3, shift[0]), -inner * half[0], np.full(3, z[0])])
        left, right = np.column_stack([shift, half, z]), np.column_stack([shift, -half, z])
        rings[row] = np.concatenate([left, deck, right[::-1], keel])
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
    radius, top = 0.035 * shape.mast_m + 0.08, shape.mast_m
    rows = [(-0.3, 0.0), (-0.29, 1.6 * radius), (top / 2, radius), (top, 0.6 * radius), (top + 0.01, 0.0)]
    origin = np.array([shape.length_m * (share - 0.5), 0.0, floor])
    return revolve("mast", np.array(rows), origin, np.array([0.0, 0.0, 1.0]), around=12)


def _funnel(length_m: float, share: float, length: float, height: float, floor: float) -> Part:
    outline, up = superellipse(32, 2.6), np.linspace(0, 1, 6)[:, None]
    narrow = 1 - 0.2 * up
    x = length_m * (share - 0.5) - 0.3 * height * up + length / 2 * narrow * outline[:, 0]
    y = 0.3 * length * narrow * outline[:, 1]
    z = np.broadcast_to(floor - 0.2 + up * height, x.shape)
    return loft("funnel", np.stack([x, y, z], axis=-1))


# Stations of a blade, shares of the rotor's radius; its chord, as a share of the widest, there.
_BLADE = (0.03, 0.06, 0.09, 0.13, 0.18, 0.23, 0.3, 0.38, 0.47, 0.57, 0.67, 0.77, 0.86, 0.94, 0.985, 1)
_CHORD = (0, 0.08, 0.22, 0.5, 0.9, 0.97, 1), (0.62, 0.62, 1, 0.66, 0.27, 0.18, 0.06)


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
    share, (foot, top) = np.linspace(0, 1, 29), shape.tower_m
    half = (top + (foot - top) * (1 - share[:, None]) ** shape.flare) / 2
    height, angle = shape.hub_height_m - 0.35 * shape.nacelle_m[2], np.linspace(0, np.pi, 13)
    radius = 0.36 * shape.nacelle_m[2] + 0.1 * shape.chord_m
    profile = np.stack([-np.cos(angle) * 1.15 * radius, np.sin(angle) * radius], axis=1)
    parts = [_pillar("tower", np.zeros(2), share * height, half, 2.0, around=24)]
    parts += [_nacelle(shape, hub, axis), revolve("hub", profile, hub, axis)]
    parts += [_blade(shape, hub, axis, number) for number in range(3)]
    return assemble(structure_id, "wind_turbine", parts, "parametric wind turbine", landmarks=("hub",))


def _nacelle(shape: TurbineShape, hub: Floats, axis: Floats) -> Part:
    length, width, height = shape.nacelle_m
    lift, across = np.array([-axis[2], 0.0, axis[0]]), np.array([0.0, 1.0, 0.0])
    along = np.cos(np.linspace(0, np.pi, 17))[1:-1]
    swell = (1 - np.abs(along) ** (shape.nacelle_exponent + 1)) ** (1 / (shape.nacelle_exponent + 1))
    outline = superellipse(28, shape.nacelle_exponent)
    middle = hub - (length / 2 + 0.10 * length) * axis + 0.06 * height * lift
    rings = (middle + along[:, None] * length / 2 * axis)[:, None]
    rings = rings + swell[:, None, None] * width / 2 * outline[None, :, :1] * across
    rings = rings + swell[:, None, None] * height / 2 * outline[None, :, 1:] * lift
    return loft("nacelle", rings, (middle + length / 2 * axis, middle - length / 2 * axis))


def _blade(shape: TurbineShape, hub: Floats, axis: Floats, number: int) -> Part:
    """A blade from its round root over the widest chord to the tip, twisted towards the wind."""
    angle = np.radians(shape.azimuth_deg + 120.0 * number)
    lift = np.array([-axis[2], 0.0, axis[0]])
    out = np.cos(angle) * lift + np.sin(angle) * np.array([0.0, 1.0, 0.0])
    edge = np.cross(axis, out)  # the direction in which the blade turns
    share = np.array(_BLADE)
    round_share = 1 - np.interp(share, (0.08, 0.22), (0.0, 1.0))
    chord = shape.chord_m * np.interp(share, *_CHORD)
    thick = np.interp(share, (0.2, 0.5, 1.0), (0.34, 0.22, 0.15))
    twist = np.radians(np.interp(share, (0.1, 0.25, 0.6, 1.0), (16, 13, 3, 0)))
    foil = airfoil(12, 0.02)
    turn = 2 * np.pi * np.arange(len(foil)) / len(foil)
    circle = np.stack([0.5 + 0.5 * np.cos(turn), 0.5 * np.sin(turn)], axis=1)
    rings = np.empty((len(share), len(foil), 3))
    for row, (at, round_, angle) in enumerate(zip(share, round_share, twist, strict=True)):
        outline = round_ * circle + (1 - round_) * foil * (1, thick[row])
        outline = outline - (0.5 * round_ + 0.3 * (1 - round_), 0)
        aft, wind = -np.cos(angle) * edge - np.sin(angle) * axis, np.cos(angle) * axis - np.sin(angle) * edge
        middle = hub + at * shape.rotor_m / 2 * out
        rings[row] = middle + chord[row] * (outline[:, :1] * aft + outline[:, 1:] * wind)
    return loft(f"blade_{number + 1}", rings)


def _pillar(name: str, base: Floats, levels: Floats, half: Floats, exponent: float, around: int) -> Part:
    """An upright column round a base (2,), m: superellipses of half sizes (S, 2), m, at heights (S,), m."""
    rings = np.empty((len(levels), around, 3))
    rings[..., :2] = base + half[:, None] * superellipse(around, exponent)
    rings[..., 2] = levels[:, None]
    return loft(name, rings)


@dataclass(frozen=True)
class BridgeShape:
    """Parameters of a bridge."""

    length_m: float
    width_m: float
    deck_z_m: float  # underside of the deck above the ground
    deck_m: float  # thickness of the deck
    spacing_m: float  # between two piers
    pier_m: tuple[float, float]  # size of a pier along and across the road
    pier_exponent: float  # 2 round, 6 nearly square
    taper: float = 0.0  # share by which a pier is narrower at its top
    piers: int = 2


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
    for number in range(1, shape.piers + 1):
        x = shape.spacing_m * (number - (shape.piers + 1) / 2)
        parts += [
            _pillar(f"pier_{number}", np.array([x, 0.0]), level * low, pier, shape.pier_exponent, around=32),
            block(f"cap_{number}", (x - along, -across, low - 1.2), (x + along, across, low + 0.1), cells=3),
        ]
    wide, top = wide + 0.3, low + shape.deck_m / 2
    parts += [
        block("abutment_back", (-half - 4.0, -wide, 0.0), (-half + 1.0, wide, top), cells=6),
        block("abutment_front", (half - 1.0, -wide, 0.0), (half + 4.0, wide, top), cells=6),
    ]
    return assemble(structure_id, "bridge", parts, "parametric beam bridge", landmarks=("pier",))
