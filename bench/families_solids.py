"""Closed bodies that the families are built of: slabs, struts, prisms, shells and lattices, in metres."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from upplied.geometry.polylines import arc_length, interpolated
from upplied.records import Floats
from upplied.samples.surfaces import Part, joined, loft, revolve

STEP_M = 3.0  # longest edge along a body
_UP = np.array([0.0, 0.0, 1.0])
Point = Sequence[float] | Floats


def sized(rng: np.random.Generator, typical: float, factor: float = 1.5) -> float:
    """A size that varies by a factor in all, about a typical one."""
    reach = np.log(factor) / 2
    return float(typical * np.exp(rng.uniform(-reach, reach)))


def place(x: float, y: float, z: float) -> Floats:
    """A place, or a step from one."""
    return np.array([x, y, z], float)


def up(height: float) -> Floats:
    """A place on the vertical axis, or a step upwards."""
    return height * _UP


def spoke(angle: float, radius: float = 1.0, height: float = 0.0) -> Floats:
    """A place about the vertical axis."""
    return np.array([radius * np.cos(angle), radius * np.sin(angle), height])


def ticks(low: float, high: float, step_m: float = STEP_M) -> Floats:
    """Even places from low to high, no more than a step apart."""
    return np.linspace(low, high, max(int(np.ceil((high - low) / step_m - 1e-9)), 1) + 1)


def slab(name: str, low: Point, high: Point, step_m: float = STEP_M) -> Part:
    """A box between two corners (3,), with edges no longer than a step."""
    axes = [ticks(lo, hi, step_m) for lo, hi in zip(low, high, strict=True)]
    faces = []
    for axis in range(3):
        across, along = (axis + 1) % 3, (axis + 2) % 3
        u, v = np.meshgrid(axes[across], axes[along], indexing="ij")
        row, column = np.meshgrid(np.arange(u.shape[0] - 1), np.arange(u.shape[1] - 1), indexing="ij")
        a = row * u.shape[1] + column
        b = a + u.shape[1]
        triangles = np.stack([a, b, b + 1, a, b + 1, a + 1], axis=-1).reshape(-1, 3)
        for end in (0, -1):
            grid = np.empty((u.size, 3))
            grid[:, axis], grid[:, across], grid[:, along] = axes[axis][end], u.ravel(), v.ravel()
            faces.append(Part(name, grid, triangles if end else triangles[:, ::-1]))
    return joined(name, faces)


def strut(
    name: str, start: Point, end: Point, radius: float, around: int = 6, end_radius: float | None = None
) -> Part:
    """A round bar from one place to another; it narrows to the end's radius where one is given."""
    start, axis = np.asarray(start, float), np.subtract(end, start)
    length = float(np.linalg.norm(axis))
    at = ticks(0.0, length)
    radii = radius + ((radius if end_radius is None else end_radius) - radius) * at / length
    profile = np.vstack([[0.0, 0.0], np.column_stack([at, radii]), [length, 0.0]])
    return revolve(name, profile, start, axis / length, around)


