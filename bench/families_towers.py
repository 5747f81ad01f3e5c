"""Families that stand: cooling towers, dishes, lighthouses, water towers and statues, by chance.

Sizes vary by about 1.5; what else does is said of each.
"""

from __future__ import annotations

import numpy as np
from families_solids import (
    dome,
    gable,
    lattice,
    nodes,
    place,
    prism,
    ring,
    sized,
    slab,
    spoke,
    square_section,
    strut,
    turned,
    up,
)

from upplied.records import Floats
from upplied.samples.surfaces import Part, loft, revolve

_ORIGIN = up(0.0)


def cooling_tower(rng: np.random.Generator) -> list[Part]:
    """A hyperbolic shell with a rim, on 22 to 36 pairs of slanting columns over a basin."""
    height, base, lift = sized(rng, 72.0), sized(rng, 28.0), sized(rng, 6.0)
    throat, waist = base * rng.uniform(0.56, 0.66), height * rng.uniform(0.72, 0.8)
    z = np.linspace(lift, height, 25)
    spread = (waist - lift) / np.sqrt((base / throat) ** 2 - 1)
    outer = throat * np.sqrt(1 + ((z - waist) / spread) ** 2)
    inner = outer - np.interp(z, (lift, lift + 6, height), (0.9, 0.4, 0.3))
    section = np.vstack([np.column_stack([outer, z]), np.column_stack([inner, z])[::-1]])
    parts = [ring("shell", section, _ORIGIN, 64)]
    rim = square_section(inner[-1], outer[-1] + 0.8, height, height + 0.6)
    parts.append(ring("rim", rim, _ORIGIN, 64))
    foot, pairs = base + (base - outer[1]) / (z[1] - z[0]) * 0.6 * lift, int(rng.integers(22, 37))
    for number in range(2 * pairs):
        angle, lean = np.pi * number / pairs, 0.8 * np.pi / pairs * (1 if number % 2 else -1)
        high = spoke(angle + lean, base - 0.4, lift + 0.3)
        parts.append(strut(f"column_{number + 1}", spoke(angle, foot, 0.2), high, 0.4))
    parts.append(ring("basin", square_section(foot + 1.0, foot + 1.6, 0.0, 1.6), _ORIGIN, 64))
    return parts


def dish_antenna(rng: np.random.Generator) -> list[Part]:
    """A dish towards +X on a fork: 8 to 16 ribs, 3 or 4 legs of the subreflector, a weight, a hut or none."""
    radius, tilt = sized(rng, 8.0), np.radians(rng.uniform(25, 60))
    depth, tall, foot = radius * rng.uniform(0.3, 0.42), radius * rng.uniform(0.75, 1.0), 0.45 * radius
    parts = [turned("plate", _ORIGIN, [(0, foot + 1), (0.4, foot + 1)])]
    parts.append(turned("pedestal", up(0.2), [(0.0, foot), (0.5 * tall, 0.8 * foot), (tall, 0.55 * foot)]))
    axis, side, elbow = spoke(0.0, np.cos(tilt), np.sin(tilt)), spoke(np.pi / 2), up(tall + 0.4 * radius)
    lift = np.cross(axis, side)
    for label, y in (("left", 0.42 * foot), ("right", -0.42 * foot)):
        low, high = (-0.3 * foot, y - 0.3, tall - 0.3), (0.3 * foot, y + 0.3, elbow[2] + 0.8)
        parts.append(slab(f"fork_{label}", low, high))
    parts.append(strut("axle", elbow - 0.6 * foot * side, elbow + 0.6 * foot * side, 0.45, 12))
    apex, share = elbow + 0.16 * radius * axis, np.linspace(0, 1, 9)
    bowl = np.column_stack([depth * share**2, radius * share])
    inside = bowl[-2:0:-1] + np.array([0.22, -0.1])
    profile = np.vstack([bowl, [[depth + 0.15, radius]], inside, [[0.22, 0.0]]])
    parts.append(revolve("dish", profile, apex, axis, 40))
    hub = np.array([[-0.25, 0], [-0.25, 0.2], [0.02, 0.28], [0.02, 0]]) * radius
    parts.append(revolve("hub", hub, apex, axis))
    ribs = int(rng.integers(8, 17))
    for number, angle in enumerate(2 * np.pi * np.arange(ribs) / ribs, 1):
        way = radius * (np.cos(angle) * side + np.sin(angle) * lift)
        start, end = apex - 0.2 * radius * axis + 0.15 * way, apex + 0.8 * depth * axis + 0.92 * way
        parts.append(strut(f"rib_{number}", start, end, 0.1))
    focus, legs, cup = apex + radius**2 / (4 * depth) * axis, int(rng.integers(3, 5)), 0.1 * radius
    for number, angle in enumerate(2 * np.pi * (np.arange(legs) + 0.5) / legs, 1):
        way = radius * (np.cos(angle) * side + np.sin(angle) * lift)
        parts.append(strut(f"leg_{number}", apex + 0.5 * depth * axis + 0.7 * way, focus, 0.08))
    mirror = np.array([[-0.3, 0], [-0.3, cup], [0.2, 0.8 * cup], [0.3, 0]])
    parts.append(revolve("subreflector", mirror, focus, axis, 16))
    if rng.integers(2):
        middle, size = elbow - up(1.0) - (0.4 * radius, 0, 0), np.array([0.12 * radius, 0.3 * foot, 0.7])
        parts.append(slab("weight", middle - size, middle + size))
    if rng.integers(2):
        x = foot + sized(rng, 4.0)
        parts.append(slab("hut", (-x - 3, -2, 0), (-x, 2, 2.8)))
    return parts


