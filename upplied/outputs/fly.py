"""The pilot's part of a plan's page: the mission, drawn and in figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from upplied.catalog.verbs.recipes import settings_of
from upplied.errors import UppliedError
from upplied.geometry.polylines import leg_lengths
from upplied.outputs.mission_drawing import MissionDrawing
from upplied.outputs.missions import Mission, MissionOptions, missions_for
from upplied.records import Camera, Plan, Structure

_MB_OF_A_MEGAPIXEL = 0.4  # of a JPEG as inspection cameras write it
_USUAL_MEGAPIXELS = 20.0  # if the log does not state the size of the picture


def fly_data(row: Any, plan: Plan, structure: Structure, camera: Camera) -> dict[str, Any]:
    """The mission of a plan with the usual options; ``refused`` is the reason why there is none.

    A draft is drawn as a draft: its file leaves by a release alone.
    """
    if plan.status != "ok":
        return path_drawn(plan, structure, camera, plan.reason or "The plan has no path.")
    options = as_settled(row, MissionOptions(draft=True))
    try:
        missions = missions_for("qgc-plan", plan, structure, options, camera)
    except UppliedError as error:
        return path_drawn(plan, structure, camera, str(error))
    return _mission_data(missions, structure, options, camera)


def path_drawn(plan: Plan, structure: Structure, camera: Camera, refused: str = "") -> dict[str, Any]:
    """The path of a plan alone, as `fly_data` shows a mission; `refused` says why there is none."""
    if plan.trajectory is None or plan.is_viewpoint is None:
        return {"refused": refused}
    return {"refused": refused, **_drawings(MissionDrawing.of_plan(plan, structure, camera))}


def as_settled(row: Any, options: MissionOptions) -> MissionOptions:
    """The options with the vehicle, and at least the clearance, of the plan's settings where none was set."""
    try:
        settings = settings_of(str(row.get("settings_json") or "{}"))
    except (ValueError, KeyError, UppliedError):  # of a program that knew other settings
        return options
    usual, vehicle = MissionOptions(), asdict(settings.vehicle)
    more = {name: value for name, value in vehicle.items() if getattr(options, name) == getattr(usual, name)}
    if settings.route.enforce and options.clearance_m == usual.clearance_m:
        more["clearance_m"] = max(usual.clearance_m, settings.route.clearance_m)
    return replace(options, **more)


def _mission_data(
    missions: Sequence[Mission], structure: Structure, options: MissionOptions, camera: Camera
) -> dict[str, Any]:
    """Drawings, flights, heights, photos and battery of a mission as a page shows them."""
    first, home = missions[0], missions[0].home_local
    photos = sum(map(_count_photos, missions))
    usable_s = None if options.endurance_s is None else options.endurance_s * (1 - options.reserve_pct / 100)
    megapixels = camera.width_px * camera.height_px / 1e6 or _USUAL_MEGAPIXELS
    legs = np.concatenate([mission.local[~mission.inspect, 2] for mission in missions])
    return {
        "refused": "",
        **_drawings(MissionDrawing.of_missions(missions, structure, camera)),
        "home_deg": first.home[:2].tolist(),
        "return_m": first.return_height_m,
        "transit_m": float(legs.max() - home[2]) if len(legs) else None,
        "highest_m": float(max(mission.height_m.max() for mission in missions)),
        "endurance_s": options.endurance_s,
        "usable_s": usable_s,
        "photos": photos,
        "shown_pct": None if np.isnan(first.shown_pct) else first.shown_pct,
        "interval_s": _interval_s(missions),
        "storage_mb": photos * (megapixels * _MB_OF_A_MEGAPIXEL),
        "assumed_camera": not camera.width_px,
        "flights_s": [mission.duration_s for mission in missions],
    }


def _drawings(drawing: MissionDrawing) -> dict[str, Any]:
    return {"map": drawing.map(), "heights": drawing.heights(), "legend": drawing.legend()}


def _count_photos(mission: Mission) -> int:
    if not mission.photo_distance_m:
        return int(mission.photo.sum())
    return 1 + int(leg_lengths(mission.local[mission.inspect]).sum() / mission.photo_distance_m)


def _interval_s(missions: Sequence[Mission]) -> float | None:
    """The shortest time between two photos, s; the camera must store one within it."""
    shortest = []
    for mission in missions:
        if mission.photo_distance_m:
            fastest = float(mission.speed_mps[mission.inspect].max())
            shortest.append(mission.photo_distance_m / max(fastest, 0.1))
        else:
            shortest += np.diff(mission.arrival_s[mission.photo]).tolist()
    return min(shortest, default=None)
