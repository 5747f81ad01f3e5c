"""Poses of ROS 2, ROS 1 and Foxglove's schemas, and velocity, turn rates and wind beside them.

ROS and MAVROS have ENU and x forward, y left, z up (REP-103, REP-105); Foxglove states no axes and is read
alike. PX4 and ArduPilot log the wind to north and east, MAVROS a twist (`wind_estimation`).
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from upplied.inputs.flight import tracks
from upplied.inputs.flight.tracks import Track, pose_track, source_times
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Floats, Ints
from upplied.records.flights import LoggedWind

_SHAPES, _FIELDS = tracks.shapes_of("ros"), tracks.fields_of("ros")
SOURCES = tuple(_SHAPES)
IMU = "sensor_msgs/Imu"
_MOTION, _INERTIAL = _FIELDS["nav_msgs/Odometry"][-6:], _FIELDS[IMU][-6:]
_GRAVITY_MPS2 = (6.0, 14.0)  # mean of an accelerometer: others had it taken out, or are none
_EAST_NORTH = tracks.fields_of("wind")
_MOST_MPS = 60.0  # a hurricane: an estimate of the wind beyond has diverged


def samples(table: Table, tables: Sequence[Table], facts: LogOptions) -> Track:
    """The poses of one channel."""
    return pose_track(table, _SHAPES[table.schema], facts.publisher)


def velocity(tables: Sequence[Table], topic: str) -> tuple[Ints, Floats] | None:
    """When (N,), ns, and velocities (N, 6), m/s and rad/s, of the densest odometry of a topic, or None."""
    table = max((each for each in tables if each.channel.topic == topic), key=len, default=None)
    if table is None or _MOTION[0] not in table or not len(table):
        return None
    motion = table.stack(*_MOTION)
    good = np.isfinite(motion).all(axis=1)
    return (source_times(table)[0][good], motion[good]) if motion[good].any() else None


def turning(tables: Sequence[Table]) -> list[tuple[Ints, Floats]]:
    """When (N,), ns, and turn (N,), rad/s, of each inertial unit, counter-clockwise about felt vertical."""
    units = []
    for table in tables:
        if table.schema != IMU or not len(table) or any(path not in table for path in _INERTIAL):
            continue
        felt = table.stack(*_INERTIAL)
        good = np.isfinite(felt).all(axis=1)
        t_ns, felt = source_times(table)[0][good], felt[good]
        length = np.linalg.norm(felt[:, 3:], axis=1)
        if not len(felt) or not felt[:, :3].any() or not _GRAVITY_MPS2[0] < length.mean() < _GRAVITY_MPS2[1]:
            continue
        order = np.argsort(t_ns, kind="stable")
        rate = 1e9 * (len(t_ns) - 1) / max(int(t_ns[order[-1]] - t_ns[order[0]]), 1)
        up = uniform_filter1d(felt[order, 3:], max(round(rate), 1), axis=0, mode="nearest")
        up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-9)
        about = uniform_filter1d((felt[order, :3] * up).sum(axis=1), max(round(rate / 2), 1), mode="nearest")
        units.append((t_ns[order], about))
    return units


def wind_of(tables: Sequence[Table], track: Track, heading_deg: float | None) -> LoggedWind | None:
    """The wind while a track was logged, None without; whereto only by the heading, clockwise from north."""
    usable = []
    for table in tables:
        topic = table.channel.topic  # a twist tells of a vehicle, unless it is named for the wind
        if table.schema not in _EAST_NORTH or (table.schema[:4] == "geom" and "wind" not in topic.lower()):
            continue
        air = table.stack(*_EAST_NORTH[table.schema])
        speed = np.linalg.norm(air, axis=1)
        good = (table.log_ns >= track.log_ns.min()) & (table.log_ns <= track.log_ns.max())
        good &= np.isfinite(speed) & (speed <= _MOST_MPS)
        if (speed[good] > 0).any():  # an estimate that never began is zero
            usable.append((int(good.sum()), topic, air[good]))
    if not usable:
        return None
    _, topic, air = max(usable, key=lambda each: each[:2])
    speed, mean = np.linalg.norm(air, axis=1), air.mean(axis=0)
    bearing = np.degrees(np.arctan2(mean[0], mean[1]))
    towards = None if heading_deg is None else float((heading_deg - bearing) % 360.0)
    return LoggedWind(topic, float(speed.mean()), float(speed.max()), towards)
