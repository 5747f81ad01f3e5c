"""Positions on the Earth (WGS 84), with an attitude from elsewhere, in the structure's frame and datum."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pymap3d
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.geometry.poses import from_yaw_pitch
from upplied.inputs.flight.clean import attitude_track
from upplied.inputs.flight.tracks import Track, are_unit, fields_of, source_times
from upplied.inputs.schemas import px4
from upplied.inputs.schemas.ros import IMU
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Bools, Floats, Ints

_PLACE = ("latitude", "longitude", "altitude")
_TURN = tuple(f"orientation.{axis}" for axis in "xyzw")
SOURCES = tuple(fields_of("geodetic"))
TAKEOFF = "takeoff"  # a datum: heights count from there
_NAMES = {"ellipsoid": "ellipsoid", "amsl": "mean sea level", TAKEOFF: "place of take-off"}
STRUCTURE = "structure"  # name of the frame of these tracks: no further placing is needed
MAX_DISTANCE_M = 20_000.0
_NO_FIX = -1
# Grids of PROJ on this machine, the finest first; none is fetched.
GRIDS = ("us_nga_egm08_25.tif", "us_nga_egm96_15.tif", "egm08_25.gtx", "egm96_15.gtx")
_PIPELINE = (
    "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
    " +step +proj=vgridshift +grids={} +multiplier=1 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
)


def samples(table: Table, tables: Sequence[Table], facts: LogOptions) -> Track:
    """The poses of one channel in the structure's frame; InputError without its place, datum, attitude."""
    names = ("structure_lat_deg", "structure_lon_deg", "structure_alt_m", "structure_heading_deg")
    if missing := [name for name in names if getattr(facts, name) is None]:
        finding = f"gives positions on the Earth, but the structure's place is unknown ({', '.join(missing)})"
        rule = "latitude, longitude, altitude and heading of the structure"
        raise InputError(table.channel.topic, finding, rule, "write them into the side-car")
    times, clock, place, datum = _fixes(table, facts)
    lat, lon, alt = np.where(np.abs(place) < 1e7, place, np.nan).T
    lift, own, words = _lifts(datum, facts, table)
    east, north, up = pymap3d.geodetic2enu(
        np.clip(lat, -90, 90), lon, alt + lift,
        facts.structure_lat_deg, facts.structure_lon_deg, (facts.structure_alt_m or 0.0) + own
    )  # fmt: skip
    distance = np.linalg.norm(enu := np.column_stack([east, north, up]), axis=1)
    if np.isfinite(distance).any() and np.nanmedian(distance) > MAX_DISTANCE_M:
        finding = f"lies {np.nanmedian(distance) / 1000:.0f} km from the structure"
        rule, remedy = f"within {MAX_DISTANCE_M / 1000:.0f} km", "check the structure's place on the Earth"
        raise InputError(table.channel.topic, finding, rule, remedy)
    track = Track(times, enu, np.full((len(table), 4), np.nan), table.log_ns, "enu", "base_link", clock)
    notes = (f"altitudes above the {_NAMES[datum]}", *words)
    track = replace(track.during(_valid(table), "fix"), notes=notes)
    track, turn = _with_attitude(track, table, tables, facts), structure_R_enu(facts)
    quats = px4.turned(turn, track.quat_xyzw, Rotation.identity())
    return replace(track, positions=turn.apply(track.positions), quat_xyzw=quats, parent=STRUCTURE)


def structure_R_enu(facts: LogOptions) -> Rotation:
    """Of east, north, up to the structure's frame, by the heading of its +X."""
    return Rotation.from_euler("z", -(90.0 - (facts.structure_heading_deg or 0.0)), degrees=True)


def _fixes(table: Table, facts: LogOptions) -> tuple[Ints, str, Floats, str]:
    """Times and their clock, latitude, longitude and altitude (N, 3), and the datum of the altitude."""
    if table.schema != "px4_msgs/VehicleGlobalPosition":
        return *source_times(table), table.stack(*_PLACE), "ellipsoid"
    known = [np.isfinite(table.numbers(name)).any() for name in ("alt", "alt_ellipsoid")]
    if not any(known):
        return *source_times(table), table.stack("lat", "lon", "alt_takeoff"), TAKEOFF
    amsl = known[0] and (facts.structure_datum == "amsl" or not known[1])
    place = table.stack("lat", "lon", "alt" if amsl else "alt_ellipsoid")
    return *source_times(table), place, "amsl" if amsl else "ellipsoid"


def _valid(table: Table) -> Bools:
    fixed = np.asarray(table.integers("status.status") > _NO_FIX)
    return fixed & px4.flag(table, "lat_lon_valid") & px4.flag(table, "alt_valid")


