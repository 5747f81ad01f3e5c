"""KML for map viewers: the path as a line in space, the photos as points."""

from __future__ import annotations

from xml.sax.saxutils import escape

from upplied.outputs.missions.flying import Flying
from upplied.outputs.missions.records import Mission

_MODE = {"relative": "relativeToGround", "amsl": "absolute"}
FLYING = Flying(altitudes=tuple(_MODE), altitude_rule="KML knows ground and mean sea level", zooms=True)
_LINE = """ <Placemark><name>{name}</name><description>{about}</description>
  <Style><LineStyle><color>ffb27200</color><width>3</width></LineStyle></Style>
  <LineString><altitudeMode>{mode}</altitudeMode><coordinates>{coordinates}</coordinates></LineString>
 </Placemark>"""
_PHOTO = """ <Placemark><name>photo {number}</name>
  <description>heading {heading:.1f} deg, gimbal pitch {pitch:.1f} deg{zoom}</description>
  <ExtendedData><Data name="t_s"><value>{time:.3f}</value></Data></ExtendedData>
  <Point><altitudeMode>{mode}</altitudeMode><coordinates>{coordinates}</coordinates></Point>
 </Placemark>"""


def kml_text(mission: Mission) -> str:
    """The mission as KML; absolute altitudes are above mean sea level there, relative ones above ground."""
    mode = _MODE[mission.altitude]
    places = [
        f"{lon:.9f},{lat:.9f},{alt:.3f}"
        for (lat, lon, _), alt in zip(mission.geodetic, mission.written_alt_m, strict=True)
    ]
    times = mission.arrival_s
    photos = [
        _PHOTO.format(
            number=number + 1, time=times[at], heading=mission.heading_deg[at], pitch=mission.pitch_deg[at],
            mode=mode, coordinates=places[at],
            zoom="" if mission.fov_deg is None else f", field of view {mission.fov_deg[at, 0]:.1f} deg",
        )
        for number, at in enumerate(mission.photo.nonzero()[0])
    ]  # fmt: skip
    about = "; ".join([f"altitudes: {mission.altitude}, datum {mission.placement.datum}", *mission.notes])
    line = _LINE.format(
        name=escape(f"{mission.name} {mission.number} of {mission.count}"), about=escape(about), mode=mode,
        coordinates=" ".join(places),
    )  # fmt: skip
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">\n<Document>'
    title = f"<name>{escape(mission.name)}</name>"
    return "\n".join([head, title, line, *photos, "</Document>\n</kml>\n"])
