"""The whole path leaned towards what it sees too obliquely (preset `recommended`).

Many missed samples miss by a few degrees of incidence each: the belly seen from slightly too high,
a flank from slightly too far ahead. No single bend is worth it for one of them, one gentle lean is
for all.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from upplied.planning.trajectory.look import View
from upplied.records import Floats, Ints

_VOTERS = 600
_SMOOTHING = 5.0  # stations


def lean(positions: Floats, missing: Ints, view: View, reach_m: Floats) -> Floats:
    """The move of each station (M, 3), m, that missed samples ask for, smooth along the path.

    Each sample votes, with its need, for the least move along its normal that ends a too oblique
    view, at the station where that move is least.

    Parameters
    ----------
    positions : array, shape (M, 3), m
    missing : array of int
        Samples of the view's cloud.
    view : View
    reach_m : array, shape (3,), m
        What counts as far along each axis.
    """
    voters = missing[np.unique(np.linspace(0, len(missing) - 1, min(_VOTERS, len(missing))).astype(int))]
    normals = view.cloud.normals[voters]  # type: ignore[index]
    move = least_moves(view.cloud.points[voters], normals, positions, view.settings.max_incidence_deg)
    effort = move * np.linalg.norm(normals / reach_m, axis=1)[:, None]
    station = effort.argmin(axis=1)
    least = np.arange(len(voters)), station
    willing = (effort[least] > 0) & (effort[least] < 2.0)
    weight = view.need[voters] * willing
    asked, votes = np.zeros_like(positions), np.zeros(len(positions))
    np.add.at(asked, station, (weight * move[least])[:, None] * normals)
    np.add.at(votes, station, weight)
    asked = gaussian_filter1d(asked, _SMOOTHING, axis=0, mode="nearest")
    votes = gaussian_filter1d(votes, _SMOOTHING, mode="nearest")
    few = 0.05 * max(float(votes.max()), 1e-12)
    return asked / (votes + few)[:, None]


def least_moves(points: Floats, normals: Floats, positions: Floats, max_incidence_deg: float) -> Floats:
    """How far (N, M) each camera must move along each sample's normal to see it at the largest incidence.

    Parameters
    ----------
    points, normals : array, shape (N, 3)
    positions : array, shape (M, 3), m
    max_incidence_deg : float
        Two degrees are kept in reserve.
    """
    ray = positions[None] - points[:, None]
    height = np.einsum("nmk,nk->nm", ray, normals)
    wanted = np.cos(np.radians(max_incidence_deg - 2.0)) * np.linalg.norm(ray, axis=2)
    return 1.05 * np.maximum(wanted - height, 0.0)
