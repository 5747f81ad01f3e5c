"""A flight carried to where the counterparts of what it saw are (preset `recommended`).

The paper maps viewpoints by the statistics of the whole structure and then repairs them one by one. Here
one map carries the flight. A stand-off in metres is no matter of size: the camera then stands as far from
the counterpart of what was in the middle of its picture as is asked for, on the side that it came from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from upplied.config import TransferSettings
from upplied.geometry.polylines import interpolated, leg_lengths
from upplied.geometry.poses import without_roll
from upplied.planning.carry.affine import AxisMap
from upplied.planning.carry.standoff import Counted, counted, picture_share
from upplied.planning.visibility.frustum import coarseness
from upplied.records import Camera, Cloud, Correspondences, Floats, Record, Trajectory, Visibility


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

    Returns
    -------
    Followed
    """
    positions, quats = carrier.points(flight.positions), without_roll(carrier.orientations(flight.quat_xyzw))
    known = np.flatnonzero((correspondences.target_index >= 0) & visibility.total)
    if len(known) == 0:
        nothing = Counted(np.empty((len(flight), 0)), np.empty((0, 3)), None, np.full(len(flight), np.nan))
        return Followed(positions, quats, nothing)
    here, there = source.points[known], correspondences.target_points[known]
    weight = visibility.seen[:, known] * picture_share(flight.positions, source, known, visibility.total)
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