def _lifts(datum: str, facts: LogOptions, table: Table) -> tuple[float, float, tuple[str, ...]]:
    """What to add to the altitudes of the log and of the structure for one datum, and in words by what."""
    goal = facts.structure_datum or "ellipsoid"
    if datum == goal:
        return 0.0, 0.0, ()
    if datum == TAKEOFF:
        if facts.takeoff_alt_m is None:
            finding, rule = "gives heights above the place of take-off alone", "the altitude of that place"
            remedy = "write takeoff_alt_m, in the structure's datum, into the side-car"
            raise InputError(table.channel.topic, finding, rule, remedy)
        return facts.takeoff_alt_m, 0.0, ()
    undulation, words = facts.geoid_undulation_m, "as declared"
    if undulation is None:
        assert facts.structure_lat_deg is not None and facts.structure_lon_deg is not None
        undulation, words = undulation_m(facts.structure_lat_deg, facts.structure_lon_deg)
    if undulation is None:
        finding = f"gives altitudes above the {_NAMES[datum]}, the structure's above the {_NAMES[goal]}"
        rule = "one datum, or the height of mean sea level above the ellipsoid there"
        raise InputError(table.channel.topic, finding, rule, f"give geoid_undulation_m, or a grid: {words}")
    lifts = (0.0, undulation) if datum == "ellipsoid" else (undulation, 0.0)
    return *lifts, (f"mean sea level {undulation:.1f} m above the ellipsoid, {words}",)


def _with_attitude(track: Track, table: Table, tables: Sequence[Table], facts: LogOptions) -> Track:
    if (turns := (px4.attitude if table.schema.startswith("px4") else _imu)(tables, facts)) is not None:
        return _from_antenna(px4.with_attitude(track, turns, facts), facts)
    heading = table.numbers("heading")[_valid(table)]
    if np.isfinite(heading).any():
        heading = np.where(np.abs(heading) < 1e3, heading, np.nan)
        quats = from_yaw_pitch(np.pi / 2 - heading, np.zeros(len(heading)))
        note = "heading of the fix: the attitude is taken to be level"
        return _from_antenna(replace(track, quat_xyzw=quats).noted(note), facts)
    if px4.earth_fixed(tables) and facts.body_T_antenna_position_m is None:
        return replace(track, quat_xyzw=np.tile([0.0, 0, 0, 1], (len(track), 1)))
    finding = "gives positions, but the log holds no attitude of the vehicle"
    gimbals = "" if facts.body_T_antenna_position_m else ", or a gimbal's attitude"
    rule = f"an IMU's orientation, a heading{gimbals}"
    raise InputError(table.channel.topic, finding, rule, "record the attitude too")


def _from_antenna(track: Track, facts: LogOptions) -> Track:
    """Positions of the body from those of its antenna, where that is said to lie off the body's origin."""
    if facts.body_T_antenna_position_m is None:
        return track
    arms, good = np.zeros((len(track), 3)), are_unit(track.quat_xyzw)
    arms[good] = Rotation.from_quat(track.quat_xyzw[good]).apply(facts.body_T_antenna_position_m)
    return replace(track, positions=track.positions - arms)


def _imu(tables: Sequence[Table], facts: LogOptions) -> Track | None:
    """The densest orientation of an IMU; REP-145 marks a missing one by a covariance of -1."""
    tracks = []
    for table in tables:
        if table.schema == IMU and len(table):
            good = are_unit(quats := table.stack(*_TURN)) & (
                table.vectors("orientation_covariance", 9)[:, 0] != -1
            )
            if good.mean() > 0.5:
                tracks.append(attitude_track(table, quats, facts, good))
    return max(tracks, key=len, default=None)


def undulation_m(lat_deg: float, lon_deg: float) -> tuple[float | None, str]:
    """Undulation of the geoid, m (EGM2008, else EGM96), and by which grid; None, and what is missing."""
    try:
        from pyproj import Transformer, network
        from pyproj.exceptions import ProjError
    except ImportError:
        return None, 'pip install "upplied[geoid]", and a grid of PROJ such as us_nga_egm96_15.tif'
    network.set_network_enabled(False)
    for grid in GRIDS:
        try:
            transformer = Transformer.from_pipeline(_PIPELINE.format(grid))
            height = transformer.transform((lon_deg + 180) % 360 - 180, lat_deg, 0.0, errcheck=True)[2]
        except ProjError:  # the grid is not here, or does not reach there
            continue
        return float(height), f"by the grid {grid}"
    return None, f"none of PROJ's grids {', '.join(GRIDS[:2])} is on this machine (projsync --file NAME)"
