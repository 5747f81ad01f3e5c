"""What of a target was never scanned: where the source has surface and the scan is open instead.

A displacement that brings the source onto what was scanned brings the rest of it to where the rest of the
target is likely to be. Nobody knows more of that, so a path keeps clear of it, and nothing of it is shown.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.geometry.discs import Discs
from upplied.geometry.scene import Scene, scene_of
from upplied.geometry.vectors import across
from upplied.planning.constants import FRAGMENT, LEAST_PART, MAJORITY, TOUCH
from upplied.planning.correspondence.coherent_point_drift import brought_onto
from upplied.planning.correspondence.fit import Fit
from upplied.planning.correspondence.label_transfer import connected
from upplied.planning.correspondence.partial import as_likely, is_open
from upplied.planning.geometry.clouds import spacing
from upplied.planning.surface.escape import shows_inside
from upplied.planning.surface.parts import labels_of
from upplied.records import (
    Bools,
    Cloud,
    Correspondences,
    Floats,
    Ints,
    Record,
    Registration,
    Structure,
    SupposedSurface,
)

_SURE = 95  # percent of what was scanned as well, that lies as near to where it is brought as the error says


@dataclass(frozen=True, eq=False, repr=False)
class NeverScanned(Record):
    """Where the scan of a target is open, and what of the source would lie beyond."""

    opening: Ints  # (A,) samples of the target whose inside shows, and the source's does not
    beyond: Ints  # (K,) samples of the source that would lie where nothing was scanned
    area_m2: float = 0.0  # of the target, that they stand for
    error_m: float = 0.0  # how far the surface may be from there
    reach_m: float = 0.0  # how much farther the target may go on by other registrations that are as likely
    supposed: SupposedSurface | None = None  # where these samples lie, and where the target may go on


NOTHING_MISSING = NeverScanned(np.empty(0, np.int64), np.empty(0, np.int64))


def never_scanned(source: Structure, target: Structure, fit: Fit) -> NeverScanned:
    """What of a registered scan was never scanned, as the source tells; `fit` is that of their surfaces."""
    here, there, registration = fit.source, fit.target, fit.registration
    scene, open_ = scene_of(target), _open(target, there)
    # Between the discs of a thin cloud some of the inside shows of a wing that is whole.
    least = LEAST_PART if scene.grain_m else FRAGMENT
    if there.areas[open_].sum() < least * there.areas.sum():
        return NOTHING_MISSING
    step = TOUCH * spacing(there)  # nearer to what was scanned, nothing is missing
    points = registration.to_target(brought_onto(fit.registered, here).points)
    normals, area_m2 = _in_target_frame(here, registration)
    open_here = _open(source, here)
    if open_here.any():
        open_ &= cKDTree(points[open_here]).query(there.points)[0] > TOUCH * step
    if not open_.any():
        return NOTHING_MISSING
    apart, seeds, opening = _apart(scene, points), there.points[open_], np.flatnonzero(open_)
    beyond, near = _beyond(points, apart, seeds, step), apart[apart <= step]
    error_m = float(np.percentile(near, _SURE)) if len(near) else step
    surfaces = [(points[beyond], normals[beyond])]
    # By other registrations that are as likely: nobody knows where a body ends that was cut off.
    known, reach_m = cKDTree(np.concatenate([there.points, points[beyond]])), 0.0
    for way, past in as_likely(here, there, registration) if is_open(there) else ():
        other, facing = way.to_target(here.points[past]), _in_target_frame(here, way)[0][past]
        farther = _beyond(other, _apart(scene, other), seeds, step)
        off = known.query(other[farther])[0]
        reach_m, farther = max(reach_m, float(off.max(initial=0.0))), farther[off > step]
        surfaces.append((other[farther], facing[farther]))
    if reach_m <= step:
        surfaces, reach_m = surfaces[:1], 0.0
    supposed = supposed_surface(surfaces, float(np.sqrt(area_m2.mean())), error_m)
    return NeverScanned(opening, beyond, float(area_m2[beyond].sum()), error_m, reach_m, supposed)


def _apart(scene: Scene, points: Floats) -> Floats:
    """Distance of points (N, 3) from the scan, m, at least its surface error."""
    return np.maximum(scene.apart(points), scene.error_m)


def _beyond(points: Floats, apart: Floats, seeds: Floats, step: float) -> Ints:
    """Which samples (K,) lie apart from what was scanned, and are joined with an opening by short steps."""
    far, reach_m = np.flatnonzero(apart > step), TOUCH * step
    if not len(far):
        return far
    pairs = cKDTree(points[far]).query_pairs(reach_m, output_type="ndarray")
    piece = connected(pairs, np.zeros(len(far), np.int64))
    near = cKDTree(seeds).query(points[far])[0] <= reach_m
    return far[np.isin(piece, np.unique(piece[near]))]


def _open(structure: Structure, cloud: Cloud) -> Bools:
    return shows_inside(structure, scene_of(structure), cloud) if cloud.open is None else cloud.open


def supposed_surface(
    surfaces: Sequence[tuple[Floats, Floats]], spacing_m: float, error_m: float
) -> SupposedSurface | None:
    """Surface where nothing was scanned, of points and normals: the first likely, the others possible."""
    likely = np.repeat(np.arange(len(surfaces)) == 0, [len(points) for points, _ in surfaces])
    surfaces = [each for each in surfaces if len(each[0])]
    if not surfaces:
        return None
    points, normals = (np.concatenate([each[at] for each in surfaces]) for at in (0, 1))
    radius_m = np.concatenate([Discs.of(*each).radius_m for each in surfaces])
    # A sample that lies alone stands for no more surface than others.
    radius_m = np.minimum(radius_m, TOUCH * spacing_m)
    return SupposedSurface(points, normals, across(normals)[0], radius_m, likely, error_m)


def without(
    match: Correspondences, missing: NeverScanned, here: Cloud, there: Cloud, carried: Ints | None
) -> Correspondences:
    """The correspondences without those of what was never scanned.

    A part that corresponds to another one than the one where it would lie, since a user named it or it is
    repeated there, keeps its own. `carried` (M,) is the source's part that a smooth displacement brings onto
    each target sample.
    """
    gone, mine = missing.beyond, labels_of(here)
    if carried is not None:
        theirs, area = labels_of(there), there.areas
        for part in np.unique(mine[gone]).tolist():
            on = np.isin(theirs, match.target_parts(part))
            if area[on & (carried == part)].sum() < MAJORITY * area[on].sum():
                gone = gone[mine[gone] != part]
    if not len(gone):
        return match
    scanned = np.ones(len(here), bool)
    scanned[gone] = False
    return replace(
        match,
        target_index=np.where(scanned, match.target_index, -1),
        distance_m=np.where(scanned, match.distance_m, np.nan),
        target_points=np.where(scanned[:, None], match.target_points, np.nan),
    )


def _in_target_frame(here: Cloud, registration: Registration) -> tuple[Floats, Floats]:
    """Normals (N, 3) and areas (N,), m^2, of a source's samples as those of surface carried to the target."""
    carried = here.outward @ registration.matrix
    length = np.linalg.norm(carried, axis=1)
    return carried / length[:, None], here.areas * length / np.abs(np.linalg.det(registration.matrix))
