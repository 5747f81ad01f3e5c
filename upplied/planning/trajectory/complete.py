"""A carried flight completed: safe, as much like the demonstrated one as asked, showing what it showed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from upplied.config import FIDELITIES, Settings
from upplied.errors import RefusedError
from upplied.planning.airspace.at_target import airspace_of
from upplied.planning.airspace.detours import Ways, safe_positions
from upplied.planning.carry.carried import Carried, Goal
from upplied.planning.demonstration.repetition import Take
from upplied.planning.demonstration.sharp_looks import steady_radps
from upplied.planning.geometry.frechet import frechet_floored
from upplied.planning.trajectory.optimise import Problem, optimise
from upplied.planning.trajectory.required import required_first
from upplied.planning.trajectory.retime import demonstrated_speed
from upplied.planning.trajectory.state import Flown, State
from upplied.planning.trajectory.terms.shape import Shape
from upplied.planning.trajectory.view import View
from upplied.poses import from_yaw_pitch, optical_axis, yaw_pitch
from upplied.records import Floats, Waypoints

_STEP_M = 0.5  # largest leg of the result
_LEAST_TURN_RAD = (
    np.pi / 2
)  # that a demonstration counts as having turned, so that little turning is not dear
_SHARES = (1.0, 0.5, 0.0)  # of what the optimisation changed, the first that is safe within the bound
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
        Every leg keeps the rules; the shape departs from the demonstrated one by no more than the
        fidelity allows.

    Raises
    ------
    RefusedError
        If no safe path is found, or none of that shape.
    """
    take, path, flown = carried.take, carried.path, goal.flown
    inspection, pair = take.inspection, take.pair
    flight, airspace = inspection.flight, airspace_of(pair, settings)
    if goal.height_m is not None:
        airspace = airspace.in_plane(goal.height_m)
    ways = Ways(airspace, pair.obstacle)

    def safe(positions: Floats) -> Floats:
        return safe_positions(positions, ways) if settings.route.enforce else positions

    yaw, pitch = yaw_pitch(path.quat_xyzw)
    axis = optical_axis(flight.quat_xyzw)
    turned = float(np.arccos(np.clip((axis[1:] * axis[:-1]).sum(axis=1), -1, 1)).sum())
    stands = goal.standing
    start, view = Flown(safe(path.positions), np.unwrap(yaw), pitch), _view(take, goal, settings)
    if take.required is not None:
        times = settings.optimise.required
        view = required_first(view, take.required, start, ways.planning, goal.standoff.usual_m, times)
    problem = Problem(
        flown=flown,
        carried=start,
        demonstrated=Shape.of(flown, stands),
        view=view,
        standoff=goal.standoff,
        airspace=ways.planning,
        speed_mps=_finite(demonstrated_speed(flight.t_s, flight, inspection.breaks)),
        turned_rad=max(turned, _LEAST_TURN_RAD),
        pan_radps=min(
            np.radians(settings.retime.max_yaw_rate_degps), steady_radps([take], settings.inspection)
        ),
        level=settings.transfer.plane,
    )
    fidelity = FIDELITIES[settings.refine.fidelity]
    bound = settings.refine.deviation or fidelity.deviation
    state, variables = optimise(problem, fidelity.shape, settings.optimise)
    _, base = state.curve(np.zeros_like(variables), _STEP_M)
    reference, first = goal.reference @ stands.T, state.nearest(problem.carried)

    def bounded(positions: Floats) -> Floats:
        image = Shape.of(base.positions, stands).image(positions)
        return safe(_within_bound(safe(positions), image, stands, reference, bound))

    def departs(positions: Floats) -> float:
        return frechet_floored(reference, positions @ stands.T)

    at, curve, positions = _changed_safely(state, first, variables, bounded, departs, bound)
    low, high = np.radians([settings.retime.min_gimbal_pitch_deg, settings.retime.max_gimbal_pitch_deg])
    own = np.zeros(len(at), bool)
    whole = np.flatnonzero(at == np.round(at))
    own[whole] = path.is_viewpoint[at[whole].astype(int)]
    return Waypoints(
        positions,
        from_yaw_pitch(curve.yaw, np.clip(curve.pitch, low, high)),
        np.interp(at, np.arange(float(len(path))), path.t_s),
        own,
    )


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


def _changed_safely(
    state: State,
    first: Floats,
    variables: Floats,
    bounded: Callable[[Floats], Floats],
    departs: Callable[[Floats], float],
    bound: float,
) -> tuple[Floats, Flown, Floats]:
    """The curve with as much of the optimised change as is safe within the bound, and its safe positions.

    What is pushed off the structure may leave the bound again: then half of the change is made, or none.

    Raises
    ------
    RefusedError
        If the path without any change is not safe within the bound either.
    """
    for share in _SHARES:
        at, curve = state.curve(first + share * (variables - first), _STEP_M)
        positions = bounded(curve.positions)
        departure = departs(positions)
        if departure <= bound * (1 + 1e-6):
            return at, curve, positions
    raise _beyond_bound(departure, bound)


def _within_bound(
    positions: Floats, image: Floats, stands: Floats, reference: Floats, bound: float
) -> Floats:
    """The path, drawn towards the demonstrated shape until it departs by no more than the bound."""

    def departs(share: float) -> bool:
        return frechet_floored(reference, (positions + share * (image - positions)) @ stands.T) > bound

    low, high = 0.0, 1.0
    if not departs(low):
        return positions
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if departs(middle) else (low, middle)
    return positions + high * (image - positions)


def _beyond_bound(departure: float, bound: float) -> RefusedError:
    return RefusedError(
        "the shape of the path",
        f"departs from the demonstrated one by {departure:.2f} of its spread where it is safe",
        f"at most {bound:g} (refine.fidelity, refine.deviation)",
        "a looser fidelity (--fidelity coverage), or a smaller safety distance, may help",
    )
