"""How inertial units turn, as a witness beside the poses of a log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from upplied.inputs.flight.tracks import source_times, stamps
from upplied.inputs.tables import Table
from upplied.records import Floats, Ints

IMU = "sensor_msgs/Imu"
FELT = tuple(f"{part}.{axis}" for part in ("angular_velocity", "linear_acceleration") for axis in "xyz")
_GRAVITY_MPS2 = (6.0, 14.0)  # mean of what an accelerometer feels: others had it taken out, or are none


def turning(tables: Sequence[Table]) -> list[tuple[str, Ints, Floats]]:
    """Of each inertial unit its topic, when (N,), ns, and how fast it turns about the vertical (N,), rad/s.

    The accelerometer tells the vertical, so how the unit is mounted does not count. Counter-clockwise from
    above.
    """
    found = []
    for table in tables:
        if table.schema != IMU or not len(table):
            continue
        if any(path not in table for path in FELT):
            continue
        felt = table.stack(*FELT)
        good = np.isfinite(felt).all(axis=1)
        t_ns, felt = source_times(table, stamps(table, "header.stamp"))[0][good], felt[good]
        length = np.linalg.norm(felt[:, 3:], axis=1)
        if not len(felt) or not felt[:, :3].any() or not _GRAVITY_MPS2[0] < length.mean() < _GRAVITY_MPS2[1]:
            continue
        order = np.argsort(t_ns, kind="stable")
        rate = 1e9 * (len(t_ns) - 1) / max(int(t_ns[order[-1]] - t_ns[order[0]]), 1)
        up = uniform_filter1d(felt[order, 3:], max(round(rate), 1), axis=0, mode="nearest")
        up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-9)
        about = uniform_filter1d((felt[order, :3] * up).sum(axis=1), max(round(rate / 2), 1), mode="nearest")
        found.append((table.channel.topic, t_ns[order], about))
    return found
