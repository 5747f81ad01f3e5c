"""Structures: a declared mesh file becomes metres, Z up, +X forward, welded and clean."""

from __future__ import annotations

import numpy as np

from upplied.checks import check_finite, check_id
from upplied.config import digest
from upplied.errors import InputError
from upplied.inputs.formats.raw import RawMesh
from upplied.inputs.formats.reader import read_raw
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.repair import clean
from upplied.records import Floats, Structure

NOMINAL_TOLERANCE = 0.07  # passes nearly every good model of a type and flags toys and wrong units


def read_structure(entry: StructureEntry) -> Structure:
    """The structure of a manifest entry.

    Parameters
    ----------
    entry : StructureEntry
        Says where the file lies and what its units and axes mean.

    Returns
    -------
    Structure
        In metres, Z up, +X forward; vertices welded, no triangle degenerate or twice.

    Raises
    ------
    InputError
        Where the file is empty, truncated, mislabelled, of another format, or not of the nominal size.
    """
    check_id(entry.structure_id, "structure id")
    raw, sha256 = read_raw(entry.path)
    vertices = structure_frame(raw, entry)
    triangles = np.asarray(raw.triangles, np.int64)
    if not len(triangles):
        raise InputError(str(entry.path), "holds no triangles", "a mesh", "export the surface again")
    vertices, triangles, _, _ = clean(vertices, triangles)
    if not len(triangles):
        raise InputError(str(entry.path), "holds no triangle with an area", "a mesh", "export it again")
    _check_nominal(vertices, entry)
    return Structure(
        structure_id=entry.structure_id,
        kind=entry.kind,
        vertices=vertices,
        triangles=triangles,
        site=entry.site,
        sha256=_sha256(sha256, entry),
        placement=entry.placement,
        surroundings=entry.surroundings,
        landmarks=dict(entry.landmarks),
        symmetric=entry.symmetric,
        notes=entry.notes,
    )


def structure_frame(raw: RawMesh, entry: StructureEntry) -> Floats:
    """The vertices (V, 3) in metres in the structure frame."""
    unit = raw.unit_m if entry.unit_m is None else entry.unit_m
    if unit is None:
        raise InputError(
            str(entry.path),
            "does not declare its units",
            "units = file only for formats that do",
            "declare m, cm, mm, in, ft or metres per unit",
        )
    vertices = check_finite(raw.vertices, (None, 3), f"{entry.path}, vertices")
    local = vertices - np.asarray(entry.local_origin)
    return (local @ turn(entry.up, entry.forward).T) * (unit * entry.scale)


def turn(up: str, forward: str) -> Floats:
    """Rotation (3, 3) that takes the file's axes to +X forward and Z up."""
    rows = np.stack([_axis(forward), np.cross(_axis(up), _axis(forward)), _axis(up)])
    if abs(np.linalg.det(rows) - 1) > 1e-9:
        raise InputError("axes", f"up {up!r} and forward {forward!r}", "two different axes of the file")
    return rows


def _axis(name: str) -> Floats:
    return (-1.0 if name.startswith("-") else 1.0) * np.eye(3)["xyz".index(name[-1])]


def _check_nominal(vertices: Floats, entry: StructureEntry) -> None:
    size = np.ptp(vertices, axis=0)
    for side, have, want in zip(
        ("length (x)", "width (y)", "height (z)"), size, entry.nominal_m, strict=True
    ):
        if want is not None and abs(have / want - 1) > NOMINAL_TOLERANCE:
            raise InputError(
                f"{entry.path} ({entry.structure_id})",
                f"{side} is {have:.3g} m, {100 * (have / want - 1):+.0f} % off the nominal {want:g} m",
                f"within {100 * NOMINAL_TOLERANCE:.0f} %",
                "check units, up, forward and scale, and look for parts that are not the structure",
            )


def _sha256(file: str, entry: StructureEntry) -> str:
    surroundings, placement = entry.surroundings, entry.placement
    said = {
        "file": file,
        "id": entry.structure_id,
        "kind": entry.kind,
        "geometry": [entry.unit_m, entry.up, entry.forward, entry.scale, list(entry.local_origin)],
        "repair": [entry.drop_hidden, entry.drop_outliers, entry.clip_ground],
        "placement": None if placement is None else vars(placement),
        "surroundings": [
            surroundings.ground_z_m,
            surroundings.keep_out_m.tolist(),
            surroundings.geofence_m.tolist(),
            surroundings.ceiling_z_m,
        ],
        "landmarks": {name: list(xyz) for name, xyz in entry.landmarks.items()},
        "symmetric": entry.symmetric,
    }
    return digest(said)
