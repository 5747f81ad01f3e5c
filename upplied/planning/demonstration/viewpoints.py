"""Segments of a demonstration and their viewpoints (paper, Sec. III-C and Alg. 2, lines 5 to 13)."""

from __future__ import annotations

import itertools

import numpy as np

from upplied.config import ViewpointSettings
from upplied.geometry.poses import mean_rotation
from upplied.records import Ints, Trajectory, Viewpoints, Visibility


def find_viewpoints(
    flight: Trajectory, visibility: Visibility, settings: ViewpointSettings, breaks: Ints | None = None
) -> Viewpoints:
    """One viewpoint for each stretch of the flight that looks at one region (or for each pose, if set so).

    The position is the centroid of the segment's positions, the orientation the mean of its
    rotations, the visible set the union over the segment.

    Parameters
    ----------
    flight : Trajectory
        N poses.
    visibility : Visibility
        What each pose sees, (N, points).
    settings : ViewpointSettings
    breaks : array of int, optional
        Poses that start a new part after a gap in the log; they always start a segment.
    """
    if settings.method == "poses":
        bounds = np.arange(len(flight) + 1)
    else:
        bounds = segment(visibility, settings.shared, breaks)
    spans = list(itertools.pairwise(bounds))
    return Viewpoints(
        positions=np.array([flight.positions[a:b].mean(axis=0) for a, b in spans]),
        quat_xyzw=np.array([mean_rotation(flight.quat_xyzw[a:b]) for a, b in spans]),
        seen=np.array([visibility.seen[a:b].any(axis=0) for a, b in spans]),
        start=bounds[:-1],
        stop=bounds[1:],
        t_s=np.array([flight.t_s[a:b].mean() for a, b in spans]),
    )


def segment(visibility: Visibility, shared: float, breaks: Ints | None = None) -> Ints:
    """Where segments start, followed by the number of poses: (K + 1,).

    The paper's Algorithm 1 writes ``n(start & q) & n(V) < lambda``, which cannot be meant. Ours: a
    segment ends at the first pose q with ``|v_start & v_q| / |v_start| < lambda``. A segment whose
    first pose sees nothing ends at the first pose that sees something.

    Examples
    --------
    >>> seen = np.array([[1, 1, 0], [1, 1, 0], [0, 1, 1], [0, 0, 1]], bool)
    >>> segment(Visibility(seen), 0.6)
    array([0, 2, 3, 4])
    """
    seen = visibility.seen
    forced = set() if breaks is None else {int(index) for index in breaks}
    starts = [0]
    view, size = seen[0], int(seen[0].sum())
    for index in range(1, len(seen)):
        common = int(np.count_nonzero(view & seen[index]))
        moved_on = common < shared * size if size else bool(seen[index].any())
        if moved_on or index in forced:
            starts.append(index)
            view, size = seen[index], int(seen[index].sum())
    return np.array([*starts, len(seen)], np.int64)
