"""What a structure shows by itself of the rules, and all that was found in its file.

Parts that are hardly it (a wake makes a 251 m ship 872 m long) are dropped only where the manifest says so.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from upplied.inputs.manifests import StructureEntry
from upplied.inputs.raw import RawMesh
from upplied.inputs.repair import Topology, used_vertices
from upplied.inputs.rules import RULES, Verdict, broken, measured, refusals, unlike_its_kind
from upplied.records import Bools, Floats, Ints, Record
from upplied.records.structures import BURIED_M

_FAR_M = 10_000.0  # from the origin: single precision is off by a millimetre there
_EFFECT = re.compile(
    r"(?i)(?:^|[^a-z])(wake|lights?|flash|beacon|spots?|glow|billboard|halo|shadow)(?![a-z])"
)
_PLACED = 0.02  # of a side, that an origin may be off its low end or its middle and is meant there
_STANDS_M, _STANDS = 0.5, 0.1  # m, and of its height, that what stands on the ground may miss it
_PLANE, _RIM, _ACROSS = 0.002, 8, 0.05  # of a side; vertices; of the other sides: a surface that was cut
_BESIDE = 0.05  # of the diagonal that a landmark may lie outside the box
_VOXELS = 50  # along the longest side: a gap of a fiftieth parts two clusters
_SAMPLES = 10_000_000  # on large triangles, in all
_BATCH = 200_000
_SMALL = 0.05  # of the volume of the main cluster's box
_STICKS_OUT = 0.03  # of the diagonal of the rest's box
_FLAT = 1e-5  # thickness over length: a plane but for rounding
_BILLBOARD_TRIANGLES = 32  # triangles of a billboard


@dataclass(frozen=True, eq=False, repr=False)
class Outlier(Record):
    """Triangles that stick far out of the box of all the others."""

    reason: str
    triangles: Ints  # (K,) which they are
    low_m: Floats  # (3,) corners of their box, structure frame
    high_m: Floats  # (3,)

    def __str__(self) -> str:
        size = " x ".join(f"{side:.1f}" for side in self.high_m - self.low_m)
        centre = ", ".join(f"{place:.1f}" for place in (self.low_m + self.high_m) / 2)
        return f"{self.reason}: {len(self.triangles)} triangles, {size} m, around ({centre})"


def find_outliers(vertices: Floats, triangles: Ints, topology: Topology) -> list[Outlier]:
    """Planes of few triangles that stick out (first: they would hide a gap), and clusters far off."""
    component = topology.component
    flat, planes = _flat(vertices, triangles, component), np.empty(0, np.int64)
    if not flat.all():  # flat components that stick out of the box of those that are not flat
        low, high = _box(vertices, triangles[~flat[component]])
        lows, highs = _boxes(vertices, triangles, component)
        beyond = np.maximum(low - lows, highs - high).max(axis=1)
        planes = np.flatnonzero(flat & (beyond > _STICKS_OUT * np.linalg.norm(high - low)))
    rest = np.flatnonzero(~np.isin(component, planes))
    cluster = _clusters(vertices, triangles[rest])
    labels = np.unique(cluster)  # far are those that are small beside the main one and stick out of its box
    low, high = _boxes(vertices, triangles[rest], np.searchsorted(labels, cluster))
    side = high - low
    volume = np.prod(np.maximum(side, 1e-3 * side.max(axis=1, keepdims=True)), axis=1)
    main = int(np.argmax(volume))
    beyond = np.maximum(low[main] - low, high - high[main]).max(axis=1)
    sticks_out = beyond > _STICKS_OUT * np.linalg.norm(side[main])
    far = [rest[cluster == label] for label in labels[(volume < _SMALL * volume[main]) & sticks_out]]
    lone = [np.flatnonzero(component == label) for label in planes]
    plane = "a plane that sticks out (a wake, a light, a billboard?)"
    named = [*((plane, which) for which in lone), *(("a part far off the rest", which) for which in far)]
    return [Outlier(words, which, *_box(vertices, triangles[which])) for words, which in named]


def _clusters(vertices: Floats, triangles: Ints) -> Ints:
    """A label of each triangle (T,): voxels that touch make a cluster."""
    low, high = _box(vertices, triangles)
    edge = max(float((high - low).max()), 1e-9) / _VOXELS

    def cells(points: Floats) -> tuple[Ints, ...]:
        return tuple(np.clip(np.floor((points - low) / edge), 0, _VOXELS).astype(np.int64).T)

    grid = np.zeros((_VOXELS + 1,) * 3, bool)
    for points in (vertices[used_vertices(triangles, len(vertices))], *_spread(vertices, triangles, edge)):
        grid[cells(points)] = True
    label, _ = ndimage.label(grid, np.ones((3, 3, 3)))
    return label[cells(vertices[triangles[:, 0]])].astype(np.int64)


def _spread(vertices: Floats, triangles: Ints, edge: float) -> Iterator[Floats]:
    """Points on the triangles longer than a voxel, close enough that no voxel between them is missed."""
    corners = vertices[triangles]
    length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1, initial=0)
    large, steps = corners[length > edge], np.ceil(2 * length[length > edge] / edge)
    steps *= min(1.0, np.sqrt(2 * _SAMPLES / max((steps**2).sum(), 1)))  # bounded for meshes of giants alone
    steps = np.maximum(steps, 1).astype(np.int64)
    for number in np.unique(steps):
        i, j = np.divmod(np.arange((number + 1) ** 2), number + 1)
        weight = np.stack([i, j, number - i - j], axis=1)[i + j <= number] / number
        chosen = large[steps == number]
        batch = 1 + _BATCH // len(weight)
        for at in range(0, len(chosen), batch):
            yield np.einsum("wk,tkx->twx", weight, chosen[at : at + batch]).reshape(-1, 3)


def _flat(vertices: Floats, triangles: Ints, component: Ints) -> Bools:
    """(C,) components of few triangles in one plane."""
    number = component.max(initial=-1) + 1
    flat = np.bincount(component, minlength=number) <= _BILLBOARD_TRIANGLES
    few = flat[component]
    points, owner = vertices[triangles[few]].reshape(-1, 3), np.repeat(component[few], 3)
    count = np.maximum(np.bincount(owner, minlength=number), 1)
    mean = np.stack([np.bincount(owner, points[:, k], number) for k in range(3)], axis=1) / count[:, None]
    centred = points - mean[owner]
    products = centred[:, [0, 0, 0, 1, 1, 2]] * centred[:, [0, 1, 2, 1, 2, 2]]
    sums = np.stack([np.bincount(owner, products[:, k], number) for k in range(6)], axis=1)
    spread = np.linalg.eigvalsh(sums[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]])
    return flat & (spread[:, 0] <= _FLAT**2 * spread[:, 2])


def _boxes(vertices: Floats, triangles: Ints, label: Ints) -> tuple[Floats, Floats]:
    """Corners (L, 3), low and high, of the box of the triangles of each label from 0, all of which occur."""
    starts = np.flatnonzero(np.diff(label[order := np.argsort(label, kind="stable")], prepend=-1))
    corners = vertices[triangles[order]]
    return np.minimum.reduceat(corners.min(axis=1), starts), np.maximum.reduceat(corners.max(axis=1), starts)


def _box(vertices: Floats, triangles: Ints) -> tuple[Floats, Floats]:
    points = vertices[triangles].reshape(-1, 3)
    return points.min(axis=0), points.max(axis=0)


def concerns(vertices: Floats, raw: RawMesh, entry: StructureEntry, turn: Floats) -> Iterator[Verdict]:
    """The rules that a structure (V, 3), m, breaks by itself; `turn` (3, 3) took it from its file's axes."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    own, declared, ground = raw.unit_m, entry.unit_m, entry.surroundings.ground_z_m
    longest, bounds, centre = float((high - low).max()), entry.bounds, (low + high) / 2
    if own is not None and declared is not None and abs(own / declared - 1) >= 1e-3:
        yield measured("declared-unit", own, declared)
    if raw.up not in ("", entry.up):
        yield measured("declared-up", raw.up, entry.up)
    if not bounds.least_m <= longest <= bounds.most_m:
        yield measured("extent", longest)
    elif not bounds.odd_least_m <= longest <= bounds.odd_most_m:
        yield measured("odd-extent", longest)
    if np.abs(centre).max() >= _FAR_M:
        yield measured("far", np.linalg.norm(centre) / 1000)
    if ground is not None and low[2] < ground - BURIED_M and not entry.clip_ground:
        yield measured("below-ground", ground - low[2])
    if ground is not None and low[2] - ground > max(_STANDS_M, _STANDS * (high[2] - low[2])):
        yield measured("floating", low[2] - ground)
    if not any(entry.local_origin) and (up := _standing_up(low, high, turn)):
        yield measured("odd-up-axis", up[-1], up)
    if named := sorted({name for name in raw.part_names if _EFFECT.search(name)}):
        yield measured("effects", ", ".join(map(repr, named[:5])))
    yield from unlike_its_kind(high - low, entry.kind)
    room = _BESIDE * float(np.linalg.norm(high - low))
    for name, point in entry.landmarks.items():
        off = float(np.maximum(np.maximum(low - point, np.asarray(point) - high), 0).max())
        if off > room:
            yield measured("landmark", name, off)


