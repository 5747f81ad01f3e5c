"""GeoJSON for GIS: the path, and every waypoint with what the camera does there."""

from __future__ import annotations

import json
from typing import Any

from upplied.outputs.missions.records import Mission

_FIELDS = ("hfov_deg", "vfov_deg")


def geojson_text(mission: Mission) -> str:
    """The mission as a feature collection; `altitude_reference` says what the third coordinate means."""
    places = [
        [round(float(lon), 9), round(float(lat), 9), round(float(alt), 3)]
        for (lat, lon, _), alt in zip(mission.geodetic, mission.written_alt_m, strict=True)
    ]
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
    for at, place in enumerate(places):
        features.append(
            _feature(
                "Point",
                place,
                {
                    "seq": at,
                    "heading_deg": round(float(mission.heading_deg[at]), 2),
                    "gimbal_pitch_deg": round(float(mission.pitch_deg[at]), 2),
                    "speed_mps": round(float(mission.speed_mps[at]), 3),
                    "hold_s": round(float(mission.hold_s[at]), 3),
                    "photo": bool(mission.photo[at]),
                    "inspect": bool(mission.inspect[at]),
                    **_zoom(mission, at),
                },
            )
        )
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False) + "\n"


def _zoom(mission: Mission, at: int) -> dict[str, float]:
    if mission.fov_deg is None:
        return {}
    return {name: round(float(angle), 2) for name, angle in zip(_FIELDS, mission.fov_deg[at], strict=True)}


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": properties,
    }
