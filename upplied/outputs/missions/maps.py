"""Missions as tables and maps: CSV for scripts, Litchi's CSV, GeoJSON for GIS, and KML for map viewers."""

import csv
import io
import json
import math
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from upplied.outputs.labels import table
from upplied.outputs.missions.records import SHORTEST_HOLD_S, Mission

_KML_MODE = {"relative": "relativeToGround", "amsl": "absolute"}
_TEXTS: dict[str, str] = table("missions/maps.toml")
# Litchi gives no schema. The columns and codes are those its hub imports and exports: gimbal mode 2
# interpolates the pitch, action 0 stays for milliseconds, 1 takes a photo, 2 and 3 start and stop a film,
# 4 turns the aircraft, 5 the gimbal, -1 is no action, altitude mode 0 is above take-off.
_ACTIONS = 15
_LITCHI_COLUMNS = (
    "latitude", "longitude", "altitude(m)", "heading(deg)", "curvesize(m)", "rotationdir", "gimbalmode",
    "gimbalpitchangle",
    *(f"action{part}{at}" for at in range(1, _ACTIONS + 1) for part in ("type", "param")),
    "altitudemode", "speed(m/s)", "poi_latitude", "poi_longitude", "poi_altitude(m)", "poi_altitudemode",
    "photo_timeinterval", "photo_distinterval",
)  # fmt: skip
_INTERPOLATE, _NOTHING, _ABOVE_TAKEOFF = 2, -1, 0
_STAY, _SHOOT, _RECORD, _RECORDED, _ROTATE, _TILT = 0, 1, 2, 3, 4, 5
_TURNS = _ACTIONS // 4  # on the spot, of one row


def csv_text(mission: Mission) -> str:
    """The mission as CSV: `alt_m` in `datum`, `height_m` above take-off, `x_m y_m z_m` and quaternion in the
    structure frame; the field of view where the camera zooms, else empty.
    """
    count = len(mission)
    fov = (".3f", mission.fov_deg) if mission.fov_deg is not None else ("s", np.full((count, 2), ""))
    groups: tuple[tuple[str, str, Any], ...] = (
        ("seq", "d", np.arange(count)),
        ("lat_deg lon_deg", ".9f", mission.geodetic[:, :2]),
        ("alt_m", ".4f", mission.geodetic[:, 2]),
        ("datum", "s", np.full(count, mission.placement.datum)),
        ("height_m", ".4f", mission.height_m),
        ("x_m y_m z_m", ".4f", mission.local),
        ("qx qy qz qw", ".9f", mission.quat_xyzw),
        ("heading_deg", ".4f", mission.heading_deg),
        ("gimbal_pitch_deg", ".4f", mission.pitch_deg),
        ("speed_mps", ".4f", mission.speed_mps),
        ("photo inspect", "d", np.column_stack([mission.photo, mission.inspect]).astype(int)),
        ("hfov_deg vfov_deg", *fov),
        ("hold_s", ".3f", mission.hold_s),
    )
    rows = [" ".join(names for names, _, _ in groups).split()]
    for at in range(count):
        rows.append([format(value, form) for _, form, values in groups for value in np.ravel(values[at])])
    return _csv(rows)


