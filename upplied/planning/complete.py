"""The carried flight made safe and completed until it sees what it should (preset `recommended`)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from upplied.planning.look import Looks, View, bend, find_detours, find_looks
from upplied.records import Bools, Floats, Waypoints

_ROUNDS = 3  # bends of the path; each leaves less to see, and two suffice on most structures


def complete(
    path: Waypoints,
    view: View,
    standoff_m: float,
    safe: Callable[[Floats], Floats],
    allowed: Callable[[Floats], Bools],
) -> Waypoints:
    """Route, turn and bend the path until nothing worth a turn is missed.

    Parameters
    ----------
    path : Waypoints
        The carried flight, target frame.
    view : View
        What is to be seen, and by which camera.
    standoff_m : float
        Usual distance from the surface, m, at which detours are looked for.
    safe : callable
        Takes positions (M, 3), gives as many that keep the safety distance, also between them.
    allowed : callable
        Takes positions (K, 3), gives (K,) bool: where the vehicle may be.

    Returns
    -------
    Waypoints
        With a further waypoint for each turn of the camera, flagged as viewpoint.
    """
    positions = safe(path.positions)
    for _ in range(_ROUNDS):
        covered = view.seen(positions, path.quat_xyzw).any(axis=0)
        looks = find_looks(positions, path.quat_xyzw, covered, view)
        covered |= view.seen(positions[looks.station], looks.quat_xyzw).any(axis=0)
        detours = find_detours(positions, covered, view, standoff_m, allowed)
        if len(detours.station) == 0:
            return with_looks(path, positions, looks)
        positions = safe(bend(positions, detours))
    covered = view.seen(positions, path.quat_xyzw).any(axis=0)
    return with_looks(path, positions, find_looks(positions, path.quat_xyzw, covered, view))


def with_looks(path: Waypoints, positions: Floats, looks: Looks) -> Waypoints:
    """The path at these positions, with each turn of the camera as a waypoint after its station."""
    after = np.asarray(looks.station) + 1
    return Waypoints(
        positions=np.insert(positions, after, positions[looks.station], axis=0),
        quat_xyzw=np.insert(path.quat_xyzw, after, looks.quat_xyzw, axis=0),
        t_s=np.insert(path.t_s, after, path.t_s[looks.station]),
        is_viewpoint=np.insert(path.is_viewpoint, after, True),
    )
