"""A carried flight completed: safe, as much like the demonstrated one as asked, showing what it showed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from upplied.config import FIDELITIES, Settings
from upplied.errors import RefusedError, SettingsError
from upplied.planning.airspace.at_target import airspace_of
from upplied.planning.airspace.detours import Ways, safe_positions
from upplied.planning.carry.affine import box_map, registered_map, zscore_map
from upplied.planning.carry.inspected_surface import (
    InspectedSurface,
    inspected_by,
    inspected_surface,
    steady_radps,
)
from upplied.planning.carry.planar import at_height, in_plane, plane_height
from upplied.planning.carry.reference import demonstrated_on_target, standing
from upplied.planning.carry.standoff import Standoff
from upplied.planning.carry.to_counterparts import Followed, follow_counterparts
from upplied.planning.demonstration.repetition import Take
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


def completed(take: Take, settings: Settings) -> Waypoints:
    """The whole flight carried to the counterparts, made safe, and optimised.

    Parameters
    ----------
    take : Take
    settings : Settings

    Returns
    -------
    Waypoints
        Every leg keeps the rules; the shape departs from the demonstrated one by no more than the
        fidelity allows.

    Raises
    ------
    RefusedError
        If what the flight was about has no counterpart, no safe path is found, or none of that shape.
    """
    if not settings.visibility.occlusion:
        raise SettingsError("refine.method 'view'", "with visibility.occlusion false", "what is truly seen")
    inspection, pair = take.inspection, take.pair
    flight = inspection.flight
    wanted = inspected_by(take, settings)
    _refuse_without_counterpart(wanted, settings)
    followed = _carried(take, settings)
    is_viewpoint = np.zeros(len(flight), bool)
    is_viewpoint[inspection.viewpoints.middle] = True
    path = Waypoints(followed.positions, followed.quat_xyzw, flight.t_s, is_viewpoint)
    airspace, flown = (
        airspace_of(pair, settings),
        registered_map(pair.surface.registration).points(flight.positions),
    )
    if settings.transfer.plane:
        height = plane_height(flight, pair, path.positions, settings.transfer)
        airspace, path = in_plane(airspace, height), at_height(path, height)
        flown[:, 2] = height
    ways = Ways(airspace, pair.surface.target)

    def safe(positions: Floats) -> Floats:
        return safe_positions(positions, ways) if settings.route.enforce else positions

    yaw, pitch = yaw_pitch(path.quat_xyzw)
    axis = optical_axis(flight.quat_xyzw)
    turned = float(np.arccos(np.clip((axis[1:] * axis[:-1]).sum(axis=1), -1, 1)).sum())
    stands = standing(pair)
    shape, standoff = Shape.of(flown, stands), _standoff(take, followed)
    carried, view = Flown(safe(path.positions), np.unwrap(yaw), pitch), _view(take, wanted, settings)
    if take.required is not None:
        times = settings.optimise.required
        view = required_first(view, take.required, carried, ways.planning, standoff.usual_m, times)
    problem = Problem(
        flown=flown,
        carried=carried,
        demonstrated=shape,
        view=view,
        standoff=standoff,
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
    reference, first = demonstrated_on_target(take) @ stands.T, state.nearest(problem.carried)

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


def _carried(take: Take, settings: Settings) -> Followed:
    """The flight on the target, before anything is made better."""
    inspection, fit, limits = take.inspection, take.pair.surface, settings.retime
    flight = inspection.flight
    followed = follow_counterparts(
        flight,
        inspection.visibility,
        fit.source,
        fit.correspondences,
        registered_map(fit.registration),
        settings.transfer,
        inspection.camera,
        settings.route.clearance_m,
        settings.refine.deviation or FIDELITIES[settings.refine.fidelity].deviation,
    )
    if settings.transfer.method != "counterparts":
        carrier = (zscore_map if settings.transfer.method == "zscore" else box_map)(fit.source, fit.target)
        followed = replace(
            followed,
            positions=carrier.points(flight.positions),
            quat_xyzw=carrier.orientations(flight.quat_xyzw),
        )
    yaw, pitch = yaw_pitch(followed.quat_xyzw)
    low, high = np.radians([limits.min_gimbal_pitch_deg, limits.max_gimbal_pitch_deg])
    return replace(followed, quat_xyzw=from_yaw_pitch(yaw, np.clip(pitch, low, high)))


def _view(take: Take, wanted: InspectedSurface, settings: Settings) -> View:
    """What the target is to show: what was inspected, and with less weight what was seen beside it."""
    fit, camera = take.pair.surface, take.inspection.camera
    seen = inspected_surface(fit.source, fit.target, fit.correspondences, take.inspection.truly).need
    context = settings.optimise.context if wanted.need.any() else 1.0
    own = wanted.need / max(wanted.need.sum(), 1e-12)
    need = context * seen / max(seen.sum(), 1e-12) + (1 - context) * own
    inspected = wanted.need > 0
    resolved_m = np.where(inspected, wanted.standoff_m / settings.inspection.least_resolution, np.inf)
    return View(
        fit.target,
        need / max(need.sum(), 1e-12),
        np.minimum(resolved_m, camera.max_range_m * take.inspection.truly.coarseness.max(initial=1.0)),
        inspected,
        camera,
        settings.visibility,
        settings.retime,
        take.pair.target_scene,
        take.inspection.flight.fov_deg,
    )


def _standoff(take: Take, followed: Followed) -> Standoff:
    """The stand-off of the viewpoints, at the same moments that the plan is judged by."""
    asked_s = take.inspection.viewpoints.t_s
    station = np.abs(take.inspection.flight.t_s[:, None] - asked_s).argmin(axis=0)
    return followed.standoff.at(station)


def _finite(speed_mps: Floats) -> Floats:
    """Speeds with one metre a second for those of a flight that does not move."""
    return np.where(np.isfinite(speed_mps), speed_mps, 1.0)


def _refuse_without_counterpart(wanted: InspectedSurface, settings: Settings) -> None:
    """The flight has to be about something that the target has."""
    if wanted.whole > 0 and wanted.without_pct > 100 * (1 - settings.refine.least_counterpart):
        raise RefusedError(
            "what the flight was about",
            f"{wanted.without_pct:.0f} % of it has no counterpart on the target",
            f"at least {100 * settings.refine.least_counterpart:g} % has one (refine.least_counterpart)",
            "fly one on a structure whose inspected parts this one has, or name them (--counterpart)",
        )


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
