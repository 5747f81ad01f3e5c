"""Families that are built in place: bridges, tanks, churches, dams and stadiums, by chance.

Sizes vary by about 1.5; what else does is said of each.
"""

from __future__ import annotations

import numpy as np
from families_solids import (
    beam,
    dome,
    extruded,
    gable,
    place,
    prism,
    refined,
    ring,
    sized,
    slab,
    spoke,
    square_section,
    strut,
    turned,
    up,
)

from upplied.samples.surfaces import Part, loft


def stayed_bridge(rng: np.random.Generator) -> list[Part]:
    """A cable-stayed bridge along X: 1 or 2 pylons, each a pair of legs; 4 to 7 stays to each side."""
    pylons, side = int(rng.integers(1, 3)), sized(rng, 50.0)
    wide, low, deep, tall = sized(rng, 12.0), sized(rng, 12.0), sized(rng, 1.4), sized(rng, 30.0)
    middles = side * (2 * np.arange(pylons) - pylons + 1.0)
    half, top, stays = side * (pylons + 0.1), low + deep, int(rng.integers(4, 8))
    parts = [slab("deck", (-half, -wide / 2, low), (half, wide / 2, top))]
    for label, y in (("left", wide / 2 - 0.3), ("right", -wide / 2)):
        parts.append(slab(f"rail_{label}", (-half, y, top), (half, y + 0.3, top + 1.1)))
    lean, leg = rng.uniform(0.0, 0.7), sized(rng, 1.1)
    for number, x in enumerate(middles, 1):
        peak = top + tall
        for sign, label in ((1, "left"), (-1, "right")):
            foot = sign * (wide / 2 + leg + 0.4)
            levels = (0.0, top, peak)
            across = (foot, foot, (1 - lean) * foot)
            for n in (0, 1):
                name = f"pylon_{number}_{label}_{n + 1}"
                parts.append(_leg(name, x, across[n : n + 2], levels[n : n + 2], leg))
            for n, share in enumerate((np.arange(stays) + 1.0) / stays, 1):
                at = top + tall * (0.96 - 0.5 * (1 - share))
                y = float(np.interp(at, levels, across))
                for way, end in ((1, "front"), (-1, "back")):
                    anchor = (x + way * 0.94 * share * side, sign * (wide / 2 - 0.5), top)
                    parts.append(strut(f"stay_{number}_{label}_{end}_{n}", (x, y, at), anchor, 0.09, 5))
        foot = wide / 2 + leg + 0.4
        parts.append(slab(f"sill_{number}", (x - 0.8, -foot, low - 1.2), (x + 0.8, foot, low)))
        high = (1 - lean) * foot
        parts.append(slab(f"crown_{number}", (x - 0.7, -high - 0.4, peak - 1.4), (x + 0.7, high + 0.4, peak)))
    for number, x in enumerate((-half + 2, half - 2), 1):
        parts.append(slab(f"pier_{number}", (x - 1, -wide / 3, 0), (x + 1, wide / 3, low)))
    return parts


def _leg(name: str, x: float, across: tuple[float, ...], levels: tuple[float, ...], half: float) -> Part:
    """A square leg from one place across the road to another, narrower at its top."""
    share = np.linspace(0, 1, max(int((levels[1] - levels[0]) / 3.0), 1) + 1)[:, None]
    size = half * (1 - 0.15 * share)
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    rings = np.empty((len(share), 4, 3))
    rings[..., 0] = x + size * corners[:, 0]
    rings[..., 1] = across[0] + share * (across[1] - across[0]) + size * corners[:, 1]
    rings[..., 2] = levels[0] + share * (levels[1] - levels[0])
    return loft(name, rings)


