"""Structures: a declared mesh or cloud becomes metres, Z up, +X forward, clean, its outside outside."""

import hashlib
from dataclasses import astuple, fields, replace
from typing import Any

import numpy as np

from upplied.checks import check_id
from upplied.config import digest
from upplied.errors import InputError
from upplied.geometry.reconstruction import looks_scanned
from upplied.geometry.vectors import area_vectors
from upplied.inputs.concerns import Findings, concerns, cut_off, find_outliers, nominal_problems
from upplied.inputs.files import open_regular
from upplied.inputs.formats.reader import read_raw
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.outside import look, outward_normals
from upplied.inputs.raw import NO_TRIANGLES, RawMesh, counted
from upplied.inputs.repair import clean, clip_below, compact, topology_of, used_vertices
from upplied.inputs.rules import decided, measured, refuse, to_json
from upplied.records import Bools, Floats, Ints, Structure

_AS_DECLARED = {item.name for item in fields(Structure)} & {item.name for item in fields(StructureEntry)}
Clean = tuple[Floats, Ints, Floats | None, Findings]  # vertices, triangles, normals, and what was found

_FARTHEST_M = 1e9  # beyond, the file is damaged; single precision and squares stay in range below


def read_structure(entry: StructureEntry, judge: bool = True) -> Structure:
    """The structure of a manifest entry.

    Parameters
    ----------
    entry : StructureEntry
    judge : bool
        False: a rule that is broken is no error, and stands in `verdicts_json` for who asks others too.

    Returns
    -------
    Structure
        In metres, Z up, +X forward. Meshes: vertices welded, no triangle degenerate or twice, patches
        that show their back turned. Clouds: no point twice, normals outwards. What was repaired and
        what looks odd is added to its notes.

    Raises
    ------
    InputError
        Where the file is empty, truncated, mislabelled or of another format, or breaks a rule.
    """
    check_id(entry.structure_id, "structure id")
    raw, sha256 = read_raw(entry.path)
    structure, findings = normalise(entry, raw, sha256)
    if judge:
        refuse(f"{entry.path} ({entry.structure_id})", findings.verdicts)
    return structure


def fingerprint(entry: StructureEntry) -> str:
    """The hash that `read_structure` would give, by the bytes of the file alone; OSError if it is unreadable.

    It differs where a file refers to others beside it (glTF): such a file is read to be known.
    """
    with open_regular(entry.path) as stream:
        return _sha256(hashlib.file_digest(stream, "sha256").hexdigest(), entry)


def normalise(entry: StructureEntry, raw: RawMesh, sha256: str) -> tuple[Structure, Findings]:
    """The structure that a file holds by its entry, with all that was found on the way."""
    vertices, unit_m = structure_frame(raw, entry)
    structure_of = _mesh if len(raw.triangles) else _cloud
    vertices, triangles, normals, findings = structure_of(vertices, raw, entry)
    nominal = nominal_problems(vertices, entry, findings.outliers)
    verdicts = (*nominal, *findings.verdicts, *concerns(vertices, raw, entry, turn(entry.up, entry.forward)))
    verdicts = decided(verdicts, entry.allow, entry.strict)
    findings = replace(
        findings, unit_m=unit_m, unit_from="file" if entry.unit_m is None else "manifest",
        up=entry.up, forward=entry.forward,
        repairs=(*raw.remarks, *findings.repairs), verdicts=verdicts,
    )  # fmt: skip
    declared: dict[str, Any] = {name: getattr(entry, name) for name in _AS_DECLARED}
    declared |= {
        "landmarks": dict(entry.landmarks),
        "notes": "; ".join(filter(None, (entry.notes, *findings.repairs, *(v.found for v in verdicts)))),
        "verdicts_json": to_json(verdicts) if verdicts else "",
        "sha256": _sha256(sha256, entry),
    }
    structure = Structure(vertices=vertices, triangles=triangles, normals=normals, **declared)
    what, stated = f"{entry.path} ({entry.structure_id})", entry.surface_error_m
    most = structure.diagonal_m / 10
    if structure.is_scan and structure.surface == "drawn":
        remedy = "leave out surface; where its points are exact, state surface_error_m"
        raise InputError(what, "is a point cloud and declared to be drawn", "a cloud is a scan", remedy)
    if stated is not None and stated > most:  # round a surface of which less is known nothing can be planned
        finding = f"surface_error_m is {stated:g} m, of a structure of {structure.diagonal_m:.3g} m"
        rule = f"at most {most:.3g} m, a tenth of its size"
        raise InputError(what, finding, rule, "give it in metres, or leave it out")
    return structure, findings


def structure_frame(raw: RawMesh, entry: StructureEntry) -> tuple[Floats, float]:
    """The vertices (V, 3) in metres in the structure frame, double precision throughout; metres per unit."""
    unit = raw.unit_m if entry.unit_m is None else entry.unit_m
    if unit is None or not 0 < unit < np.inf:
        problem = "does not declare its units" if unit is None else f"declares a unit of {unit} m"
        allowed = "units = file only for formats that do"
        raise InputError(str(entry.path), problem, allowed, "declare m, cm, mm, in, ft or metres per unit")
    limit = min(_FARTHEST_M / (unit * entry.scale), _FARTHEST_M**2)
    near = np.abs(raw.vertices) <= limit
    used = used_vertices(raw.triangles, len(near)) if len(raw.triangles) else slice(None)
    far = raw.vertices[used][~near[used] & np.isfinite(raw.vertices[used])]
    if len(far):
        finding, rule = f"has a coordinate of {far[0]:.3g} units", f"at most {_FARTHEST_M:g} m"
        raise InputError(str(entry.path), finding, rule, "check the units, or export it again")
    local = np.where(near, raw.vertices, np.nan) - np.asarray(entry.local_origin)
    return (local @ turn(entry.up, entry.forward).T) * (unit * entry.scale), unit


