"""The sample fleet as files: meshes in mixed formats, a manifest, and flight logs."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from upplied.files import replace_file
from upplied.outputs.logs import Encoding, write_log
from upplied.records import Floats, Structure
from upplied.samples.fleet import member, sample_demonstrations, sample_structures


@dataclass(frozen=True)
class _Form:
    """The form of a mesh file: format, metres per unit, and the axes that point up and forward."""

    suffix: str
    units: str
    unit_m: float
    up: str
    forward: str


_FORMS = (
    _Form("ply", "m", 1.0, "z", "x"),
    _Form("glb", "m", 1.0, "y", "z"),  # glTF: metres, +Y up, +Z forward
    _Form("stl", "mm", 0.001, "z", "x"),
    _Form("obj", "cm", 0.01, "z", "-y"),
)
FILES = 21  # meshes and logs, for a progress bar
_ENCODINGS: tuple[Encoding, ...] = ("pose_stamped", "odometry", "tf")


def write_sample_fleet(folder: str | Path, progress: Callable[[str], None] | None = None) -> Path:
    """Write meshes, `structures.toml` and one MCAP log per demonstration.

    Parameters
    ----------
    folder : path
        Created if missing; files of the same names are replaced.
    progress : callable, optional
        Receives the name of each written file.

    Returns
    -------
    Path
        The manifest.
    """
    root = Path(folder)
    report = progress or (lambda name: None)
    entries = []
    for number, structure in enumerate(sample_structures()):
        form = _FORMS[number % len(_FORMS)]
        name = f"meshes/{structure.structure_id}.{form.suffix}"
        replace_file(root / name, _mesh_bytes(structure, form))
        entries.append(_entry(structure, name, form))
        report(name)
    for number, demonstration in enumerate(sample_demonstrations()):
        name, encoding = f"logs/{demonstration.demonstration_id}.mcap", _ENCODINGS[number % len(_ENCODINGS)]
        structure = member(demonstration.structure_id).structure
        write_log(root / name, demonstration, structure, encoding=encoding, simulated=True)
        report(name)
    head = "# The sample fleet: parametric structures in several formats, units and axes.\n\n"
    return replace_file(root / "structures.toml", head + "\n".join(entries))


def _entry(structure: Structure, name: str, form: _Form) -> str:
    texts = {
        "id": structure.structure_id, "kind": structure.kind, "path": name,
        "units": form.units, "up": form.up, "forward": form.forward,
        "site": structure.site, "notes": structure.notes,
    }  # fmt: skip
    lines = ["[[structure]]", *(f"{key} = {json.dumps(text)}" for key, text in texts.items() if text)]
    lines.append(f"ground_z = {structure.surroundings.ground_z_m or 0.0}")
    sides = zip(("length", "width", "height"), np.ptp(structure.vertices, axis=0), strict=True)
    lines += [f"nominal_{side}_m = {value:.2f}" for side, value in sides]
    if (place := structure.placement) is not None:
        lines += [f"lat = {place.lat_deg}", f"lon = {place.lon_deg}", f"alt = {place.alt_m}"]
        lines += [f"heading = {place.heading_deg}", f"datum = {json.dumps(place.datum)}"]
    if structure.landmarks:
        lines.append("[structure.landmarks]")
        lines += [f"{key} = {[round(value, 3) for value in xyz]}" for key, xyz in structure.landmarks.items()]
    return "\n".join(lines) + "\n"


def _mesh_bytes(structure: Structure, form: _Form) -> bytes:
    import trimesh

    forward, up = _axis(form.forward), _axis(form.up)
    axes = np.stack([forward, np.cross(up, forward), up])  # of the file, along which x, y and z run
    vertices = structure.vertices @ axes / form.unit_m
    mesh = trimesh.Trimesh(vertices, structure.triangles, process=False)
    content = mesh.export(file_type=form.suffix)
    return content.encode() if isinstance(content, str) else bytes(content)


def _axis(name: str) -> Floats:
    return np.eye(3)["xyz".index(name[-1])] * (-1.0 if name.startswith("-") else 1.0)
