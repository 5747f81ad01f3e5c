"""Manifests: declarations about the structures of a folder, in TOML or CSV with the same keys.

A mesh file states no unit, axis or heading to trust. Other lengths are metres in the structure frame.
"""

import csv
import io
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.inputs import manifest_keys as keys
from upplied.inputs.files import read_regular
from upplied.inputs.rules import StructureSettings
from upplied.records import Placement, Surroundings

MAX_BYTES = 16 << 20  # a row is some 200 bytes: 80 000 structures
_PLACE = ("lat", "lon", "alt", "heading")
_AREAS = {"keep_out": (0, 2, 3), "geofence": (0, 2), "rally": (0, 3)}  # and the shapes of none


@dataclass(frozen=True, eq=False)
class StructureEntry:
    """One structure as declared: where its file lies and how to understand it."""

    structure_id: str
    kind: str
    path: Path
    unit_m: float | None = None  # metres per unit of the file; None: the file itself declares it
    up: str = "z"  # axis of the file that points up: x, y, z, -x, -y or -z
    forward: str = "x"  # axis of the file that becomes +X: nose, bow, rotor hub, long axis
    scale: float = 1.0  # of the whole, besides the unit (a scene file's scale, a toy model)
    local_origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # subtracted first, units and axes of the file
    site: str = ""
    placement: Placement | None = None
    surroundings: Surroundings = field(default_factory=Surroundings)
    nominal_m: tuple[float | None, float | None, float | None] = (None, None, None)  # along x, y, z; checked
    landmarks: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)  # structure frame, m
    symmetric: bool = False  # no heading can be told from the shape
    surface: str | None = None  # declared: drawn or scanned
    surface_error_m: float | None = None  # stated: how far the surface may lie from where the file has it
    drop_hidden: bool = False  # drop parts that cannot be seen from outside
    drop_outliers: bool = False  # drop parts far off the rest: billboards, wakes
    clip_ground: bool = False  # cut off what lies below the declared ground
    notes: str = ""
    allow: tuple[str, ...] = ()  # rules that are overruled for it, by name
    strict: bool = False  # what is odd is refused too
    bounds: StructureSettings = field(default_factory=StructureSettings)


def read_manifest(path: Path | str, allow_outside: bool = False) -> list[StructureEntry]:
    """The structures that a manifest declares.

    Parameters
    ----------
    path : path
        A ``.toml`` file with ``[[structure]]`` tables, or a ``.csv`` with the same keys as columns.
    allow_outside : bool
        Also accept absolute paths and paths that leave the manifest's folder.

    Raises
    ------
    InputError
        Naming the manifest, the entry and the rule that it breaks. The files that it names are not
        opened here.
    """
    path = Path(path)
    if (suffix := path.suffix.lower()) not in (".toml", ".csv"):
        raise InputError(str(path), f"has the suffix {path.suffix!r}", "a manifest is a .toml or a .csv file")
    try:
        text = read_regular(path, MAX_BYTES, remedy="split it").decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(str(path), f"byte {error.start} is not UTF-8", "text in UTF-8") from None
    rows = _toml_rows(path, text) if suffix == ".toml" else _csv_rows(path, text)
    entries: dict[str, StructureEntry] = {}
    for what, row in rows:
        entry = _entry(row, what, path.parent, allow_outside)
        if entry.structure_id in entries:
            raise InputError(what, f"the id {entry.structure_id!r} stands twice", "one entry per id")
        entries[entry.structure_id] = entry
    if not entries:
        raise InputError(str(path), "declares no structure", "at least one [[structure]] table or CSV row")
    return list(entries.values())


def _toml_rows(path: Path, text: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(str(path), f"is not TOML: {str(error)[:200]}", "", "correct the line") from None
    for key in document.keys() - {"structure"}:
        raise InputError(str(path), f"unknown top-level key {key[:60]!r}", "[[structure]] tables only")
    tables = document.get("structure", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InputError(str(path), "`structure` is no array of tables", "[[structure]], with two brackets")
    for number, table in enumerate(tables, 1):
        yield f"{path}, structure {number} ({str(table.get('id', 'without id'))[:64]!r})", table


def _csv_rows(path: Path, text: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        header = [name.strip() for name in next(reader, [])]
        if len(set(header)) < len(header):
            raise InputError(f"{path}, header", "names a column twice", "each column once")
        for cells in reader:
            what = f"{path}, line {reader.line_num}"
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) != len(header):
                raise InputError(what, f"has {len(cells)} cells", f"{len(header)}, as the header")
            row = zip(header, cells, strict=True)
            yield what, {name: cell.strip() for name, cell in row if cell.strip()}
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num}", f"is not CSV: {error}") from None


def _entry(row: Mapping[str, Any], what: str, folder: Path, allow_outside: bool) -> StructureEntry:
    values = keys.parse(row, what)
    up, forward = values["up"], values.get("forward")
    if forward is None and values.get("symmetric"):
        forward = next(axis for axis in keys.AXES if axis[-1] != up[-1])
    if forward is None:
        rule = "the axis of the file that points to the nose, bow, rotor hub or along the structure"
        remedy = "declare it, or symmetric = true where there is none"
        raise InputError(what, "has no 'forward'", rule, remedy)
    if forward[-1] == up[-1]:
        raise InputError(what, f"forward {forward!r} and up {up!r} lie on one axis", "two different axes")
    if values.get("clip_ground") and "ground_z" not in values:
        raise InputError(what, "has clip_ground but no ground_z", "the height of the ground to clip at")
    missing = [key for key in _PLACE if key not in values]
    if 0 < len(missing) < len(_PLACE):
        rule = "lat, lon, alt and heading (deg of +X, clockwise from north) are given together or not at all"
        raise InputError(what, f"has no {' and no '.join(missing)}", rule)
    declared = {item.name: values[item.name] for item in fields(StructureEntry) if item.name in values}
    areas = {f"{key}_m": np.asarray(values.get(key, np.empty(shape)), float) for key, shape in _AREAS.items()}
    around = Surroundings(ground_z_m=values.get("ground_z"), ceiling_z_m=values.get("ceiling_z"), **areas)
    path, root = Path(values["path"]), folder.resolve()
    if not allow_outside and (path.is_absolute() or not (root / path).resolve().is_relative_to(root)):
        finding = f"the path {values['path'][:120]!r} leaves the manifest's folder"
        rule = "paths relative to the manifest, inside its folder"
        raise InputError(what, finding, rule, "move the file there, or allow outside paths explicitly")
    declared |= {"path": folder / path, "up": up, "forward": forward}
    declared |= {"structure_id": values["id"], "unit_m": values["units"], "surroundings": around}
    declared["nominal_m"] = tuple(values.get(f"nominal_{side}_m") for side in ("length", "width", "height"))
    if not missing:
        place = (*(values[key] for key in _PLACE), values.get("datum", "ellipsoid"))
        declared["placement"] = Placement(*place)
    return StructureEntry(**declared)