def turn(up: str, forward: str) -> Floats:
    """Rotation (3, 3) that takes the file's axes to +X forward and Z up."""
    x, z = ((-1.0 if name[0] == "-" else 1.0) * np.eye(3)["xyz".index(name[-1])] for name in (forward, up))
    rows = np.stack([x, np.cross(z, x), z])
    if abs(np.linalg.det(rows) - 1) > 1e-9:
        raise InputError("axes", f"up {up!r} and forward {forward!r}", "two different axes of the file")
    return rows


def _mesh(vertices: Floats, raw: RawMesh, entry: StructureEntry) -> Clean:
    vertices, triangles, _, repairs = clean(vertices, raw.triangles)
    words = list(repairs)
    ground = entry.surroundings.ground_z_m
    if entry.clip_ground and ground is not None and len(triangles) and vertices[:, 2].min() < ground:
        before = _area(vertices, triangles)
        vertices, triangles, _ = clip_below(vertices, triangles, ground)
        words.append(f"{before - _area(vertices, triangles):.0f} m² below the ground cut off")
    _check_left(triangles, entry)
    topology = topology_of(triangles)
    inverted, hidden, outside_area_m2 = look(vertices, triangles, topology, ground)
    triangles = np.where(inverted[:, None], triangles[:, ::-1], triangles)
    if inverted.any():
        words.append(f"{inverted.sum()} triangles turned that showed outside their back")
    outliers = tuple(find_outliers(vertices, triangles, topology))
    drop: Bools = hidden & entry.drop_hidden
    verdicts = []
    if hidden.any() and not entry.drop_hidden:
        verdicts.append(measured("hidden", hidden.sum(), len(triangles)))
    for outlier in outliers:
        drop[outlier.triangles] |= entry.drop_outliers
        if not entry.drop_outliers:
            verdicts.append(measured("outlier", outlier))
    if drop.any():
        words.append(f"{drop.sum()} triangles of hidden parts and outliers dropped")
        vertices, triangles = compact(vertices, triangles[~drop])
        _check_left(triangles, entry)
    if looks_scanned(Structure(entry.structure_id, entry.kind, vertices, triangles, surface=entry.surface)):
        verdicts.append(measured("looks-scanned"))
    final = topology_of(triangles) if drop.any() else topology
    verdicts += cut_off(vertices, final.rim)
    findings = Findings(
        parts=int(final.component.max()) + 1,
        hidden_parts=len(np.unique(topology.component[hidden])),
        area_m2=_area(vertices, triangles),
        outside_area_m2=outside_area_m2,
        topology=final,
        outliers=outliers,
        repairs=tuple(words),
        verdicts=tuple(verdicts),
    )
    return vertices, triangles, None, findings


def _cloud(vertices: Floats, raw: RawMesh, entry: StructureEntry) -> Clean:
    finite = np.isfinite(vertices).all(axis=1)
    places, first = np.unique(vertices[finite], axis=0, return_index=True)
    centred = places - places.sum(axis=0) / max(len(places), 1)
    rounding = 1e-9 * np.abs(places).max(initial=0)
    if len(places) < 4 or np.linalg.matrix_rank(centred, rounding) < 2:
        rule, remedy = "a mesh, or at least four points that do not lie on a line", "export the surface again"
        raise InputError(str(entry.path), f"holds no triangles and {len(places)} points", rule, remedy)
    distinct = np.flatnonzero(finite)[np.sort(first)]
    points = vertices[distinct]
    turned = None if raw.normals is None else raw.normals[distinct] @ turn(entry.up, entry.forward).T
    normals, word = outward_normals(points, turned)
    dropped = counted((len(vertices) - len(points), "points dropped that stood twice or nowhere"))
    words = filter(None, [word, "a point cloud: sizes and sight lines are as dense as its points"])
    return points, NO_TRIANGLES, normals, Findings(repairs=(*dropped, *words))


def _check_left(triangles: Ints, entry: StructureEntry) -> None:
    if not len(triangles):
        raise InputError(str(entry.path), "holds no triangle that has an area", "a mesh", "export it again")


def _area(vertices: Floats, triangles: Ints) -> float:
    return float(np.linalg.norm(area_vectors(vertices[triangles]), axis=1).sum() / 2)


def _sha256(file: str, entry: StructureEntry) -> str:
    """Of the bytes of the file and of all that the manifest says and a plan may depend on."""
    area, placement = entry.surroundings, entry.placement
    walls = area.keep_out_m, area.geofence_m
    declared: dict[str, object] = {
        "file": file,
        "id": entry.structure_id,
        "kind": entry.kind,
        "geometry": [entry.unit_m, entry.up, entry.forward, entry.scale, *map(float, entry.local_origin)],
        "repair": [entry.drop_hidden, entry.drop_outliers, entry.clip_ground],
        "placement": None if placement is None else astuple(placement),
        "surroundings": [area.ground_z_m, *(each.tolist() for each in walls), area.ceiling_z_m],
        "landmarks": {name: list(xyz) for name, xyz in entry.landmarks.items()},
        "symmetric": entry.symmetric,
    }
    stated = {"surface": entry.surface, "surface_error_m": entry.surface_error_m}
    stated["rally"] = area.rally_m.tolist() or None
    declared |= {key: value for key, value in stated.items() if value is not None}  # else as before
    return digest(declared)
