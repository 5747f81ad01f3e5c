"""A flight carried to where the counterparts of what it saw are (preset `recommended`).

The paper maps viewpoints by the statistics of the whole structure and then repairs them one by
one. Here the map of the structure carries the flight, and what that map gets wrong near the part
in view (an engine further out, a lower tower) is added as a shift that varies smoothly along the
path. The stand-off is then set along the line of sight, scaled with the structure or kept.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from upplied.config import TransferSettings
from upplied.planning.frechet import spread
from upplied.planning.transfer import AxisMap, aimed
from upplied.poses import without_roll
from upplied.records import Camera, Cloud, Correspondences, Floats, Ints, Trajectory, Visibility


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
) -> tuple[Floats, Floats]:
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
    positions : array, shape (M, 3), m, target frame
    quat_xyzw : array, shape (M, 4)
        Without roll.
    """
    known = np.flatnonzero((correspondences.target_index >= 0) & visibility.total)
    if len(known) == 0:
        return carrier.points(flight.positions), without_roll(carrier.orientations(flight.quat_xyzw))
    here, there = source.points[known], correspondences.target_points[known]
    weight = visibility.seen[:, known] * _picture_share(flight.positions, source, known)
    aim_before = _centres(weight, here)
    aim = _centres(weight, there)
    smoothing = _smoothing(flight.positions, aim_before)
    shift = _smoothed(_filled(aim - carrier.points(aim_before)), smoothing)
    aim_filled = carrier.points(_filled(aim_before)) + shift
    positions = carrier.points(flight.positions) + shift
    wanted = expected_standoff(flight.positions, weight, here, carrier, settings, camera, nearest_m)
    positions = _stood_off(positions, aim_filled, weight, there, wanted, smoothing)
    positions = _like_carried(positions, carrier.points(flight.positions), deviation)
    before_to_aim = _filled(aim_before) - flight.positions
    turned = aimed(
        carrier.orientations(flight.quat_xyzw), positions, aim_filled, flight.quat_xyzw, before_to_aim
    )
    return positions, without_roll(turned)


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


def _picture_share(positions: Floats, source: Cloud, known: Ints) -> Floats:
    """Solid angle (M, K) under which each camera sees each sample: how much of the picture it fills."""
    ray = positions[:, None] - source.points[known][None]
    squared = np.maximum(np.einsum("mkj,mkj->mk", ray, ray), 1e-6)
    area = np.ones(len(known)) if source.area_m2 is None else source.area_m2[known]
    if source.normals is None:
        return area / squared
    facing = np.maximum(np.einsum("mkj,kj->mk", ray, source.normals[known]), 0.0)
    return area * facing / squared**1.5


def expected_standoff(
    positions: Floats,
    weight: Floats,
    points: Floats,
    carrier: AxisMap,
    settings: TransferSettings,
    camera: Camera,
    nearest_m: float,
) -> Floats:
    """How far each camera should stand from what it sees, (M,), m; NaN where it sees nothing.

    The demonstrated stand-off is the median distance over the picture. `scaled` takes the
    distances as the structure's map carries them, `kept` as flown, and a ground sampling distance
    sets the distance at which one pixel covers it in the middle of the picture.
    """
    if settings.gsd_m is not None and camera.width_px:
        pixel = 2 * np.tan(np.radians(min(camera.hfov_deg, 170.0)) / 2) / camera.width_px
        wanted = np.where(weight.any(axis=1), settings.gsd_m / pixel, np.nan)
    else:
        jacobian = carrier.matrix if settings.standoff == "scaled" else np.eye(3)
        wanted = _median_distance(positions @ jacobian.T, points @ jacobian.T, weight)
    lowest = max(nearest_m, camera.min_range_m) * 1.15  # so that the middle of the view is not too near
    return np.clip(wanted, lowest, max(0.9 * camera.max_range_m, lowest))


def _stood_off(
    positions: Floats, aim: Floats, weight: Floats, points: Floats, wanted: Floats, smoothing: float
) -> Floats:
    """Move along the line from the aim until the median distance to the counterparts is as wanted."""
    placed = positions
    for _ in range(4):
        ray = placed - aim
        length = np.maximum(np.linalg.norm(ray, axis=1), 1e-9)
        error = wanted - _median_distance(placed, points, weight)
        step = _smoothed(_filled(error[:, None]), smoothing)[:, 0]
        step = np.clip(step, -0.6 * length, 2.0 * length)
        placed = placed + ray / length[:, None] * step[:, None]
    return placed


def _median_distance(positions: Floats, points: Floats, weight: Floats) -> Floats:
    """Weighted median distance (M,) from each position to the points it sees; NaN where there are none."""
    medians = np.full(len(positions), np.nan)
    for index, shares in enumerate(weight):
        seen = np.flatnonzero(shares > 0)
        if len(seen):
            distance = np.linalg.norm(points[seen] - positions[index], axis=1)
            order = np.argsort(distance, kind="stable")
            share = np.cumsum(shares[seen][order])
            medians[index] = distance[order][np.searchsorted(share, share[-1] / 2)]
    return medians


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
    return np.column_stack([np.interp(index, known, column[known]) for column in values.T])


def _smoothing(positions: Floats, aim: Floats) -> float:
    """Standard deviation, in poses, of the smoothing along the path: half the usual stand-off."""
    step = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    spacing = max(float(np.mean(step)) if len(step) else 1.0, 1e-6)
    standoff = float(np.nanmedian(np.linalg.norm(positions - aim, axis=1)))
    return float(np.clip(0.5 * standoff / spacing, 1.0, max(1.0, len(positions) / 8)))


def _smoothed(values: Floats, sigma: float) -> Floats:
    return gaussian_filter1d(values, sigma, axis=0, mode="nearest")
