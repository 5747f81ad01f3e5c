"""What a structure shows by itself of the rules, and all that was found in its file."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from upplied.inputs.manifests import StructureEntry
from upplied.inputs.outliers import Outlier
from upplied.inputs.raw import RawMesh
from upplied.inputs.repair import Topology
from upplied.inputs.rules import RULES, Verdict, broken, measured, refusals, unlike_its_kind
from upplied.records import Floats, Ints, Record

_FAR_M = 10_000.0  # from the origin: single precision is off by a millimetre there
_EFFECT = re.compile(
    r"(?i)(?:^|[^a-z])(wake|lights?|flash|beacon|spots?|glow|billboard|halo|shadow)(?![a-z])"
)
_PLACED = 0.02  # of a side, that an origin may be off its low end or its middle and is meant there
_STANDS_M, _STANDS = 0.5, 0.1  # m, and of its height, that what stands on the ground may miss it
_PLANE, _RIM, _ACROSS = 0.002, 8, 0.05  # of a side; vertices; of the other sides: a surface that was cut
_BESIDE = 0.05  # of the diagonal that a landmark may lie outside the box


def concerns(vertices: Floats, raw: RawMesh, entry: StructureEntry, turn: Floats) -> Iterator[Verdict]:
    """The rules that a structure (V, 3), m, breaks by itself, whatever others there are.

    `turn` (3, 3) took it there from the axes of its file.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    yield from (measured(rule, *figures) for rule, *figures in _oddities(low, high, raw, entry, turn))
    yield from unlike_its_kind(high - low, entry.kind)
    room = _BESIDE * float(np.linalg.norm(high - low))
    for name, point in entry.landmarks.items():
        off = float(np.maximum(np.maximum(low - point, np.asarray(point) - high), 0).max())
        if off > room:
            yield measured("landmark", name, off)


def _oddities(
    low: Floats, high: Floats, raw: RawMesh, entry: StructureEntry, turn: Floats
) -> Iterator[tuple[Any, ...]]:
    """Rules that the box of corners (3,), m, or the file breaks, with the figures of each finding."""
    own, declared, ground = raw.unit_m, entry.unit_m, entry.surroundings.ground_z_m
    longest, bounds, centre = float((high - low).max()), entry.bounds, (low + high) / 2
    if own is not None and declared is not None and abs(own / declared - 1) >= 1e-3:
        yield "declared-unit", own, declared
    if raw.up not in ("", entry.up):
        yield "declared-up", raw.up, entry.up
    if not bounds.least_m <= longest <= bounds.most_m:
        yield "extent", longest
    elif not bounds.odd_least_m <= longest <= bounds.odd_most_m:
        yield "odd-extent", longest
    if np.abs(centre).max() >= _FAR_M:
        yield "far", np.linalg.norm(centre) / 1000
    if ground is not None and low[2] < ground - 0.1 and not entry.clip_ground:
        yield "below-ground", ground - low[2]
    if ground is not None and low[2] - ground > max(_STANDS_M, _STANDS * (high[2] - low[2])):
        yield "floating", low[2] - ground
    if not any(entry.local_origin) and (up := _standing_up(low, high, turn)):
        yield "odd-up-axis", up[-1], up
    if named := sorted({name for name in raw.part_names if _EFFECT.search(name)}):
        yield "effects", ", ".join(map(repr, named[:5]))


def nominal_problems(
    vertices: Floats, entry: StructureEntry, outliers: tuple[Outlier, ...]
) -> tuple[Verdict, ...]:
    """Where the size is not the nominal one."""
    remedy = RULES["nominal"].remedy
    if outliers and not entry.drop_outliers:
        remedy += f", or set drop_outliers = true: it has {outliers[0]}"
    size, most = np.ptp(vertices, axis=0), entry.bounds.nominal_pct
    verdicts = []
    for side, have, want in zip(
        ("length (x)", "width (y)", "height (z)"), size, entry.nominal_m, strict=True
    ):
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

    unit_m: float
    unit_from: str  # "manifest", "file" or "assumed"
    up: str
    forward: str
    parts: int = 0  # connected, welded
    hidden_parts: int = 0  # that no outside ray reaches
    area_m2: float = 0.0
    outside_area_m2: float = 0.0  # that can be seen from outside, each face counted once
    topology: Topology | None = None  # of a mesh
    outliers: tuple[Outlier, ...] = ()
    done: tuple[str, ...] = ()  # what was repaired, converted or dropped, in words
    assumed: tuple[str, ...] = ()  # where nothing declares the file
    verdicts: tuple[Verdict, ...] = ()  # the rules that it breaks

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should look at, in words."""
        odd = (verdict for verdict in self.verdicts if verdict.severity == "warn")
        return (*self.assumed, *(verdict.found for verdict in odd))

    @property
    def problems(self) -> tuple[Verdict, ...]:
        """Why it is refused."""
        return refusals(self.verdicts)
