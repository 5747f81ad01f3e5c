"""What of a target was never scanned: where the source has surface and the scan is open instead.

A displacement that brings the source onto what was scanned brings the rest of it to where the rest of the
target is likely to be. Nobody knows more of that, so a path keeps clear of it, and nothing of it is shown.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import CloudSettings
from upplied.discs import Discs
from upplied.planning.constants import FRAGMENT, LEAST_PART, MAJORITY, TOUCH
from upplied.planning.correspondence.coherent_point_drift import brought_onto
from upplied.planning.correspondence.fit import Fit
from upplied.planning.correspondence.label_transfer import connected
from upplied.planning.correspondence.memo import Memo, content_key
from upplied.planning.correspondence.partial import as_likely, is_open
from upplied.planning.geometry.boxes import in_source_frame, spacing
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
from upplied.scene import Scene
from upplied.vectors import across

_SURE = 95  # percent of what was scanned as well, that lies as near to where it is brought as the error says


@dataclass(frozen=True, eq=False, repr=False)
class NeverScanned(Record):
    """Where the scan of a target is open, and what of the source would lie beyond."""

    opening: Ints  # (A,) samples of the target whose inside shows, and the source's does not
    beyond: Ints  # (K,) samples of the source that would lie where nothing was scanned
    points: Floats  # (K, 3) m, where they would, target frame
    normals: Floats  # (K, 3) unit
    area_m2: float  # of the target, that they stand for
    error_m: float  # how far the surface may be from there
    spacing_m: float = 0.0  # of these samples
    # The same by other registrations that are as likely: nobody knows where a body ends that was cut off.
    other_points: Floats = field(default_factory=lambda: np.empty((0, 3)))  # (J, 3) m
    other_normals: Floats = field(default_factory=lambda: np.empty((0, 3)))  # (J, 3) unit
    other_way: Ints = field(default_factory=lambda: np.empty(0, np.int64))  # (J,) which registration
    reach_m: float = 0.0  # how much farther the target may go on so


NOTHING_MISSING = NeverScanned(*(np.empty(0, np.int64),) * 2, *(np.empty((0, 3)),) * 2, 0.0, 0.0)


def missing_from(
    fit: Fit,
    structures: tuple[Structure, Structure],
    scenes: tuple[Scene, Scene],
    clouds: CloudSettings,
    memo: Memo,
) -> NeverScanned:
    """What of a fitted target was never scanned, remembered; nothing of one that is no scan."""
    if not structures[1].is_scan:
        return NOTHING_MISSING
    registration = fit.registration
    lies = registration.matrix.tolist(), registration.translation.tolist()
    key = content_key("never scanned", *(each.sha256 for each in structures), clouds, lies)
    (one, other), (here, there) = structures, scenes
    return memo(
        "missing",
        NeverScanned,
        key,
        lambda: never_scanned(one, here, fit.source, other, there, fit.target, registration),
    )


def never_scanned(
    source: Structure,
    source_scene: Scene,
    here: Cloud,
    target: Structure,
    target_scene: Scene,
    there: Cloud,
    registration: Registration,
) -> NeverScanned:
    """What of a registered target was never scanned, as the source tells.

    Parameters
    ----------
    source, target : Structure
    source_scene, target_scene : Scene
    here, there : Cloud
        Their surface samples, each in its own frame.
    registration : Registration
    """
    open_ = _open(target, target_scene, there)
    # Between the discs of a thin cloud some of the inside shows of a wing that is whole.
    least = LEAST_PART if target_scene.grain_m else FRAGMENT
    if there.areas[open_].sum() < least * there.areas.sum():
        return NOTHING_MISSING
    step = TOUCH * spacing(there)  # nearer to what was scanned, nothing is missing
    moved = brought_onto(in_source_frame(there, registration), here)
    points = registration.to_target(moved.points)
    normals, area_m2 = _in_target_frame(here, registration)
    open_here = _open(source, source_scene, here)
    if open_here.any():
        open_ &= cKDTree(points[open_here]).query(there.points)[0] > TOUCH * step
    if not open_.any():
        return NOTHING_MISSING
    apart = _apart(target_scene, points)
    beyond = _beyond(points, apart, there.points[open_], step)
    near = apart[apart <= step]
    known = NeverScanned(
        np.flatnonzero(open_),
        beyond,
        points[beyond],
        normals[beyond],
        float(area_m2[beyond].sum()),
        float(np.percentile(near, _SURE)) if len(near) else step,
        float(np.sqrt(area_m2.mean())),
    )
    if not is_open(there):
        return known
    return _with_others(known, here, there, registration, target_scene, step)


def _with_others(
    known: NeverScanned, here: Cloud, there: Cloud, registration: Registration, scene: Scene, step: float
) -> NeverScanned:
    """What is missing, with where the target may go on by other registrations."""
    seeds, supposed = there.points[known.opening], cKDTree(np.concatenate([there.points, known.points]))
    others: list[tuple[Floats, Floats, Ints]] = []
    reach_m = 0.0
    for number, (way, past) in enumerate(as_likely(here, there, registration)):
        points, normals = way.to_target(here.points[past]), _in_target_frame(here, way)[0][past]
        beyond = _beyond(points, _apart(scene, points), seeds, step)
        farther = supposed.query(points[beyond])[0]
        beyond, reach_m = beyond[farther > step], max(reach_m, float(farther.max(initial=0.0)))
        others.append((points[beyond], normals[beyond], np.full(len(beyond), number)))
    if reach_m <= step:
        return known
    points, normals, way_of = (np.concatenate(each) for each in zip(*others, strict=True))
    return replace(known, other_points=points, other_normals=normals, other_way=way_of, reach_m=reach_m)


def _apart(scene: Scene, points: Floats) -> Floats:
    """How far points (N, 3) lie from what was scanned, m; no nearer than that is known."""
    return np.maximum(scene.apart(points), scene.error_m)


def _beyond(points: Floats, apart: Floats, seeds: Floats, step: float) -> Ints:
    """Which samples (K,) lie apart from what was scanned, and are joined with an opening."""
    far = np.flatnonzero(apart > step)
    return far[_reached(points[far], seeds, TOUCH * step)] if len(far) else far


def _open(structure: Structure, scene: Scene, cloud: Cloud) -> Bools:
    return shows_inside(structure, scene, cloud) if cloud.open is None else cloud.open


def supposed_surface(missing: NeverScanned) -> SupposedSurface | None:
    """The surface that is supposed where nothing was scanned, and where it may go on; None where none is."""
    surfaces = [(missing.points, missing.normals, True)] if len(missing.beyond) else []
    for way in np.unique(missing.other_way):
        mine = missing.other_way == way
        surfaces.append((missing.other_points[mine], missing.other_normals[mine], False))
    if not surfaces:
        return None
    points, normals = (np.concatenate([each[at] for each in surfaces]) for at in (0, 1))
    radius_m = np.concatenate([Discs.of(*each[:2]).radius_m for each in surfaces])
    return SupposedSurface(
        points,
        normals,
        across(normals)[0],
        # A sample that lies alone stands for no more surface than others.
        np.minimum(radius_m, TOUCH * missing.spacing_m),
        np.repeat([each[2] for each in surfaces], [len(each[0]) for each in surfaces]),
        missing.error_m,
    )


def without(
    match: Correspondences, missing: NeverScanned, here: Cloud, there: Cloud, carried: Ints | None
) -> Correspondences:
    """The same, where what was never scanned has no counterpart.

    A part that corresponds to another one than the one where it would lie, since a user said so or it is
    repeated there, keeps what it has.

    Parameters
    ----------
    match : Correspondences
    missing : NeverScanned
    here, there : Cloud
        The surface samples of the source and the target, with parts.
    carried : array of int, shape (M,), or None
        The source's part that a smooth displacement brings onto each target sample.
    """
    gone, mine = missing.beyond, labels_of(here)
    if carried is not None:
        elsewhere = [
            part for part in np.unique(mine[gone]).tolist() if _elsewhere(match, part, there, carried)
        ]
        gone = gone[~np.isin(mine[gone], elsewhere)]
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


def _elsewhere(match: Correspondences, part: int, there: Cloud, carried: Ints) -> bool:
    """Whether a part of the source was matched with what it does not come to lie on."""
    theirs = np.isin(labels_of(there), match.target_parts(part))
    area = there.areas
    return bool(area[theirs & (carried == part)].sum() < (1 - MAJORITY) * area[theirs].sum())


def _in_target_frame(here: Cloud, registration: Registration) -> tuple[Floats, Floats]:
    """Normals (N, 3) and areas (N,), m^2, of a source's samples as those of surface carried to the target."""
    carried = here.outward @ registration.matrix
    length = np.linalg.norm(carried, axis=1)
    return carried / length[:, None], here.areas * length / np.abs(np.linalg.det(registration.matrix))


def _reached(points: Floats, seeds: Floats, reach_m: float) -> Bools:
    """Which points (N,) are joined with a seed over steps of at most `reach_m`."""
    pairs = cKDTree(points).query_pairs(reach_m, output_type="ndarray")
    piece = connected(pairs, np.zeros(len(points), np.int64))
    near = cKDTree(seeds).query(points)[0] <= reach_m
    return np.isin(piece, np.unique(piece[near]))
