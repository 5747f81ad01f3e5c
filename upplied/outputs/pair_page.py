"""The data of a transfer's page: both paths with what happens along them, and the figures of each preset."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pandas as pd

from upplied.geometry.polylines import leg_lengths
from upplied.geometry.poses import interpolate, matrices
from upplied.geometry.scene import Scene
from upplied.outputs import pairs
from upplied.outputs.display import packed
from upplied.outputs.pairs import NOT_FLYABLE, PRESETS, Pair, number, shown_status
from upplied.outputs.verdicts import verdict
from upplied.records import Camera, Demonstration, Floats, Measures, Record, Trajectory

DRAFTED = "newer draft"  # how a page names it
_UNSAFE = "Do not fly this plan. Its waypoints break safety rules."
_PROVENANCE = (
    "transfer_id", "planned_at", "run_id", "code_version", "icp_score_m2",
    "demonstration_sha256", "source_sha256", "target_sha256", "settings_sha256",
)  # fmt: skip
# Least probability of each word for a counterpart; plans require 0.8 by default.
_SURE = ((0.95, "sure"), (0.8, "likely"), (0.0, "doubtful"))
_MOST = 600  # poses of a path
_HALF_PICTURE = 2  # rays on each side of the middle of a picture, across and upwards


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Record):
    """A path at display density, with its values along it."""

    path: Trajectory
    speed_mps: Floats  # (N,)
    clearance_m: Floats  # (N,) to the nearest surface
    standoff_m: Floats  # (N,) to the surface in the picture, nearest to its middle


def profile(trajectory: Trajectory, scene: Scene, camera: Camera | None = None) -> Profile:
    """The values along a trajectory round the structure of a scene, at its own or at most 600 even times.

    Without a camera, whose field of view bounds the picture, the optical axis alone counts.
    """
    path = trajectory
    if len(path) > _MOST:
        path = interpolate(path, np.linspace(path.t_s[0], path.t_s[-1], _MOST))
    clearance = scene.distance(path.positions)
    return Profile(path, speeds(path), clearance, _standoff(path, scene, camera, clearance))


def _standoff(path: Trajectory, scene: Scene, camera: Camera | None, clearance_m: Floats) -> Floats:
    """Distance (N,), m, to the surface in the middle of each picture; without any, to the nearest surface."""
    across, upwards = np.zeros(1), np.zeros(1)
    if camera is not None:
        steps = np.linspace(-1, 1, 2 * _HALF_PICTURE + 1)
        half = np.tan(np.radians(np.minimum([camera.hfov_deg, camera.vfov_deg], 150.0)) / 2)
        across, upwards = (axis.ravel() for axis in np.meshgrid(steps * half[0], steps * half[1]))
    rays = np.stack([np.ones_like(across), across, upwards], axis=1)
    rays = rays[np.argsort(np.linalg.norm(rays, axis=1), kind="stable")]  # from the middle outwards
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    turned = np.einsum("nij,kj->nki", matrices(path.quat_xyzw), rays)
    origins = np.repeat(path.positions, len(rays), axis=0)
    reach = scene.cast(origins, turned.reshape(-1, 3))[0].reshape(len(path), len(rays))
    hits = np.isfinite(reach)
    first = reach[np.arange(len(path)), hits.argmax(axis=1)]
    return np.where(hits.any(axis=1), first, clearance_m)


def speeds(path: Trajectory) -> Floats:
    """Speed (N,), m/s, at each pose: of the steps on both of its sides together."""
    steps = leg_lengths(path.positions), np.diff(path.t_s)
    distance, duration = (np.append(0.0, step) + np.append(step, 0.0) for step in steps)
    return distance / np.maximum(duration, 1e-9)


def demonstration_data(demonstration: Demonstration, profile: Profile, origin: Floats) -> dict[str, Any]:
    """The demonstrated path and who flew it; coordinates relative to the structure's `origin`, m."""
    camera = demonstration.camera
    return {
        "id": demonstration.demonstration_id,
        "source": demonstration.structure_id,
        **{name: getattr(demonstration, name) for name in ("operator", "site", "notes", "about")},
        "poses": len(demonstration),
        "passport": _passport(demonstration.passport),
        "camera": {"hfov_deg": camera.hfov_deg, "vfov_deg": camera.vfov_deg, "range_m": camera.max_range_m},
        "path": path_data(profile, origin),
    }


def _passport(passport: Mapping[str, Any]) -> str:
    if not passport:
        return ""
    words = {True: " (overruled)", False: ""}
    findings = (f"{one['rule']}: {one['found']}{words[one['overruled']]}" for one in passport["findings"])
    return "; ".join([passport["verdict"], *findings])


