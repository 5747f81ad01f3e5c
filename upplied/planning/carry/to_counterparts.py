"""A flight carried to where the counterparts of what it saw are (preset `recommended`).

The paper maps viewpoints by the statistics of the whole structure and then repairs them one by
one. Here the map of the structure carries the flight, and what that map gets wrong near the part
in view (an engine further out, a lower tower) is added as a shift that varies smoothly along the
path. The stand-off is then set along the line of sight, scaled with the structure or kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from upplied.config import TransferSettings
from upplied.planning.carry.affine import AxisMap, aimed
from upplied.planning.carry.standoff import Counted, counted, picture_share
from upplied.planning.constants import MOST_RATIO
from upplied.planning.geometry.frechet import spread
from upplied.planning.visibility.frustum import coarseness
from upplied.polylines import interpolated, leg_lengths
from upplied.poses import from_yaw_pitch, optical_axis, without_roll, yaw_pitch
from upplied.records import Camera, Cloud, Correspondences, Floats, Record, Trajectory, Visibility

_STEEP = np.radians(75)  # of elevation: from there on a camera looks at what is below, whatever its heading


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
    correspondences: Correspondences,
    carrier: AxisMap,
    settings: TransferSettings,
    camera: Camera,
    nearest_m: float,
    deviation: float,
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
    correspondences : Correspondences
        From `source` to the target's surface samples.
    carrier : AxisMap
        Where the source's space lies on the target.
    settings : TransferSettings
    camera : Camera
        Bounds the stand-off by its range.
    nearest_m : float
        Smallest stand-off, m: the safety distance.
    deviation : float
        How far the shape may differ from the demonstrated one, in units of the path's spread.

    Returns
    -------
    Followed
    """
    known = np.flatnonzero((correspondences.target_index >= 0) & visibility.total)
    if len(known) == 0:
        quats = without_roll(carrier.orientations(flight.quat_xyzw))
        nothing = Counted(np.empty((len(flight), 0)), np.empty((0, 3)), None, np.full(len(flight), np.nan))
        return Followed(carrier.points(flight.positions), quats, nothing)
    here, there = source.points[known], correspondences.target_points[known]
    weight = visibility.seen[:, known] * picture_share(flight.positions, source, known, visibility.total)
    aim_before = _centres(weight, here)
    aim = _centres(weight, there)
    smoothing = _smoothing(flight.positions, aim_before)
    shift = _smoothed(_filled(aim - carrier.points(aim_before)), smoothing)
    aim_filled = carrier.points(_filled(aim_before)) + shift
    positions = carrier.points(flight.positions) + shift
    coarse = coarseness(camera, flight.fov_deg)
    asked = counted(flight.positions, weight, here, there, carrier, settings, camera, nearest_m, coarse)
    positions = _stood_off(positions, aim_filled, asked, smoothing)
    carried = carrier.points(flight.positions)
    if settings.standoff != "scaled" or settings.gsd_m is not None:
        carried = _stretched(carried, positions)  # in metres, a larger structure is flown round more closely
    positions = _like_carried(positions, carried, deviation)
    before_to_aim = _filled(aim_before) - flight.positions
    quats = carrier.orientations(flight.quat_xyzw)
    turned = aimed(quats, positions, aim_filled, flight.quat_xyzw, before_to_aim)
    return Followed(positions, _level(turned, quats), asked)


def _level(turned: Floats, carried: Floats) -> Floats:
    """The turned cameras without roll; those that looked steeply keep the heading they were carried with.

    A camera that looks down and should look a little to its side would have to turn by a right angle.
    """
    heading, elevation = yaw_pitch(carried)
    yaw, pitch = yaw_pitch(turned)
    axis = optical_axis(turned)
    ahead = axis[:, 0] * np.cos(heading) + axis[:, 1] * np.sin(heading)
    tilt = np.arctan2(axis[:, 2], np.maximum(ahead, 0.0))
    steep = np.abs(elevation) > _STEEP
    return from_yaw_pitch(np.where(steep, heading, yaw), np.where(steep, tilt, pitch))


def _like_carried(positions: Floats, carried: Floats, deviation: float) -> Floats:
    """The path drawn towards the shape of the carried flight, so far as it strays from it.

    A shift of the whole path changes no shape and is free. What is beyond the deviation is taken
    back smoothly, so that the path still leans where it should.
    """
    stray = positions - carried
    whole = stray.mean(axis=0)
    size = np.linalg.norm((stray - whole) / (deviation * spread(carried)[1]), axis=1, keepdims=True)
    kept = np.where(size > 1e-9, np.tanh(size) / np.maximum(size, 1e-9), 1.0)
    return carried + whole + (stray - whole) * kept


def _stretched(carried: Floats, positions: Floats) -> Floats:
    """The carried flight stretched along each axis towards a path: no change of shape either.

    A level flight is stretched along no height, since its height says nothing of its shape.
    """
    middle, offset = carried.mean(axis=0), carried - carried.mean(axis=0)
    most = np.maximum((offset**2).sum(axis=0), 1e-12)
    stretch = np.einsum("ij,ij->j", offset, positions - positions.mean(axis=0)) / most
    wide = offset.std(axis=0) > 0.5 * spread(carried)[1]
    return np.asarray(middle + np.where(wide, np.clip(stretch, 1 / MOST_RATIO, MOST_RATIO), 1.0) * offset)


def _stood_off(positions: Floats, aim: Floats, asked: Counted, smoothing: float) -> Floats:
    """Move along the line from the aim until the stand-off is as wanted."""
    placed = positions
    for _ in range(4):
        ray = placed - aim
        length = np.maximum(np.linalg.norm(ray, axis=1), 1e-9)
        error = asked.wanted_m - asked.distance(placed)
        step = _smoothed(_filled(error[:, None]), smoothing)[:, 0]
        step = np.clip(step, -0.6 * length, 2.0 * length)
        placed = placed + ray / length[:, None] * step[:, None]
    return placed


def _centres(weight: Floats, points: Floats) -> Floats:
    """Weighted centres (M, 3) of the points in view; NaN where none is."""
    mass = weight.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return (weight @ points) / mass[:, None]


def _filled(values: Floats) -> Floats:
    """NaN rows interpolated along the path; all zero where there is nothing to interpolate."""
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    if len(known) == 0:
        return np.zeros_like(values)
    index = np.arange(len(values))
    return interpolated(index, known, values[known])


def _smoothing(positions: Floats, aim: Floats) -> float:
    """Standard deviation, in poses, of the smoothing along the path: half the usual stand-off."""
    step = leg_lengths(positions)
    spacing = max(float(np.mean(step)) if len(step) else 1.0, 1e-6)
    standoff = float(np.nanmedian(np.linalg.norm(positions - aim, axis=1)))
    return float(np.clip(0.5 * standoff / spacing, 1.0, max(1.0, len(positions) / 8)))


def _smoothed(values: Floats, sigma: float) -> Floats:
    return gaussian_filter1d(values, sigma, axis=0, mode="nearest")
