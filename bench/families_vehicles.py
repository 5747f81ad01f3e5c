"""Families that move: helicopters, locomotives and biplanes towards +X, by chance.

Sizes vary by about 1.5; what else does is said of each.
"""

from __future__ import annotations

import numpy as np
from families_solids import extruded, place, sized, slab, spoke, strut, turned, up

from upplied.records import Floats
from upplied.samples.surfaces import Part, foil_loft, loft, revolve, superellipse

_FORWARD, _LEFT = spoke(0.0), spoke(np.pi / 2)


def helicopter(rng: np.random.Generator) -> list[Part]:
    """A main rotor of 2 to 5 blades, a tail rotor, skids or three wheels; stub wings with pods or none."""
    long, wide, tall = sized(rng, 6.2), sized(rng, 2.2), sized(rng, 2.2)
    boom, radius, ground = sized(rng, 6.5), sized(rng, 6.0), rng.uniform(0.7, 0.95)
    middle = ground + tall / 2
    share = np.linspace(0, 1, 13)[1:-1]
    swell = np.sin(np.pi * share**0.75) ** 0.55
    x = long * (0.55 - share)
    parts = [
        _body("body", x, wide / 2 * swell, tall / 2 * swell, middle + 0.1 * tall * (share - 0.5), 0.55 * long)
    ]
    at, high = np.linspace(0, 1, 6), middle + 0.25 * tall
    rear = -0.3 * long
    thin = np.interp(at, (0, 1), (0.28 * tall, 0.1 * tall))
    parts.append(_body("boom", rear - boom * at, thin, thin, high + 0.1 * boom * at, rear + 0.2))
    tip, fin = np.array([rear - boom, 0.0, high + 0.1 * boom]), sized(rng, 1.5)
    sections = [
        (tuple(tip + place(0.6, 0, -0.3 * fin)), 0.9, 0.16),
        (tuple(tip + place(-0.3, 0, fin)), 0.6, 0.14),
    ]
    parts.append(foil_loft("fin", sections, (0.0, 1.0, 0.0), 6))
    for label, side in (("left", 1.0), ("right", -1.0)):
        root = tip + place(1.4, side * 0.1, -0.1)
        sections = [(tuple(root), 0.7, 0.14), (tuple(root + place(-0.1, side * 1.2, 0)), 0.5, 0.12)]
        parts.append(foil_loft(f"stabiliser_{label}", sections, (0.0, 0.0, 1.0), 6))
    hub = np.array([0.08 * long, 0.0, middle + 0.5 * tall + sized(rng, 0.7)])
    parts.append(strut("mast", hub - up(1.0), hub + up(0.15), 0.18, 12))
    parts.append(slab("cowling", hub - place(1.6, 0.5, 1.15), hub + np.array([0.7, 0.5, -0.35])))
    blades, turn = int(rng.integers(2, 6)), rng.uniform(0, 2 * np.pi)
    parts += _blades("blade", hub, np.array([1.0, 0, 0]), _LEFT, radius, blades, turn, 0.36)
    rotor = tip + place(0.1, 0.35, 0.55 * fin)
    parts += _blades(
        "tail_blade", rotor, np.array([1.0, 0, 0]), up(1.0), 1.1, int(rng.integers(2, 5)), turn, 0.2
    )
    parts.append(strut("tail_hub", rotor - place(0, 0.35, 0), rotor + place(0, 0.1, 0), 0.09, 8))
    if rng.integers(2):
        for label, y in (("left", 0.55 * wide), ("right", -0.55 * wide)):
            parts.append(strut(f"skid_{label}", (-0.35 * long, y, 0.07), (0.4 * long, y, 0.07), 0.07, 8))
            for n, at_x in enumerate((-0.15 * long, 0.25 * long), 1):
                parts.append(
                    strut(
                        f"skid_leg_{label}_{n}", (at_x, y, 0.1), (at_x, 0.5 * y, ground + 0.4 * tall), 0.05, 6
                    )
                )
    else:
        for n, (at_x, y) in enumerate(
            ((0.3 * long, 0), (-0.12 * long, 0.5 * wide), (-0.12 * long, -0.5 * wide)), 1
        ):
            parts.append(_wheel(f"wheel_{n}", (at_x, y, 0.3), 0.3, 0.2))
            parts.append(
                strut(f"wheel_leg_{n}", (at_x, y, 0.3), (at_x, 0.6 * y, ground + 0.35 * tall), 0.06, 6)
            )
    if rng.integers(2):
        for label, side in (("left", 1.0), ("right", -1.0)):
            root, end = (0.1, side * 0.3 * wide, middle), (0.0, side * (wide / 2 + 1.3), middle - 0.1)
            parts.append(
                foil_loft(f"stub_{label}", [(root, 1.0, 0.15), (end, 0.8, 0.13)], (0.0, 0.0, 1.0), 4)
            )
            parts.append(
                strut(
                    f"pod_{label}",
                    np.array(end) - place(1.3, 0, 0.25),
                    np.array(end) + place(0.4, 0, -0.25),
                    0.2,
                    10,
                )
            )
    return parts


