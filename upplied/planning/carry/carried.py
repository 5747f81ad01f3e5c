"""The takes of a demonstration on the target, before any is optimised (paper, Alg. 2, lines 14 to 16)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from upplied.config import Settings, TransferSettings
from upplied.errors import RefusedError, SettingsError
from upplied.geometry.polylines import interpolated, leg_lengths
from upplied.geometry.poses import from_yaw_pitch, without_roll, yaw_pitch
from upplied.planning.carry.affine import (
    PUBLISHED,
    AxisMap,
    at_height,
    carried_orientation,
    demonstrated_on_target,
    plane_height,
    published,
    registered_map,
    standing,
)
from upplied.planning.carry.inspected_surface import (
    InspectedSurface,
    area_ratio,
    demonstrated_looks,
    inspected_by,
)
from upplied.planning.carry.standoff import Counted, Standoff, counted, picture_share
from upplied.planning.correspondence.registration import box_on_box
from upplied.planning.demonstration.repetition import Take, look_limits
from upplied.planning.visibility.line_of_sight import coarseness
from upplied.records import Camera, Cloud, Correspondences, Floats, Record, Trajectory, Visibility, Waypoints


@dataclass(frozen=True, eq=False, repr=False)
class Followed(Record):
    """A flight on the target, and what it was carried by."""

    positions: Floats  # (M, 3) m, target frame
    quat_xyzw: Floats  # (M, 4), without roll
    standoff: Counted  # what each demonstrated pose saw, and from how far it is to be seen


def follow_counterparts(
    flight: Trajectory,
    visibility: Visibility,
    source: Cloud,
    attention: Floats,
    correspondences: Correspondences,
    carrier: AxisMap,
    settings: TransferSettings,
    camera: Camera,
    nearest_m: float,
) -> Followed:
    """Positions and orientations on the target that look at the counterparts from the demonstrated side.

    Parameters
    ----------
    flight : Trajectory
        M poses, evenly spaced along the path, source frame.
    visibility : Visibility
        What each pose truly sees of `source`, (M, N).
    source : Cloud
        N surface samples with areas.
    attention : array, shape (N,)
        How much the flight was about each.
    correspondences : Correspondences
        From `source` to the target's surface samples.
    carrier : AxisMap
        Where the source's space lies on the target.
    camera, nearest_m
        Its range, and the safety distance, m, bound the stand-off.
    """
    positions = carrier.points(flight.positions)
    quats = without_roll(carried_orientation(carrier.matrix, flight.quat_xyzw))
    known = np.flatnonzero((correspondences.target_index >= 0) & visibility.total)
    if len(known) == 0:
        nothing = Counted(np.empty((len(flight), 0)), np.empty((0, 3)), None, np.full(len(flight), np.nan))
        return Followed(positions, quats, nothing)
    here, there = source.points[known], correspondences.target_points[known]
    weight = picture_share(flight.positions, source, known, visibility.seen[:, known], attention)
    coarse = coarseness(camera, flight.fov_deg)
    standoff = counted(flight.positions, weight, here, there, carrier, settings, camera, nearest_m, coarse)
    if standoff.middle is not None and standoff.before is not None:
        sight = (flight.positions - standoff.before) @ carrier.matrix.T
        sight *= (standoff.wanted_m / np.linalg.norm(sight, axis=1))[:, None]
        shift = _filled(standoff.middle + sight - positions)
        usual = float(np.nanmedian(np.linalg.norm(flight.positions - standoff.before, axis=1)))
        positions = positions + _smoothed(shift, usual, flight.positions)
    return Followed(positions, quats, standoff)


def _filled(values: Floats) -> Floats:
    """NaN rows interpolated along the path; all zero where there is nothing to interpolate."""
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    if len(known) == 0:
        return np.zeros_like(values)
    return interpolated(np.arange(len(values)), known, values[known])


def _smoothed(values: Floats, standoff_m: float, positions: Floats) -> Floats:
    """Values (M, 3) averaged along the path over half the usual stand-off, an eighth of the path at most."""
    step = leg_lengths(positions)
    spacing = max(float(np.mean(step)) if len(step) else 1.0, 1e-6)
    sigma = float(np.clip(0.5 * standoff_m / spacing, 1.0, max(1.0, len(positions) / 8)))
    return gaussian_filter1d(values, sigma, axis=0, mode="nearest")


@dataclass(frozen=True, eq=False, repr=False)
class Goal(Record):
    """What the path of a take is to show, and what it is to stay like."""

    inspected: InspectedSurface  # N target samples, those that the flight was about
    flown: Floats  # (M, 3) m, the flight as the structure's map carries it
    standoff: Standoff  # of the viewpoints
    reference: Floats  # (K, 3) m, the demonstrated positions, by which the shape is measured
    standing: Floats  # (3, 3) turns the target's axes into the source's
    height_m: float | None  # of the plane that the path stays in
    looked_m: Floats  # (S,) m, of the source's samples, from how near each was looked at, sharply or at all
    area_ratio: float = 1.0  # of what corresponds to the inspected surface, to that surface


@dataclass(frozen=True, eq=False, repr=False)
class Carried(Record):
    """A take on the target."""

    take: Take
    path: Waypoints  # its M stations; of presets that optimise nothing its viewpoints
    goal: Goal | None  # None: the path is flown as it is
    others: Sequence[Waypoints] = ()  # other paths of as many stations, that an optimisation may start from


def carry(takes: Sequence[Take], settings: Settings) -> list[Carried]:
    """The takes of a demonstration carried to the target: whole flights to be optimised, or viewpoints.

    Raises
    ------
    RefusedError
        If what the flight was about has no counterpart.
    SettingsError
        If a path is to be optimised for what is seen, and what occludes it does not count.
    """
    if settings.refine.method != "view":
        return [Carried(take, published(take, settings), None) for take in takes]
    if not settings.visibility.occlusion:
        raise SettingsError("refine.method 'view'", "with visibility.occlusion false", "what is truly seen")
    return [_carried(take, settings) for take in takes]


def _carried(take: Take, settings: Settings) -> Carried:
    inspection, pair, fit = take.inspection, take.pair, take.pair.surface
    flight = inspection.flight
    inspected = inspected_by(take, settings)
    _refuse_without_counterpart(inspected, settings)
    path, standoff = _at_counterparts(take, settings)
    flown, height_m = registered_map(fit.registration).points(flight.positions), None
    if settings.transfer.plane:
        height_m = plane_height(flight, pair, path.positions, settings.transfer)
        path = at_height(path, height_m)
        flown[:, 2] = height_m
    # As the boxes' ratio carries it, and of its own size about what was inspected.
    turn, others = standing(pair), []
    boxed = registered_map(box_on_box(fit.source, fit.target, turn))
    for carrier in (boxed, *_about_inspected(take, turn.T)):
        quats = without_roll(carried_orientation(carrier.matrix, flight.quat_xyzw))
        other = replace(path, positions=carrier.points(flight.positions), quat_xyzw=quats)
        others.append(other if height_m is None else at_height(other, height_m))
    sharply_m = demonstrated_looks(take, look_limits([take], settings.inspection)).sampled_m
    at_all_m, _ = inspection.truly.nearest(fit.source.points)
    goal = Goal(
        inspected,
        flown=flown,
        standoff=standoff,
        reference=demonstrated_on_target(take),
        standing=turn,
        height_m=height_m,
        looked_m=np.where(np.isfinite(sharply_m), sharply_m, at_all_m),
        area_ratio=area_ratio([take], inspected),
    )
    return Carried(take, path, goal, others)


def _about_inspected(take: Take, *matrices: Floats) -> list[AxisMap]:
    """Maps by these matrices (3, 3) that bring the middle of what was inspected onto its counterpart's."""
    fit, match = take.pair.surface, take.pair.surface.correspondences
    known = match.target_index >= 0
    weight = (fit.source.areas * take.inspection.attention.weight)[known]
    if not weight.sum() > 0:
        return []
    both = fit.source.points, match.target_points
    here, there = (weight @ points[known] / weight.sum() for points in both)
    return [AxisMap(matrix, there - matrix @ here) for matrix in matrices]


