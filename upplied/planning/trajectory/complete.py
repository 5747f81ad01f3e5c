"""A carried flight completed: safe, as much like the demonstrated one as asked, showing what it showed."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from upplied.config import FIDELITIES, Settings
from upplied.errors import RefusedError
from upplied.geometry.poses import fov_at, optical_axis, yaw_pitch
from upplied.planning.airspace.detours import Ways, airspace_of, route
from upplied.planning.carry.carried import Carried, Goal
from upplied.planning.carry.inspected_surface import InspectedSurface
from upplied.planning.demonstration.repetition import Take, begins_of, breaks_of, joined, steady_radps
from upplied.planning.trajectory.added_passes import Beside, Extended, Pace, pays
from upplied.planning.trajectory.flyable import Flyable, Result
from upplied.planning.trajectory.optimise import Optimised, Problem, optimise
from upplied.planning.trajectory.required import required_first
from upplied.planning.trajectory.retime import Timed, demonstrated_speed, retime
from upplied.planning.trajectory.sharpness import sharply_timed
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.terms.axis import axes
from upplied.planning.trajectory.terms.path import Shape
from upplied.planning.trajectory.view import ALIKE, Sight, View
from upplied.records import Bools, Floats, Waypoints

_LEAST_TURN_RAD = np.pi / 2  # that a demonstration counts as having turned: little turning is not dear
_LESS = 0.98  # of the time there is, for a path that is still to be optimised: that changes it by less
_SHORTENED = 5  # times, until passes are flown in time


def propose(carried: Sequence[Carried], settings: Settings) -> Timed:
    """The trajectory planned for one flight, or as many as the demonstration is to be repeated, target frame.

    Of its P poses it is told which are viewpoints (P,), to which time of the joined flights
    (`repetition.joined`) each corresponds (P,), s, and which are on added passes (P,). Refused if no path
    keeps what the settings demand.
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
    if goals and settings.retime.limits:
        inspected = InspectedSurface.together([goal.inspected for goal in goals])
        timed = sharply_timed(path, flight, takes, inspected, settings)
    else:
        timed = retime(path, flight, settings.retime, breaks_of(takes))
    planned = replace(timed.trajectory, fov_deg=fov_at(flight, timed.demonstrated_s))
    return timed._replace(trajectory=planned)


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


def completed(carried: Carried, goal: Goal, settings: Settings) -> Waypoints:
    """A carried flight made safe, and optimised for its own goal; refused if no path keeps the limits."""
    take, flown = carried.take, goal.flown
    inspection, pair = take.inspection, take.pair
    flight, airspace = inspection.flight, airspace_of(pair, settings)
    if goal.height_m is not None:
        airspace = airspace.in_plane(goal.height_m)
    ways = Ways(airspace, pair.obstacle)

    flyable = Flyable(carried, goal, settings, ways)
    axis = optical_axis(flight.quat_xyzw)
    turned = float(np.arccos(np.clip((axis[1:] * axis[:-1]).sum(axis=1), -1, 1)).sum())
    starts, view = _starts(carried, flyable.safe), _view(take, goal, settings)
    aside_rad = _aside(take, goal, view, settings)
    if take.required is not None:
        near, times = (starts[0], ways.planning, goal.standoff.usual_m), settings.optimise.required
        view = required_first(view, take.required, *near, times)
    problem = Problem(
        starts=starts,
        demonstrated=Shape.of(flown, goal.standing),
        view=view,
        standoff=goal.standoff,
        airspace=ways.planning,
        turned_rad=max(turned, _LEAST_TURN_RAD),
        aside_rad=aside_rad,
        level=settings.transfer.plane,
    )
    best = optimise(problem, FIDELITIES[settings.refine.fidelity].shape, settings.optimise)
    every, none = np.arange(len(flown)), np.zeros(len(flown), bool)
    limit_s = flyable.allowed_s(view, starts[0])
    alone = flyable.in_time(best, every, none, limit_s)
    if goal.standoff.in_metres and goal.height_m is None and settings.refine.added_passes:
        return _with_passes(problem, best, alone, flyable, limit_s)
    return alone.waypoints


def _with_passes(
    problem: Problem, best: Optimised, alone: Result, flyable: Flyable, limit_s: float
) -> Waypoints:
    """The flight with passes, in the time that there is, where what they show pays for the time they take."""
    if alone.worth(limit_s) + ALIKE > 1:
        return alone.waypoints
    settings, take, path = flyable.settings, flyable.carried.take, problem.starts[0]
    lanes = _pace(take, settings), _half_rad(take, settings), settings.refine.added_passes
    missed = problem.view.missed(alone.waypoints.positions, alone.waypoints.quat_xyzw)
    beside = Beside.of(path, problem.view, missed, flyable.ways, *lanes)
    try:
        longer = None if beside is None else _longer(beside, _LESS * limit_s - alone.taken_s, flyable)
        if longer is None:
            return alone.waypoints
        led = replace(best.path, positions=flyable.safe(best.path.positions))
        request = problem.along(longer.path, longer.origin, longer.added, led)
        result = optimise(request, FIDELITIES[settings.refine.fidelity].shape, settings.optimise)
        whole = flyable.in_time(result, longer.origin, longer.added, limit_s)
    except RefusedError:  # no safe way along the passes: the flight without them has one
        return alone.waypoints
    gain, taken_s = whole.worth(limit_s) - alone.worth(limit_s), whole.taken_s - alone.taken_s
    return (whole if pays(gain, taken_s, alone.taken_s) else alone).waypoints


