"""Which point of the target corresponds to each point of the demonstration's cloud (paper, Sec. III-B)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import CorrespondenceSettings
from upplied.planning.correspondence.by_parts import by_parts
from upplied.planning.correspondence.landmarks import Landmarks, pinned_parts
from upplied.planning.correspondence.misfit import UNTURNED
from upplied.records import Cloud, Correspondences, Floats, Ints, Registration


def correspond(
    source: Cloud,
    target: Cloud,
    registration: Registration,
    settings: CorrespondenceSettings,
    source_landmarks: Landmarks | None = None,
    target_landmarks: Landmarks | None = None,
    words: Floats = UNTURNED,
    named: Ints | None = None,
) -> Correspondences:
    """Counterparts of all points of the demonstration's cloud.

    Parameters
    ----------
    source, target : Cloud
        Of the demonstration structure and of the target, each in its own frame.
    registration : Registration
    settings : CorrespondenceSettings
        Method ``nearest`` as published, or ``parts``, for clouds with normals.
    source_landmarks, target_landmarks : mapping of name to x y z, m, optional
        What the names in `settings.counterparts` may refer to.
    words : array, shape (3, 3), optional
        Quarter turns of the source to the axes in which places such as ``left`` are named.
    named : array of int, shape (M,), optional
        The source's part that the parts of either were inferred by, of each target sample; -1 none.

    Returns
    -------
    Correspondences

    Raises
    ------
    SettingsError
        If `settings.counterparts` names a part that is not there.
    """
    if settings.method == "nearest" or source.normals is None or target.normals is None:
        return nearest(source, target, registration)
    landmarks = (source_landmarks or {}, target_landmarks or {})
    pinned = pinned_parts(
        source, target, registration, settings.counterparts, *landmarks, words=words, named=named
    )
    return by_parts(source, target, registration, pinned, words, named)


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
