"""PX4 by uXRCE-DDS: odometry, or local position with attitude; and gimbals, as MAVROS has them too.

Turned here from north, east, down and forward, right, down (quaternions w x y z, microseconds). The yaw of a
gimbal (MAVLink's GIMBAL_DEVICE_ATTITUDE_STATUS) counts from north or the vehicle's heading, by its flags.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.geometry.poses import yaw_pitch
from upplied.inputs.flight.clean import attitude_track
from upplied.inputs.flight.tracks import Track, are_unit, at_times, fields_of, source_times
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Bools, Floats

SOURCES = ("px4_msgs/VehicleOdometry", "px4_msgs/VehicleLocalPosition")

_HALF = np.sqrt(0.5)
NED_R_ENU = Rotation.from_quat([_HALF, _HALF, 0, 0])  # its own inverse
FRD_R_FLU = Rotation.from_quat([1, 0, 0, 0])
_NED, _FRD = 1, 2  # VehicleOdometry.pose_frame
_OTHER_FRAME = "pose frame not stated, or another than before"
_GIMBALS = fields_of("gimbal")
_YAW_LOCK, _YAW_IN_VEHICLE, _YAW_IN_EARTH = 16, 32, 64


def samples(table: Table, tables: Sequence[Table], facts: LogOptions) -> Track:
    """The poses of one channel, in ENU (or another frame with z up) and FLU; InputError without attitude."""
    if table.schema == "px4_msgs/VehicleOdometry":
        return _odometry(table)
    if (turns := attitude(tables, facts)) is None:
        finding = "has no attitude, and the log holds no px4_msgs/VehicleAttitude"
        remedy = "record vehicle_attitude, or vehicle_odometry, too"
        raise InputError(table.channel.topic, finding, "position and attitude", remedy)
    times, clock = source_times(table)
    epoch = (table.integers("xy_reset_counter") << 8) + table.integers("z_reset_counter")
    places, nothing = _enu(table.stack("x", "y", "z")), np.full((len(table), 4), np.nan)
    track = Track(times, places, nothing, table.log_ns, "", "base_link", clock, epoch)
    track = track.during(flag(table, "xy_valid") & flag(table, "z_valid"), "valid position")
    return with_attitude(track, turns, facts)


def attitude(tables: Sequence[Table], facts: LogOptions) -> Track | None:
    """The attitude of the vehicle, FLU in ENU, clean; None where the log has none."""
    attitudes = [table for table in tables if table.schema == "px4_msgs/VehicleAttitude" and len(table)]
    if (table := max(attitudes, key=len, default=None)) is None:
        return None
    every, epoch = np.ones(len(table), bool), table.integers("quat_reset_counter")
    return attitude_track(table, enu_flu(xyzw(table)), facts, every, epoch)


def with_attitude(track: Track, turns: Track, facts: LogOptions) -> Track:
    """A track of positions with the attitude of the same moments, interpolated on the sphere."""
    _, quats = at_times(turns, track.t_ns, facts.gap_s)
    return replace(track, quat_xyzw=quats).during(np.isfinite(quats[:, 0]), "attitude")


def xyzw(table: Table) -> Floats:
    """Quaternions (N, 4) ``x y z w`` from the field ``q``, which is ``w x y z``."""
    return table.vectors("q", 4)[:, [1, 2, 3, 0]]


def flag(table: Table, name: str) -> Bools:
    """A flag of each sample (N,); set where the messages do not have it."""
    return np.asarray(table.integers(name) != 0) if name in table else np.ones(len(table), bool)


def enu_flu(ned_frd_xyzw: Floats) -> Floats:
    """Orientations FRD in NED to FLU in ENU; NaN and wrong lengths are passed on."""
    return turned(NED_R_ENU, ned_frd_xyzw, FRD_R_FLU)


def turned(left: Rotation, quats: Floats, right: Rotation) -> Floats:
    """``left * q * right`` for each quaternion (N, 4) that is one; the others as they are."""
    good, result = are_unit(quats), np.array(quats)
    if good.any():
        result[good] = (left * Rotation.from_quat(quats[good]) * right).as_quat()
    return result


def _odometry(table: Table) -> Track:
    times, clock = source_times(table)
    positions, quats, frame = table.vectors("position", 3), xyzw(table), table.integers("pose_frame")
    ned = np.count_nonzero(frame == _NED) >= len(frame) / 2
    notes = () if ned else ("the heading of the log's frame is arbitrary (PX4 frame FRD)",)
    positions = _enu(positions) if ned else positions * (1.0, -1.0, -1.0)
    quats = enu_flu(quats) if ned else turned(FRD_R_FLU, quats, FRD_R_FLU)
    epoch = table.integers("reset_counter")
    track = Track(times, positions, quats, table.log_ns, "", "base_link", clock, epoch, notes=notes)
    return track.keep(frame == (_NED if ned else _FRD), _OTHER_FRAME)


def _enu(ned: Floats) -> Floats:
    return np.asarray(ned[:, [1, 0, 2]] * (1.0, 1.0, -1.0))


@dataclass(frozen=True)
class Gimbal:
    """Attitude of a gimbal, forward, right, down, from north or from the vehicle's heading."""

    track: Track
    from_north: bool
    topic: str

    def orientations(self, body: Track, gap_s: float) -> Floats:
        """Orientation (N, 4) of the gimbal, x forward, y left, z up, in the body's ENU frame; NaN in gaps."""
        _, quats = at_times(self.track, body.t_ns, gap_s)
        if self.from_north:
            return enu_flu(quats)
        level = turned(FRD_R_FLU, quats, FRD_R_FLU)
        heading = Rotation.from_euler("z", yaw_pitch(body.quat_xyzw)[0][:, None])
        known = np.isfinite(level[:, 0])
        level[known] = (heading[known] * Rotation.from_quat(level[known])).as_quat()
        return level


def gimbal(tables: Sequence[Table], facts: LogOptions) -> Gimbal | None:
    """The gimbal of a log; None where it has none. Of several, the one that reports most often."""
    if (table := max(_gimbals(tables), key=len, default=None)) is None:
        return None
    quats = xyzw(table) if "q" in table else table.stack("q.x", "q.y", "q.z", "q.w")
    most = bool((north := _from_north(table)).mean() >= 0.5)
    return Gimbal(attitude_track(table, quats, facts, north == most), most, table.channel.topic)


def earth_fixed(tables: Sequence[Table]) -> bool:
    """Whether a gimbal in the log holds its orientation without the vehicle's."""
    return any(_from_north(table).mean() >= 0.5 for table in _gimbals(tables))


def _gimbals(tables: Sequence[Table]) -> list[Table]:
    return [table for table in tables if table.schema in _GIMBALS and len(table) > 1]


def _from_north(table: Table) -> Bools:
    flags = table.integers("device_flags" if "device_flags" in table else "flags")
    stated = (flags & (_YAW_IN_VEHICLE | _YAW_IN_EARTH)) != 0
    return np.where(stated, (flags & _YAW_IN_EARTH) != 0, (flags & _YAW_LOCK) != 0)
