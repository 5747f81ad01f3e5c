"""Attitude of a gimbal: MAVLink's GIMBAL_DEVICE_ATTITUDE_STATUS as PX4 and MAVROS publish it.

The gimbal's frame is forward, right, down. Its yaw counts from north or from the heading of the
vehicle, by the flags; pitch and roll always count from the horizon.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.geometry.poses import yaw_pitch
from upplied.inputs.flight.clean import attitude_track
from upplied.inputs.flight.tracks import Track, at_times, fields_of, source_times, stamps
from upplied.inputs.schemas import px4
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Bools, Floats

_SCHEMAS = fields_of("gimbal")
_YAW_LOCK, _YAW_IN_VEHICLE, _YAW_IN_EARTH = 16, 32, 64


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
            return px4.enu_flu(quats)
        level = px4.turned(px4.FRD_R_FLU, quats, px4.FRD_R_FLU)
        heading = Rotation.from_euler("z", yaw_pitch(body.quat_xyzw)[0][:, None])
        known = np.isfinite(level[:, 0])
        level[known] = (heading[known] * Rotation.from_quat(level[known])).as_quat()
        return level


def gimbal(tables: Sequence[Table], facts: LogOptions) -> Gimbal | None:
    """The gimbal of a log; None where it has none. Of several, the one that reports most often."""
    gimbals = [table for table in tables if table.schema in _SCHEMAS and len(table) > 1]
    if not gimbals:
        return None
    table = max(gimbals, key=len)
    if table.schema.startswith("px4"):
        times, quats = px4.stamps_us(table), px4.xyzw(table)
    else:
        times = source_times(table, stamps(table, "header.stamp"))
        quats = table.stack("q.x", "q.y", "q.z", "q.w")
    north = _from_north(table)
    most = bool(north.mean() >= 0.5)
    return Gimbal(attitude_track(table, times, quats, facts, north == most), most, table.channel.topic)


def earth_fixed(tables: Sequence[Table]) -> bool:
    """Whether a gimbal in the log holds its orientation without the vehicle's."""
    gimbals = [table for table in tables if table.schema in _SCHEMAS and len(table) > 1]
    return any(_from_north(table).mean() >= 0.5 for table in gimbals)


def _from_north(table: Table) -> Bools:
    name = "device_flags" if "device_flags" in table else "flags"
    flags = table.integers(name)
    stated = (flags & (_YAW_IN_VEHICLE | _YAW_IN_EARTH)) != 0
    return np.where(stated, (flags & _YAW_IN_EARTH) != 0, (flags & _YAW_LOCK) != 0)