def lighthouse(rng: np.random.Generator) -> list[Part]:
    """A round tower with a gallery and a lantern; a second gallery, a house, both or neither."""
    height, foot = sized(rng, 26.0), sized(rng, 3.4)
    top, lantern, tall = foot * rng.uniform(0.55, 0.7), sized(rng, 1.5), sized(rng, 2.6)
    rows = [(0.0, foot + 0.5), (1.0, foot + 0.5), (1.2, foot), (height, top)]
    parts = [turned("tower", _ORIGIN, rows, 32)]
    parts += _gallery("gallery", top + 0.9, height, int(rng.integers(12, 21)))
    parts.append(turned("lantern", up(height + 0.4), [(0, lantern), (tall, lantern)]))
    cap = [(0.0, 1.2 * lantern), (0.15, 1.2 * lantern), *dome(1.1 * lantern, lantern, 0.2)]
    eave = height + 0.4 + tall
    parts.append(turned("cap", up(eave), cap))
    parts.append(strut("vane", up(eave + lantern), up(eave + 2 * lantern), 0.06))
    if rng.integers(2):
        at = height * rng.uniform(0.6, 0.75)
        parts += _gallery("lower_gallery", float(np.interp(at, (0, height), (foot, top))) + 1.1, at, 16)
    if rng.integers(2):
        near, far, wide = foot + 0.2, foot + sized(rng, 9.0), sized(rng, 3.0)
        parts.append(slab("house", (near, -wide, 0), (far, wide, 3.4)))
        low, high = (near - 0.3, -wide - 0.4, 3.4), (far + 0.3, wide + 0.4, 3.4 + wide)
        parts.append(gable("house_roof", low, high))
    return parts


def _gallery(name: str, radius: float, at: float, posts: int) -> list[Part]:
    parts = [turned(f"{name}_floor", up(at), [(0, radius), (0.4, radius)], 32)]
    rail = square_section(radius - 0.15, radius - 0.05, at + 1.4, at + 1.5)
    parts.append(ring(f"{name}_rail", rail, _ORIGIN, 32))
    for number, angle in enumerate(2 * np.pi * np.arange(posts) / posts, 1):
        foot = spoke(angle, radius - 0.1, at + 0.3)
        parts.append(strut(f"{name}_post_{number}", foot, foot + up(1.15), 0.04, 5))
    return parts