def _body(name: str, x: Floats, half: Floats, tall: Floats, middle: Floats, nose: float) -> Part:
    """A round body through sections along X, closed at a nose."""
    outline = superellipse(24, 2.3)
    rings = np.empty((len(x), 24, 3))
    rings[..., 0] = x[:, None]
    rings[..., 1] = half[:, None] * outline[:, 0]
    rings[..., 2] = np.broadcast_to(middle, x.shape)[:, None] + tall[:, None] * outline[:, 1]
    return loft(name, rings, (np.array([nose, 0.0, rings[0, :, 2].mean()]), rings[-1].mean(axis=0)))


def _blades(
    name: str, hub: Floats, one: Floats, other: Floats, radius: float, number: int, turn: float, chord: float
) -> list[Part]:
    """Flat blades in the plane of two directions."""
    parts, normal = [], np.cross(one, other)
    for n in range(number):
        angle = turn + 2 * np.pi * n / number
        out, edge = np.cos(angle) * one + np.sin(angle) * other, np.cos(angle) * other - np.sin(angle) * one
        at = np.linspace(0.05, 1, 6)[:, None, None] * radius
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2 * (chord, 0.14 * chord)
        rings = hub + at * out + corners[:, :1] * edge + corners[:, 1:] * normal
        parts.append(loft(f"{name}_{n + 1}", rings))
    return parts


def _wheel(name: str, middle: tuple[float, float, float], radius: float, wide: float) -> Part:
    """A wheel about an axis along Y."""
    rows = np.array([[-0.5, 0], [-0.5, 0.8], [-0.3, 1], [0.3, 1], [0.5, 0.8], [0.5, 0]]) * (wide, radius)
    return revolve(name, rows, np.asarray(middle, float), _LEFT, 20)


