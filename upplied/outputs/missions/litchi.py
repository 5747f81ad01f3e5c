"""Litchi's mission hub CSV: 46 columns, one row a waypoint; heights above take-off.

Litchi gives no schema. The columns and codes are those its hub imports and exports: gimbal mode 2
interpolates the pitch, action 1 takes a photo, -1 is no action, altitude mode 0 is above take-off.
"""

from __future__ import annotations

import csv
import io

from upplied.errors import RefusedError
from upplied.outputs.missions.mission import Mission

MAX_WAYPOINTS = 99
_ACTIONS = 15
COLUMNS = (
    "latitude", "longitude", "altitude(m)", "heading(deg)", "curvesize(m)", "rotationdir", "gimbalmode",
    "gimbalpitchangle",
    *(f"action{part}{at}" for at in range(1, _ACTIONS + 1) for part in ("type", "param")),
    "altitudemode", "speed(m/s)", "poi_latitude", "poi_longitude", "poi_altitude(m)", "poi_altitudemode",
    "photo_timeinterval", "photo_distinterval",
)  # fmt: skip
_INTERPOLATE, _PHOTO, _NOTHING, _ABOVE_TAKEOFF = 2, 1, -1, 0


def litchi_text(mission: Mission) -> str:
    """The mission as Litchi's CSV."""
    if mission.altitude != "relative":
        raise RefusedError(
            mission.name, f"{mission.altitude} altitudes were asked for", "Litchi flies above take-off"
        )
    buffer = io.StringIO()
    rows = csv.writer(buffer, lineterminator="\n")
    rows.writerow(COLUMNS)
    for at in range(len(mission)):
        lat, lon = mission.geodetic[at, :2]
        actions = [_PHOTO, 0] if mission.photo[at] else []
        actions += [_NOTHING, 0] * (_ACTIONS - len(actions) // 2)
        every_m = mission.photo_distance_m if mission.photo_distance_m and mission.inspect[at] else -1
        rows.writerow(
            [
                f"{lat:.8f}", f"{lon:.8f}", f"{mission.height_m[at]:.2f}",
                f"{mission.heading_deg[at]:.1f}", 0, 0,
                _INTERPOLATE, f"{mission.pitch_deg[at]:.1f}", *actions, _ABOVE_TAKEOFF,
                f"{mission.speed_mps[min(at + 1, len(mission) - 1)]:.2f}", 0, 0, 0, 0, -1, every_m,
            ]
        )  # fmt: skip
    return buffer.getvalue()
