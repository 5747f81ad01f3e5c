"""A photogrammetry project as a structure and a flight: the surface beside its cameras, in the same frame."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import turn
from upplied.inputs.sidecar import LogOptions, inspection, safe_id, stated
from upplied.inputs.sources import door
from upplied.inputs.sources.source import Source
from upplied.records import Floats

KINDS = ("project", "placed", "colmap")
#: Surfaces of OpenDroneMap, COLMAP and OpenSfM in the frame of their cameras, from the project's folder.
SURFACES = (
    "odm_meshing/odm_mesh.ply", "odm_filterpoints/point_cloud.ply",
    "dense/meshed-poisson.ply", "meshed-poisson.ply", "dense/meshed-delaunay.ply", "meshed-delaunay.ply",
    "dense/fused.ply", "fused.ply", "undistorted/depthmaps/merged.ply",
    "opensfm/undistorted/depthmaps/merged.ply",
)  # fmt: skip
_ENDINGS = (".ply", ".obj", ".glb", ".stl", ".dae")
_DEEP = 3  # folders from the cameras up to the project's own
_TILT_DEG = 10.0  # of cameras beside the horizon, root mean square, that give the vertical
_OFF_DEG = 5.0  # of the vertical off an axis of the file
_TURNED = 0.02  # least share of the cameras' sides in a second direction: in a row they give no vertical


@dataclass(frozen=True)
class Project:
    """The surface of a reconstruction as a structure, and the facts of its flight round it."""

    entry: StructureEntry
    facts: LogOptions
    folder: Path


def project_at(cameras: Path, options: LogOptions) -> Project | None:
    """The structure and the flight of a project; None where a structure is named, or no surface is there.

    `cameras` is a file of one of `KINDS`; `unit_m` of the facts is the metres per unit of a model.
    Raises InputError if its kind, its scale or its vertical is unknown, or the cameras cannot be read.
    """
    declared, _ = inspection(cameras, [], options)
    roots = list(cameras.resolve().parents)[:_DEEP]
    surfaces = [(root / name, root) for root in roots for name in SURFACES if (root / name).is_file()]
    beside = [each for each in roots[0].iterdir() if each.suffix.lower() in _ENDINGS and each.is_file()]
    surfaces = surfaces[:1] or [(each, roots[0]) for each in beside]
    if declared.structure_id or len(surfaces) != 1:
        return None
    (surface, folder), what = surfaces[0], str(cameras)
    if not declared.kind:
        rule = "a structure is planned for among its kind alone"
        finding = "does not state the kind of its structure"
        raise InputError(what, finding, rule, "give --kind, e.g. --kind building")
    source = door.read(cameras, {})
    facts = stated(declared, source.defaults)
    if facts.unit_m is not None and not facts.unit_m > 0:
        rule, remedy = "unit_m: metres per unit of the model", "give --unit-m, or georegister it"
        raise InputError(what, "is a reconstruction without scale", rule, remedy)
    up = "z" if source.place is not None else _up(source, what)
    forward = "x" if up[-1] != "x" else "y"
    name = safe_id(folder.name)
    entry = StructureEntry(
        name, declared.kind, surface, facts.unit_m or 1.0, up, forward,
        site=declared.site, placement=source.place, surface="scanned",
        notes=f"reconstructed by the project of {cameras.name}",
    )  # fmt: skip
    flight_id = options.demonstration_id or f"{name}-flight"
    flight, axes = replace(options, structure_id=name, demonstration_id=flight_id), turn(up, forward)
    if source.place is None and not np.array_equal(axes, np.eye(3)):
        flight = replace(flight, structure_quat_xyzw=tuple(Rotation.from_matrix(axes.T).as_quat().tolist()))
    return Project(entry, flight, folder)


def _up(source: Source, what: str) -> str:
    """The axis of the file that points up: cameras of drones hold the horizon, so their sides lie level."""
    if not (tables := [table for table in source.tables if "pose.orientation.w" in table]):
        raise InputError(what, "holds no frame of its own", "cameras and surface in one", "give --structure")
    turns = Rotation.from_quat(tables[0].stack(*(f"pose.orientation.{axis}" for axis in "xyzw")))
    sides: Floats = turns.apply([0.0, 1.0, 0.0])
    shares, axes = np.linalg.eigh(sides.T @ sides / len(sides))
    up = axes[:, 0] * np.sign(float((turns.apply([0.0, 0.0, 1.0]) @ axes[:, 0]).mean()) or 1.0)
    tilt = float(np.degrees(np.arcsin(np.sqrt(max(shares[0], 0.0)))))
    axis = int(np.argmax(np.abs(up)))
    off = float(np.degrees(np.arccos(min(abs(up[axis]), 1.0))))
    if tilt > _TILT_DEG or shares[1] < _TURNED or off > _OFF_DEG:
        finding = f"its cameras give no vertical along an axis (tilted by {tilt:.0f} deg, {off:.0f} deg off)"
        remedy = "align it first (COLMAP: model_orientation_aligner), or give --structure and --register"
        raise InputError(what, finding, f"within {_OFF_DEG:g} deg of an axis", remedy)
    return ("-" if up[axis] < 0 else "") + "xyz"[axis]
