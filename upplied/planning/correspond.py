"""Which point of the target answers to each point of the demonstration's cloud (paper, Sec. III-B)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import CorrespondenceSettings
from upplied.records import Cloud, Correspondences, Registration


def correspond(
    source: Cloud, target: Cloud, registration: Registration, settings: CorrespondenceSettings
) -> Correspondences:
    """Counterparts of all points of the demonstration's cloud.

    Parameters
    ----------
    source, target : Cloud
        Of the demonstration structure and of the target, each in its own frame.
    registration : Registration
    settings : CorrespondenceSettings

    Returns
    -------
    Correspondences
    """
    return nearest(source, target, registration)


def nearest(source: Cloud, target: Cloud, registration: Registration) -> Correspondences:
    """The nearest point of the aligned target for every point (paper, Alg. 1, lines 8 to 12)."""
    aligned = registration.to_demo(target.points)
    distance, index = cKDTree(aligned).query(source.points)
    return Correspondences(
        target_index=np.asarray(index, np.int64),
        distance_m=np.asarray(distance, float),
        target_points=target.points[index],
        summary=f"nearest of {len(target)} target points for each of {len(source)}",
    )
