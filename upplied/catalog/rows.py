"""Records to rows and back; what comes back equals what went in."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pyarrow as pa

from upplied.catalog.tables import POSES, TABLES, WAYPOINTS, Table
from upplied.config import Settings, settings_for
from upplied.errors import CatalogError
from upplied.records import (
    Bools,
    Camera,
    Demonstration,
    Floats,
    Ints,
    Measures,
    Placement,
    Plan,
    Registration,
    Structure,
    Surroundings,
    Trajectory,
)

Row = dict[str, Any]

#: What may be said of how a plan came about; see `transfer_row`.
PROVENANCE = (
    "run_id",
    "code_version",
    "method_version",
    "planned_at",
    "planning_s",
    "settings",
    "demonstration_sha256",
    "source_sha256",
    "target_sha256",
)

_ID_DIGITS = 20  # of the key in `transfer_id`: 80 bits, still short enough to type
_POSITION = ("x_m", "y_m", "z_m")
_QUATERNION = ("qx", "qy", "qz", "qw")


def transfer_id(key: str) -> str:
    """The name of the plan with this key."""
    return key[:_ID_DIGITS]


# --- structures --------------------------------------------------------------------------------


def structure_row(structure: Structure, mesh_sha256: str) -> Row:
    """The row of `structures`, without the moment and commit that add it."""
    size = np.ptp(structure.vertices, axis=0)
    placement = structure.placement
    around = structure.surroundings
    return {
        "structure_id": structure.structure_id,
        "kind": structure.kind,
        "site": structure.site,
        "notes": structure.notes,
        "sha256": structure.sha256,
        "mesh_sha256": mesh_sha256,
        "n_vertices": len(structure.vertices),
        "n_triangles": len(structure.triangles),
        "size_x_m": size[0],
        "size_y_m": size[1],
        "size_z_m": size[2],
        "diagonal_m": structure.diagonal_m,
        **({} if placement is None else asdict(placement)),
        "datum": "" if placement is None else placement.datum,
        "surroundings_json": _json(
            {
                "ground_z_m": around.ground_z_m,
                "keep_out_m": np.asarray(around.keep_out_m, float).tolist(),
                "geofence_m": np.asarray(around.geofence_m, float).tolist(),
                "ceiling_z_m": around.ceiling_z_m,
            }
        ),
        "landmarks_json": _json({name: list(map(float, at)) for name, at in structure.landmarks.items()}),
        "symmetric": structure.symmetric,
        "retired": False,
    }


def structure_of(row: Row, mesh: Structure) -> Structure:
    """The structure of a row and its stored mesh (whose other fields are ignored)."""
    around = json.loads(row["surroundings_json"] or "{}")
    placed = row["lat_deg"] is not None
    return Structure(
        structure_id=row["structure_id"],
        kind=row["kind"],
        vertices=mesh.vertices,
        triangles=mesh.triangles,
        normals=mesh.normals,
        site=row["site"],
        sha256=row["sha256"],
        placement=Placement(**{f.name: row[f.name] for f in fields(Placement)}) if placed else None,
        surroundings=Surroundings(
            ground_z_m=around.get("ground_z_m"),
            keep_out_m=np.array(around.get("keep_out_m", []), float).reshape(-1, 2, 3),
            geofence_m=np.array(around.get("geofence_m", []), float).reshape(-1, 2),
            ceiling_z_m=around.get("ceiling_z_m"),
        ),
        landmarks={name: (x, y, z) for name, (x, y, z) in json.loads(row["landmarks_json"] or "{}").items()},
        symmetric=row["symmetric"],
        notes=row["notes"],
    )


# --- demonstrations ----------------------------------------------------------------------------


def demonstration_row(demonstration: Demonstration) -> Row:
    """The row of `demonstrations`, without the moment and commit that add it."""
    steps = np.linalg.norm(np.diff(demonstration.positions, axis=0), axis=1)
    steps[demonstration.breaks - 1] = 0.0
    return {
        "demonstration_id": demonstration.demonstration_id,
        "structure_id": demonstration.structure_id,
        "operator": demonstration.operator,
        "site": demonstration.site,
        "notes": demonstration.notes,
        "sha256": demonstration.sha256,
        "poses_sha256": poses_sha256(demonstration.t_ns, demonstration.positions, demonstration.quat_xyzw),
        "n_poses": len(demonstration),
        "duration_s": float(demonstration.t_ns[-1] - demonstration.t_ns[0]) * 1e-9,
        "path_length_m": float(steps.sum()),
        **asdict(demonstration.camera),
        "clock": demonstration.clock,
        "topic": demonstration.topic,
        "breaks_json": _json(demonstration.breaks.tolist()),
        "dropped_json": _json(dict(demonstration.dropped)),
        "degraded": demonstration.degraded,
        "retired": False,
    }


def pose_table(demonstration: Demonstration, commit_id: str) -> pa.Table:
    """The rows of `poses` of one demonstration."""
    columns = {
        "demonstration_id": demonstration.demonstration_id,
        "commit_id": commit_id,
        "t_ns": np.asarray(demonstration.t_ns, np.int64),
    }
    return _steps(POSES, columns, demonstration.positions, demonstration.quat_xyzw)


def demonstration_of(row: Row, poses: pa.Table) -> Demonstration:
    """The demonstration of a row and its poses in order."""
    positions, quats = _pose_arrays(poses)
    return Demonstration(
        demonstration_id=row["demonstration_id"],
        structure_id=row["structure_id"],
        t_ns=poses["t_ns"].to_numpy(),
        positions=positions,
        quat_xyzw=quats,
        camera=Camera(**{item.name: row[item.name] for item in fields(Camera)}),
        operator=row["operator"],
        site=row["site"],
        sha256=row["sha256"],
        breaks=np.array(json.loads(row["breaks_json"] or "[]"), np.int64),
        degraded=row["degraded"],
        dropped=json.loads(row["dropped_json"] or "{}"),
        clock=row["clock"],
        topic=row["topic"],
        notes=row["notes"],
    )


# --- plans -------------------------------------------------------------------------------------


def transfer_row(key: str, plan: Plan, provenance: Mapping[str, Any]) -> Row:
    """The row of `transfers`, without the commit that adds it.

    Parameters
    ----------
    key : str
        Hash of everything the plan depends on.
    plan : Plan
    provenance : mapping
        Any of `PROVENANCE`. `settings` is the `Settings` used (those of the preset where it is not
        said), `planned_at` an aware datetime (now where it is not said).

    Raises
    ------
    CatalogError
        If the provenance has a name that is not kept.
    """
    unknown = sorted(set(provenance) - set(PROVENANCE))
    if unknown:
        raise CatalogError(
            f"provenance of {key}", f"has {', '.join(unknown)}", f"any of {', '.join(PROVENANCE)}"
        )
    said = dict(provenance)
    settings: Settings = said.pop("settings", None) or settings_for(plan.preset)
    registration = plan.registration
    path = plan.trajectory
    return {
        "planned_at": datetime.now(UTC),
        **said,
        "transfer_id": transfer_id(key),
        "key": key,
        **{
            name: getattr(plan, name)
            for name in (
                "demonstration_id",
                "source_id",
                "target_id",
                "kind",
                "preset",
                "status",
                "reason",
                "counterpart_summary",
            )
        },
        **asdict(plan.measures),
        "n_viewpoints": plan.n_viewpoints,
        "n_waypoints": 0 if path is None else len(path),
        **(
            {}
            if registration is None
            else {
                "icp_score_m2": registration.score_m2,
                "acceptance": registration.acceptance,
                "runner_up_gap": registration.runner_up_gap,
            }
        ),
        "warnings": _json(list(plan.warnings)),
        "settings_sha256": settings.sha256,
        "settings_json": _json(asdict(settings)),
        "registration_json": "" if registration is None else _registration_json(registration),
        "waypoints_sha256": "" if path is None else _plan_sha256(plan),
    }


def waypoint_table(name: str, plan: Plan, commit_id: str) -> pa.Table:
    """The rows of `waypoints` of one plan that has a trajectory."""
    assert plan.trajectory is not None
    path = plan.trajectory
    columns = {
        "transfer_id": name,
        "commit_id": commit_id,
        "t_s": np.asarray(path.t_s, float),
        "is_viewpoint": _viewpoint_flags(plan),
    }
    return _steps(WAYPOINTS, columns, path.positions, path.quat_xyzw)


def plan_of(row: Row, waypoints: pa.Table) -> Plan:
    """The plan of a row and its waypoints in order, without the states of the surface."""
    planned = row["n_waypoints"] > 0
    nan = float("nan")
    measures = {item.name: row[item.name] for item in fields(Measures)}
    return Plan(
        **{name: row[name] for name in ("demonstration_id", "source_id", "target_id", "kind", "preset")},
        status=row["status"],
        reason=row["reason"],
        trajectory=trajectory_of(waypoints) if planned else None,
        is_viewpoint=waypoints["is_viewpoint"].to_numpy(zero_copy_only=False) if planned else None,
        registration=_registration_of(row["registration_json"]),
        measures=Measures(**{name: nan if value is None else value for name, value in measures.items()}),
        counterpart_summary=row["counterpart_summary"],
        warnings=tuple(json.loads(row["warnings"] or "[]")),
    )


def trajectory_of(waypoints: pa.Table) -> Trajectory:
    """The timed camera poses of rows of `waypoints` in order."""
    return Trajectory(waypoints["t_s"].to_numpy(), *_pose_arrays(waypoints))


def _plan_sha256(plan: Plan) -> str:
    assert plan.trajectory is not None
    path = plan.trajectory
    return poses_sha256(path.t_s, path.positions, path.quat_xyzw, _viewpoint_flags(plan))


def _viewpoint_flags(plan: Plan) -> Bools:
    assert plan.trajectory is not None
    if plan.is_viewpoint is None:
        return np.zeros(len(plan.trajectory), bool)
    return np.asarray(plan.is_viewpoint, bool)


def _registration_json(registration: Registration) -> str:
    plain = {
        item.name: value.tolist()
        if isinstance(value := getattr(registration, item.name), np.ndarray)
        else value
        for item in fields(registration)
    }
    return _json(plain)


def _registration_of(text: str) -> Registration | None:
    if not text:
        return None
    plain = json.loads(text)
    arrays = {name: np.array(plain[name], float) for name in ("scale", "rotation", "translation")}
    return Registration(**{**plain, **arrays})


# --- all of them -------------------------------------------------------------------------------


def table_of(table: Table, rows: list[Row]) -> pa.Table:
    """Rows as an Arrow table in the declared schema; NaN and absent numbers are null, texts empty."""
    columns = []
    for column in table.columns:
        empty = "" if pa.types.is_string(column.type) else None
        values = [row.get(column.name, empty) for row in rows]
        if pa.types.is_floating(column.type):
            values = [None if value is None or np.isnan(value) else float(value) for value in values]
        columns.append(pa.array(values, column.type))
    return pa.table(columns, schema=table.schema)


def rows_of(table: pa.Table) -> list[Row]:
    """An Arrow table as rows."""
    rows: list[Row] = table.to_pylist()
    return rows


def poses_sha256(t: Floats | Ints, positions: Floats, quat_xyzw: Floats, flags: Bools | None = None) -> str:
    """Hash of poses as they are stored, the same on every machine."""
    hashed = hashlib.sha256()
    parts: list[Any] = [t, np.asarray(positions, float), _stored_quats(quat_xyzw)]
    for part in parts + ([] if flags is None else [flags]):
        values = np.ascontiguousarray(part)
        hashed.update(values.astype(values.dtype.newbyteorder("<"), copy=False).tobytes())
    return hashed.hexdigest()


def same(stored: Row, given: Row) -> bool:
    """Whether a row says the same as a stored one, apart from when and by which commit it was added."""
    name = next(table for table in TABLES.values() if table.names[0] in given and "retired" in table.names)
    left, right = (table_of(name, [row]).drop_columns(list(_ADDED)) for row in (stored, given))
    return bool(left.equals(right))


_ADDED = ("version", "added_at", "commit_id")


def _steps(table: Table, columns: dict[str, Any], positions: Floats, quat_xyzw: Floats) -> pa.Table:
    count = len(positions)
    quats = _stored_quats(quat_xyzw)
    columns = {
        **columns,
        "seq": np.arange(count),
        **dict(zip(_POSITION, np.asarray(positions, float).T, strict=True)),
        **dict(zip(_QUATERNION, quats.T, strict=True)),
    }
    arrays = [
        pa.repeat(values, count) if isinstance(values, str) else pa.array(np.ascontiguousarray(values))
        for values in (columns[name] for name in table.names)
    ]
    return pa.table(arrays, schema=table.schema)


def _stored_quats(quat_xyzw: Floats) -> Floats:
    """The same orientations with w >= 0; no other digit changes."""
    quats = np.asarray(quat_xyzw, float)
    return np.where(quats[:, 3:] < 0, -quats, quats) + 0.0  # and no negative zeros


def _pose_arrays(steps: pa.Table) -> tuple[Floats, Floats]:
    return (
        np.column_stack([steps[name].to_numpy() for name in _POSITION]),
        np.column_stack([steps[name].to_numpy() for name in _QUATERNION]),
    )


def _json(value: Any) -> str:
    return json.dumps(value, sort_keys=isinstance(value, Mapping), separators=(",", ":"), ensure_ascii=False)