def arch_bridge(rng: np.random.Generator) -> list[Part]:
    """A deck over 2 or 3 arch ribs along X, on 5 to 9 columns of each rib."""
    span, rise, wide = sized(rng, 70.0), sized(rng, 17.0), sized(rng, 10.0)
    deep, ribs, columns = sized(rng, 1.6), int(rng.integers(2, 4)), 2 * int(rng.integers(2, 5)) + 1
    low, thick = rise + deep / 2 + sized(rng, 1.4) + 1.5, sized(rng, 1.2)
    half, at = span / 2, np.linspace(-1, 1, 33)
    path = np.column_stack([half * at, np.zeros(33), 1.5 + rise * (1 - at**2)])
    parts = [slab("deck", (-half - 6, -wide / 2, low), (half + 6, wide / 2, low + thick))]
    for label, y in (("left", wide / 2 - 0.3), ("right", -wide / 2)):
        parts.append(
            slab(f"rail_{label}", (-half - 6, y, low + thick), (half + 6, y + 0.3, low + thick + 1.1))
        )
    for number, y in enumerate(np.linspace(-0.36, 0.36, ribs) * wide, 1):
        parts.append(beam(f"rib_{number}", path + place(0, y, 0), sized(rng, 1.2, 1.2), deep))
        for n, x in enumerate(np.linspace(-0.86, 0.86, columns) * half, 1):
            foot = 1.5 + rise * (1 - (x / half) ** 2)
            parts.append(
                slab(f"column_{number}_{n}", (x - 0.4, y - 0.4, foot), (x + 0.4, y + 0.4, low + 0.1))
            )
    ends = 0.36 * wide
    for n, share in enumerate((-0.7, -0.35, 0.35, 0.7), 1):
        x, z = share * half, 1.5 + rise * (1 - share**2)
        parts.append(slab(f"tie_{n}", (x - 0.4, -ends, z - 0.4), (x + 0.4, ends, z + 0.4)))
    for sign, label in ((-1, "back"), (1, "front")):
        one, other = sorted((sign * (half - 1.5), sign * (half + 8)))
        parts.append(slab(f"footing_{label}", (one, -wide / 2 - 0.5, 0), (other, wide / 2 + 0.5, 3.0)))
        one, other = sorted((sign * (half + 4), sign * (half + 8)))
        parts.append(slab(f"abutment_{label}", (one, -wide / 2, 3.0), (other, wide / 2, low)))
    return parts