def locomotive(rng: np.random.Generator) -> list[Part]:
    """A hood, a cab and a short nose on bogies of 2 or 3 axles on rails: 2 to 4 fans, a tank or none."""
    long, wide, tall = sized(rng, 17.0), sized(rng, 2.9, 1.2), sized(rng, 2.6, 1.3)
    axles, wheel, half = int(rng.integers(2, 4)), rng.uniform(0.48, 0.6), long / 2
    floor = 2 * wheel + 0.55
    parts = [
        slab(f"rail_{n}", (-half - 3, y - 0.07, 0), (half + 3, y + 0.07, 0.18))
        for n, y in ((1, 0.75), (2, -0.75))
    ]
    parts.append(slab("frame", (-half, -wide / 2, floor), (half, wide / 2, floor + 0.35)))
    base, nose, cab = floor + 0.35, half - 0.7, half - sized(rng, 2.8)
    front = cab - sized(rng, 2.4, 1.3)
    outline = np.array([(-0.38, 0), (0.38, 0), (0.38, 0.85), (0.26, 1), (-0.26, 1), (-0.38, 0.85)])
    parts.append(extruded("body_hood", outline * (wide, tall) + (0, base), 0.9 - half, front))
    parts.append(extruded("body_cab", outline * (1.3 * wide, 1.12 * tall) + (0, base), front, cab))
    parts.append(extruded("body_nose", outline * (wide, 0.6 * tall) + (0, base), cab, nose))
    for n, x in enumerate(np.linspace(0.14, 0.6, int(rng.integers(2, 5))) * (front + half) - half, 1):
        parts.append(turned(f"fan_{n}", (x, 0, base + tall - 0.05), [(0, 0.6), (0.3, 0.6)], 20))
    parts.append(
        strut("exhaust", (front - 1.2, 0, base + tall - 0.1), (front - 1.2, 0, base + tall + 0.5), 0.2, 12)
    )
    for label, x in (("back", -half + 0.25 * long * 0.75), ("front", half - 0.25 * long * 0.75)):
        step = 2 * wheel + 0.4
        reach = step * (axles - 1) / 2 + wheel
        for y, side in ((0.95, "left"), (-1.1, "right")):
            low, high = (x - reach, y, wheel + 0.05), (x + reach, y + 0.15, floor - 0.1)
            parts.append(slab(f"bogie_{label}_{side}", low, high))
        parts.append(
            slab(f"bogie_{label}_beam", (x - 0.5, -0.95, wheel + 0.5), (x + 0.5, 0.95, floor + 0.02))
        )
        for n in range(axles):
            at = x + step * (n - (axles - 1) / 2)
            for y, side in ((0.72, "left"), (-0.72, "right")):
                parts.append(_wheel(f"wheel_{label}_{side}_{n + 1}", (at, y, wheel + 0.18), wheel, 0.14))
            parts.append(
                strut(f"axle_{label}_{n + 1}", (at, -0.7, wheel + 0.18), (at, 0.7, wheel + 0.18), 0.09, 8)
            )
    if rng.integers(2):
        size = 0.13 * long
        parts.append(slab("tank", (-size, -0.42 * wide, 0.5), (size, 0.42 * wide, floor)))
    for sign, label in ((1, "front"), (-1, "back")):
        for n, y in enumerate((0.85, -0.85), 1):
            start = np.array([sign * half, y, floor + 0.1])
            parts.append(strut(f"buffer_{label}_{n}", start, start + place(sign * 0.5, 0, 0), 0.2, 12))
    for y, side in ((wide / 2 - 0.05, "left"), (0.05 - wide / 2, "right")):
        parts.append(strut(f"handrail_{side}", (0.4 - half, y, base + 1.0), (front, y, base + 1.0), 0.03, 5))
        for n, x in enumerate(np.linspace(0.4 - half, front - 0.3, 6), 1):
            parts.append(strut(f"handrail_post_{side}_{n}", (x, y, base), (x, y, base + 1.0), 0.03, 5))
    return parts