def _at_counterparts(take: Take, settings: Settings) -> tuple[Waypoints, Standoff]:
    """The whole flight on the target within the gimbal's limits, and the stand-off of its viewpoints."""
    inspection, fit, limits = take.inspection, take.pair.surface, settings.retime
    flight, mapped = inspection.flight, registered_map(fit.registration)
    carrier = next(iter(_about_inspected(take, mapped.matrix)), mapped)
    seen = inspection.visibility, fit.source, inspection.attention.weight, fit.correspondences
    rules = settings.transfer, inspection.camera, settings.route.clearance_m
    followed = follow_counterparts(flight, *seen, carrier, *rules)
    positions, quats = followed.positions, followed.quat_xyzw
    if settings.transfer.method != "counterparts":
        carrier = PUBLISHED[settings.transfer.method](fit.source, fit.target)
        positions = carrier.points(flight.positions)
        quats = carried_orientation(carrier.matrix, flight.quat_xyzw)
    yaw, pitch = yaw_pitch(quats)
    low, high = np.radians([limits.min_gimbal_pitch_deg, limits.max_gimbal_pitch_deg])
    is_viewpoint = np.zeros(len(flight), bool)
    is_viewpoint[inspection.viewpoints.middle] = True
    path = Waypoints(positions, from_yaw_pitch(yaw, np.clip(pitch, low, high)), flight.t_s, is_viewpoint)
    station = inspection.viewpoints.middle
    return path, followed.standoff.at(station)


def _refuse_without_counterpart(inspected: InspectedSurface, settings: Settings) -> None:
    """The flight has to be about something that the target has."""
    if inspected.whole > 0 and inspected.without_pct > 100 * (1 - settings.refine.least_counterpart):
        raise RefusedError(
            "what the flight was about",
            f"{inspected.without_pct:.0f} % of it has no counterpart on the target",
            f"at least {100 * settings.refine.least_counterpart:g} % has one (refine.least_counterpart)",
            "fly one on a structure whose inspected parts this one has, or name them (--counterpart)",
        )
