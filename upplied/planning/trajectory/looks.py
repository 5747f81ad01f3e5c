"""Looks aside: where turning the camera far shows what no small change would, chosen greedily.

No term: the slope of the coverage is zero for what lies far outside of the picture, and which way to
look is a choice among separate directions. So the optimisation is given these as where to start from;
it then moves and shortens them, and takes out those that its other moves made superfluous.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.polylines import arc_length, chosen_evenly
from upplied.poses import from_yaw_pitch, matrices, wrapped
from upplied.records import Bools, Floats, Ints

_STATIONS = 160  # of the path from which looks are considered
_DIRECTIONS = 24  # at each
_INSIDE = 0.98  # of the field of view: well inside the picture
_TAKEN = 0.3  # of the way that a look takes, within which there is no other look
_LEAST = 1e-4  # share of the need, net of its price, that a look must add


def looks_aside(path: Flown, view: View, price_per_rad: float, way_m_per_rad: float) -> Flown:
    """The path with its camera turned aside where that shows more than it costs.

    Parameters
    ----------
    path : Flown
        M stations.
    view : View
    price_per_rad : float
        Share of the need that a turn by one radian must show.
    way_m_per_rad : float
        Metres that are flown while the camera turns by one radian.

    Returns
    -------
    Flown
        Each look is a tent over the way that turning there and back takes.
    """
    missed = view.missed(path.positions, from_yaw_pitch(path.yaw, path.pitch))
    stations = chosen_evenly(len(path), _STATIONS)
    reach = (
        view.reach(path.positions[stations], missed, station=stations)
        if len(missed)
        else np.zeros((len(stations), 0), bool)
    )
    if not reach.any():
        return path
    half = view.halves_rad(len(path))[stations]
    places = path.positions[stations]
    row, to_yaw, to_pitch, shows = directions(places, half, reach, missed, view, _DIRECTIONS)
    at = stations[row]
    aside_yaw = wrapped(to_yaw - path.yaw[at])
    aside_pitch = to_pitch - path.pitch[at]
    level = np.cos(path.pitch[at])
    along = arc_length(path.positions)
    yaw, pitch = np.zeros(len(path)), np.zeros(len(path))  # by which the camera is turned aside
    table, left = shows.astype(np.float32), np.array(view.need[missed], np.float32)
    open_ = np.ones(len(path), bool)
    limits = np.radians([view.limits.min_gimbal_pitch_deg, view.limits.max_gimbal_pitch_deg])
    while True:
        turn = np.hypot(level * (aside_yaw - yaw[at]), aside_pitch - pitch[at])
        net = np.where(open_[at], table @ left - 2 * price_per_rad * turn, -1.0)
        best = int(np.argmax(net))
        if net[best] <= _LEAST:
            low, high = np.minimum(limits[0], path.pitch), np.maximum(limits[1], path.pitch)
            return Flown(path.positions, path.yaw + yaw, np.clip(path.pitch + pitch, low, high))
        left[shows[best]] = 0.0
        station = at[best]
        way_m = max(way_m_per_rad * float(turn[best]), 1e-6)
        apart = np.abs(along - along[station])
        tent = np.clip(1 - apart / way_m, 0, 1)
        yaw += tent * (aside_yaw[best] - yaw[station])
        pitch += tent * (aside_pitch[best] - pitch[station])
        open_ &= apart > _TAKEN * way_m


def directions(
    places: Floats, half_rad: Floats, reach: Bools, missed: Ints, view: View, most: int
) -> tuple[Ints, Floats, Floats, Bools]:
    """Directions worth trying from places (P, 3), and which of the missed samples each shows.

    From each place that reaches any: towards the middle of what it reaches, and towards at most `most`
    single samples; `half_rad` (P, 2) is half the field of view there. Returns for each its place (C,),
    yaw and pitch (C,), and (C, m) what it shows.
    """
    points, need = view.cloud.points[missed], view.need[missed]
    rows, aims = [], []
    for place in np.flatnonzero(reach.any(axis=1)):
        hit = np.flatnonzero(reach[place])
        count = min(most, len(hit))
        chosen = hit[np.arange(count) * (len(hit) - 1) // max(count - 1, 1)]
        middle = (need[hit, None] * points[hit]).sum(axis=0) / need[hit].sum()
        aims += [middle[None], points[chosen]]
        rows.append(np.full(1 + count, place))
    row = np.concatenate(rows)
    towards = np.concatenate(aims) - places[row]
    yaw = np.arctan2(towards[:, 1], towards[:, 0])
    pitch = np.arctan2(towards[:, 2], np.hypot(towards[:, 0], towards[:, 1]))
    low, high = np.radians([view.limits.min_gimbal_pitch_deg, view.limits.max_gimbal_pitch_deg])
    pitch = np.clip(pitch, low, high)
    half = half_rad[row]
    axes = matrices(from_yaw_pitch(yaw, pitch))
    round_ = half[:, 0] >= np.pi / 2
    return row, yaw, pitch, _in_picture(places, row, axes, points, reach, half * _INSIDE, round_)


@njit(cache=True)
def _in_picture(
    places: Floats, row: Ints, axes: Floats, points: Floats, reach: Bools, half: Floats, round_: Bools
) -> Bools:
    """Which of the points in reach fall into the picture of each orientation, (C, m)."""
    shown = np.zeros((len(row), len(points)), np.bool_)
    for index in range(len(row)):
        place, turn = places[row[index]], axes[index]
        for sample in range(len(points)):
            if not reach[row[index], sample]:
                continue
            x, y, z = 0.0, 0.0, 0.0
            for axis in range(3):
                ray = points[sample, axis] - place[axis]
                x += turn[axis, 0] * ray
                y += turn[axis, 1] * ray
                z += turn[axis, 2] * ray
            forward = np.hypot(x, y) if round_[index] else x
            across, up = abs(np.arctan2(y, x)), abs(np.arctan2(z, forward))
            shown[index, sample] = across <= half[index, 0] and up <= half[index, 1]
    return shown
