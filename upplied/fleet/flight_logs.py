"""Logs of flights into the catalog: each laid on its plan, what it truly saw, and how it differs."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from upplied.catalog import Catalog, open_catalog
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs.looks import put_looks
from upplied.config import CloudSettings, digest
from upplied.errors import InputError, UppliedError
from upplied.fleet.ingest import find_logs
from upplied.fleet.plan_of_flight import Laid, plan_of_flight
from upplied.fleet.workers import JobKilled, Limits, Workers
from upplied.fleet.zone_gaps import zones_left_out
from upplied.inputs.flight.clock import STEPPED
from upplied.inputs.photos import photo_times
from upplied.inputs.sidecar import LogOptions
from upplied.planning.surface.samples import surface_samples
from upplied.polylines import leg_lengths
from upplied.proof.align import Alignment
from upplied.proof.as_flown import AsFlown, as_flown, looks_of
from upplied.records import Bools, Camera, Cloud, Demonstration, Ints, Plan, Structure, Trajectory
from upplied.scene import scene_of
from upplied.supposed_scene import scene_for

_SHOWN = 1  # of SURFACE_STATES


@dataclass(frozen=True)
class Judged:
    """A flight as it was found to be: its row, its path on the plan, and what it saw."""

    row: Row
    path: Trajectory
    surface: Cloud
    flown: AsFlown


def add_flight_log(
    catalog: Catalog,
    log: str | Path,
    transfer_id: str = "",
    photos: str | Path | None = None,
    options: LogOptions | None = None,
    limits: Limits | None = None,
    accuracy_m: float | None = None,
) -> Row:
    """Read the log of a flight, lay it on its plan and keep what came of it; a known log adds nothing.

    Parameters
    ----------
    catalog : Catalog
    log : path
        Of any family of logs that demonstrations are read from.
    transfer_id : str
        The plan that was flown; empty: the one of the structure that the log lies on best, among those
        in force, or the newest where none is.
    photos : path, optional
        Times of the photos, one a line, ns of the log's clock; a CSV with a column `t_ns` will do. Without
        it the camera is taken to see all the time.
    options : LogOptions, optional
        What a side-car may say.
    limits : Limits, optional
        Time and memory of reading it: a file that crashes a reader costs itself alone.
    accuracy_m : float, optional
        Of the logged positions, m, as of RTK: the log is corrected by no more.

    Returns
    -------
    dict
        The row of `flights`.

    Raises
    ------
    InputError
        If the log or the photos cannot be read, or are of another structure.
    RefusedError
        If the log lies on no plan.
    """
    if accuracy_m is not None and not 0 <= accuracy_m < np.inf:
        raise InputError("accuracy", f"is {accuracy_m:g} m", "0 m or more")
    with Workers(1, limits=limits or Limits()) as workers:
        try:
            place = catalog.location
            judged: Judged = workers.run(judge_log, place, str(log), transfer_id, photos, options, accuracy_m)
        except JobKilled as death:
            raise InputError(str(log), str(death)) from None
    return keep(catalog, judged)


def keep(catalog: Catalog, judged: Judged) -> Row:
    """Add a judged flight to the catalog, unless it is there; its row."""
    row, looks = judged.row, judged.flown.looks
    same = catalog.flights(row["transfer_id"])
    if row["flight_id"] in set(same["flight_id"]):
        return {str(k): v for k, v in same[same["flight_id"] == row["flight_id"]].iloc[-1].items()}
    stored = put_looks(
        catalog,
        judged.surface.points,
        judged.surface.normals,
        looks.seen,
        looks.values,
        looks.pictures,
        looks.assumed,
    )
    row = {**row, "looks_sha256": stored}
    catalog.add_flight(row, judged.path)
    return row


def judge_log(
    location: str,
    log: str,
    transfer_id: str,
    photos: str | Path | None,
    options: LogOptions | None,
    accuracy_m: float | None = None,
) -> Judged:
    """In a worker: a log read, laid on its plan and judged."""
    catalog = open_catalog(location)
    laid = plan_of_flight(catalog, log, transfer_id, options or LogOptions(), accuracy_m)
    photo_ns = None if photos is None else photo_times(photos)
    if photo_ns is not None and STEPPED in laid.flown.notes:
        found = "cannot be placed: the clock of the log stepped in flight"
        raise InputError(str(photos), found, "one clock for log and photos", "leave the photos out")
    return _judged(catalog, laid, photo_ns, accuracy_m)


def _judged(catalog: Catalog, laid: Laid, photo_ns: Ints | None, accuracy_m: float | None) -> Judged:
    row, flown, found = laid.row, laid.flown, laid.on
    target = catalog.structure(row["target_id"])
    plan = catalog.plan(row["transfer_id"])
    camera = flown.camera
    if vars(camera) == vars(Camera()):  # the log does not say: the demonstration's
        camera = catalog.demonstration(row["demonstration_id"]).camera
    photo_s = None if photo_ns is None else np.asarray((photo_ns - flown.t_ns[0]) * 1e-9, np.float64)
    surface, required = required_of(catalog, row, plan, target, camera)
    assert plan.trajectory is not None
    moments = plan.trajectory.t_s[viewpoint_index(plan)]
    # Where it flew, and what it saw, nothing stood that is only supposed: what was scanned counts.
    said = as_flown(
        plan.trajectory, moments, found, flown.trajectory, surface, camera, scene_of(target), photo_s
    )
    parts = ["flown", row["transfer_id"], row["waypoints_sha256"], flown.sha256]
    parts.append("" if photo_ns is None else hashlib.sha256(photo_ns.tobytes()).hexdigest())
    parts += [] if accuracy_m is None else [accuracy_m]
    made = {
        "flight_id": digest(parts),
        "kind": "flown",
        "flown_at": _moment(int(flown.t_ns[0])),
        "log_sha256": flown.sha256,
        "operator": flown.operator,
        "photos": None if photo_s is None else len(photo_s),
        **_wind(flown),
        **flight_columns(row, found, said, required),
    }
    return Judged(made, found.flown, surface, said)


def _wind(flown: Demonstration) -> Row:
    """What the log says of the wind; nothing where it says nothing."""
    if flown.wind is None:
        return {}
    said = flown.wind
    return {"wind_mps": said.mean_mps, "wind_most_mps": said.most_mps, "towards_deg": said.towards_deg}


def flight_columns(row: Row, found: Alignment, said: AsFlown, required: Bools) -> Row:
    """What every flight says of itself, by the columns of `flights`."""
    seen, assumed = said.looks.seen[required], said.looks.assumed
    steps = leg_lengths(found.flown.positions)
    return {
        **{name: row[name] for name in ("transfer_id", "demonstration_id", "target_id", "waypoints_sha256")},
        "photos_missing": said.photos_missing,
        "clock_s": found.clock_s,
        "clock_error_s": found.clock_error_s if np.isfinite(found.clock_error_s) else None,
        "shift_m": float(np.linalg.norm(found.shift_m)),
        "place_error_m": found.place_error_m if np.isfinite(found.place_error_m) else None,
        "turn_deg": found.heading_deg,
        "camera_yaw_deg": found.camera_yaw_deg,
        "camera_pitch_deg": found.camera_pitch_deg,
        "residual_p95_m": found.residual_p95_m,
        "cross_track_p95_m": said.cross_track_p95_m,
        "plan_frechet_m": said.frechet_m,
        "flown_pct": said.flown_pct,
        "required_pct": 100 * float(seen.mean()) if len(seen) else None,
        "assumed_pct": 0.0 if assumed is None or not len(seen) else 100 * float(assumed[required].mean()),
        "silent_s": said.silent_s,
        "findings": "; ".join(said.findings),
        "min_clearance_m": said.clearance_m,
        "path_length_m": float(steps.sum()),
        "duration_s": float(found.flown.t_s[-1] - found.flown.t_s[0]),
    }


def required_of(
    catalog: Catalog, row: Row, plan: Plan, target: Structure, camera: Camera
) -> tuple[Cloud, Bools]:
    """The samples of a target, and which of them (N,) its plan shows: what a flight of it must show."""
    kept = catalog.surface(row["transfer_id"])
    if kept is not None and kept.normals is not None:
        required = kept.state == _SHOWN
        if required.any():
            return Cloud(kept.points, kept.normals), required
    surface = surface_samples(target, scene_of(target), CloudSettings())
    assert plan.trajectory is not None
    return surface, looks_of(plan.trajectory, surface, camera, scene_for(target, plan.supposed)).seen


def viewpoint_index(plan: Plan) -> Ints:
    """Which poses of a plan are viewpoints."""
    return np.flatnonzero(plan.is_viewpoint) if plan.is_viewpoint is not None else np.empty(0, int)


def _moment(t_ns: int) -> datetime:
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=t_ns // 1000)


def add_flight_logs(
    catalog: Catalog, logs: Sequence[str | Path], limits: Limits | None = None
) -> list[dict[str, str]]:
    """Each log, or those of each folder, into the catalog, on the plan in force that it lies on best.

    Returns
    -------
    list of dict
        Of each log its name, status (added, unchanged, failed), reason and findings; `flight` is its id,
        `left_out` says in words how much of what its plan shows it did not, and which zones no flight showed
        as they ask; it is empty where it showed all.
    """
    known = set(catalog.flights(kind="flown")["flight_id"])
    done = []
    for log in find_logs(logs):
        said = {
            "name": log.name,
            "status": "failed",
            "reason": "",
            "findings": "",
            "flight": "",
            "left_out": "",
        }
        try:
            row = add_flight_log(catalog, log, limits=limits)
        except UppliedError as error:
            done.append({**said, "reason": str(error)})
            continue
        status = "unchanged" if row["flight_id"] in known else "added"
        left = 100 - (row["required_pct"] or 0.0)
        parts = [f"{left:.1f} % of what its plan shows" if left > 0 else ""]
        parts.append(zones_left_out(catalog, row) if status == "added" else "")
        said |= {"status": status, "flight": row["flight_id"], "findings": row["findings"]}
        done.append({**said, "left_out": ", ".join(filter(None, parts))})
    return done
