"""From the structure frame to the Earth, by pymap3d."""

from __future__ import annotations

import numpy as np
from pymap3d import enu2geodetic, geodetic2enu

from upplied.errors import RefusedError
from upplied.geometry.poses import yaw_pitch
from upplied.records import Floats, Placement, Structure


def placement_of(structure: Structure) -> Placement:
    """The structure's place on the Earth; a mission for one without a place is refused."""
    if structure.placement is None:
        raise RefusedError(
            structure.structure_id,
            "its place on the Earth is unknown",
            "a mission needs latitude, longitude, altitude, datum and heading",
            "give lat, lon, alt and heading in the manifest",
        )
    return structure.placement


def to_geodetic(points: Floats, placement: Placement) -> Floats:
    """Latitude, longitude (deg) and altitude (m, datum of the placement), (N, 3), of points (N, 3), m."""
    bearing, (x, y, up) = np.radians(placement.heading_deg), points.T
    east, north = x * np.sin(bearing) - y * np.cos(bearing), x * np.cos(bearing) + y * np.sin(bearing)
    lat, lon, alt = enu2geodetic(east, north, up, placement.lat_deg, placement.lon_deg, placement.alt_m)
    return np.stack([lat, lon, alt], axis=1)


def from_geodetic(geodetic: Floats, placement: Placement) -> Floats:
    """The inverse: points (N, 3), m, structure frame."""
    east, north, up = geodetic2enu(*geodetic.T, placement.lat_deg, placement.lon_deg, placement.alt_m)
    bearing = np.radians(placement.heading_deg)
    x = east * np.sin(bearing) + north * np.cos(bearing)
    y = -east * np.cos(bearing) + north * np.sin(bearing)
    return np.stack([x, y, up], axis=1)


def heading_and_pitch(quat_xyzw: Floats, heading_deg: float) -> tuple[Floats, Floats]:
    """Compass heading (0 .. 360, clockwise from true north) and pitch (deg, negative down) of each camera.

    Parameters
    ----------
    quat_xyzw : array, shape (N, 4)
    heading_deg : float
        Of the structure's +X, clockwise from true north.
    """
    yaw, pitch = yaw_pitch(quat_xyzw)
    return np.mod(heading_deg - np.degrees(yaw), 360.0), np.degrees(pitch)
