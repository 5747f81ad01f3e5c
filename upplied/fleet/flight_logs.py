"""Logs of flights into the catalog: each laid on its plan, what it truly saw, and how it differs."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from upplied.catalog import Catalog, open_catalog
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs.belonging import Zones
from upplied.catalog.verbs.recipes import settings_of
from upplied.config import CloudSettings, digest
from upplied.errors import InputError, UppliedError
from upplied.fleet.ingest import find_logs
from upplied.fleet.plan_of_flight import moment_of, plan_of_flight
from upplied.fleet.workers import JobKilled, Workers
from upplied.geometry.polylines import leg_lengths
from upplied.geometry.scene import Scene, scene_of
from upplied.geometry.supposed_scene import scene_for
from upplied.inputs.columns import photo_times
from upplied.inputs.flight.clean import STEPPED
from upplied.inputs.sidecar import LogOptions
from upplied.outputs.zones import flown_rows, looked
from upplied.planning.surface.samples import surface_samples
from upplied.proof.align import Alignment
from upplied.proof.as_flown import AsFlown, as_flown
from upplied.proof.looks import looks_of
from upplied.proof.required_zones import RequiredZones
from upplied.records import Bools, Camera, Cloud, Floats, Plan, Structure, Trajectory

_SHOWN = 1  # of SURFACE_STATES
#: Columns of `flights` by the names that an alignment, and a flight as flown, have for them.
_OF_ALIGNMENT = ("clock_s", "camera_yaw_deg", "camera_pitch_deg", "residual_p95_m")
_OF_FLIGHT = ("photos_missing", "cross_track_p95_m", "flown_pct", "silent_s")


@dataclass(frozen=True)
class Judged:
    row: Row
    path: Trajectory
    surface: Cloud
    flown: AsFlown


def add_flight_log(
    catalog: Catalog,
    log: str | Path,
    transfer_id: str = "",
    photos: str | Path | None = None,
    accuracy_m: float | None = None,
) -> Row:
    """Read the log of a flight, lay it on its plan and keep what came of it: its row of `flights`.

    A known log adds nothing; an `InputError` where log or photos cannot be read, or are of another structure;
    refused where the log lies on no plan.

    Parameters
    ----------
    transfer_id : str
        The plan that was flown; empty: the one of the structure that the log lies on best, among those
        in force, or the newest where none is.
    photos : path, optional
        Times of the photos, one a line, ns of the log's clock; a CSV with a column `t_ns` will do. Without
        it the camera is taken to see all the time.
    accuracy_m : float, optional
        Of the logged positions, m, as of RTK: the log is corrected by no more.
    """
    if accuracy_m is not None and not 0 <= accuracy_m < np.inf:
        raise InputError("accuracy", f"is {accuracy_m:g} m", "0 m or more")
    options = LogOptions() if accuracy_m is None else LogOptions(accuracy_m=accuracy_m)
    with Workers(1) as workers:  # a file that crashes a reader costs itself alone
        return _added(workers, catalog, log, transfer_id, photos, options)


def _added(workers: Workers, catalog: Catalog, log: str | Path, *options: Any) -> Row:
    try:
        judged: Judged = workers.run(judge_log, catalog.location, str(log), *options)
    except JobKilled as death:
        raise InputError(str(log), str(death)) from None
    return keep(catalog, judged)


def keep(catalog: Catalog, judged: Judged) -> Row:
    same = catalog.flights(judged.row["transfer_id"])
    same = same[same["flight_id"] == judged.row["flight_id"]]
    if len(same):
        return {str(name): value for name, value in same.iloc[-1].items()}
    row = {**judged.row, "looks_sha256": keep_looks(catalog, judged)}
    catalog.add_flight(row, judged.path)
    return row


def judge_log(
    location: str,
    log: str,
    transfer_id: str = "",
    photos: str | Path | None = None,
    options: LogOptions | None = None,
) -> Judged:
    """In a worker: a log read, laid on its plan and judged."""
    catalog = open_catalog(location)
    laid = plan_of_flight(catalog, log, transfer_id, options or LogOptions())
    photo_ns = None if photos is None else photo_times(photos)
    if photo_ns is not None and STEPPED in laid.flown.notes:
        fault = "cannot be placed: the clock of the log stepped in flight"
        raise InputError(str(photos), fault, "one clock for log and photos", "leave the photos out")
    row, flown = laid.row, laid.flown
    if photo_ns is None and flown.stills:  # a pose for each photo
        photo_ns = flown.t_ns
    photo_s = None if photo_ns is None else np.asarray((photo_ns - flown.t_ns[0]) * 1e-9, np.float64)
    # Where it flew, and what it saw, nothing stood that is only supposed: what was scanned counts.
    scene = scene_of(catalog.structure(row["target_id"]))
    judged = judged_on_plan(catalog, row, laid.on, flown.trajectory, scene, flown.camera, photo_s)
    photos_sha256 = "" if photo_ns is None else hashlib.sha256(photo_ns.tobytes()).hexdigest()
    made_of = [row["transfer_id"], row["waypoints_sha256"], flown.sha256, photos_sha256]
    wind = flown.wind
    own = {
        "flight_id": digest(["flown", *made_of]),
        "kind": "flown",
        "flown_at": moment_of(int(flown.t_ns[0])),
        "log_sha256": flown.sha256,
        "operator": flown.operator,
        "photos": None if photo_s is None else len(photo_s),
        "wind_mps": wind and wind.mean_mps,
        "wind_most_mps": wind and wind.most_mps,
        "towards_deg": wind and wind.towards_deg,
    }
    return replace(judged, row=own | judged.row)


def judged_on_plan(
    catalog: Catalog,
    row: Row,
    on: Alignment,
    logged: Trajectory,
    scene: Scene,
    camera: Camera | None = None,
    photo_s: Floats | None = None,
) -> Judged:
    """What every flight says of itself, by the columns of `flights`, the surface it was judged on, and how.

    The row is the plan's, `on` the flight on it; `photo_s` (F,), s, its photos from the first pose.
    """
    plan = catalog.plan(row["transfer_id"])
    planned_with = catalog.demonstration(row["demonstration_id"]).camera
    if camera is None or vars(camera) == vars(Camera()):
        camera = planned_with
    surface, required = required_of(catalog, row, plan, catalog.structure(row["target_id"]), camera)
    assert plan.trajectory is not None
    viewpoint_s = plan.trajectory.t_s[np.flatnonzero([] if plan.is_viewpoint is None else plan.is_viewpoint)]
    known = surface, camera, scene, photo_s, planned_with, settings_of(row["settings_json"]).inspection
    flown = as_flown(plan.trajectory, viewpoint_s, on, logged, *known)
    looks = flown.looks
    columns = {
        **{name: row[name] for name in ("transfer_id", "demonstration_id", "target_id", "waypoints_sha256")},
        **{name: getattr(on, name) for name in _OF_ALIGNMENT},
        **{name: getattr(flown, name) for name in _OF_FLIGHT},
        "clock_error_s": on.clock_error_s if np.isfinite(on.clock_error_s) else None,
        "shift_m": float(np.linalg.norm(on.shift_m)),
        "place_error_m": on.place_error_m if np.isfinite(on.place_error_m) else None,
        "turn_deg": on.heading_deg,
        "plan_frechet_m": flown.frechet_m,
        "inspected_pct": _share_pct(looks.inspected, required),
        "inspected_if_corrected_pct": _share_pct(looks.inspected_if_corrected, required),
        "required_pct": _share_pct(looks.seen, required),
        "assumed_pct": _share_pct(looks.assumed, required) or 0.0,
        "findings": "; ".join(flown.findings),
        "min_clearance_m": flown.clearance_m,
        "path_length_m": float(leg_lengths(on.flown.positions).sum()),
        "duration_s": float(on.flown.t_s[-1] - on.flown.t_s[0]),
    }
    return Judged(columns, on.flown, surface, flown)


def _share_pct(flags: Bools | None, required: Bools) -> float | None:
    return None if flags is None or not required.any() else 100 * float(flags[required].mean())


def keep_looks(catalog: Catalog, judged: Judged) -> str:
    """Store how a flight saw the samples of its surface; the hash of it."""
    surface, looks = judged.surface, judged.flown.looks
    seen = looks.seen, looks.values, looks.pictures, looks.assumed
    inspected = {name: getattr(looks, name) for name in ("inspected", "inspected_if_corrected")}
    return catalog.put_looks(surface.points, surface.normals, *seen, **inspected)


def required_of(
    catalog: Catalog, row: Row, plan: Plan, target: Structure, camera: Camera
) -> tuple[Cloud, Bools]:
    """The samples of a target, and which of them (N,) its plan shows: what a flight of it must show."""
    planned_surface = catalog.surface(row["transfer_id"])
    if planned_surface is not None and planned_surface.normals is not None:
        required = planned_surface.state == _SHOWN
        if required.any():
            return Cloud(planned_surface.points, planned_surface.normals), required
    surface = surface_samples(target, scene_of(target), CloudSettings())
    assert plan.trajectory is not None
    return surface, looks_of(plan.trajectory, surface, camera, scene_for(target, plan.supposed)).seen


def add_flight_logs(catalog: Catalog, logs: Sequence[str | Path]) -> list[dict[str, str]]:
    """Each log, or those of each folder, into the catalog, on the plan in force that it lies on best.

    Returns of each its name, status (added, unchanged, failed), reason and findings; `flight` is its id,
    `left_out` what of its plan and which zones it did not show, in words.
    """
    known = set(catalog.flights(kind="flown")["flight_id"])
    rows = []
    with Workers(1) as workers:
        for log in find_logs(logs):
            file = dict.fromkeys(("reason", "findings", "flight", "left_out"), "")
            file |= {"name": log.name, "status": "failed"}
            try:
                row = _added(workers, catalog, log)
                file["status"] = "unchanged" if row["flight_id"] in known else "added"
                file |= {"flight": row["flight_id"], "findings": row["findings"]}
                file["left_out"] = left_out(catalog, row, zones=file["status"] == "added")
            except UppliedError as error:
                file["reason"] = str(error)
            rows.append(file)
    return rows


def left_out(catalog: Catalog, row: Row, zones: bool = True) -> str:
    """What a flight left out of what its plan shows, and of zones, in words; empty where it left nothing."""
    inspected = row.get("inspected_pct")
    if inspected is None or inspected != inspected:  # judged before there was such a figure
        inspected = row["required_pct"] or 0.0
    share = f"{100 - inspected:.1f} % of what its plan shows" if inspected < 100 else ""
    return ", ".join(filter(None, (share, zones_left_out(catalog, row) if zones else "")))


def zones_left_out(catalog: Catalog, row: Row) -> str:
    """The zones that some safe camera can see and that were not seen as they ask, in words."""
    camera = catalog.demonstration(str(row["demonstration_id"])).camera
    if (asking := zones_asked(catalog, row, catalog.structure(str(row["target_id"])), camera)) is None:
        return ""
    judged = asking.judged(*looked(catalog, flown_with(catalog, row), asking.surface))
    return ", ".join(f"zone {each['zone']}" for each in judged if each["status"] == "missed")


def zones_asked(catalog: Catalog, row: Row, target: Structure, camera: Camera) -> RequiredZones | None:
    if not (zones := Zones(catalog).of(target.kind, target.structure_id)):
        return None
    known = target, catalog.supposed(str(row["transfer_id"])), camera, zones
    return RequiredZones(catalog.structure, catalog.cache, *known, catalog.faces_labelled)


def flown_with(catalog: Catalog, row: Row) -> list[Row]:
    every = flown_rows(catalog, str(row["target_id"]))
    return every + [row] * (row["flight_id"] not in {each["flight_id"] for each in every})