def _csv(rows: list[list[Any]]) -> str:
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def litchi_text(mission: Mission) -> str:
    """The mission as Litchi's mission hub CSV: 46 columns, one row a waypoint; heights above take-off."""
    rows: list[list[Any]] = [[*_LITCHI_COLUMNS]]
    stops = [stop[first : first + _TURNS] for stop in mission.stops for first in range(0, len(stop), _TURNS)]
    for stop in stops:
        at = stop[0]
        lat, lon = mission.geodetic[at, :2]
        actions = [part for each in stop for part in _litchi_actions(mission, each, each > at)]
        actions += [_NOTHING, 0] * (_ACTIONS - len(actions) // 2)
        every_m = mission.photo_distance_m if mission.inspects_behind(stop[-1]) else 0.0
        after_mps = mission.speed_mps[min(stop[-1] + 1, len(mission) - 1)]
        rows.append(
            [
                f"{lat:.8f}", f"{lon:.8f}", f"{mission.height_m[at]:.2f}",
                f"{mission.heading_deg[at]:.1f}", 0, 0,
                _INTERPOLATE, f"{mission.pitch_deg[at]:.1f}", *actions, _ABOVE_TAKEOFF,
                f"{after_mps:.2f}", 0, 0, 0, 0, -1, every_m or -1,
            ]
        )  # fmt: skip
    return _csv(rows)


def _litchi_actions(mission: Mission, at: int, on_the_spot: bool) -> list[int]:
    """Types and parameters of the actions at a waypoint; a turn on the spot has no row of its own."""
    turn = [_ROTATE, round(mission.heading_deg[at]) % 360, _TILT, round(mission.pitch_deg[at])]
    stay = [_STAY, math.ceil(1e3 * mission.hold_s[at])] if mission.hold_s[at] > SHORTEST_HOLD_S else []
    photo = [_SHOOT, 0] if mission.photo[at] else []
    if mission.films:
        photo = [_RECORD, 0] * (at == mission.starts_at) + [_RECORDED, 0] * (at == mission.stops_at)
    return (turn if on_the_spot else []) + stay + photo


def geojson_text(mission: Mission) -> str:
    """The mission as a feature collection; `altitude_reference` defines the third coordinate."""
    lon_lat_alt = zip(mission.geodetic[:, 1], mission.geodetic[:, 0], mission.written_alt_m, strict=True)
    places = [[round(float(v), digits) for v, digits in zip(each, (9, 9, 3), strict=True)]
              for each in lon_lat_alt]  # fmt: skip
    path: dict[str, Any] = {"name": mission.name, "sortie": mission.number, "sorties": mission.count}
    path |= {"altitude_reference": mission.altitude, "datum": mission.placement.datum}
    path |= {"duration_s": round(mission.duration_s, 1), "notes": list(mission.notes)}
    features = [_feature("LineString", places, path)]
    figures = {"heading_deg": (2, mission.heading_deg), "gimbal_pitch_deg": (2, mission.pitch_deg)}
    figures |= {"speed_mps": (3, mission.speed_mps), "hold_s": (3, mission.hold_s)}
    for at, place in enumerate(places):
        values = {"seq": at} | {name: round(float(v[at]), digits) for name, (digits, v) in figures.items()}
        values |= {"photo": bool(mission.photo[at]), "inspect": bool(mission.inspect[at])}
        if mission.fov_deg is not None:
            angles = (round(angle, 2) for angle in mission.fov_deg[at].tolist())
            values |= zip(("hfov_deg", "vfov_deg"), angles, strict=True)
        features.append(_feature("Point", place, values))
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False) + "\n"


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def kml_text(mission: Mission) -> str:
    """The mission as KML; absolute altitudes are above mean sea level there, relative ones above ground."""
    mode = _KML_MODE[mission.altitude]
    places = [
        f"{lon:.9f},{lat:.9f},{alt:.3f}"
        for (lat, lon, _), alt in zip(mission.geodetic, mission.written_alt_m, strict=True)
    ]
    times = mission.arrival_s
    photos = [
        _TEXTS["photo"].format(
            number=number + 1, time=times[at], heading=mission.heading_deg[at], pitch=mission.pitch_deg[at],
            mode=mode, coordinates=places[at],
            zoom="" if mission.fov_deg is None else f", field of view {mission.fov_deg[at, 0]:.1f} deg",
        )
        for number, at in enumerate(mission.photo.nonzero()[0])
    ]  # fmt: skip
    about = "; ".join([f"altitudes: {mission.altitude}, datum {mission.placement.datum}", *mission.notes])
    return _TEXTS["kml"].format(
        title=escape(mission.name), name=escape(f"{mission.name} {mission.number} of {mission.count}"),
        about=escape(about), mode=mode, coordinates=" ".join(places), photos="".join(photos),
    )  # fmt: skip
