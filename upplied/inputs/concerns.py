"""What looks odd in a structure and only a person can judge: units, axes, far coordinates, size."""

from __future__ import annotations

import re

import numpy as np

from upplied.inputs.manifests import StructureEntry
from upplied.inputs.outliers import Outlier
from upplied.inputs.raw import RawMesh
from upplied.records import Floats

NOMINAL_TOLERANCE = 0.07  # passes nearly every good model of a type and flags toys and wrong units
_SMALLEST_M, _LARGEST_M = 0.5, 2000.0
_FAR_M = 10_000.0  # from the origin: single precision is off by a millimetre there
_EFFECT = re.compile(
    r"(?i)(?:^|[^a-z])(wake|lights?|flash|beacon|spots?|glow|billboard|halo|shadow)(?![a-z])"
)
_BESIDE = 0.05  # of the diagonal that a landmark may lie outside the box


def concerns(vertices: Floats, raw: RawMesh, entry: StructureEntry) -> tuple[str, ...]:
    """Warnings about a structure (V, 3), m, in words."""
    found = [
        _units(raw, entry),
        _up(raw, entry),
        _scale(vertices),
        _far(vertices, entry),
        _below(vertices, entry),
        _effects(raw),
        *_landmarks(vertices, entry),
    ]
    return tuple(filter(None, found))


def nominal_problems(
    vertices: Floats, entry: StructureEntry, outliers: tuple[Outlier, ...]
) -> tuple[tuple[str, str, str], ...]:
    """Where the size is not the nominal one: found, rule, remedy."""
    remedy = "check units, up, forward and scale"
    if outliers and not entry.drop_outliers:
        remedy += f", or set drop_outliers = true: it has {outliers[0]}"
    size = np.ptp(vertices, axis=0)
    found = []
    for side, have, want in zip(
        ("length (x)", "width (y)", "height (z)"), size, entry.nominal_m, strict=True
    ):
        if want is not None and abs(have / want - 1) > NOMINAL_TOLERANCE:
            off = f"{side} is {have:.4g} m, {100 * (have / want - 1):+.0f} % off the nominal {want:g} m"
            found.append((off, f"within {100 * NOMINAL_TOLERANCE:.0f} %", remedy))
    return tuple(found)


def _units(raw: RawMesh, entry: StructureEntry) -> str:
    said, declared = raw.unit_m, entry.unit_m
    if said is None or declared is None or abs(said / declared - 1) < 1e-3:
        return ""
    return f"the file says that its unit is {said:g} m, the manifest {declared:g} m: the manifest wins"


def _up(raw: RawMesh, entry: StructureEntry) -> str:
    if raw.up in ("", entry.up):
        return ""
    return f"the file says that {raw.up} is up, the manifest {entry.up}: the manifest wins"


def _scale(vertices: Floats) -> str:
    longest = float(np.ptp(vertices, axis=0).max())
    if _SMALLEST_M <= longest <= _LARGEST_M:
        return ""
    return f"its longest side is {longest:.4g} m: are the units right?"


def _far(vertices: Floats, entry: StructureEntry) -> str:
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