def biplane(rng: np.random.Generator) -> list[Part]:
    """Two wings of 1 or 2 bays of struts on each side; a radial engine of 5 to 9 cylinders, or a cowling."""
    long, span, chord = sized(rng, 7.4), sized(rng, 10.0), sized(rng, 1.5)
    gap, stagger, wide, wheel = sized(rng, 1.6), rng.uniform(0.0, 0.6), sized(rng, 0.95, 1.3), 0.36
    axis, nose = 2.0 * wheel + 0.75 + 0.3 * wide, 0.3 * long
    share = np.array([0.0, 0.06, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0])
    full = np.array([0.7, 0.92, 1.0, 1.0, 0.8, 0.52, 0.32, 0.28])
    x = nose - share * long
    parts = [
        _body(
            "fuselage", x, wide / 2 * full**1.3, 0.62 * wide * full, axis + 0.12 * long * share**2 * 0.5, nose
        )
    ]
    low, high, half = axis - 0.45 * wide, axis - 0.45 * wide + gap, span / 2
    lead, drop = 0.12 * long, rng.uniform(0.82, 1.0)
    for label, side in (("left", 1.0), ("right", -1.0)):
        for name, z, at, reach, root in (
            ("upper", high, lead + stagger, half, 0.0),
            ("lower", low, lead, drop * half, 0.1),
        ):
            sections = [
                ((at, side * root, z), chord, 0.12),
                ((at - 0.1, side * reach, z + 0.03 * reach), 0.86 * chord, 0.1),
            ]
            parts.append(foil_loft(f"wing_{name}_{label}", sections, (0.0, 0.0, 1.0), 8))
        bays = (0.85,) if span < 9.6 else (0.5, 0.88)
        for n, out in enumerate(bays, 1):
            y, rise = side * out * drop * half, 0.03 * out * drop * half
            for end, aft in (("front", 0.2), ("rear", 0.65)):
                foot, head = (
                    (lead - aft * chord, y, low + rise),
                    (lead + stagger - aft * chord, y, high + rise),
                )
                parts.append(strut(f"strut_{label}_{n}_{end}", foot, head, 0.045, 6))
        for end, aft in (("front", 0.2), ("rear", 0.65)):
            foot = (lead - aft * chord, side * 0.3 * wide, axis + 0.4 * wide)
            parts.append(
                strut(
                    f"cabane_{label}_{end}", foot, (lead + stagger - aft * chord, side * 0.4, high), 0.04, 6
                )
            )
        tail = (x[-2] + 0.7, side * 0.05, axis + 0.07 * long)
        sections = [(tail, 0.9, 0.09), ((tail[0] - 0.3, side * 0.15 * span, tail[2]), 0.6, 0.09)]
        parts.append(foil_loft(f"stabiliser_{label}", sections, (0.0, 0.0, 1.0), 6))
        foot = np.array([lead - 0.1, side * 0.75, wheel])
        parts.append(_wheel(f"wheel_{label}", tuple(foot), wheel, 0.16))
        parts += [
            strut(f"gear_{label}_{n}", foot, (lead + at, side * 0.3 * wide, low), 0.04)
            for n, at in ((1, 0.1), (2, -0.7))
        ]
    fin = np.array([x[-2] + 0.7, 0.0, axis + 0.06 * long])
    sections = [(tuple(fin), 1.0, 0.09), (tuple(fin + place(-0.45, 0, sized(rng, 1.15))), 0.6, 0.09)]
    parts.append(foil_loft("fin", sections, (0.0, 1.0, 0.0), 6))
    parts.append(strut("axle", (lead - 0.1, -0.75, wheel), (lead - 0.1, 0.75, wheel), 0.05))
    hub = np.array([nose + 0.35, 0.0, axis])
    if rng.integers(2):
        number = 2 * int(rng.integers(2, 5)) + 1
        for n, angle in enumerate(2 * np.pi * np.arange(number) / number, 1):
            way = np.cos(angle) * up(1.0) + np.sin(angle) * _LEFT
            root = hub - place(0.25, 0, 0)
            parts.append(strut(f"cylinder_{n}", root + 0.1 * way, root + 0.55 * wide * way, 0.1, 8))
    else:
        rows = np.array([[-0.5, 0], [-0.5, 0.5 * wide], [0.1, 0.5 * wide], [0.25, 0.3 * wide], [0.25, 0]])
        parts.append(revolve("cowling", rows, hub - place(0.1, 0, 0), _FORWARD, 20))
    parts.append(strut("spinner", hub - place(0.4, 0, 0), hub + place(0.3, 0, 0), 0.14, 12, 0.05))
    parts += _blades(
        "blade", hub + place(0.1, 0, 0), _LEFT, up(1.0), sized(rng, 1.15), int(rng.integers(2, 4)), 0.6, 0.2
    )
    parts.append(strut("tail_skid", (x[-2], 0, axis - 0.1), (x[-1] - 0.1, 0, 0.05), 0.04))
    return parts
