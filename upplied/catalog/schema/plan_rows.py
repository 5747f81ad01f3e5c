"""Plans to rows and back; what comes back equals what went in."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pyarrow as pa

from upplied.catalog.schema.rows import Row, json_text, same_named
from upplied.catalog.schema.steps import ORIGINS, added_of, pose_arrays, poses_sha256, step_table, zoom_of
from upplied.catalog.schema.tables import TABLES
from upplied.config import Settings, settings_for
from upplied.errors import CatalogError
from upplied.records import Bools, Counterpart, Measures, Plan, Registration, Trajectory

#: What may be said of how a plan came about; see `transfer_row`.
PROVENANCE = (
    "run_id", "planned_on", "code_version", "method_version", "sources_sha256", "libraries", "machine",
    "planned_at", "planning_s", "settings", "demonstration_sha256", "source_sha256", "target_sha256",
    "siblings", "purpose",
)  # fmt: skip
ID_DIGITS = 20  # of the key in `transfer_id`: 80 bits, still short enough to type

#: Texts of a plan that are in its row as they are.
_TEXTS = (
    "demonstration_id", "source_id", "target_id", "kind", "preset", "status", "reason", "counterpart_summary",
    "parts_told_by", "acceptance_evidence", "not_flyable", "photos_sha256",
)  # fmt: skip

#: What `imported_from` ends with: whether what a dataset says of a plan was measured here.
AS_IT_SAYS = "measures as it says"


def is_foreign(row: Mapping[str, Any]) -> bool:
    """Whether a plan was imported and never measured here: it settles nothing, and nobody flies it."""
    return str(row.get("imported_from") or "").endswith(AS_IT_SAYS)


def transfer_id(key: str) -> str:
    """The name of the plan with this key."""
    return key[:ID_DIGITS]


def transfer_row(key: str, plan: Plan, provenance: Mapping[str, Any]) -> Row:
    """The row of `transfers`, without the commit that adds it.

    `key` is the hash of all that the plan depends on. The provenance has any of `PROVENANCE`: `settings`
    (else those of the preset), `planned_at` (else now), `siblings` by id and hash; others are refused.
    """
    unknown = sorted(set(provenance) - set(PROVENANCE))
    if unknown:
        known = f"any of {', '.join(PROVENANCE)}"
        raise CatalogError(f"provenance of {key}", f"has {', '.join(unknown)}", known)
    about = dict(provenance)
    settings: Settings = about.pop("settings", None) or settings_for(plan.preset)
    siblings, gsd_m = [list(one) for one in about.pop("siblings", ())], settings.transfer.gsd_m
    registration, path = plan.registration, plan.trajectory
    icp, fit, waypoints_sha256 = dict[str, Any](), "", ""
    if path is not None:
        poses = path.t_s, path.positions, path.quat_xyzw, _viewpoint_flags(plan, path)
        waypoints_sha256 = poses_sha256(*poses, path.fov_deg, plan.added)
    if registration is not None:
        fit = json_text({name: _json_value(value) for name, value in _values(registration).items()})
        icp = {name: getattr(registration, name) for name in ("acceptance", "runner_up_gap")}
        icp["icp_score_m2"] = registration.score_m2
    return {
        "planned_at": datetime.now(UTC),
        **about,
        "transfer_id": transfer_id(key),
        "key": key,
        **{name: getattr(plan, name) for name in same_named(Plan, "transfers")},
        **_values(plan.measures),
        "standoff_mode": settings.transfer.standoff if gsd_m is None else f"gsd {1e3 * gsd_m:g} mm",
        "n_viewpoints": plan.n_viewpoints,
        "n_waypoints": 0 if path is None else len(path),
        **icp,
        "counterparts": json_text([asdict(one) for one in plan.counterparts]),
        "siblings": json_text(siblings) if siblings else "",
        "warnings": json_text(list(plan.warnings)),
        "settings_sha256": settings.sha256,
        "settings_json": settings.text,
        "registration_json": fit,
        "waypoints_sha256": waypoints_sha256,
    }


def waypoint_table(plans: Mapping[str, Plan]) -> pa.Table:
    """The rows of `waypoints` of plans by their ids, those that have a trajectory, without their commit."""
    paths, origins = [], np.array(ORIGINS, object)
    columns = dict[str, list[Any]]((name, []) for name in ("t_s", "is_viewpoint", "origin"))
    for name, plan in plans.items():
        if (path := plan.trajectory) is not None:
            paths.append((name, path))
            columns["t_s"].append(np.asarray(path.t_s, float))
            columns["is_viewpoint"].append(_viewpoint_flags(plan, path))
            added = np.full(len(path), None) if plan.added is None else origins[plan.added.astype(int)]
            columns["origin"].append(added)
    return step_table(TABLES["waypoints"], paths, columns)


def plan_of(row: Row, waypoints: pa.Table) -> Plan:
    """The plan of a row and its waypoints in order, without the states of the surface."""
    planned, texts = row["n_waypoints"] > 0, Row((name, row[name] or "") for name in _TEXTS)
    counterparts = json.loads(row["counterparts"] or "[]")  # null in rows of before there was such a column
    fit = fields_in(Registration, json.loads(row["registration_json"] or "{}"))
    fit = {name: np.array(it, float) if isinstance(it, list) else _number(it) for name, it in fit.items()}
    return Plan(
        **texts,
        trajectory=trajectory_of(waypoints) if planned else None,
        is_viewpoint=np.array(waypoints["is_viewpoint"]) if planned else None,
        added=added_of(waypoints) if planned else None,
        registration=Registration(**fit) if fit else None,
        measures=Measures(**{item.name: _number(row[item.name]) for item in fields(Measures)}),
        counterparts=tuple(Counterpart(**fields_in(Counterpart, tuples(one))) for one in counterparts),
        warnings=tuple(json.loads(row["warnings"] or "[]")),
        flyable=bool(row["flyable"]),
    )


def tuples(value: Any) -> Any:
    """A value of JSON with tuples for its lists."""
    if isinstance(value, dict):
        return {name: tuples(item) for name, item in value.items()}
    return tuple(map(tuples, value)) if isinstance(value, list) else value


def trajectory_of(waypoints: pa.Table) -> Trajectory:
    """The timed camera poses of rows of `waypoints` in order."""
    return Trajectory(np.array(waypoints["t_s"]), *pose_arrays(waypoints), zoom_of(waypoints))


def _values(record: Any) -> dict[str, Any]:
    """The fields of a record, without the deep copies of `asdict`."""
    return {name: getattr(record, name) for name in record.__dataclass_fields__}


def _viewpoint_flags(plan: Plan, path: Trajectory) -> Bools:
    return np.asarray(np.zeros(len(path), bool) if plan.is_viewpoint is None else plan.is_viewpoint, bool)


def _json_value(value: Any) -> Any:
    """Arrays as lists; not-a-number as null, since JSON has no word for it."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _number(value: Any) -> Any:
    return float("nan") if value is None else value


def fields_in(record: type, values: Row) -> Row:
    """The values that are fields of a record: a newer program may know more."""
    return {item.name: values[item.name] for item in fields(record) if item.name in values}
