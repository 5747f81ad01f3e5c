"""Families of bars: pylons, guyed masts, tower cranes and oil platforms; each a list of parts by chance.

Sizes vary by about 1.5; what else does is said of each.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from families_solids import lattice, nodes, place, sized, slab, spoke, strut, turned, up

from upplied.samples.surfaces import Part, revolve


def pylon(rng: np.random.Generator) -> list[Part]:
    """A lattice tower of a power line, arms along Y: 2 or 3 pairs of arms, insulators or none."""
    height, foot, waist = sized(rng, 40.0), sized(rng, 3.6), sized(rng, 1.1)
    bend, neck, lower, upper = height * rng.uniform(0.52, 0.64), 0.94 * height, *rng.integers(4, 7, 2)
    levels = np.concatenate([np.linspace(0.1, bend, lower + 1), np.linspace(bend, neck, upper + 1)[1:]])
    half = np.interp(levels, (0, bend, height), (foot, waist, 0.7 * waist)) * np.sqrt(2)
    parts = lattice("body", nodes(levels, half, 4), 0.13, 0.06, crossed=bool(rng.integers(2)))
    parts.append(strut("peak", up(neck), up(height), 0.12))
    arms, insulators = int(rng.integers(2, 4)), bool(rng.integers(2))
    reach = sized(rng, 6.5) * rng.uniform(0.8, 1.2, arms)
    for number, at in enumerate(np.linspace(bend, 0.86 * height, arms), 1):
        thick, wide = sized(rng, 1.6), float(np.interp(at, (bend, height), (waist, 0.7 * waist)))
        for side, label in ((1, "left"), (-1, "right")):
            tip = np.array([0.0, side * (wide + reach[number - 1]), at])
            roots = [place(x, side * wide, at + z) for x in (-wide, wide) for z in (0.0, thick)]
            name = f"arm_{label}_{number}"
            parts += [strut(f"{name}_chord_{n}", root, tip, 0.08) for n, root in enumerate(roots, 1)]
            for n, share in enumerate((0.3, 0.6), 1):
                ends = [root + share * (tip - root) for root in roots]
                sides = ((0, 1), (1, 3), (3, 2), (2, 0))
                parts += [strut(f"{name}_bar_{n}_{i + 1}", ends[i], ends[j], 0.05, 5) for i, j in sides]
            if insulators:
                parts.append(strut(f"insulator_{label}_{number}", tip, tip - up(2.2), 0.14, 8))
    return parts


def guyed_mast(rng: np.random.Generator) -> list[Part]:
    """A slender mast held by wires in three directions at 2 or 3 levels; 1 to 3 drums, an aerial or none."""
    height, half = sized(rng, 48.0), sized(rng, 0.75)
    levels = np.linspace(0.5, height, round(height / (2.6 * half)) + 1)
    parts = [slab("plinth", (-1.5, -1.5, 0), (1.5, 1.5, 0.5))]
    parts += lattice("mast", nodes(levels, np.full(len(levels), half), 3), 0.07, 0.03)
    anchor, angles = height * rng.uniform(0.5, 0.65), np.pi / 3 * (2 * np.arange(3) + 1)
    wires, highest = int(rng.integers(2, 4)), height * rng.uniform(0.78, 0.86)
    heights = highest * np.arange(1, wires + 1) / wires
    for number, angle in enumerate(angles, 1):
        foot = spoke(angle, anchor)
        parts.append(slab(f"anchor_{number}", foot - (1, 1, 0), foot + place(1, 1, 0.8)))
        for n, at in enumerate(heights, 1):
            parts.append(strut(f"guy_{number}_{n}", foot + up(0.8), spoke(angle, half, at), 0.03, 5))
    for number in range(1, int(rng.integers(1, 4)) + 1):
        at, angle, radius = height * rng.uniform(0.88, 0.97), rng.uniform(0, 2 * np.pi), sized(rng, 0.7)
        drum = np.array([[0.0, 0.0], [0.0, radius], [0.8 * radius, radius], [0.8 * radius, 0.0]])
        parts.append(revolve(f"drum_{number}", drum, spoke(angle, half + 0.05, at), spoke(angle), 16))
    for number, angle in enumerate(angles + np.pi / 3, 1):
        foot = spoke(angle, half + 0.3, height - 2.2)
        parts.append(slab(f"panel_{number}", foot - (0.15, 0.15, 0), foot + place(0.15, 0.15, 2.2)))
    if rng.integers(2):
        parts.append(strut("aerial", up(height - 0.3), up(height + sized(rng, 3.0)), 0.06, 8))
    return parts


def tower_crane(rng: np.random.Generator) -> list[Part]:
    """A tower crane, its jib along X: a pointed head with tie bars or a flat top; 2 to 4 counterweights."""
    height, jib, counter = sized(rng, 34.0), sized(rng, 36.0), sized(rng, 11.0)
    half, depth, top = sized(rng, 0.95), sized(rng, 1.5), height + 1.4
    levels = np.linspace(0.8, height, round(height / (2 * half)) + 1)
    parts = [slab("base", (-3, -3, 0), (3, 3, 0.8))]
    parts += lattice("mast", nodes(levels, np.full(len(levels), half * np.sqrt(2)), 4), 0.12, 0.05)
    parts.append(turned("turntable", up(height), [(0, 1.6 * half), (0.5, 1.6 * half), (1.4, 1.2 * half)]))
    parts.append(slab("cab", (half, half, top - 0.6), (half + 1.8, half + 1.5, top + 1.6)))
    at = np.linspace(half, jib, round((jib - half) / 2.2) + 1)
    corners = np.array([[0.0, 0.8, 0.0], [0.0, -0.8, 0.0], [0.0, 0.0, depth]])
    axis = np.column_stack([at, np.zeros(len(at)), np.full(len(at), top)])
    parts += lattice("jib", axis[:, None] + corners, 0.08, 0.04)
    parts.append(slab("counter_jib", (-counter, -0.7, top), (-half, 0.7, top + 0.35)))
    parts.append(slab("winch", (-0.55 * counter, -0.6, top + 0.35), (-0.35 * counter, 0.6, top + 1.4)))
    for number in range(int(rng.integers(2, 5))):
        x = 0.2 + 0.75 * number - counter
        parts.append(slab(f"weight_{number + 1}", (x, -0.6, top - 1.9), (x + 0.6, 0.6, top + 0.6)))
    if rng.integers(2):
        head = up(top + sized(rng, 6.0))
        feet = [(x, y, top) for x in (-half, half) for y in (-half, half)]
        parts += [strut(f"head_{n}", foot, head, 0.1) for n, foot in enumerate(feet, 1)]
        ends = [(0.45 * jib, 0, top + depth), (0.85 * jib, 0, top + depth), (0.1 - counter, 0, top + 0.3)]
        parts += [strut(f"tie_{n}", head, end, 0.05) for n, end in enumerate(ends, 1)]
    x, low = jib * rng.uniform(0.4, 0.8), top - height * rng.uniform(0.3, 0.6)
    parts.append(slab("trolley", (x - 0.8, -0.7, top - 0.5), (x + 0.8, 0.7, top - 0.1)))
    parts.append(strut("rope", (x, 0, top - 0.4), (x, 0, low), 0.03, 5))
    parts.append(slab("hook", (x - 0.25, -0.3, low - 0.9), (x + 0.25, 0.3, low)))
    return parts


def oil_platform(rng: np.random.Generator) -> list[Part]:
    """Decks on 4, 6 or 8 braced legs, a derrick, quarters with a helideck; a flare boom and 1 or 2 cranes.

    The flare boom is sometimes missing. The water is at z = 0.
    """
    long, wide, under = sized(rng, 38.0), sized(rng, 24.0), sized(rng, 15.0)
    rows, radius = int(rng.integers(2, 5)), sized(rng, 0.9)
    xs, ys = np.linspace(-0.42, 0.42, rows) * long, np.array([-0.4, 0.4]) * wide
    parts, levels = [], np.array([2.0, 0.55 * under, under - 0.8])
    for i, x in enumerate(xs):
        for y, label in zip(ys, ("right", "left"), strict=True):
            parts.append(strut(f"leg_{label}_{i + 1}", (x, y, 0), (x, y, under + 0.2), radius, 12))
            if i:
                for n, (low, high) in enumerate(pairwise(levels), 1):
                    ends = (
                        ((xs[i - 1], y, low), (x, y, high))
                        if (n + i) % 2
                        else ((x, y, low), (xs[i - 1], y, high))
                    )
                    parts.append(strut(f"brace_{label}_{i}_{n}", *ends, 0.35, 8))
        parts += [
            strut(f"tie_{i + 1}_{n}", (x, ys[0], z), (x, ys[1], z), 0.35, 8) for n, z in enumerate(levels, 1)
        ]
    gap, top = sized(rng, 5.0), under
    for number in (1, 2):
        parts.append(slab(f"deck_{number}", (-long / 2, -wide / 2, top), (long / 2, wide / 2, top + 0.7)))
        for i, x in enumerate(xs if number == 1 else ()):
            parts += [strut(f"post_{i + 1}_{n}", (x, y, top + 0.6), (x, y, top + gap + 0.1), 0.4, 8)
                      for n, y in enumerate(ys, 1)]  # fmt: skip
        parts.append(slab(f"plant_{number}", (-0.1 * long, -0.3 * wide, top + 0.7),
                          (0.1 * long, 0.1 * wide, top + 0.7 + 0.6 * gap)))  # fmt: skip
        top += gap
    top += 0.7 - gap
    tall, foot = sized(rng, 24.0), sized(rng, 3.8)
    steps = np.linspace(top, top + tall, int(rng.integers(6, 9)))
    half = np.interp(steps, (top, top + tall), (foot, 0.3 * foot)) * np.sqrt(2)
    parts += lattice("derrick", nodes(steps, half, 4, (-0.28 * long, 0.0)), 0.16, 0.08, crossed=True)
    storeys, end = int(rng.integers(2, 5)) * 3.0, 0.48 * long
    parts.append(slab("quarters", (0.24 * long, -0.35 * wide, top), (end, 0.35 * wide, top + storeys)))
    pad = sized(rng, 7.5)
    parts.append(turned("helideck", (end - 2, 0, top + storeys + 1.5), [(0, pad), (0.5, pad)], 8))
    parts.append(turned("helideck_foot", (end - 2, 0, top + storeys), [(0, 1.0), (1.6, 2.0)], 12))
    for number in range(int(rng.integers(1, 3))):
        y = (0.45 - 0.9 * number) * wide
        head = place(0.12 * long, y, top + sized(rng, 7.0))
        parts.append(strut(f"crane_post_{number + 1}", (head[0], y, top - 0.2), head, 0.7, 12))
        boom = head + sized(rng, 16.0) * place(-0.75, 0.0, 0.66)
        parts.append(strut(f"crane_boom_{number + 1}", head, boom, 0.35, 8, 0.15))
    if rng.integers(2):
        root, length = place(-long / 2, 0.0, top - 0.6), sized(rng, 18.0)
        at = np.linspace(0, 1, 9)[:, None, None]
        corners = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.6]])
        boom = root + at * length * place(-0.8, 0.0, 0.6) + (1 - 0.6 * at) * corners
        parts += lattice("flare", boom, 0.12, 0.06)
    return parts
