"""Lofts, surfaces of revolution, airfoils and boxes: closed parts with outward normals.

Every primitive has a fixed grid: the same part of two members of a kind has the same triangles in the same
order, and a point of the one has a known counterpart on the other.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from upplied.geometry.polylines import arc_length, interpolated
from upplied.records import Floats, Ints, Record, Structure, Surroundings


@dataclass(frozen=True, eq=False, repr=False)
class Part(Record):
    """One closed part of a structure."""

    name: str
    vertices: Floats  # (V, 3) m, structure frame
    triangles: Ints  # (T, 3) vertex indices, outward

    @property
    def middle(self) -> tuple[float, float, float]:
        """The middle of its box, m."""
        x, y, z = (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2
        return float(x), float(y), float(z)


@dataclass(frozen=True, eq=False, repr=False)
class Member(Record):
    """A structure of the sample fleet together with the part each of its triangles belongs to."""

    structure: Structure
    part_names: tuple[str, ...]
    part_of_triangle: Ints  # (T,) index into `part_names`

    def triangles_of(self, name: str) -> Ints:
        """Indices of the triangles of a part, in the order of its grid; empty without that part."""
        if name not in self.part_names:
            return np.empty(0, np.int64)
        return np.flatnonzero(self.part_of_triangle == self.part_names.index(name))


def assemble(
    structure_id: str, kind: str, parts: Sequence[Part], notes: str = "", landmarks: Sequence[str] = ()
) -> Member:
    """The member that consists of these parts and stands on ground (or water) at z = 0.

    The middles of parts whose names begin with one of `landmarks` become landmarks.
    """
    whole, surroundings = joined(structure_id, parts), Surroundings(ground_z_m=0.0)
    middles = {part.name: part.middle for part in parts if part.name.startswith(tuple(landmarks))}
    structure = Structure(
        structure_id=structure_id, kind=kind, vertices=whole.vertices, triangles=whole.triangles,
        surroundings=surroundings, landmarks=middles, notes=notes,
    )  # fmt: skip
    owner = np.repeat(np.arange(len(parts)), [len(part.triangles) for part in parts])
    return Member(stamped(structure), tuple(part.name for part in parts), owner)


def stamped(structure: Structure) -> Structure:
    """The structure with the hash of its surface, to 1e-7 m, as its identity."""
    content = hashlib.sha256(np.round(structure.vertices * 1e7).astype("<i8").tobytes())
    content.update(structure.triangles.astype("<i8").tobytes())
    return replace(structure, sha256=content.hexdigest())


def joined(name: str, parts: Sequence[Part]) -> Part:
    """The parts as one, their vertices shared where they meet; the triangles keep their order."""
    vertices = np.concatenate([part.vertices for part in parts])
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    triangles = np.concatenate([part.triangles + start for part, start in zip(parts, offsets, strict=True)])
    _, first, place = np.unique(np.round(vertices, 9), axis=0, return_index=True, return_inverse=True)
    order = np.sort(first)
    rank = np.empty(len(order), np.int64)
    rank[np.argsort(first)] = np.arange(len(order))
    return Part(name, vertices[order], rank[place.reshape(-1)][triangles])


def loft(name: str, rings: Floats, tips: tuple[Floats, Floats] | None = None) -> Part:
    """A tube through rings (S, K, 3), m, of K points in one order around, closed at both ends.

    The end caps have their tips (3,), m, in the middles of the first and the last ring, or as given.
    """
    sections, around, _ = rings.shape
    first, last = tips if tips is not None else (rings[0].mean(axis=0), rings[-1].mean(axis=0))
    vertices = np.concatenate([rings.reshape(-1, 3), [first], [last]])
    s, k = np.meshgrid(np.arange(sections - 1), np.arange(around), indexing="ij")
    a, b = s * around + k, s * around + (k + 1) % around
    walls = np.stack([a, b, b + around, a, b + around, a + around], axis=-1).reshape(-1, 3)
    ring, following = np.arange(around), (np.arange(around) + 1) % around
    end = (sections - 1) * around
    front = np.stack([np.full(around, sections * around), following, ring], axis=1)
    back = np.stack([np.full(around, sections * around + 1), end + ring, end + following], axis=1)
    triangles = np.concatenate([walls, front, back])
    one, two, three = (vertices[triangles[:, corner]] for corner in range(3))
    volume = np.einsum("ij,ij->i", one - vertices[0], np.cross(two - one, three - one)).sum()
    return Part(name, vertices, triangles if volume >= 0 else triangles[:, ::-1])  # normals to the outside


def revolve(name: str, profile: Floats, origin: Floats, axis: Floats, around: int = 24) -> Part:
    """A surface of revolution about the axis (3,), of unit length, through the origin (3,), m.

    The profile (P, 2), m, is distances along the axis and radii; the first and last radius are 0.
    """
    other = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    side = np.cross(other, axis)
    side /= np.linalg.norm(side)
    other, angle = np.cross(axis, side), 2 * np.pi * np.arange(around) / around
    circle = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other
    stations = origin + profile[:, :1] * axis
    rings = stations[1:-1, None] + profile[1:-1, 1, None, None] * circle
    return loft(name, rings, (stations[0], stations[-1]))


def airfoil(half: int = 12, camber: float = 0.015) -> Floats:
    """A four-digit airfoil of unit chord and unit thickness ratio: (2 half, 2), aft and up.

    The thickness of the section is that times its thickness ratio (NACA report 460, Eq. 6, with the
    closed trailing edge of 0.1036 for the last coefficient).
    """
    aft = (1 - np.cos(np.pi * np.arange(half + 1) / half)) / 2
    thick = 5 * (0.2969 * np.sqrt(aft) - 0.126 * aft - 0.3516 * aft**2 + 0.2843 * aft**3 - 0.1036 * aft**4)
    mean = camber * 4 * aft * (1 - aft) / 0.12
    upper = np.stack([aft, mean + thick], axis=1)
    lower = np.stack([aft, mean - thick], axis=1)
    return np.concatenate([upper[::-1], lower[1:-1]])


# One airfoil of a lifting surface: its leading edge, m, chord, m, and thickness as a share of the chord.
Section = tuple[tuple[float, float, float], float, float]


def foil_loft(name: str, sections: list[Section], up: tuple[float, float, float], stations: int = 12) -> Part:
    """A wing, fin or pylon through airfoils whose chords run aft (-x) and whose thickness runs along `up`."""
    corners = np.array([[*leading, chord_m, thickness] for leading, chord_m, thickness in sections])
    travelled, pieces = arc_length(corners[:, :3]), len(sections) - 1
    each = max(1, stations // pieces)  # every corner is a station
    places = np.interp(np.arange(each * pieces + 1) / each, np.arange(pieces + 1), travelled)
    table = interpolated(places, travelled, corners)
    shape = airfoil(camber=0.0 if abs(up[2]) < 0.5 else 0.015)
    chord, thickness = table[:, 3, None, None], table[:, 4, None, None]
    rings = table[:, None, :3] + chord * shape[:, :1] * np.array([-1.0, 0.0, 0.0])
    return loft(name, rings + chord * thickness * shape[:, 1:] * np.array(up))


def superellipse(around: int, exponent: float) -> Floats:
    """Points (around, 2) of the curve |y|^n + |z|^n = 1, anticlockwise from +y."""
    angle = 2 * np.pi * (np.arange(around) + 0.5) / around
    cosine, sine = np.cos(angle), np.sin(angle)
    radius = (np.abs(cosine) ** exponent + np.abs(sine) ** exponent) ** (-1 / exponent)
    return np.stack([radius * cosine, radius * sine], axis=1)


def block(name: str, low: Sequence[float] | Floats, high: Sequence[float] | Floats, cells: int) -> Part:
    """A closed box between two corners, m."""
    return joined(name, box_faces(low, high, cells))


def box_faces(low: Sequence[float] | Floats, high: Sequence[float] | Floats, cells: int) -> list[Part]:
    """The six faces of a box, of cells x cells squares: front (+x), back, left (+y), right, top, bottom."""
    lo, hi = np.asarray(low, float), np.asarray(high, float)
    x, y, z = np.diag(hi - lo)
    i, j = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
    a, step = i * (cells + 1) + j, np.arange(cells + 1) / cells
    b = a + cells + 1
    triangles = np.stack([a, b, b + 1, a, b + 1, a + 1], axis=-1).reshape(-1, 3)
    # A corner and the two sides from there, whose cross product leads outwards.
    sides = {"front": (lo + x, y, z), "back": (lo, z, y), "left": (lo + y, z, x), "right": (lo, x, z)}
    sides |= {"top": (lo + z, x, y), "bottom": (lo, y, x)}
    faces = []
    for name, (corner, along, across) in sides.items():
        grid = corner + step[:, None, None] * along + step[None, :, None] * across
        faces.append(Part(name, grid.reshape(-1, 3), triangles))
    return faces


def box(size_m: tuple[float, float, float], structure_id: str) -> Member:
    """A box of length along X, width and height, m, its base round the origin; every face is a part."""
    length, width, height = size_m
    faces = box_faces((-length / 2, -width / 2, 0.0), (length / 2, width / 2, height), cells=12)
    return assemble(structure_id, "box", faces, "box")