def beam(name: str, path: Floats, width: float, height: float) -> Part:
    """A bar of rectangular section along a polyline (N, 3) that is not vertical; the width is horizontal."""
    along = arc_length(path)
    dense = interpolated(np.union1d(ticks(0.0, float(along[-1])), along), along, path)
    forward = np.gradient(dense, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    side = np.cross(_UP, forward)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    lift = np.cross(forward, side)
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2 * (width, height)
    return loft(name, dense[:, None] + corners[:, :1] * side[:, None] + corners[:, 1:] * lift[:, None])


def turned(name: str, base: Point, profile: Sequence[tuple[float, float]], around: int = 24) -> Part:
    """A body of revolution about a vertical axis: heights above the base and radii, the ends closed."""
    first, last = (profile[0][0], 0.0), (profile[-1][0], 0.0)
    rows = []
    for (low, one), (high, other) in pairwise([first, *profile, last]):
        share = ticks(0.0, 1.0, STEP_M / max(abs(high - low), abs(other - one), 1e-9))[:-1, None]
        rows.append((1 - share) * (low, one) + share * (high, other))
    table = np.vstack([*rows, [last]])
    return revolve(name, table, np.asarray(base, float), _UP, around)


def dome(radius: float, rise: float, low: float = 0.0, steps: int = 6) -> list[tuple[float, float]]:
    """Rows of a profile for `turned`: half an ellipse above a height, from its foot to near its top."""
    angle = np.linspace(0, np.pi / 2, steps + 1)[:-1]
    return [(low + rise * float(np.sin(one)), radius * float(np.cos(one))) for one in angle]


def refined(outline: Floats, step_m: float = STEP_M) -> Floats:
    """A closed outline (K, D) with points no farther apart than a step."""
    following = np.roll(outline, -1, axis=0)
    edges = []
    for one, other in zip(outline, following, strict=True):
        edges.append(one + ticks(0.0, 1.0, step_m / np.linalg.norm(other - one))[:-1, None] * (other - one))
    return np.concatenate(edges)


def prism(
    name: str, outline: Floats, low: float, high: float, scale: tuple[float, float] = (1.0, 1.0)
) -> Part:
    """A horizontal outline (K, 2) from one height to another, scaled about the outline's middle."""
    outline, share = refined(outline), ticks(0.0, 1.0, STEP_M / (high - low))
    middle, factor = outline.mean(axis=0), scale[0] + (scale[1] - scale[0]) * share
    rings = np.empty((len(share), len(outline), 3))
    rings[..., :2] = middle + factor[:, None, None] * (outline - middle)
    rings[..., 2] = (low + share * (high - low))[:, None]
    return _capped(name, rings)


def extruded(name: str, outline: Floats, start: float, end: float, axis: int = 0) -> Part:
    """An upright outline (K, 2) from one place along X (or Y) to another; it begins with Y (or X)."""
    outline, at = refined(outline), ticks(start, end)
    rings = np.empty((len(at), len(outline), 3))
    rings[..., axis], rings[..., 1 - axis], rings[..., 2] = at[:, None], outline[:, 0], outline[:, 1]
    return _capped(name, rings)


def _capped(name: str, rings: Floats) -> Part:
    """A tube through rings whose ends are divided by smaller rings."""
    first, last = rings[0].mean(axis=0), rings[-1].mean(axis=0)
    share = ticks(0.0, 1.0, STEP_M / np.linalg.norm(rings[0] - first, axis=1).max())[1:-1, None, None]
    front, back = first + share * (rings[0] - first), last + share * (rings[-1] - last)
    return loft(name, np.concatenate([front, rings, back[::-1]]))


def gable(name: str, low: Point, high: Point, axis: int = 0) -> Part:
    """A roof over the rectangle of a box: its ridge along X (or Y) at the box's top."""
    one, other = low[1 - axis], high[1 - axis]
    outline = np.array([[one, low[2]], [other, low[2]], [(one + other) / 2, high[2]]])
    return extruded(name, outline, low[axis], high[axis], axis)


def hoop(name: str, rings: Floats) -> Part:
    """A body through rings (S, K, 3) that go round and meet again: a shell, a rim, a rail."""
    sections, around, _ = rings.shape
    s, k = np.meshgrid(np.arange(sections), np.arange(around), indexing="ij")
    a, b = s * around + k, s * around + (k + 1) % around
    c, d = (s + 1) % sections * around + (k + 1) % around, (s + 1) % sections * around + k
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    vertices = rings.reshape(-1, 3)
    volume = np.linalg.det(vertices[triangles] - vertices[0]).sum()
    return Part(name, vertices, triangles if volume >= 0 else triangles[:, ::-1])


def ring(
    name: str, section: Floats, middle: Point, around: int, stretch: tuple[float, float] = (1.0, 1.0)
) -> Part:
    """A hoop of a section (K, 2), radius and height, about a vertical axis; an ellipse where stretched."""
    angle = 2 * np.pi * np.arange(around) / around
    rings = np.empty((around, len(section), 3))
    rings[..., 0] = stretch[0] * np.cos(angle)[:, None] * section[:, 0]
    rings[..., 1] = stretch[1] * np.sin(angle)[:, None] * section[:, 0]
    rings[..., 2] = section[:, 1]
    return hoop(name, rings + np.asarray(middle, float))


def square_section(inner: float, outer: float, low: float, high: float) -> Floats:
    """The section of a ring with upright sides."""
    return refined(np.array([[inner, low], [outer, low], [outer, high], [inner, high]]))


def nodes(levels: Floats, half: Floats, corners: int, middle: Point = (0.0, 0.0)) -> Floats:
    """Nodes (S, corners, 3) of a lattice mast: corners at each level (S,), at a distance (S,) from it."""
    angle = 2 * np.pi * (np.arange(corners) + 0.5) / corners
    ground = half[:, None, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    heights = np.broadcast_to(levels[:, None, None], (len(levels), corners, 1))
    return np.concatenate([ground + np.asarray(middle, float), heights], axis=2)


def lattice(name: str, rings: Floats, chord: float, brace: float, crossed: bool = False) -> list[Part]:
    """Legs along the nodes (S, K, 3), bars round each level, and one diagonal of each panel, or two.

    `chord` and `brace` are radii. A leg that bends is one strut for each straight stretch.
    """
    parts, braces = [], []
    for corner in range(rings.shape[1]):
        leg = rings[:, corner]
        for number, (first, last) in enumerate(_straight(leg), 1):
            parts.append(strut(f"{name}_leg_{corner + 1}_{number}", leg[first], leg[last], chord))
        beside = rings[:, (corner + 1) % rings.shape[1]]
        for level in range(1, len(rings)):
            braces.append((leg[level], beside[level]))
            low, high = (leg, beside) if (level + corner) % 2 else (beside, leg)
            braces.append((low[level - 1], high[level]))
            if crossed:
                braces.append((high[level - 1], low[level]))
    parts += [strut(f"{name}_brace_{n}", *ends, brace, around=5) for n, ends in enumerate(braces, 1)]
    return parts


def _straight(leg: Floats) -> list[tuple[int, int]]:
    """First and last node of each straight stretch."""
    way = np.diff(leg, axis=0)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    bends = 1 + np.flatnonzero(np.einsum("ij,ij->i", way[1:], way[:-1]) < 1 - 1e-9)
    ends = [0, *(int(one) for one in bends), len(leg) - 1]
    return list(pairwise(ends))
