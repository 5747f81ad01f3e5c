"""PX4 by uXRCE-DDS: odometry, or local position joined with attitude.

PX4 says north, east, down and forward, right, down, quaternions w x y z, microseconds. Turned to
east, north, up and forward, left, up here. Fields differ by firmware: what is read is what the
schema in the log says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.inputs.flight.clean import attitude_track
from upplied.inputs.flight.tracks import Track, are_unit, at_times, source_times
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Bools, Floats, Ints

SOURCES = ("px4_msgs/VehicleOdometry", "px4_msgs/VehicleLocalPosition")

_HALF = np.sqrt(0.5)
NED_R_ENU = Rotation.from_quat([_HALF, _HALF, 0, 0])  # its own inverse
FRD_R_FLU = Rotation.from_quat([1, 0, 0, 0])
_NED, _FRD = 1, 2  # VehicleOdometry.pose_frame
_OTHER_FRAME = "pose frame not stated, or another than before"


def samples(table: Table, tables: Sequence[Table], facts: LogOptions) -> Track:
    """The poses of one channel, in ENU (or another frame with z up) and FLU.

    Raises InputError if there is no attitude to a position, or the frame of the poses is not stated.
    """
    if table.schema == "px4_msgs/VehicleOdometry":
        return _odometry(table)
    track, turns = _local(table), attitude(tables, facts)
    if turns is None:
        finding = "has no attitude, and the log holds no px4_msgs/VehicleAttitude"
        remedy = "record vehicle_attitude, or vehicle_odometry, too"
        raise InputError(table.channel.topic, finding, "position and attitude", remedy)
    return with_attitude(track, turns, facts)


def attitude(tables: Sequence[Table], facts: LogOptions) -> Track | None:
    """The attitude of the vehicle, FLU in ENU, clean; None where the log has none."""
    attitudes = [table for table in tables if table.schema == "px4_msgs/VehicleAttitude" and len(table)]
    if not attitudes:
        return None
    table = max(attitudes, key=len)
    epoch = table.integers("quat_reset_counter")
    return attitude_track(table, stamps_us(table), enu_flu(xyzw(table)), facts, epoch=epoch)


def with_attitude(track: Track, turns: Track, facts: LogOptions) -> Track:
    """A track of positions with the attitude of the same moments, interpolated on the sphere."""
    _, quats = at_times(turns, track.t_ns, facts.gap_s)
    return replace(track, quat_xyzw=quats).during(np.isfinite(quats[:, 0]), "attitude")


def stamps_us(table: Table) -> tuple[Ints, str]:
    """Stamps (N,) in ns and their clock: when sampled, else when published by the autopilot."""
    for name in ("timestamp_sample", "timestamp"):
        times = table.integers(name).clip(0, 9 * 10**15) * 1000
        if times.any():
            return source_times(table, times)
    return source_times(table, None)


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
    times, clock = stamps_us(table)
    positions, quats, frame = table.vectors("position", 3), xyzw(table), table.integers("pose_frame")
    epoch = table.integers("reset_counter")
    track = Track(times, positions, quats, table.log_ns, "", "base_link", clock, epoch)
    if np.count_nonzero(frame == _NED) >= len(frame) / 2:
        track = replace(track, positions=_enu(positions), quat_xyzw=enu_flu(quats))
        return track.keep(frame == _NED, _OTHER_FRAME)
    track = replace(
        track,
        positions=positions * (1.0, -1.0, -1.0),
        quat_xyzw=turned(FRD_R_FLU, quats, FRD_R_FLU),
        notes=("the heading of the log's frame is arbitrary (PX4 frame FRD)",),
    )
    return track.keep(frame == _FRD, _OTHER_FRAME)


def _local(table: Table) -> Track:
    times, clock = stamps_us(table)
    nothing = np.full((len(table), 4), np.nan)
    epoch = (table.integers("xy_reset_counter") << 8) + table.integers("z_reset_counter")
    ned = table.stack("x", "y", "z")
    track = Track(times, _enu(ned), nothing, table.log_ns, "", "base_link", clock, epoch)
    return track.during(flag(table, "xy_valid") & flag(table, "z_valid"), "valid position")


def _enu(ned: Floats) -> Floats:
    return np.asarray(ned[:, [1, 0, 2]] * (1.0, 1.0, -1.0))
