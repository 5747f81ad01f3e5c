"""From the demonstrated viewpoints to a timed trajectory on the target (paper, Alg. 2, lines 14 to 18)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from upplied.config import Settings
from upplied.errors import SettingsError
from upplied.planning.airspace.at_target import airspace_of
from upplied.planning.airspace.detours import Ways, route, safe_positions
from upplied.planning.carry.affine import aimed, box_map, registered_map, zscore_map
from upplied.planning.carry.gauss_newton import gauss_newton
from upplied.planning.carry.inspected_surface import inspected_surface
from upplied.planning.carry.planar import at_height, in_plane, plane_height
from upplied.planning.carry.reference import demonstrated_on_target, standing
from upplied.planning.carry.standoff import carried_sight, standoff_of
from upplied.planning.carry.to_counterparts import Followed, follow_counterparts
from upplied.planning.correspondence.pair import Pair
from upplied.planning.demonstration.inspection import Inspection
from upplied.planning.demonstration.repetition import Take, begins_of, breaks_of, joined
from upplied.planning.geometry.frechet import spread, zscored
from upplied.planning.trajectory.camera_turns import eased, with_looks
from upplied.planning.trajectory.complete import complete
from upplied.planning.trajectory.fair import faired
from upplied.planning.trajectory.likeness import Likeness
from upplied.planning.trajectory.look import View
from upplied.planning.trajectory.retime import demonstrated_speed, hovering, retime
from upplied.poses import from_yaw_pitch, yaw_pitch
from upplied.records import Bools, Floats, Trajectory, Waypoints

_COMPACT = 0.7  # of the stand-off: a path with less spread counts as small
_LARGER = 2.4  # and as so many times as large as it is, at most
_COMPARED = 500  # demonstrated positions that the path's shape is compared with
_RIPPLES = 0.07  # of the usual stand-off: what is taken out of a path that was led and bent


def propose(takes: Sequence[Take], settings: Settings) -> tuple[Trajectory, Bools, Floats]:
    """The planned trajectory, which of its poses are viewpoints, and the demonstration's times.

    The times, s, are those of the joined flights (`repetition.joined`) that the poses
    answer to.

    Parameters
    ----------
    takes : sequence of Take
        One, or as many as the demonstration is to be repeated.
    settings : Settings

    Raises
    ------
    RefusedError
        If no path keeps what the settings demand.
    """
    way = completed if settings.refine.method == "view" else published
    flight = joined([take.inspection.flight for take in takes])
    paths = _in_joined_times([way(take.inspection, take.pair, settings) for take in takes], takes, flight)
    if len(takes) > 1:
        pair = takes[0].pair
        paths = _with_transits(paths, Ways(airspace_of(pair, settings), pair.surface.target))
    return retime(_in_a_row(paths), flight, settings.retime, breaks_of(takes))


def _in_joined_times(
    paths: Sequence[Waypoints], takes: Sequence[Take], flight: Trajectory
) -> list[Waypoints]:
    """The paths of several takes in the times of the joined flight."""
    begins = begins_of(takes, flight)
    return [
        replace(path, t_s=path.t_s - take.inspection.flight.t_s[0] + begin)
        for path, take, begin in zip(paths, takes, begins, strict=True)
    ]


def _with_transits(paths: Sequence[Waypoints], ways: Ways) -> list[Waypoints]:
    """The paths, and between them safe ways from the end of each to the start of the next."""
    whole = [paths[0]]
    for before, after in itertools.pairwise(paths):
        ends = _in_a_row([before[-1:], after[:1]])
        transit = route(replace(ends, is_viewpoint=np.zeros(2, bool)), ways)
        whole += [transit[1:-1], after]
    return whole


def _in_a_row(paths: Sequence[Waypoints]) -> Waypoints:
    """Several stretches of waypoints one after another, as one."""
    return Waypoints(
        np.concatenate([path.positions for path in paths]),
        np.concatenate([path.quat_xyzw for path in paths]),
        np.concatenate([path.t_s for path in paths]),
        np.concatenate([path.is_viewpoint for path in paths]),
    )


def published(inspection: Inspection, pair: Pair, settings: Settings) -> Waypoints:
    """The paper's way, and its baseline's: viewpoints carried by an axis map, refined one by one."""
    viewpoints, fit = inspection.viewpoints, pair.fit_for(settings)
    carry = zscore_map if settings.transfer.method == "zscore" else box_map
    carrier = carry(fit.source, fit.target)
    positions = carrier.points(viewpoints.positions)
    quats = carrier.orientations(viewpoints.quat_xyzw)
    if settings.refine.method == "gauss-newton":
        positions = gauss_newton(
            positions, viewpoints, fit.source, fit.target, fit.correspondences, settings.refine
        )
        before, now = _centres_of_view(inspection, pair, settings)
        quats = aimed(quats, positions, now, viewpoints.quat_xyzw, before - viewpoints.positions)
    return Waypoints(positions, quats, viewpoints.t_s, np.ones(len(viewpoints), bool))


def completed(inspection: Inspection, pair: Pair, settings: Settings) -> Waypoints:
    """Ours: the whole flight carried to the counterparts, made safe, and completed by turns and bends."""
    if not settings.visibility.occlusion:
        raise SettingsError("refine.method 'view'", "with visibility.occlusion false", "what is truly seen")
    flight, fit, camera = inspection.flight, pair.surface, inspection.camera
    carried = _carried(inspection, pair, settings)
    sight = carried_sight(registered_map(fit.registration), settings.transfer)
    wanted = inspected_surface(fit.source, fit.target, fit.correspondences, inspection.truly, sight)
    view = View(fit.target, wanted.need, camera, settings.visibility, settings.retime, pair.target_scene)
    is_viewpoint = np.zeros(len(flight), bool)
    is_viewpoint[inspection.viewpoints.middle] = True
    path = Waypoints(carried.positions, carried.quat_xyzw, flight.t_s, is_viewpoint)

    standoff_m = float(np.nan_to_num(np.nanmedian(wanted.standoff_m)))
    airspace = airspace_of(pair, settings)
    likeness = _likeness(inspection, pair, carried, standoff_m, settings)
    reach_m = settings.refine.deviation * _size(carried.positions, standoff_m)
    if settings.transfer.plane:
        height = plane_height(flight, pair, carried.positions, settings.transfer)
        airspace, path = in_plane(airspace, height), at_height(path, height)
        reach_m = np.array([reach_m[0], reach_m[1], 1e-6])
    ways = Ways(airspace, fit.target)
    flown = registered_map(fit.registration).points(flight.positions)

    def safe(places: Floats) -> Floats:
        if not settings.route.enforce:
            return places
        return faired(safe_positions(places, ways), ways.planning, _RIPPLES * standoff_m, flown)

    path, looks = complete(path, view, likeness, reach_m, safe, ways.planning.allowed, ways.planning.broken)
    path, fixed = with_looks(path, looks)
    breaks = inspection.breaks
    fixed |= hovering(path, flight, settings.retime.least_stop_s, breaks) > 0
    speed = demonstrated_speed(path.t_s, flight, breaks, settings.retime.transit_speed_mps)
    return eased(path, fixed, speed, view)


def _size(positions: Floats, standoff_m: float) -> Floats:
    """The path's spread (3,), m, in units of which its likeness is measured.

    A path that is small beside its stand-off, such as one round an engine, counts as large as that.
    """
    scale = spread(positions)[1]
    return scale * float(np.clip(_COMPACT * standoff_m / scale.max(), 1.0, _LARGER))


def _likeness(
    inspection: Inspection, pair: Pair, carried: Followed, standoff_m: float, settings: Settings
) -> Likeness:
    """What of the demonstration the path has to keep."""
    asked_s = inspection.viewpoints.t_s  # the same moments that the plan is judged by
    station = np.abs(inspection.flight.t_s[:, None] - asked_s).argmin(axis=0)
    stands = standing(pair)
    boxed = demonstrated_on_target(Take(inspection, pair)) @ stands.T
    kept = np.unique(np.linspace(0, len(boxed) - 1, min(_COMPARED, len(boxed))).astype(np.int64))
    size = _size(boxed, standoff_m)[0] / spread(boxed)[1][0]
    return Likeness(
        shape=zscored(boxed)[kept],
        leash=settings.refine.deviation * size,
        standoff=standoff_of(
            station, carried.weight[station], carried.counterparts, carried.standoff_m[station]
        ),
        standing=stands,
    )


def _carried(inspection: Inspection, pair: Pair, settings: Settings) -> Followed:
    """The flight on the target, before anything is made better."""
    flight, fit, limits = inspection.flight, pair.surface, settings.retime
    followed = follow_counterparts(
        flight,
        inspection.visibility,
        fit.source,
        fit.correspondences,
        registered_map(fit.registration),
        settings.transfer,
        inspection.camera,
        settings.route.clearance_m,
        settings.refine.deviation,
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


def _centres_of_view(inspection: Inspection, pair: Pair, settings: Settings) -> tuple[Floats, Floats]:
    """Centre of what each viewpoint saw, and of its counterparts on the target, (K, 3) each; NaN for none."""
    fit = pair.fit_for(settings)
    known = fit.correspondences.target_index >= 0
    weight = inspection.viewpoints.seen[:, known].astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        weight /= weight.sum(axis=1, keepdims=True)
    return weight @ fit.source.points[known], weight @ fit.correspondences.target_points[known]