def _longer(beside: Beside, spare_s: float, flyable: Flyable) -> Extended | None:
    """The carried flight with passes in so much time; None where there are none, refused if not safe."""
    # The pace knows neither bends nor sharp pictures: passes are shortened until the time is right.
    alone_s = flyable.seconds_of(Extended.alone(beside.path))
    wished_s = spare_s * beside.own_s / max(alone_s, 1e-3)
    for _ in range(_SHORTENED):
        longer = beside.with_passes(wished_s)
        if longer is None:
            return None
        longer = replace(longer, path=replace(longer.path, positions=flyable.safe(longer.path.positions)))
        taken_s = flyable.seconds_of(longer) - alone_s
        if taken_s <= spare_s:
            return longer
        wished_s = longer.passes_s * spare_s / taken_s
    return None


def _pace(take: Take, settings: Settings) -> Pace:
    """How fast the expert flew at each station, and how fast a turning camera is still sharp."""
    inspection, fastest = take.inspection, np.radians(settings.retime.max_yaw_rate_degps)
    speed_mps = demonstrated_speed(inspection.flight.t_s, inspection.flight, inspection.breaks)
    usual_mps = np.where(np.isfinite(speed_mps), speed_mps, 1.0)  # a flight may not move at all
    return Pace(usual_mps, min(fastest, steady_radps([take], settings.inspection)))


def _half_rad(take: Take, settings: Settings) -> float:
    """Half the angle across the flight within which a wall is shown as finely as asked."""
    camera, rule = take.inspection.camera, settings.inspection
    fine = float(np.arccos(np.sqrt(max(rule.planned_resolution, rule.least_resolution))))
    return min(fine, float(np.radians(min(camera.hfov_deg, camera.vfov_deg, 120.0))) / 2)


def _starts(carried: Carried, safe: Callable[[Floats], Floats]) -> list[Flown]:
    """The paths to start from that can be made safe; refused where none can, as the first is."""
    starts, refusals = [], []
    for path in (carried.path, *carried.others):
        yaw, pitch = yaw_pitch(path.quat_xyzw)
        try:
            starts.append(Flown(safe(path.positions), np.unwrap(yaw), pitch))
        except RefusedError as refusal:
            refusals.append(refusal)
    if not starts:
        raise refusals[0]
    return starts


def _view(take: Take, goal: Goal, settings: Settings) -> View:
    """What the target is to show: what was inspected."""
    wanted, inspection = goal.inspected, take.inspection
    return View(
        wanted.cloud,
        wanted.need / max(wanted.need.sum(), 1e-12),
        _farthest_m(wanted.standoff_m, wanted.need > 0, take, goal, settings),
        wanted.need > 0,
        inspection.camera,
        settings.visibility,
        settings.retime,
        take.pair.target_scene,
        inspection.flight.fov_deg,
    )


def _farthest_m(wanted_m: Floats, inspected: Bools, take: Take, goal: Goal, settings: Settings) -> Floats:
    """From where samples (N,) are resolved, m: inspected ones as from as near as they are wanted from."""
    rule, inspection = settings.inspection, take.inspection
    finer = rule.planned_resolution if goal.standoff.in_metres else 0.0
    resolved_m = np.where(inspected, wanted_m / max(finer, rule.least_resolution), np.inf)
    return np.minimum(
        resolved_m, inspection.camera.max_range_m * inspection.truly.coarseness.max(initial=1.0)
    )


def _aside(take: Take, goal: Goal, view: View, settings: Settings) -> Floats:
    """Angle (M,), rad, from the expert's optical axis to what was inspected; NaN where none was in sight."""
    # What was in sight is asked as it is of the plan's `view`: so on the demonstrated structure both agree.
    flight, cloud = take.inspection.flight, take.pair.surface.source
    need = take.inspection.attention.weight * cloud.areas
    theirs = replace(
        view,
        cloud=cloud,
        need=need / max(need.sum(), 1e-12),
        farthest_m=_farthest_m(goal.looked_m, need > 0, take, goal, settings),
        inspected=need > 0,
        scene=take.pair.source_scene,
    )
    path, unknown = Flown(flight.positions, *yaw_pitch(flight.quat_xyzw)), np.full(len(flight), np.nan)
    aims = Sight.of(path, theirs, *theirs.sampled(settings.optimise.samples), unknown).axis.aims
    return aims.angles(flight.positions, axes(path.yaw, path.pitch))