def tanks(rng: np.random.Generator) -> list[Part]:
    """3 to 5 round tanks in two rows, ladders and pipes: one of three sorts of roof, a wall or none."""
    number, radius, height = int(rng.integers(3, 6)), sized(rng, 7.5), sized(rng, 11.0)
    step, roof, parts = 2 * radius + sized(rng, 9.0), int(rng.integers(3)), []
    places = [(step * (n // 2), step * (n % 2)) for n in range(number)]
    shift = np.mean(places, axis=0)
    for n, (x, y) in enumerate(places - shift, 1):
        wide, tall = radius * rng.uniform(0.9, 1.1), height * rng.uniform(0.85, 1.15)
        top = {
            0: [(tall, wide)],
            1: [(tall, wide), (tall + 0.2 * wide, 0.1)],
            2: dome(wide, 0.3 * wide, tall),
        }
        parts.append(turned(f"tank_{n}", (x, y, 0), [(0.0, wide), *top[roof]], 36))
        rim = square_section(wide + 0.02, wide + 0.25, tall - 0.4, tall - 0.15)
        parts.append(ring(f"rim_{n}", rim, (x, y, 0), 36))
        way = spoke(rng.uniform(0, 2 * np.pi)) * (wide + 0.6) + (x, y, 0)
        parts.append(slab(f"ladder_{n}", way - (0.4, 0.4, 0), way + place(0.4, 0.4, tall + 1.1)))
        parts.append(strut(f"pipe_{n}", (x, y - wide + 0.3, 0.8), (x, -step - shift[1], 0.8), 0.3, 10))
    end = np.array([places[-1][0] - shift[0] + radius, -step - shift[1], 0.8])
    parts.append(strut("header", (-shift[0] - radius, end[1], 0.8), end, 0.4, 10))
    if rng.integers(2):
        (x, y), (far, wide) = -shift - radius - 7, shift * (1, 1) + radius + 7
        y -= 0.3 * step
        for label, low, high in (
            ("front", (far - 0.5, y), (far, wide)), ("back", (x, y), (x + 0.5, wide)),
            ("left", (x, wide - 0.5), (far, wide)), ("right", (x, y), (far, y + 0.5)),
        ):  # fmt: skip
            parts.append(slab(f"wall_{label}", (*low, 0), (*high, 1.6)))
    return parts


def church(rng: np.random.Generator) -> list[Part]:
    """A nave along X, a tower with a spire at its back: 4 to 7 buttresses, a transept, aisles or neither."""
    long, wide, wall = sized(rng, 28.0), sized(rng, 10.0), sized(rng, 9.0)
    pitch, tower, tall, spire = sized(rng, 6.0), sized(rng, 6.5), sized(rng, 21.0), sized(rng, 15.0)
    half = wide / 2
    parts = [slab("nave", (0, -half, 0), (long, half, wall))]
    parts.append(gable("nave_roof", (0, -half - 0.5, wall), (long + 0.5, half + 0.5, wall + pitch)))
    rows = [(0.0, 0.8 * half), (0.8 * wall, 0.8 * half), (0.8 * wall + 0.7 * pitch, 0.1)]
    parts.append(turned("apse", (long, 0, 0), rows, 20))
    parts.append(slab("tower", (-tower, -tower / 2, 0), (0, tower / 2, tall)))
    square = tower / 2 * np.array([[1, -1], [1, 1], [-1, 1], [-1, -1.0]]) - (tower / 2, 0)
    parts.append(prism("tower_spire", square, tall, tall + spire, (1.04, 0.02)))
    cross = tall + spire - 0.3
    parts.append(strut("tower_cross", (-tower / 2, 0, cross), (-tower / 2, 0, cross + 2), 0.12))
    buttresses = int(rng.integers(4, 8))
    for n, x in enumerate(np.linspace(0.08, 0.92, buttresses) * long, 1):
        for sign, label in ((1, "left"), (-1, "right")):
            one, other = sorted((sign * half, sign * (half + 1.2)))
            parts.append(slab(f"buttress_{label}_{n}", (x - 0.4, one, 0), (x + 0.4, other, 0.75 * wall)))
    if rng.integers(2):
        x, reach = long * rng.uniform(0.55, 0.7), half + sized(rng, 5.0)
        parts.append(slab("transept", (x - 0.4 * wide, -reach, 0), (x + 0.4 * wide, reach, wall)))
        low, high = (
            (x - 0.4 * wide - 0.4, -reach - 0.4, wall),
            (x + 0.4 * wide + 0.4, reach + 0.4, wall + 0.9 * pitch),
        )
        parts.append(gable("transept_roof", low, high, axis=1))
    if rng.integers(2):
        parts.append(slab("porch", (0.1 * long, half, 0), (0.1 * long + 4, half + 3, 3.0)))
        parts.append(
            gable("porch_roof", (0.1 * long - 0.3, half, 3.0), (0.1 * long + 4.3, half + 3.3, 5.0), axis=1)
        )
    return parts


def dam(rng: np.random.Generator) -> list[Part]:
    """A gravity dam along X, its water on the side of -Y: 7 to 9 blocks, a spillway of 2 to 4 bays, a house.

    An intake tower stands in the water, or does not.
    """
    blocks, step, tall = 2 * int(rng.integers(3, 5)) + 1, sized(rng, 13.0), sized(rng, 26.0)
    crest, slope, bays = sized(rng, 5.0), rng.uniform(0.65, 0.85), int(rng.integers(2, 5))
    parts, first = [], -step * blocks / 2
    for n in range(blocks):
        out = abs(n - blocks // 2) / (blocks // 2)
        low = 0.7 * tall * max(0.0, out - 0.35) / 0.65  # the height of the valley's side below the block
        top, toe = tall - (0.0 if out else 4.0), crest + slope * max(0.7 * tall - low, 0.5)
        outline = [(0, top), (0, low), (toe, low), (crest, max(0.7 * tall, low + 0.5)), (crest, top)]
        start, end = first + step * n, first + step * (n + 1)
        parts.append(extruded(f"block_{n + 1}", np.array(outline), start, end))
        if low:
            parts.append(slab(f"base_{n + 1}", (start, 0, 0), (end, toe, low)))
    bay = step / bays
    for n in range(bays + 1):
        x = -step / 2 + n * bay
        parts.append(
            slab(f"spillway_pier_{n + 1}", (x - 0.5, -1.0, tall - 6.0), (x + 0.5, crest + 1.5, tall + 2.0))
        )
    for n in range(bays):
        x = -step / 2 + n * bay
        parts.append(
            slab(f"spillway_gate_{n + 1}", (x + 0.5, 0.4, tall - 4.2), (x + bay - 0.5, 0.9, tall - 0.4))
        )
    parts.append(slab("spillway_bridge", (-step / 2 - 1, 0.5, tall + 2.0), (step / 2 + 1, crest, tall + 2.6)))
    for sign, label in ((-1, "back"), (1, "front")):
        one, other = sorted((sign * (step / 2 + 1), sign * step * blocks / 2))
        parts.append(slab(f"parapet_{label}", (one, crest - 0.4, tall), (other, crest, tall + 1.1)))
    x, size = step * rng.uniform(0.9, 1.6), sized(rng, 4.0)
    toe = crest + 0.7 * slope * tall
    parts.append(
        slab("power_house", (-x - 2 * size, toe + 1, 0), (-x + size, toe + 1 + 1.6 * size, 1.5 * size))
    )
    if rng.integers(2):
        parts.append(turned("intake", (x, -5.0, 0), [(0, 2.5), (tall + 1, 2.5)], 20))
        parts.append(slab("footbridge", (x - 0.8, -3.0, tall), (x + 0.8, 0.3, tall + 0.4)))
    return parts


def stadium(rng: np.random.Generator) -> list[Part]:
    """An oval bowl round a pitch, a roof over it on columns: 20 to 32 columns, 4 masts of lights or none."""
    inner, deep, tall = sized(rng, 36.0), sized(rng, 16.0), sized(rng, 13.0)
    stretch, columns, roof = (rng.uniform(1.2, 1.4), 1.0), 2 * int(rng.integers(10, 17)), sized(rng, 6.0)
    outer, steps = inner + deep, int(rng.integers(4, 7))
    rows = [(inner, 0.0), (outer, 0.0), (outer, tall)]
    for n in range(steps, 0, -1):
        rows += [(inner + deep * n / steps - (0 if n < steps else 1.0), 1.5 + (tall - 2.5) * n / steps)]
        rows += [(inner + deep * (n - 1) / steps, 1.5 + (tall - 2.5) * n / steps)]
    section = refined(np.array(rows))
    parts = [ring("bowl", section, up(0.0), 80, stretch)]
    lid = square_section(outer - 0.65 * deep, outer + 1.5, tall + roof, tall + roof + 0.6)
    parts.append(ring("roof", lid, up(0.0), 80, stretch))
    for n, angle in enumerate(2 * np.pi * np.arange(columns) / columns, 1):
        foot = spoke(angle, outer + 0.6) * (stretch[0], 1.0, 0.0)
        parts.append(strut(f"column_{n}", foot, foot + up(tall + roof + 0.1), 0.35, 8))
    if rng.integers(2):
        for n, angle in enumerate(np.pi / 4 * (2 * np.arange(4) + 1), 1):
            foot = spoke(angle, outer + 6.0) * (stretch[0], 1.0, 0.0)
            high = foot + up(tall + roof + sized(rng, 14.0))
            parts.append(strut(f"mast_{n}", foot, high, 0.5, 10, 0.25))
            parts.append(slab(f"lights_{n}", high - (1.8, 1.8, 2.0), high + place(1.8, 1.8, 0.8)))
    return parts
