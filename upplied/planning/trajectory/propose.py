"""From the carried flight to a timed trajectory on the target (paper, Alg. 2, lines 17 and 18)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from upplied.config import Settings
from upplied.geometry.poses import fov_at
from upplied.planning.airspace.detours import Ways, airspace_of, route
from upplied.planning.carry.carried import Carried
from upplied.planning.carry.inspected_surface import InspectedSurface
from upplied.planning.demonstration.repetition import Take, begins_of, breaks_of, joined
from upplied.planning.trajectory.complete import completed
from upplied.planning.trajectory.retime import retime
from upplied.planning.trajectory.sharpness import sharply_timed
from upplied.records import Bools, Floats, Trajectory, Waypoints


def propose(carried: Sequence[Carried], settings: Settings) -> tuple[Trajectory, Bools, Floats, Bools]:
    """The planned trajectory, which of its poses are viewpoints, and the demonstration's times.

    Parameters
    ----------
    carried : sequence of Carried
        One, or as many as the demonstration is to be repeated.
    settings : Settings

    Returns
    -------
    Trajectory
        P poses, target frame.
    array of bool, shape (P,)
        Which of them are viewpoints.
    array, shape (P,), s
        The time of the joined flights (`repetition.joined`) that each corresponds to.
    array of bool, shape (P,)
        Which of them are on passes added to the demonstrated ones.

    Raises
    ------
    RefusedError
        If no path keeps what the settings demand.
    """
    takes = [one.take for one in carried]
    flight = joined([take.inspection.flight for take in takes])
    paths = [one.path if one.goal is None else completed(one, one.goal, settings) for one in carried]
    paths = _in_joined_times(paths, takes)
    if len(takes) > 1:
        pair = takes[0].pair
        paths = _with_transits(paths, Ways(airspace_of(pair, settings), pair.obstacle))
    path = Waypoints.stacked(paths)
    goals = [one.goal for one in carried if one.goal is not None]
    if not goals or not settings.retime.limits:
        return _zooming(flight, *retime(path, flight, settings.retime, breaks_of(takes)))
    inspected = InspectedSurface.together([goal.inspected for goal in goals])
    return _zooming(flight, *sharply_timed(path, flight, takes, inspected, settings))


def _zooming(
    flight: Trajectory, planned: Trajectory, is_viewpoint: Bools, demonstrated_s: Floats, added: Bools
) -> tuple[Trajectory, Bools, Floats, Bools]:
    """The same, zooming as the demonstration did at the moments that the poses correspond to."""
    return replace(planned, fov_deg=fov_at(flight, demonstrated_s)), is_viewpoint, demonstrated_s, added


def _in_joined_times(paths: Sequence[Waypoints], takes: Sequence[Take]) -> list[Waypoints]:
    """The paths of several takes in the times of the joined flight."""
    begins = begins_of([take.inspection.flight for take in takes])
    return [
        replace(path, t_s=path.t_s - take.inspection.flight.t_s[0] + begin)
        for path, take, begin in zip(paths, takes, begins, strict=True)
    ]


def _with_transits(paths: Sequence[Waypoints], ways: Ways) -> list[Waypoints]:
    """The paths, and between them safe ways from the end of each to the start of the next."""
    whole = [paths[0]]
    for before, after in itertools.pairwise(paths):
        ends = Waypoints.stacked([before.rows(slice(-1, None)), after.rows(slice(1))])
        transit = route(replace(ends, is_viewpoint=np.zeros(2, bool)), ways)
        whole += [transit.rows(slice(1, -1)), after]
    return whole