def water_tower(rng: np.random.Generator) -> list[Part]:
    """A round tank on 4 to 8 braced legs round a riser pipe; a walk round it, a finial, both or neither."""
    height, radius, deep = sized(rng, 24.0), sized(rng, 5.2), sized(rng, 6.5)
    legs, spread, levels = int(rng.integers(4, 9)), rng.uniform(1.1, 1.4), int(rng.integers(3, 5))
    bottom, crown = radius * rng.uniform(0.3, 0.5), radius * rng.uniform(0.3, 0.6)
    rows = [
        (-bottom, 0.1 * radius),
        (-0.6 * bottom, 0.75 * radius),
        (0.0, radius),
        *dome(radius, crown, deep),
    ]
    parts = [turned("tank", up(height), rows, 36)]
    z = np.linspace(0.1, height + 0.4, levels + 1)
    apart = np.interp(z, (0, height), (spread * radius, 0.96 * radius))
    parts += lattice("legs", nodes(z, apart, legs), 0.25, 0.07)
    parts.append(turned("riser", _ORIGIN, [(0, 0.9), (0.5, 0.5), (height - 0.9 * bottom, 0.5)], 12))
    for number in range(legs):
        foot = spoke(2 * np.pi * (number + 0.5) / legs, spread * radius)
        parts.append(slab(f"foot_{number + 1}", foot - (0.7, 0.7, 0), foot + place(0.7, 0.7, 0.5)))
    if rng.integers(2):
        parts += _gallery("walk", radius + 0.9, height - 0.2, 4 * legs)
    if rng.integers(2):
        top = up(height + deep + crown)
        parts.append(strut("finial", top - up(0.3), top + up(2.0), 0.15))
    return parts


def statue(rng: np.random.Generator) -> list[Part]:
    """A robed figure towards +X on a plinth of 1 to 3 steps: with a torch or not, a staff or a shield."""
    tall, wide, plinth = sized(rng, 11.0), sized(rng, 2.4), sized(rng, 5.0)
    parts, base = [], 0.0
    for number in range(int(rng.integers(1, 4)), 0, -1):
        half = wide + 0.9 * number + 0.5
        parts.append(slab(f"step_{number}", (-half, -half, base), (half, half, base + 0.6), 2.0))
        base += 0.6
    parts.append(prism("plinth", _cut_square(wide + 0.6), base, base + plinth, (1.0, 0.86)))
    base += plinth
    share = np.array([0, 0.03, 0.15, 0.3, 0.42, 0.5, 0.58, 0.68, 0.76, 0.82, 0.845])
    girth, angle = sized(rng, 0.17) * tall, 2 * np.pi * np.arange(24) / 24
    width = girth * np.array([0.95, 1.0, 0.9, 0.8, 0.72, 0.66, 0.72, 0.86, 0.9, 0.5, 0.26])
    folded = width[:, None] * (1 + 0.07 * np.cos(8 * angle) * np.clip(1 - share / 0.5, 0, 1)[:, None])
    x = 0.03 * tall * np.sin(np.pi * share)[:, None] + 0.68 * folded * np.cos(angle)
    z = np.broadcast_to((base + share * tall)[:, None], x.shape)
    parts.append(loft("figure", np.stack([x, folded * np.sin(angle), z], axis=-1)))
    ball, head = np.linspace(0, np.pi, 9), 0.075 * tall
    globe = head * np.column_stack([-np.cos(ball), 0.8 * np.sin(ball)])
    parts.append(revolve("head", globe, up(base + 0.91 * tall), up(1.0), 16))
    for label, side, raised in (("left", 1, False), ("right", -1, bool(rng.integers(2)))):
        root = np.array([0.0, side * 0.8 * girth, base + 0.76 * tall])
        elbow = root + tall * np.array([0.03, side * 0.08, 0.1 if raised else -0.16])
        hand = elbow + tall * np.array([0.05 if raised else 0.14, 0.0, 0.18 if raised else -0.02])
        parts.append(strut(f"upper_arm_{label}", root, elbow, 0.045 * tall, 12))
        parts.append(strut(f"lower_arm_{label}", elbow, hand, 0.045 * tall, 12, 0.03 * tall))
        if raised:
            ends = hand - up(0.05 * tall), hand + up(0.09 * tall)
            parts.append(strut("torch", *ends, 0.02 * tall, 10, 0.05 * tall))
        elif label == "right" and rng.integers(2):
            low = np.array([hand[0], hand[1], base])
            parts.append(strut("staff", low, low + up(0.95 * tall), 0.014 * tall, 8))
        elif label == "left" and rng.integers(2):
            disc = np.array([[0, 0], [0, 0.13], [0.02, 0.13], [0.05, 0]]) * tall
            parts.append(revolve("shield", disc, hand, spoke(0.0), 24))
    return parts


def _cut_square(half: float) -> Floats:
    """A square without its corners."""
    cut = np.array([[1, -0.85], [1, 0.85], [0.85, 1], [-0.85, 1]]) * half
    return np.concatenate([cut, -cut])
