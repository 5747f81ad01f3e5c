"""What a structure shows by itself of the rules, and all that was found in its file."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from upplied.inputs.manifests import StructureEntry
from upplied.inputs.outliers import Outlier
from upplied.inputs.raw import RawMesh
from upplied.inputs.repair import Repairs
from upplied.inputs.rules import Verdict, broken, refusals
from upplied.inputs.structure_rules import RULES, unlike_its_kind
from upplied.records import Floats, Ints, Record

_FAR_M = 10_000.0  # from the origin: single precision is off by a millimetre there
_EFFECT = re.compile(
    r"(?i)(?:^|[^a-z])(wake|lights?|flash|beacon|spots?|glow|billboard|halo|shadow)(?![a-z])"
)
_PLACED = 0.02  # of a side, that an origin may be off its low end or its middle and is meant there
_STANDS_M, _STANDS = 0.5, 0.1  # m, and of its height, that what stands on the ground may miss it
_PLANE, _RIM, _ACROSS = 0.002, 8, 0.05  # of a side; vertices; of the other sides: a surface that was cut
_BESIDE = 0.05  # of the diagonal that a landmark may lie outside the box


def concerns(vertices: Floats, raw: RawMesh, entry: StructureEntry, turn: Floats) -> tuple[Verdict, ...]:
    """The rules that a structure (V, 3), m, breaks by itself, whatever others there are.

    `turn` (3, 3) took it there from the axes of its file.
    """
    found = {
        "declared-unit": _units(raw, entry),
        "declared-up": _up(raw, entry),
        **_extent(vertices, entry),
        "far": _far(vertices),
        "below-ground": _below(vertices, entry),
        "floating": _floats(vertices, entry),
        "odd-up-axis": _stands(vertices, turn) if not any(entry.local_origin) else "",
        "effects": _effects(raw),
    }
    verdicts = [broken(RULES[name], words) for name, words in found.items() if words]
    verdicts += unlike_its_kind(np.ptp(vertices, axis=0), entry.kind)
    return (*verdicts, *(broken(RULES["landmark"], words) for words in _landmarks(vertices, entry)))


def nominal_problems(
    vertices: Floats, entry: StructureEntry, outliers: tuple[Outlier, ...]
) -> tuple[Verdict, ...]:
    """Where the size is not the nominal one."""
    remedy = RULES["nominal"].remedy
    if outliers and not entry.drop_outliers:
        remedy += f", or set drop_outliers = true: it has {outliers[0]}"
    size, most = np.ptp(vertices, axis=0), entry.bounds.nominal_pct
    found = []
    for side, have, want in zip(
        ("length (x)", "width (y)", "height (z)"), size, entry.nominal_m, strict=True
    ):
        if want is not None and abs(have / want - 1) > most / 100:
            off = f"{side} is {have:.4g} m, {100 * (have / want - 1):+.0f} % off the nominal {want:g} m"
            found.append(broken(RULES["nominal"], off, f"within {most:g} %", remedy))
    return tuple(found)


def _units(raw: RawMesh, entry: StructureEntry) -> str:
    own, declared = raw.unit_m, entry.unit_m
    if own is None or declared is None or abs(own / declared - 1) < 1e-3:
        return ""
    return f"the file says that its unit is {own:g} m, the manifest {declared:g} m: the manifest wins"


def _up(raw: RawMesh, entry: StructureEntry) -> str:
    if raw.up in ("", entry.up):
        return ""
    return f"the file says that {raw.up} is up, the manifest {entry.up}: the manifest wins"


def _extent(vertices: Floats, entry: StructureEntry) -> dict[str, str]:
    longest, bounds = float(np.ptp(vertices, axis=0).max()), entry.bounds
    for rule, low, high in (
        ("extent", bounds.least_m, bounds.most_m),
        ("odd-extent", bounds.odd_least_m, bounds.odd_most_m),
    ):
        if not low <= longest <= high:
            return {rule: f"its longest side is {longest:.4g} m: are the units right?"}
    return {}


def _far(vertices: Floats) -> str:
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    if np.abs(centre).max() < _FAR_M:
        return ""
    return (
        f"its centre lies {np.linalg.norm(centre) / 1000:.0f} km from the origin: projected coordinates?"
        " (local_origin = [x, y, z] subtracts an origin of your choice)"
    )


def _below(vertices: Floats, entry: StructureEntry) -> str:
    ground = entry.surroundings.ground_z_m
    if ground is None or entry.clip_ground or vertices[:, 2].min() >= ground - 0.1:
        return ""
    deep = ground - vertices[:, 2].min()
    return f"it reaches {deep:.1f} m below the declared ground (clip_ground = true cuts that off)"


def _floats(vertices: Floats, entry: StructureEntry) -> str:
    ground = entry.surroundings.ground_z_m
    if ground is None:
        return ""
    low, high = vertices[:, 2].min(), vertices[:, 2].max()
    if low - ground <= max(_STANDS_M, _STANDS * (high - low)):
        return ""
    return f"its lowest point is {low - ground:.1f} m above the declared ground"


def cut_off(vertices: Floats, rim: Ints) -> tuple[Verdict, ...]:
    """Where the surface (V, 3), m, ends in a plane at one side, `rim` being the vertices at which it ends."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    side = np.maximum(high - low, 1e-9)
    found = []
    for axis, other in ((0, 1), (1, 0)):
        for name, at in (("low", low[axis]), ("high", high[axis])):
            ends = vertices[rim[np.abs(vertices[rim, axis] - at) < _PLANE * side[axis]]]
            if len(ends) >= _RIM and (np.ptp(ends[:, [other, 2]], axis=0) > _ACROSS * side[[other, 2]]).all():
                words = f"its surface ends in a plane at {'xy'[axis]} = {at:.1f} m, its {name} side"
                found.append(broken(RULES["cut-off"], words))
    return tuple(found)


def _stands(vertices: Floats, turn: Floats) -> str:
    """Whether the origin lies at another side than the lower one: models are made to stand on it."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
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
    name = ("-" if right.sum() < 0 else "") + "xyz"[int(np.argmax(np.abs(right)))]
    return (
        f"its origin is at one end of the file's {name[-1]}, and in the middle of what is up: up = {name!r}?"
    )


def _effects(raw: RawMesh) -> str:
    named = sorted({name for name in raw.part_names if _EFFECT.search(name)})
    if not named:
        return ""
    shown = ", ".join(repr(name) for name in named[:5])
    return f"parts named {shown} sound like effects, not like the structure: take them out of the file"


def _landmarks(vertices: Floats, entry: StructureEntry) -> list[str]:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    room = _BESIDE * float(np.linalg.norm(high - low))
    found = []
    for name, point in entry.landmarks.items():
        off = float(np.maximum(np.maximum(low - point, np.asarray(point) - high), 0).max())
        if off > room:
            found.append(f"the landmark {name} lies {off:.1f} m outside its box")
    return found


@dataclass(frozen=True, eq=False, repr=False)
class Findings(Record):
    """Of one file; lengths in metres in the structure frame, triangles after repair."""

    unit_m: float
    unit_from: str  # "manifest", "file" or "assumed"
    up: str
    forward: str
    repairs: Repairs
    parts: int = 0  # connected, welded
    hidden_parts: int = 0  # that no outside ray reaches
    hidden_triangles: int = 0
    area_m2: float = 0.0
    outside_area_m2: float = 0.0  # that can be seen from outside, each face counted once
    watertight: bool = False
    boundary_edges: int = 0
    nonmanifold_edges: int = 0
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
