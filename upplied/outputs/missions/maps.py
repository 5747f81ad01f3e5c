"""A mission for maps and scripts: a plain table (CSV), GeoJSON for GIS, and KML for map viewers."""

from __future__ import annotations

import csv
import io
import json
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from upplied.outputs.labels import table
from upplied.outputs.missions.records import Mission

_KML_MODE = {"relative": "relativeToGround", "amsl": "absolute"}
_TEXTS: dict[str, str] = table("missions/maps.toml")


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
    buffer = io.StringIO()
    rows = csv.writer(buffer, lineterminator="\n")
    rows.writerow(" ".join(names for names, _, _ in groups).split())
    for at in range(count):
        rows.writerow(format(value, form) for _, form, values in groups for value in np.ravel(values[at]))
    return buffer.getvalue()


def geojson_text(mission: Mission) -> str:
    """The mission as a feature collection; `altitude_reference` defines the third coordinate."""
    lon_lat_alt = zip(mission.geodetic[:, 1], mission.geodetic[:, 0], mission.written_alt_m, strict=True)
    places = [[round(float(v), digits) for v, digits in zip(each, (9, 9, 3), strict=True)]
              for each in lon_lat_alt]  # fmt: skip
    path = {
        "name": mission.name,
        "sortie": mission.number,
        "sorties": mission.count,
        "altitude_reference": mission.altitude,
        "datum": mission.placement.datum,
        "duration_s": round(mission.duration_s, 1),
        "notes": list(mission.notes),
    }
    features = [_feature("LineString", places, path)]
    figures = {
        "heading_deg": (2, mission.heading_deg),
        "gimbal_pitch_deg": (2, mission.pitch_deg),
        "speed_mps": (3, mission.speed_mps),
        "hold_s": (3, mission.hold_s),
    }
    for at, place in enumerate(places):
        values = {"seq": at} | {name: round(float(v[at]), digits) for name, (digits, v) in figures.items()}
        values |= {"photo": bool(mission.photo[at]), "inspect": bool(mission.inspect[at])}
        if mission.fov_deg is not None:
            hfov_deg, vfov_deg = mission.fov_deg[at].tolist()
            values |= {"hfov_deg": round(hfov_deg, 2), "vfov_deg": round(vfov_deg, 2)}
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