def nominal_problems(
    vertices: Floats, entry: StructureEntry, outliers: tuple[Outlier, ...]
) -> tuple[Verdict, ...]:
    """Where the size is not the nominal one."""
    remedy = RULES["nominal"].remedy
    if outliers and not entry.drop_outliers:
        remedy += f", or set drop_outliers = true: it has {outliers[0]}"
    size, most, verdicts = np.ptp(vertices, axis=0), entry.bounds.nominal_pct, []
    sides = "length (x)", "width (y)", "height (z)"
    for side, have, want in zip(sides, size, entry.nominal_m, strict=True):
        if want is not None and abs(have / want - 1) > most / 100:
            off = f"{side} is {have:.4g} m, {100 * (have / want - 1):+.0f} % off the nominal {want:g} m"
            verdicts.append(broken(RULES["nominal"], off, f"within {most:g} %", remedy))
    return tuple(verdicts)


def cut_off(vertices: Floats, rim: Ints) -> Iterator[Verdict]:
    """Where the surface (V, 3), m, ends in a plane at one side, `rim` being the vertices at which it ends."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    side = np.maximum(high - low, 1e-9)
    for axis, other in ((0, 1), (1, 0)):
        for name, at in (("low", low[axis]), ("high", high[axis])):
            ends = vertices[rim[np.abs(vertices[rim, axis] - at) < _PLANE * side[axis]]]
            if len(ends) >= _RIM and (np.ptp(ends[:, [other, 2]], axis=0) > _ACROSS * side[[other, 2]]).all():
                yield measured("cut-off", "xy"[axis], at, name)


def _standing_up(low: Floats, high: Floats, turn: Floats) -> str:
    """The axis of the file at whose lower side the origin lies, where that is not up: models stand on it."""
    side = np.maximum(high - low, 1e-9)
    middle = np.abs(low + high) / 2 < _PLACED * side
    below, above = np.abs(low) < _PLACED * side, np.abs(high) < _PLACED * side
    ends = below | above
    upright = not middle[2] or ends[:2].sum() != 1 or not middle[:2].any()
    hanging = above[2] and not below[2] and middle[:2].any()
    if upright and not hanging:
        return ""
    axis = 2 if hanging else int(np.argmax(ends))
    right = turn[axis] * (1 if below[axis] else -1)
    return "-" * bool(right.sum() < 0) + "xyz"[int(np.argmax(np.abs(right)))]


@dataclass(frozen=True, eq=False, repr=False)
class Findings(Record):
    """Of one file; lengths in metres in the structure frame, triangles after repair."""

    unit_m: float = 1.0
    unit_from: str = "assumed"  # or "manifest", or "file"
    up: str = "z"
    forward: str = "x"
    parts: int = 0  # connected, welded
    hidden_parts: int = 0  # that no outside ray reaches
    area_m2: float = 0.0
    outside_area_m2: float = 0.0  # that can be seen from outside, each face counted once
    topology: Topology | None = None  # of a mesh
    outliers: tuple[Outlier, ...] = ()
    repairs: tuple[str, ...] = ()  # what was repaired, converted or dropped, in words
    assumed: tuple[str, ...] = ()  # where nothing declares the file
    verdicts: tuple[Verdict, ...] = ()  # the rules that it breaks

    @property
    def warnings(self) -> tuple[str, ...]:
        return (*self.assumed, *(it.found for it in self.verdicts if it.severity == "warn"))

    @property
    def problems(self) -> tuple[Verdict, ...]:
        return refusals(self.verdicts)
