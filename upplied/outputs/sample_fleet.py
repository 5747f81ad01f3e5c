"""The sample fleet as files: meshes in mixed formats, a manifest, and flight logs."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from upplied.files import replace_file
from upplied.outputs.logs import Encoding, write_log
from upplied.records import Structure
from upplied.samples.fleet import member, sample_demonstrations, sample_structures

# Forms of mesh files: format, name of the unit and its metres, and the axes that point up and forward.
_Form = tuple[str, str, float, str, str]
_FORMS: tuple[_Form, ...] = (
    ("ply", "m", 1.0, "z", "x"),
    ("glb", "m", 1.0, "y", "z"),  # glTF: metres, +Y up, +Z forward
    ("stl", "mm", 0.001, "z", "x"),
    ("obj", "cm", 0.01, "z", "-y"),
)
FILES = 21  # meshes and logs, for a progress bar
_ENCODINGS: tuple[Encoding, ...] = ("pose_stamped", "odometry", "tf")


def write_sample_fleet(folder: str | Path, progress: Callable[[str], None] | None = None) -> Path:
    """Write meshes, one MCAP log per demonstration, and `structures.toml`; returns the path of this manifest.

    Files of the same names are replaced; `progress` receives the name of each written file.
    """
    root = Path(folder)
    report = progress or (lambda name: None)
    entries = []
    for number, structure in enumerate(sample_structures()):
        form = _FORMS[number % len(_FORMS)]
        name = f"meshes/{structure.structure_id}.{form[0]}"
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
    _, units, _, up, forward = form
    texts = {
        "id": structure.structure_id, "kind": structure.kind, "path": name,
        "units": units, "up": up, "forward": forward,
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

    suffix, _, unit_m, *axes = form
    up, forward = (np.eye(3)["xyz".index(name[-1])] * (-1.0 if name[:-1] else 1.0) for name in axes)
    turn = np.stack([forward, np.cross(up, forward), up])  # the axes of the file along which x, y and z run
    mesh = trimesh.Trimesh(structure.vertices @ turn / unit_m, structure.triangles, process=False)
    content = mesh.export(file_type=suffix)
    return content.encode() if isinstance(content, str) else bytes(content)