def pair_data(
    pair: Pair, demonstration: dict[str, Any], paths: Mapping[str, dict[str, Any]], picture: str = ""
) -> dict[str, Any]:
    """The whole page: `paths` holds, by preset, the planned path as `planned_data` gives it.

    `picture` is the address of a PNG of both, for print and for browsers that draw no 3-D views.
    """
    drafted = [] if pair.draft is None else [_plan(DRAFTED, pair.draft, paths.get(DRAFTED, {}))]
    order = dict.fromkeys(filter(None, (pair.decided, *PRESETS, *sorted(pair.plans))))
    plans = [_plan(name, pair.plans[name], paths.get(name, {})) for name in order if name in pair.plans]
    ids = {"pair": pair.name, "source": pair.source_id, "target": pair.target_id, "kind": pair.kind}
    shown = {"change": pairs.change(pair), "picture": picture, "demonstration": demonstration}
    return {**ids, **shown, "plans": [*plans[:1], *drafted, *plans[1:]]}


def planned_data(
    profile: Profile, viewpoints: Trajectory, origin: Floats, states: np.ndarray | None
) -> dict[str, Any]:
    """A planned path, its viewpoints, as x y z and quaternion, and the state of each triangle."""
    shifted = np.concatenate([viewpoints.positions - origin, viewpoints.quat_xyzw], axis=1)
    data = {"path": path_data(profile, origin), "viewpoints": packed(shifted.astype(np.float32))}
    more = {} if states is None else {"states": packed(states)}
    return {**data, "origin": [float(value) for value in origin], **more}


def path_data(profile: Profile, origin: Floats) -> dict[str, Any]:
    """Times, poses and values along a path as arrays of single precision."""
    path = profile.path
    columns = {"t": path.t_s, "xyz": path.positions - origin, "quat": path.quat_xyzw}
    columns |= {"speed": profile.speed_mps, "clearance": profile.clearance_m, "standoff": profile.standoff_m}
    return {name: packed(values.astype(np.float32)) for name, values in columns.items()}


def _plan(preset: str, row: Mapping[str, Any], path: dict[str, Any]) -> dict[str, Any]:
    status, result = shown_status(row), verdict(row, safety_m(row.get("settings_json")))
    if broken := path.get("gate"):
        status, result = NOT_FLYABLE, {"flyable": False, "headline": _UNSAFE, "look": broken}
    return {
        "preset": preset,
        "status": status,
        "state": str(row.get("state") or ""),
        "decided": pairs.decision_words(row),
        "counterparts": _text(row.get("counterpart_summary")),
        "parts": _parts(row.get("counterparts")),
        "told_by": _text(row.get("parts_told_by")),
        "evidence": _text(row.get("acceptance_evidence")),
        "standoff": _text(row.get("standoff_mode")),
        "verdict": result,
        "safety_m": safety_m(row.get("settings_json")),
        "measures": {item.name: number(row, item.name) for item in fields(Measures)}
        | {name: number(row, name) for name in ("n_viewpoints", "n_waypoints")},
        "provenance": {name: _shown(name, row[name]) for name in _PROVENANCE if name in row},
        **path,
    }


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""


def _parts(value: Any) -> list[dict[str, str]]:
    """The counterparts of each inspected part, from the JSON list in the catalog."""
    try:
        entries = json.loads(value) if isinstance(value, str) and value else []
        return [_part(one) for one in entries]
    except (ValueError, TypeError, KeyError, AttributeError):
        return []


def _part(one: Mapping[str, Any]) -> dict[str, str]:
    sure = one.get("probability")
    return {
        "part": str(one["part"]),
        "inspected": f"{one['inspected_pct']:.0f} %",
        "similar": str(one["found"]),
        "flown": ", ".join(one["flown"]),
        "left_out": "; ".join(one["left_out"]),
        "certainty": "unknown" if sure is None else next(name for least, name in _SURE if sure >= least),
        "probability": "unknown" if sure is None else f"{100 * sure:.0f} %",
        "doubt": "; ".join(text for text in (str(one["doubt"]), _missing(one)) if text),
    }


def _missing(one: Mapping[str, Any]) -> str:
    """The unscanned share of a part, in words; unknown for plans before version 0.2."""
    share, ends = float(one.get("never_scanned_pct", 0.0)), [str(part) for part in one.get("open", ())]
    words = f"{share:.0f} % of the inspected surface of {one['part']} was never scanned" if share >= 1 else ""
    return words or (f"the scan ends on {', '.join(ends)}" if ends else "")


def safety_m(settings_json: Any) -> float | None:
    """The required distance from the structure, m; None if there is none or it is unknown."""
    try:
        route = json.loads(settings_json)["route"]
        return float(route["clearance_m"]) if route["enforce"] else None
    except (TypeError, ValueError, KeyError):
        return None


def _shown(name: str, value: Any) -> str:
    if name == "planned_at":
        return f"{pairs.stamp(value)} UTC"
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.4g}"
    return "" if value is None or value is pd.NaT else str(value)
