"""A carried flight completed: safe, as much like the demonstrated one as asked, showing what it showed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from upplied.config import FIDELITIES, Settings
from upplied.errors import RefusedError
from upplied.geometry.polylines import interpolated
from upplied.geometry.poses import from_yaw_pitch, optical_axis, yaw_pitch
from upplied.planning.airspace.detours import Ways, airspace_of, safe_positions
from upplied.planning.carry.carried import Carried, Goal
from upplied.planning.demonstration.repetition import Take, steady_radps
from upplied.planning.geometry.frechet import frechet_floored
from upplied.planning.trajectory.added_passes import PRICES, Beside, Extended, Pace
from upplied.planning.trajectory.optimise import Optimised, Problem, Start, optimise
from upplied.planning.trajectory.required import required_first
from upplied.planning.trajectory.retime import demonstrated_speed
from upplied.planning.trajectory.sharpness import sharply_timed
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.terms.axis import aims, angles
from upplied.planning.trajectory.terms.path import Shape
from upplied.planning.trajectory.view import View
from upplied.records import Bools, Floats, Ints, Record, Waypoints

_STEP_M = 0.5  # largest leg of the result
_LEAST_TURN_RAD = (
    np.pi / 2
)  # that a demonstration counts as having turned, so that little turning is not dear
_HALVINGS = 20  # of the way to the demonstrated shape
_WORTHWHILE = 0.01  # share of the need, that added passes must show more: as near as coverage is known
_LESS = 0.98  # of the time there is, for a path that is still to be optimised: that changes it by less
_TRIES = 2  # of adding passes: fewer, where they take too long
_SHORTENED = 5  # times, until passes are flown in time
_DRAWN_BACK = 5  # paths between the start and the result, of which the farthest in time is flown


def completed(carried: Carried, goal: Goal, settings: Settings) -> Waypoints:
    """A carried flight made safe, and optimised.

    Parameters
    ----------
    carried : Carried
    goal : Goal
        Its own.
    settings : Settings

    Returns
    -------
    Waypoints
        Every leg keeps the rules.

    Raises
    ------
    RefusedError
        If no safe path is found, or none within the departure from the demonstrated shape that
        `refine.deviation` allows.
    """
    take, flown = carried.take, goal.flown
    inspection, pair = take.inspection, take.pair
    flight, airspace = inspection.flight, airspace_of(pair, settings)
    if goal.height_m is not None:
        airspace = airspace.in_plane(goal.height_m)
    ways = Ways(airspace, pair.obstacle)

    way = _Flight(carried, goal, settings, ways)
    axis = optical_axis(flight.quat_xyzw)
    turned = float(np.arccos(np.clip((axis[1:] * axis[:-1]).sum(axis=1), -1, 1)).sum())
    starts, view = _starts(carried, way.safe), _view(take, goal, settings)
    if take.required is not None:
        times = settings.optimise.required
        view = required_first(
            view, take.required, starts[0].safe, ways.planning, goal.standoff.usual_m, times
        )
    problem = Problem(
        starts=starts,
        demonstrated=Shape.of(flown, goal.standing),
        view=view,
        standoff=goal.standoff,
        airspace=ways.planning,
        speed_mps=_finite(demonstrated_speed(flight.t_s, flight, inspection.breaks)),
        turned_rad=max(turned, _LEAST_TURN_RAD),
        pan_radps=min(
            np.radians(settings.retime.max_yaw_rate_degps), steady_radps([take], settings.inspection)
        ),
        aside_rad=_aside(take),
        level=settings.transfer.plane,
    )
    best = optimise(problem, FIDELITIES[settings.refine.fidelity].shape, settings.optimise)
    every, none = np.arange(len(flown)), np.zeros(len(flown), bool)
    limit_s = way.allowed_s(view)
    alone = way.in_time(best, every, none, limit_s)
    if alone is None:  # no part of it is flown in time: what is carried takes longer already
        alone = best.shown, way.finished(best, every, none)
    if goal.standoff.in_metres and goal.height_m is None and settings.refine.added_passes:
        return _with_passes(problem, best, alone, way, limit_s)
    return alone[1]


def _with_passes(
    problem: Problem, best: Optimised, alone: tuple[float, Waypoints], flight: _Flight, limit_s: float
) -> Waypoints:
    """The flight with passes added, where they show more than it does alone in the time that there is."""
    least, settings = alone[0] + _WORTHWHILE, flight.settings
    if least > 1:
        return alone[1]
    path, pace = problem.starts[0].safe, Pace(problem.speed_mps, problem.pan_radps)
    half_rad = _half_rad(flight.carried.take, settings)
    beside = Beside.of(path, problem.view, flight.ways, pace, half_rad)
    if beside is None:
        return alone[1]
    results, most_s, longer = [], _LESS * limit_s, None
    for _ in range(_TRIES):
        try:
            longer = _longer(beside, most_s, flight.seconds_of(beside.alone), flight, longer)
            if longer is None:
                break
            request = problem.along(longer.path, longer.origin, longer.added, best.path)
            result = optimise(request, FIDELITIES[settings.refine.fidelity].shape, settings.optimise)
            if result.shown < least:
                break
            taken_s = flight.seconds(flight.finished(result, longer.origin, longer.added))
            results.append(flight.in_time(result, longer.origin, longer.added, limit_s))
        except RefusedError:  # no safe way along the passes: the flight without them has one
            break
        if taken_s <= limit_s:
            break
        most_s -= taken_s - _LESS * limit_s
    shown, waypoints = max((one for one in results if one), key=lambda one: one[0], default=alone)
    return waypoints if shown >= least else alone[1]


def _longer(
    beside: Beside, most_s: float, alone_s: float, flight: _Flight, before: Extended | None
) -> Extended | None:
    """The carried flight with passes that are flown in at most so much time; None where there are none.

    The pace knows neither bends nor sharp pictures: passes are shortened until the time is right. Those that
    took too long `before` are shortened at their price, not chosen anew.

    Raises
    ------
    RefusedError
        If there is no safe way along them.
    """
    spare_s = (most_s - alone_s) * beside.own_s / max(alone_s, 1e-3)
    for _ in range(_SHORTENED):
        prices = PRICES if before is None else (before.price,)
        longer = beside.with_passes(spare_s, flight.settings.refine.added_passes, prices)
        if longer is None:
            return None
        longer = replace(longer, path=replace(longer.path, positions=flight.safe(longer.path.positions)))
        taken_s = flight.seconds_of(longer)
        if taken_s <= most_s:
            return longer
        before, spare_s = longer, longer.passes_s * (most_s - alone_s) / (taken_s - alone_s)
    return None


@dataclass(frozen=True, eq=False, repr=False)
class _Flight(Record):
    """Paths of a take as they are flown: safe, how long they take, and may take."""

    carried: Carried
    goal: Goal
    settings: Settings
    ways: Ways

    def safe(self, positions: Floats) -> Floats:
        """Positions that keep the rules, with every leg between them."""
        return safe_positions(positions, self.ways) if self.settings.route.enforce else positions

    def finished(self, result: Optimised, origin: Ints, added: Bools) -> Waypoints:
        """A path as it is flown: a curve that is safe, and that departs no farther than it may."""
        carried, goal, settings = self.carried, self.goal, self.settings
        at, curve = result.state.curve(result.variables, _STEP_M)
        positions = self.safe(curve.positions)
        station = np.interp(at, np.arange(float(len(origin))), origin)
        if settings.refine.deviation is not None:
            positions = _within(settings.refine.deviation, positions, station, goal, self.safe)
        low, high = np.radians([settings.retime.min_gimbal_pitch_deg, settings.retime.max_gimbal_pitch_deg])
        nearest = np.floor(at).astype(int), np.ceil(at).astype(int)
        further = added[nearest[0]] | added[nearest[1]]
        return Waypoints(
            positions,
            from_yaw_pitch(curve.yaw, np.clip(curve.pitch, low, high)),
            np.interp(station, np.arange(float(len(goal.flown))), carried.path.t_s),
            (nearest[0] == at) & carried.path.is_viewpoint[origin[nearest[0]]] & ~further,
            further,
        )

    def in_time(
        self, result: Optimised, origin: Ints, added: Bools, limit_s: float
    ) -> tuple[float, Waypoints] | None:
        """As much of a result as is flown in a time, drawn back to its start, and what that shows.

        None where none of it is.
        """
        within, beyond, share, fitting = 0.0, 1.0, 1.0, None
        for _ in range(_DRAWN_BACK):
            part = result.partly(share)
            waypoints = self.finished(part, origin, added)
            if self.seconds(waypoints) > limit_s:
                beyond = share
            else:
                within, fitting = share, (part.shown, waypoints)
            if within == 1:
                break
            share = (within + beyond) / 2
        return fitting

    def allowed_s(self, view: View) -> float:
        """At most as much longer than the demonstration as what is to be shown is larger, and some more."""
        flight, area = self.carried.take.inspection.flight, view.cloud.areas
        zones = float(area[view.inspected].sum() / max(area[self.goal.inspected.need > 0].sum(), 1e-9))
        ratio = max(self.goal.area_ratio, 1.0) * max(zones, 1.0)
        return self.settings.refine.longer * ratio * float(flight.t_s[-1] - flight.t_s[0])

    def seconds_of(self, longer: Extended) -> float:
        """The time of a path with passes, before it is optimised."""
        path, origin, own = longer.path, longer.origin, self.carried.path
        viewed = own.is_viewpoint[origin] & ~longer.added
        poses = from_yaw_pitch(path.yaw, path.pitch)
        return self.seconds(Waypoints(path.positions, poses, own.t_s[origin], viewed, longer.added))

    def seconds(self, path: Waypoints) -> float:
        """The time of a path as it will be flown."""
        take = self.carried.take
        flight = take.inspection.flight
        timed = sharply_timed(path, flight, [take], self.goal.inspected, self.settings)[0]
        return float(timed.t_s[-1] - timed.t_s[0])


def _half_rad(take: Take, settings: Settings) -> float:
    """Half the angle across the flight within which a wall is shown as finely as asked."""
    camera, rule = take.inspection.camera, settings.inspection
    fine = float(np.arccos(np.sqrt(max(rule.planned_resolution, rule.least_resolution))))
    return min(fine, float(np.radians(min(camera.hfov_deg, camera.vfov_deg, 120.0))) / 2)


def _starts(carried: Carried, safe: Callable[[Floats], Floats]) -> list[Start]:
    """The paths to start from that can be made safe.

    Raises
    ------
    RefusedError
        If none can: why the first cannot.
    """
    starts, refusals = [], []
    for path in (carried.path, *carried.others):
        yaw, pitch = yaw_pitch(path.quat_xyzw)
        mapped = Flown(path.positions, np.unwrap(yaw), pitch)
        try:
            starts.append(Start(mapped, replace(mapped, positions=safe(path.positions))))
        except RefusedError as refusal:
            refusals.append(refusal)
    if not starts:
        raise refusals[0]
    return starts


def _aside(take: Take) -> Floats:
    """Angle (M,), rad, from the expert's optical axis to what was inspected; NaN where none was seen."""
    flight, cloud = take.inspection.flight, take.pair.surface.source
    axis, weight = optical_axis(flight.quat_xyzw), take.inspection.attention.weight
    inspected = np.flatnonzero(weight > 0)
    share, seen = (weight * cloud.areas)[inspected], take.inspection.visibility.seen[:, inspected]
    return angles(flight.positions, axis, aims(flight.positions, axis, cloud.points[inspected], share, seen))


