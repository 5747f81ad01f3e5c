"""A plain table: every waypoint on the Earth and in the structure frame, for scripts and offboard control."""

from __future__ import annotations

import csv
import io

from upplied.outputs.missions.records import Mission

COLUMNS = (
    "seq", "lat_deg", "lon_deg", "alt_m", "datum", "height_m", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw",
    "heading_deg", "gimbal_pitch_deg", "speed_mps", "photo", "inspect", "hfov_deg", "vfov_deg", "hold_s",
)  # fmt: skip


def csv_text(mission: Mission) -> str:
    """The mission as CSV: `alt_m` in `datum`, `height_m` above take-off, `x_m y_m z_m` and quaternion in the
    structure frame; the field of view where the camera zooms, else empty.
    """
    buffer = io.StringIO()
    rows = csv.writer(buffer, lineterminator="\n")
    rows.writerow(COLUMNS)
    for at in range(len(mission)):
        lat, lon, alt = mission.geodetic[at]
        rows.writerow(
            [
                at, f"{lat:.9f}", f"{lon:.9f}", f"{alt:.4f}", mission.placement.datum,
                f"{mission.height_m[at]:.4f}",
                *(f"{value:.4f}" for value in mission.local[at]),
                *(f"{value:.9f}" for value in mission.quat_xyzw[at]),
                *(f"{each[at]:.4f}" for each in (mission.heading_deg, mission.pitch_deg, mission.speed_mps)),
                int(mission.photo[at]), int(mission.inspect[at]),
                *(["", ""] if mission.fov_deg is None else [f"{angle:.3f}" for angle in mission.fov_deg[at]]),
                f"{mission.hold_s[at]:.3f}",
            ]
        )  # fmt: skip
    return buffer.getvalue()
