"""Records to rows and back; what comes back equals what went in."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.schema.steps import pose_arrays, poses_sha256, step_table, zoom_of
from upplied.catalog.schema.tables import TABLES, Table
from upplied.geometry.polylines import leg_lengths
from upplied.records import Camera, Demonstration, Lens, Placement, Structure, Surroundings

Row = dict[str, Any]

#: Figures of a passport that are columns of their own.
PASSPORT = (
    "lowest_m", "inside_pct", "axis_pct", "shown_pct", "fit_pct", "speed_p99_mps", "recorded_pct",
    "longest_gap_s", "hover_s",
)  # fmt: skip
_PLACES = {"keep_out_m": (-1, 2, 3), "geofence_m": (-1, 2), "rally_m": (-1, 3)}  # of surroundings: shapes
_OPTICS = ("exposure_s", "trigger_s", "focus_m", "focal_mm", "f_number")  # null where they are not known
_JSON = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
json_text = _JSON.encode  # the one JSON text of a value
#: Of a row: when and by which commit it was added.
ADDED = ("version", "added_at", "commit_id", "commit_version", "row_sha256")


def same_named(record: Any, table: str) -> list[str]:
    """The fields of a record, or of a class of them, that are columns of a table under the same names."""
    return [field.name for field in fields(record) if field.name in TABLES[table].names]


def structure_row(structure: Structure, mesh_sha256: str) -> Row:
    """The row of `structures`, without the moment and commit that add it."""
    size = np.ptp(structure.vertices, axis=0)
    around = structure.surroundings
    verdicts = json.loads(structure.verdicts_json or "[]")
    surroundings: Row = {"ground_z_m": around.ground_z_m, "ceiling_z_m": around.ceiling_z_m}
    for name in ("keep_out_m", "geofence_m", *(["rally_m"] if len(around.rally_m) else [])):
        surroundings[name] = np.asarray(getattr(around, name), float).tolist()
    return {
        **{name: getattr(structure, name) for name in same_named(structure, "structures")},
        "mesh_sha256": mesh_sha256,
        "n_vertices": len(structure.vertices),
        "n_triangles": len(structure.triangles),
        **dict(zip(("size_x_m", "size_y_m", "size_z_m"), size, strict=True)),
        "diagonal_m": structure.diagonal_m,
        **({"datum": ""} if structure.placement is None else asdict(structure.placement)),
        "surroundings_json": json_text(surroundings),
        "landmarks_json": json_text({name: list(map(float, at)) for name, at in structure.landmarks.items()}),
        "surface": structure.surface or "",
        "findings": "; ".join(map(_finding, verdicts)),
        "overruled": _overruled(verdicts),
        "retired": False,
    }


def _finding(verdict: Row) -> str:
    return f"{verdict['rule']}: {verdict['found']}" + " (overruled)" * verdict["overruled"]


def _overruled(verdicts: Iterable[Row]) -> str:
    return " ".join(sorted({verdict["rule"] for verdict in verdicts if verdict["overruled"]}))


def structure_of(row: Row, mesh: Structure) -> Structure:
    """The structure of a row and its stored mesh (whose other fields are ignored)."""
    around = json.loads(row["surroundings_json"] or "{}")
    around |= {name: np.array(around.get(name, []), float).reshape(at) for name, at in _PLACES.items()}
    placed = row["lat_deg"] is not None
    values: Row = {name: row[name] for name in same_named(Structure, "structures")}
    values |= {
        "placement": Placement(**{f.name: row[f.name] for f in fields(Placement)}) if placed else None,
        "surroundings": Surroundings(**{f.name: around.get(f.name) for f in fields(Surroundings)}),
        "landmarks": {name: tuple(at) for name, at in json.loads(row["landmarks_json"] or "{}").items()},
        "surface": row["surface"] or None,
    }
    return Structure(vertices=mesh.vertices, triangles=mesh.triangles, normals=mesh.normals, **values)


def demonstration_row(demonstration: Demonstration) -> Row:
    """The row of `demonstrations`, without the moment and commit that add it."""
    steps, lens = leg_lengths(demonstration.positions), demonstration.camera.lens
    steps[demonstration.breaks - 1] = 0.0
    poses = demonstration.t_ns, demonstration.positions, demonstration.quat_xyzw
    return {
        **{name: getattr(demonstration, name) for name in same_named(demonstration, "demonstrations")},
        "poses_sha256": poses_sha256(*poses, fov_deg=demonstration.fov_deg),
        "n_poses": len(demonstration),
        "duration_s": float(demonstration.t_ns[-1] - demonstration.t_ns[0]) * 1e-9,
        "path_length_m": float(steps.sum()),
        **asdict(demonstration.camera),
        **{name: None for name in _OPTICS if not getattr(demonstration.camera, name)},
        "lens_json": "" if lens is None else json_text(asdict(lens)),
        "stills": demonstration.stills or None,
        "breaks_json": json_text(demonstration.breaks.tolist()),
        "dropped_json": json_text(dict(demonstration.dropped)),
        **_passport_columns(demonstration.passport),
        "retired": False,
    }


def _passport_columns(passport: Mapping[str, Any]) -> Row:
    if not passport:
        return {"verdict": "", "passport_json": ""}
    measured = passport["measured"]
    return {
        "verdict": passport["verdict"],
        "findings": "; ".join(map(_finding, passport["findings"])),
        "overruled": _overruled(passport["findings"]),
        **{name: measured[name] for name in PASSPORT},
        "flown_clearance_m": measured["min_clearance_m"],
        "passport_json": json_text(passport),
    }


def pose_table(*flown: Demonstration) -> pa.Table:
    """The rows of `poses` of demonstrations, without their commit."""
    t_ns = [np.asarray(one.t_ns, np.int64) for one in flown]
    return step_table(TABLES["poses"], [(one.demonstration_id, one) for one in flown], {"t_ns": t_ns})


def demonstration_of(row: Row, poses: pa.Table) -> Demonstration:
    """The demonstration of a row and its poses in order."""
    positions, quats = pose_arrays(poses)
    values: Row = {name: row[name] for name in same_named(Demonstration, "demonstrations")}
    values |= {
        "camera": camera_of(row),
        "stills": bool(row["stills"]),
        "breaks": np.array(json.loads(row["breaks_json"] or "[]"), np.int64),
        "dropped": json.loads(row["dropped_json"] or "{}"),
        "about": row["about"] or "",
        "passport": json.loads(row["passport_json"] or "{}"),
    }
    t_ns = np.array(poses["t_ns"])
    return Demonstration(t_ns=t_ns, positions=positions, quat_xyzw=quats, fov_deg=zoom_of(poses), **values)


def camera_of(row: Row) -> Camera:
    """The camera of a row of `demonstrations`, null or NaN where something is not known."""
    known = {item.name: row.get(item.name) for item in fields(Camera)}
    if isinstance(text := row["lens_json"], str) and text:
        lens = json.loads(text)
        known["lens"] = Lens(lens["model"], tuple(lens["coefficients"]), tuple(lens["middle"]))
    return Camera(**{name: value for name, value in known.items() if value is not None and value == value})


def table_of(table: Table, rows: list[Row]) -> pa.Table:
    """Rows as an Arrow table in the declared schema; NaN and absent numbers are null, texts empty."""
    columns = []
    for name, kind in zip(table.names, table.schema.types, strict=True):
        empty = "" if pa.types.is_string(kind) else None
        values = pa.array([row.get(name, empty) for row in rows], kind)
        columns.append(pc.if_else(pc.is_nan(values), None, values) if pa.types.is_floating(kind) else values)
    return pa.table(columns, schema=table.schema)


def says_same(table: Table, stored: Row, other: Row) -> bool:
    """Whether a row says the same as a stored one, apart from when and by which commit it was added."""
    left, right = (table_of(table, [row]).drop_columns(list(ADDED)) for row in (stored, other))
    return bool(left.equals(right))
