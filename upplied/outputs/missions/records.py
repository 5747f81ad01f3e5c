"""A mission: the commands of an autopilot, in degrees and metres on the Earth (by pymap3d)."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from pymap3d import enu2geodetic, geodetic2enu

from upplied.errors import RefusedError
from upplied.geometry.polylines import cumulated, leg_lengths
from upplied.geometry.poses import yaw_pitch
from upplied.outputs.missions import gate
from upplied.records import Bools, Floats, Placement, Record, Structure

_SAME_PLACE_M = 0.05
SHORTEST_HOLD_S = 0.05  # shorter hovers are not written
SAME_ZOOM = 0.02  # of the field of view: smaller changes are not commanded


@dataclass(frozen=True, eq=False, repr=False)
class Fence(Record):
    """A polygon around the mission, or one that it must not enter."""

    inside: bool  # whether the mission stays inside
    corners: Floats  # (G, 2) latitude and longitude, deg


@dataclass(frozen=True, eq=False, repr=False)
class Mission(Record):
    """One sortie: take off at home, climb, fly the waypoints in order, return above home and land.

    Waypoints without `inspect` are the transit legs from above home to the inspection and back.
    """

    name: str
    number: int  # of this sortie, from 1
    count: int  # of sorties
    placement: Placement
    altitude: str  # reference in the file: "relative" to take-off, "amsl" or "ellipsoid"
    home: Floats  # (3,) latitude and longitude, deg, altitude, m
    home_local: Floats  # (3,) m, structure frame
    return_height_m: float  # above take-off, at which an automatic return passes over everything
    geodetic: Floats  # (N, 3) latitude and longitude, deg, altitude in the placement's datum, m
    local: Floats  # (N, 3) m, structure frame
    quat_xyzw: Floats  # (N, 4) camera to structure
    heading_deg: Floats  # (N,) of the camera, 0 .. 360 clockwise from true north
    pitch_deg: Floats  # (N,) of the gimbal, negative down
    speed_mps: Floats  # (N,) of the leg that ends at the waypoint
    hold_s: Floats  # (N,) to hover on arrival, while the camera turns or as the expert did
    passing_m: Floats  # (N,) distance before and behind within which the vehicle may turn; 0: it stops
    photo: Bools  # (N,) whether a photo is taken
    inspect: Bools  # (N,)
    photo_distance_m: float  # between photos during the inspection, 0: only at `photo`
    duration_s: float
    notes: tuple[str, ...] = ()
    fov_deg: Floats | None = None  # (N, 2) horizontal and vertical, if the camera zooms
    overruled: tuple[gate.Breach, ...] = ()  # overruled rules of the gate, also in the notes
    fences: tuple[Fence, ...] = ()  # for the autopilot to enforce
    #: (R, 3) landing points other than home: latitude and longitude, deg, height above home, m
    rally: Floats = field(default_factory=lambda: np.empty((0, 3)))
    shown_pct: float = float("nan")  # share of the inspected surface that its photos or film show
    films: bool = False  # during the inspection, instead of photos

    def __len__(self) -> int:
        return len(self.local)

    @property
    def zooms_at(self) -> dict[int, float]:
        """The waypoints with a zoom command, and its horizontal field of view, deg."""
        angles: dict[int, float] = {}
        last = float("nan")
        for at, angle in enumerate([] if self.fov_deg is None else self.fov_deg[:, 0].tolist()):
            if not abs(angle / last - 1) < SAME_ZOOM:
                angles[at] = last = angle
        return angles

    @property
    def stops(self) -> list[range]:
        """The waypoints by place; those after the first of a range are turns of the camera on the spot."""
        starts = [0]
        for at in range(1, len(self)):
            if np.linalg.norm(self.local[at] - self.local[starts[-1]]) > _SAME_PLACE_M:
                starts.append(at)
        return [range(start, end) for start, end in pairwise([*starts, len(self)])]

    @property
    def arrival_s(self) -> Floats:
        """Time (N,) at which each waypoint is left, s from the first, by speeds and holds."""
        legs = leg_lengths(self.local) / np.maximum(self.speed_mps[1:], 1e-3)
        return cumulated(legs) + np.cumsum(self.hold_s)

    def inspects_behind(self, at: int) -> bool:
        """Whether the leg behind a waypoint belongs to the inspection."""
        return at + 1 < len(self) and bool(self.inspect[at] and self.inspect[at + 1])

    @property
    def starts_at(self) -> int:
        """The first waypoint of the inspection."""
        return int(self.inspect.argmax())

    @property
    def stops_at(self) -> int:
        """The last waypoint of the inspection."""
        return len(self) - 1 - int(self.inspect[::-1].argmax())

    @property
    def height_m(self) -> Floats:
        """Height (N,) above take-off, m."""
        return self.local[:, 2] - self.home_local[2]

    @property
    def written_alt_m(self) -> Floats:
        """Altitude (N,) as the mission states it, m."""
        return self.height_m if self.altitude == "relative" else self.geodetic[:, 2]


def placement_of(structure: Structure) -> Placement:
    """The structure's place on the Earth; a mission for one without a place is refused."""
    if structure.placement is None:
        rule = "a mission needs latitude, longitude, altitude, datum and heading"
        remedy = "give lat, lon, alt and heading in the manifest"
        raise RefusedError(structure.structure_id, "its place on the Earth is unknown", rule, remedy)
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
    """Compass heading (0 .. 360, clockwise from true north) and pitch (deg, negative down) of cameras (N, 4).

    `heading_deg` is that of the structure's +X, clockwise from true north.
    """
    yaw, pitch = yaw_pitch(quat_xyzw)
    return np.mod(heading_deg - np.degrees(yaw), 360.0), np.degrees(pitch)