def _within(
    bound: float, positions: Floats, at: Floats, goal: Goal, safe: Callable[[Floats], Floats]
) -> Floats:
    """The path, drawn towards the demonstrated shape until it departs by no more than the bound, and safe.

    Raises
    ------
    RefusedError
        If the path that is drawn is not safe within the bound.
    """
    flown = interpolated(at, np.arange(float(len(goal.flown))), goal.flown)
    image, stands = Shape.of(flown, goal.standing).image(positions), goal.standing
    reference = goal.reference @ stands.T

    def departure(path: Floats) -> float:
        return frechet_floored(reference, path @ stands.T)

    low, high = 0.0, 0.0 if departure(positions) <= bound else 1.0
    for _ in range(_HALVINGS if high else 0):
        middle = (low + high) / 2
        beyond = departure(positions + middle * (image - positions)) > bound
        low, high = (middle, high) if beyond else (low, middle)
    drawn = safe(positions + high * (image - positions))
    if (departs := departure(drawn)) > bound * (1 + 1e-6):
        raise RefusedError(
            "the shape of the path",
            f"departs from the demonstrated one by {departs:.2f} of its spread where it is safe",
            f"at most {bound:g} (refine.deviation)",
            "leave refine.deviation out: a larger departure then is a warning",
        )
    return drawn


def _view(take: Take, goal: Goal, settings: Settings) -> View:
    """What the target is to show: what was inspected, and with less weight what was seen beside it."""
    wanted, seen, camera = goal.inspected, goal.seen, take.inspection.camera
    context = settings.optimise.context if wanted.need.any() else 1.0
    own = wanted.need / max(wanted.need.sum(), 1e-12)
    need = context * seen / max(seen.sum(), 1e-12) + (1 - context) * own
    inspected = wanted.need > 0
    rule, absolute = settings.inspection, goal.standoff.in_metres
    share = max(rule.planned_resolution, rule.least_resolution) if absolute else rule.least_resolution
    resolved_m = np.where(inspected, wanted.standoff_m / share, np.inf)
    return View(
        wanted.cloud,
        need / max(need.sum(), 1e-12),
        np.minimum(resolved_m, camera.max_range_m * take.inspection.truly.coarseness.max(initial=1.0)),
        inspected,
        camera,
        settings.visibility,
        settings.retime,
        take.pair.target_scene,
        take.inspection.flight.fov_deg,
    )


def _finite(speed_mps: Floats) -> Floats:
    """Speeds with one metre a second for those of a flight that does not move."""
    return np.where(np.isfinite(speed_mps), speed_mps, 1.0)
