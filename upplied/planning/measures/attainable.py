"""Which samples of a surface could be seen at all (`coverage_attainable_pct`).

For each sample many camera positions are tried: along its normal and around it up to the limit of
the incidence, from near to far. The first that may be flown and sees the sample settles it. What is
left then tries the positions that served its neighbours, which finds the narrow places. So a `True`
is proven by a position; a `False` means that none of some seven hundred does.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import VisibilitySettings
from upplied.geometry.vectors import across
from upplied.planning.airspace.rules import Airspace
from upplied.planning.visibility.observations import TRULY
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record

_TILTS = (0.0, 0.3, 0.55, 0.75, 0.88, 0.98)  # of the largest incidence
_TURNS = 16
_DISTANCES = 8
_NEIGHBOURS = 24
_BESIDE = 9  # of a missed sample, itself and others, that are tried with it
_ROUNDS = 6  # of asking neighbours
_ANYWHERE_M = 1e9
_BATCH = 6000  # rays at a time: one more position is tried for samples just served than need be


def attainable(
    cloud: Cloud,
    airspace: Airspace,
    camera: Camera,
    settings: VisibilitySettings,
    farthest_m: Floats | None = None,
) -> Bools:
    """Which samples (N,) some allowed position sees, the camera turned as it likes; see `seen_from`."""
    return np.isfinite(seen_from(cloud, airspace, camera, settings, farthest_m)[:, 0])


def attainable_beside(
    missed: Ints, cloud: Cloud, airspace: Airspace, camera: Camera, farthest_m: Floats | None = None
) -> Bools:
    """Which of some samples (K,) of a cloud some allowed position truly sees; see `attainable`.

    Their neighbours are tried with them: they tell from where a narrow place is seen.
    """
    if not len(missed):
        return np.zeros(0, bool)
    near = cKDTree(cloud.points).query(cloud.points[missed], k=min(_BESIDE, len(cloud)))[1]
    tried = np.unique(near)
    farthest = None if farthest_m is None else farthest_m[tried]
    possible = attainable(cloud.at(tried), airspace, camera, TRULY, farthest)
    return np.asarray(possible[np.searchsorted(tried, missed)], bool)


def seen_from(
    cloud: Cloud,
    airspace: Airspace,
    camera: Camera,
    settings: VisibilitySettings,
    farthest_m: Floats | None = None,
    pitch_deg: tuple[float, float] | None = None,
) -> Floats:
    """From where each sample is seen by a camera that looks straight at it.

    Parameters
    ----------
    cloud : Cloud
        N surface samples with normals.
    airspace : Airspace
        Safety distance, ground and other limits, and the scene that may hide the sample.
    camera : Camera
        Its range counts, its field of view does not.
    settings : VisibilitySettings
        Its limit on the incidence.
    farthest_m : array, shape (N,), m, optional
        From how far off, at most, each sample is to be seen frontally, and by the cosine of the incidence
        nearer obliquely; the camera's range where not given.
    pitch_deg : tuple, optional
        Least and largest pitch of the look, deg; up is positive.

    Returns
    -------
    array, shape (N, 3), m
        The most likely of the positions that were tried, which is the most frontal one; NaN where none is.
    """
    tilt, turn, share = _candidates(settings.max_incidence_deg)
    nearest = max(max(camera.min_range_m, airspace.clearance_m) * 1.001, 1e-3)
    most = camera.max_range_m * 0.999
    farthest = np.full(len(cloud), _ANYWHERE_M) if farthest_m is None else farthest_m
    possible = np.minimum(farthest, most) > nearest
    frames, targets = _frames(cloud), _Targets(cloud, airspace, pitch_deg)
    served = np.full((len(cloud), 3), np.nan)  # from where each sample was seen
    tried = 0
    while tried < len(tilt) and (np.isnan(served[:, 0]) & possible).any():
        left = np.flatnonzero(np.isnan(served[:, 0]) & possible)
        # As many again as were tried, since most samples are served soon.
        batch = slice(tried, tried + max(1, min(tried, _BATCH // len(left))))
        reach = np.minimum(farthest[left, None] * np.cos(tilt[batch]), most)
        off = frames[left], tilt[batch], turn[batch], _distances(share[batch], nearest, reach)
        positions = cloud.points[left][:, None] + _from_sample(*off)
        targets.serve(served, positions, left)
        tried = batch.stop
    _ask_neighbours(served, targets, (camera.min_range_m, most), farthest, settings.max_incidence_deg)
    return served


@dataclass(frozen=True, eq=False, repr=False)
class _Targets(Record):
    """Samples that are to be seen, and where a camera may be and look."""

    cloud: Cloud
    airspace: Airspace
    pitch_deg: tuple[float, float] | None = None

    def serve(self, served: Floats, positions: Floats, left: Ints) -> None:
        """Note for each sample of `left` the first of its positions (left, tried, 3) that sees it."""
        sample = np.repeat(left, positions.shape[1])
        seen = self.seen(positions.reshape(-1, 3), sample).reshape(positions.shape[:2])
        success = seen.any(axis=1)
        served[left[success]] = positions[success, seen[success].argmax(axis=1)]

    def seen(self, positions: Floats, sample: Ints) -> Bools:
        """Which positions are allowed and freely see their sample (K,); cheap questions first."""
        airspace, scene, points = self.airspace, self.airspace.scene, self.cloud.points[sample]
        seen = np.isfinite(positions[:, 0])
        if self.pitch_deg is not None:
            rise, (low, high) = points[seen] - positions[seen], np.sin(np.radians(self.pitch_deg))
            sine = rise[:, 2] / np.linalg.norm(rise, axis=1)
            seen[seen] = (sine >= low) & (sine <= high)
        seen[seen] = airspace.in_bounds(positions[seen])
        if scene.grain_m:
            ray = points[seen] - positions[seen]
            points[seen] -= ray * (scene.grain_m / np.linalg.norm(ray, axis=1))[:, None]
        seen[seen] = ~scene.occluded(positions[seen], points[seen])
        seen[seen] = scene.distance(positions[seen]) >= airspace.clearance_m
        return seen


def _ask_neighbours(
    served: Floats,
    targets: _Targets,
    range_m: tuple[float, float],
    farthest: Floats,
    max_incidence_deg: float,
) -> None:
    """Try for each sample left the positions that served its nearest neighbours, again where one helped."""
    cloud, left = targets.cloud, np.flatnonzero(np.isnan(served[:, 0]))
    number = min(_NEIGHBOURS + 1, len(cloud))
    near = cKDTree(cloud.points).query(cloud.points[left], k=number)[1].reshape(len(left), number)
    limit = np.cos(np.radians(max_incidence_deg))
    for _ in range(_ROUNDS):
        open_ = np.isnan(served[left, 0])
        if not open_.any():
            return
        before = int(open_.sum())
        positions = served[near[open_]]
        ray = positions - cloud.points[left[open_]][:, None]
        length = np.linalg.norm(ray, axis=2)
        facing = np.einsum("nki,ni->nk", ray, cloud.outward[left[open_]])
        fits = (facing >= limit * length) & (length >= range_m[0]) & (length <= range_m[1])
        fits &= length**2 <= farthest[left[open_], None] * facing
        positions[~fits] = np.inf  # in no airspace
        targets.serve(served, positions, left[open_])
        if np.isnan(served[left, 0]).sum() == before:
            return


def _candidates(max_incidence_deg: float) -> tuple[Floats, Floats, Floats]:
    """Tilt from the normal, turn around it (rad), and distance, as a share of the way from near to far."""
    # Likely ones first.
    ladder = np.roll(np.linspace(0, 1, _DISTANCES), -2)
    limit = np.radians(min(max_incidence_deg, 89.9))
    rows = [(0.0, 0.0, length) for length in ladder]
    for share in _TILTS[1:]:
        turns = np.arange(_TURNS) * 2 * np.pi / _TURNS
        rows += [(share * limit, turn, length) for length in ladder for turn in turns]
    tilt, turn, distance = np.array(rows).T
    return tilt, turn, distance


def _distances(share: Floats, nearest: float, farthest: Floats) -> Floats:
    """Distances (samples, candidates), m, at shares of the way from near to far on a logarithmic scale."""
    growth = np.maximum(farthest, nearest) / nearest
    return np.asarray(np.where(farthest > nearest, nearest * growth**share, np.nan))


def _frames(cloud: Cloud) -> Floats:
    """The normal of each sample and two directions across it, as rows (N, 3, 3)."""
    return np.stack([cloud.outward, *across(cloud.outward)], axis=1)


def _from_sample(frames: Floats, tilt: Floats, turn: Floats, distance: Floats) -> Floats:
    """Camera positions from their sample (samples, candidates, 3), m."""
    normal, first, second = (frames[:, None, row] for row in range(3))
    around = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    direction = np.cos(tilt)[:, None] * normal + np.sin(tilt)[:, None] * around
    return distance[:, :, None] * direction
