"""Litchi's mission hub CSV: 46 columns, one row a waypoint; heights above take-off.

Litchi gives no schema. The columns and codes are those its hub imports and exports: gimbal mode 2
interpolates the pitch, action 0 stays for milliseconds, 1 takes a photo, 2 and 3 start and stop a film,
4 turns the aircraft, 5 the gimbal, -1 is no action, altitude
mode 0 is above take-off."""

from __future__ import annotations

import csv
import io
import math

from upplied.outputs.missions.records import SHORTEST_HOLD_S, Mission

# Litchi gives no schema. The columns and codes are those its hub imports and exports: gimbal mode 2
# interpolates the pitch, action 0 stays for milliseconds, 1 takes a photo, 2 and 3 start and stop a film,
# 4 turns the aircraft, 5 the gimbal, -1 is no action, altitude mode 0 is above take-off.
_ACTIONS = 15
_COLUMNS = (
    "latitude", "longitude", "altitude(m)", "heading(deg)", "curvesize(m)", "rotationdir", "gimbalmode",
    "gimbalpitchangle",
    *(f"action{part}{at}" for at in range(1, _ACTIONS + 1) for part in ("type", "param")),
    "altitudemode", "speed(m/s)", "poi_latitude", "poi_longitude", "poi_altitude(m)", "poi_altitudemode",
    "photo_timeinterval", "photo_distinterval",
)  # fmt: skip
_INTERPOLATE, _NOTHING, _ABOVE_TAKEOFF = 2, -1, 0
_STAY, _SHOOT, _RECORD, _RECORDED, _ROTATE, _TILT = 0, 1, 2, 3, 4, 5
_TURNS = _ACTIONS // 4  # on the spot, of one row


def litchi_text(mission: Mission) -> str:
    """The mission as Litchi's CSV: 46 columns, one row a waypoint; heights above take-off."""
    buffer = io.StringIO()
    rows = csv.writer(buffer, lineterminator="\n")
    rows.writerow(_COLUMNS)
    stops = [stop[first : first + _TURNS] for stop in mission.stops for first in range(0, len(stop), _TURNS)]
    for stop in stops:
        at = stop[0]
        lat, lon = mission.geodetic[at, :2]
        actions = [part for each in stop for part in _actions(mission, each, each > at)]
        actions += [_NOTHING, 0] * (_ACTIONS - len(actions) // 2)
        behind = mission.inspects_behind(stop[-1])
        every_m = mission.photo_distance_m if mission.photo_distance_m and behind else -1
        rows.writerow(
            [
                f"{lat:.8f}", f"{lon:.8f}", f"{mission.height_m[at]:.2f}",
                f"{mission.heading_deg[at]:.1f}", 0, 0,
                _INTERPOLATE, f"{mission.pitch_deg[at]:.1f}", *actions, _ABOVE_TAKEOFF,
                f"{mission.speed_mps[min(stop[-1] + 1, len(mission) - 1)]:.2f}", 0, 0, 0, 0, -1, every_m,
            ]
        )  # fmt: skip
    return buffer.getvalue()


def _actions(mission: Mission, at: int, on_the_spot: bool) -> list[int]:
    """Types and parameters of the actions at a waypoint; a turn on the spot has no row of its own."""
    turn = [_ROTATE, round(mission.heading_deg[at]) % 360, _TILT, round(mission.pitch_deg[at])]
    stay = [_STAY, math.ceil(1e3 * mission.hold_s[at])] if mission.hold_s[at] > SHORTEST_HOLD_S else []
    photo = [_SHOOT, 0] if mission.photo[at] else []
    if mission.films:
        photo = [_RECORD, 0] * (at == mission.starts_at) + [_RECORDED, 0] * (at == mission.stops_at)
    return (turn if on_the_spot else []) + stay + photo
