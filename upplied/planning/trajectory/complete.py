"""A carried flight completed: safe, as much like the demonstrated one as asked, showing what it showed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from upplied.config import FIDELITIES, Settings
from upplied.errors import RefusedError
from upplied.planning.airspace.detours import Ways, airspace_of, safe_positions
from upplied.planning.carry.carried import Carried, Goal
from upplied.planning.demonstration.repetition import Take, steady_radps
from upplied.planning.geometry.frechet import frechet_floored
from upplied.planning.trajectory.optimise import Problem, Start, optimise
from upplied.planning.trajectory.required import required_first
from upplied.planning.trajectory.retime import demonstrated_speed
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.terms.axis import aims, angles
from upplied.planning.trajectory.terms.path import Shape
from upplied.planning.trajectory.view import View
from upplied.polylines import interpolated
from upplied.poses import from_yaw_pitch, optical_axis, yaw_pitch
from upplied.records import Floats, Waypoints

_STEP_M = 0.5  # largest leg of the result
_LEAST_TURN_RAD = (
    np.pi / 2
)  # that a demonstration counts as having turned, so that little turning is not dear
_HALVINGS = 20  # of the way to the demonstrated shape


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

    def safe(positions: Floats) -> Floats:
        return safe_positions(positions, ways) if settings.route.enforce else positions

    axis = optical_axis(flight.quat_xyzw)
    turned = float(np.arccos(np.clip((axis[1:] * axis[:-1]).sum(axis=1), -1, 1)).sum())
    starts, view = _starts(carried, safe), _view(take, goal, settings)
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
    state, variables = optimise(problem, FIDELITIES[settings.refine.fidelity].shape, settings.optimise)
    at, curve = state.curve(variables, _STEP_M)
    positions = safe(curve.positions)
    if settings.refine.deviation is not None:
        positions = _within(settings.refine.deviation, positions, at, goal, safe)
    low, high = np.radians([settings.retime.min_gimbal_pitch_deg, settings.retime.max_gimbal_pitch_deg])
    own = np.zeros(len(at), bool)
    whole = np.flatnonzero(at == np.round(at))
    own[whole] = carried.path.is_viewpoint[at[whole].astype(int)]
    return Waypoints(
        positions,
        from_yaw_pitch(curve.yaw, np.clip(curve.pitch, low, high)),
        np.interp(at, np.arange(float(len(flown))), carried.path.t_s),
        own,
    )


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
    resolved_m = np.where(inspected, wanted.standoff_m / settings.inspection.least_resolution, np.inf)
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
