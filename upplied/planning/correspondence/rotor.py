"""A rotor that stopped elsewhere: the turn of one structure's blades that fits another's surface best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.planning.constants import TOLERANCE
from upplied.planning.geometry.boxes import box_scale, diagonal_of
from upplied.planning.surface.parts import blades_of, labels_of
from upplied.records import Cloud, Floats
from upplied.vectors import scaled_normals

_STEP_DEG = 7.5  # a blade is about as wide, seen from its hub, at half its length
_ASKED = 400  # samples of the blades that are asked


def rotor_turned(known: Cloud, whole: Cloud) -> Cloud:
    """Samples of a structure, its rotor turned as that of a surface on which no blades are known.

    Parameters
    ----------
    known : Cloud
        With parts. Where none of them is a blade it comes back as it is.
    whole : Cloud
        In the same frame, of about the same size.

    Returns
    -------
    Cloud
        Its bounding box is that of `whole`, since where a rotor stopped shifts and widens the box.
    """
    blades = blades_of(known)
    if not blades.any() or known.normals is None:
        return known
    number = len(np.unique(labels_of(known)[blades]))
    middle, axis = _hub(known.points[blades], labels_of(known)[blades])
    tree, diagonal = cKDTree(whole.points), diagonal_of(whole.points)
    best, least = known, np.inf
    for angle in np.radians(np.arange(0, 360 / number, _STEP_DEG)):
        turn = _about(axis, float(angle))
        points, normals = known.points.copy(), known.normals.copy()
        points[blades] = (points[blades] - middle) @ turn.T + middle
        normals[blades] = normals[blades] @ turn.T
        fitted = _in_box_of(replace(known, points=points, normals=normals), whole.points)
        some = fitted.points[blades][:: max(1, int(blades.sum()) // _ASKED)]
        off = float(np.minimum(tree.query(some)[0], TOLERANCE * diagonal).mean())
        if off < least:
            best, least = fitted, off
    return best


def _hub(points: Floats, label: np.ndarray) -> tuple[Floats, Floats]:
    """The middle of a rotor, m, and its axis: across all blades."""
    middle = np.mean([points[label == blade].mean(axis=0) for blade in np.unique(label)], axis=0)
    offset = points - middle
    return middle, np.linalg.eigh(offset.T @ offset)[1][:, 0]


def _about(axis: Floats, angle: float) -> Floats:
    """The rotation matrix about a unit axis."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew


def _in_box_of(cloud: Cloud, points: Floats) -> Cloud:
    """A cloud scaled and shifted until its bounding box is that of some points."""
    scale = box_scale(points, cloud.points)
    normals = scaled_normals(cloud.outward, scale)
    return replace(cloud, points=scale * (cloud.points - cloud.points.min(axis=0)) + points.min(axis=0),
                   normals=normals)  # fmt: skip
