"""The wind in a log, beside its poses: the autopilot's estimate.

PX4 and ArduPilot log how fast the air moves to the north and to the east; MAVROS publishes a twist in east,
north and up (its plugin `wind_estimation`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.inputs.flight.tracks import Track, fields_of
from upplied.inputs.tables import Table
from upplied.records.flights import LoggedWind

_EAST_NORTH = fields_of("wind")
_NAMED = "wind"  # in the topic of a twist: others tell of a vehicle
_MOST_MPS = 60.0  # a hurricane: an estimate beyond has diverged


def wind_of(tables: Sequence[Table], track: Track, heading_deg: float | None) -> LoggedWind | None:
    """The wind while the poses of a track were logged; None where the log holds none.

    Without the heading of the structure's +X, clockwise from north, where it blows to is not known.
    """
    usable = []
    for table in tables:
        if table.schema not in _EAST_NORTH or not len(table):
            continue
        if table.schema.startswith("geometry_msgs") and _NAMED not in table.channel.topic.lower():
            continue
        air = table.stack(*_EAST_NORTH[table.schema])
        during = (table.log_ns >= track.log_ns.min()) & (table.log_ns <= track.log_ns.max())
        speed = np.linalg.norm(air, axis=1)
        good = during & np.isfinite(speed) & (speed <= _MOST_MPS)
        if good.any() and (speed[good] > 0).any():  # an estimate that never began is zero
            usable.append((int(good.sum()), table.channel.topic, air[good]))
    if not usable:
        return None
    _, topic, air = max(usable, key=lambda each: each[:2])
    speed, mean = np.linalg.norm(air, axis=1), air.mean(axis=0)
    bearing = np.degrees(np.arctan2(mean[0], mean[1]))
    towards = None if heading_deg is None else float((heading_deg - bearing) % 360.0)
    return LoggedWind(topic, float(speed.mean()), float(speed.max()), towards)
