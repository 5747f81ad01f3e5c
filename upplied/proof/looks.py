"""How a flight sees each sample of a surface: in view, near, frontally, when, and as planned."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from upplied.geometry.polylines import interpolated
from upplied.geometry.poses import in_a_row, interpolate
from upplied.geometry.scene import Scene
from upplied.planning.visibility.observations import moments, stations
from upplied.proof.align import silence_s
from upplied.proof.inspected import PlannedLooks, looks_at, views_from
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class Looks(Record):
    """How each of N samples of a surface was seen, by the nearest look; NaN where it was not seen.

    Of a log that was corrected, a sample is seen for certain where its path as logged and as corrected both
    see it, and distance, incidence and pictures are those of the lesser look.
    """

    seen: Bools  # (N,) for certain
    distance_m: Floats  # (N,)
    incidence_deg: Floats  # (N,)
    speed_mps: Floats  # (N,) of the camera then
    t_s: Floats  # (N,) of the flight
    pictures: Ints  # (N,) that show it: photos, or viewpoints that were passed where no photos are known
    # Distance and incidence (N,) of the most frontal look: of all, then within each given distance.
    frontal: tuple[tuple[Floats, Floats], ...] = ()
    assumed: Bools | None = None  # (N,) seen if the correction of the log is right, and only then
    inspected: Bools | None = None  # (N,) for certain as planned; None: no plan is known
    inspected_if_corrected: Bools | None = None  # (N,) the same, if the correction of the log is right

    def __len__(self) -> int:
        return len(self.seen)

    @property
    def values(self) -> dict[str, Floats]:
        """What the catalog stores of them, by name, (N,) each."""
        names = ("distance_m", "incidence_deg", "speed_mps", "t_s")
        distance, incidence = self.frontal[0]
        values = {name: getattr(self, name) for name in names}
        return values | {"frontal_distance_m": distance, "frontal_incidence_deg": incidence}


def looks_of(
    flown: Trajectory, surface: Cloud, camera: Camera, scene: Scene, photo_s: Floats | None = None,
    picture_s: Floats | None = None, within_m: Sequence[float] = (), plan: PlannedLooks | None = None,
) -> Looks:  # fmt: skip
    """How a flight sees each sample of a surface: in view and range, nothing in between, not too obliquely.

    Nothing is seen while the log is silent. Where no photos are known, a sample counts as shown in a picture
    at each moment of `picture_s`, and in one picture at least where it is seen. The most frontal look is that
    of all looks, and of those within each distance `within_m`; `inspected` needs those of a `plan`.
    """
    shown = views_from(_looking(flown, photo_s), surface, camera, scene)
    poses, seen = shown.stations, shown.seen
    pictures = np.asarray(seen.sum(axis=0) if photo_s is not None else seen.any(axis=0), np.int64)
    if photo_s is None and picture_s is not None and len(picture_s):
        passed = views_from(interpolate(flown, picture_s), surface, camera, scene).seen
        pictures = np.asarray(np.maximum(pictures, passed.sum(axis=0)), np.int64)
    where = [np.ascontiguousarray(each) for each in (poses.positions, surface.points, surface.outward)]
    nearest = _best(*where, seen, np.inf, False)
    frontal = [_look(poses, surface, _best(*where, seen, far, True)) for far in (np.inf, *within_m)]
    there: Bools = np.asarray(nearest >= 0, bool)
    near, level = _look(poses, surface, nearest)
    when = np.full(len(there), np.nan)
    when[there] = poses.t_s[nearest[there]]
    pace = np.interp(when, flown.t_s, _speeds(flown))
    inspected = None
    if plan is not None:
        breaks = np.array([part[0] for part in pieces(flown)], np.int64)
        steps = moments(flown, breaks) if photo_s is None else looks_at(flown, poses.t_s, breaks)
        none = np.zeros(len(surface), bool)
        inspected = plan.matched(shown, steps, surface, camera) if len(poses) else none
    return Looks(there, near, level, pace, when, pictures, tuple(frontal), None, inspected)


def certain_looks(corrected: Looks, logged: Looks) -> Looks:
    """What the path as corrected and the path as logged both see, by the lesser look of the two."""
    both: Bools = np.asarray(corrected.seen & logged.seen, bool)

    def lesser(first: Floats, second: Floats) -> Floats:
        return np.where(both, np.maximum(first, second), first)

    pairs, known = zip(corrected.frontal, logged.frontal, strict=True), corrected.inspected
    return replace(
        corrected,
        seen=both,
        assumed=corrected.seen & ~logged.seen,
        inspected_if_corrected=known,
        inspected=None if known is None or logged.inspected is None else known & logged.inspected,
        distance_m=lesser(corrected.distance_m, logged.distance_m),
        incidence_deg=lesser(corrected.incidence_deg, logged.incidence_deg),
        pictures=np.where(both, np.minimum(corrected.pictures, logged.pictures), corrected.pictures),
        frontal=tuple((lesser(one[0], other[0]), lesser(one[1], other[1])) for one, other in pairs),
    )


def _look(poses: Trajectory, surface: Cloud, pose: Ints) -> tuple[Floats, Floats]:
    """Distance, m, and incidence, deg, (N,) of each sample from its pose; NaN where it has none."""
    there, at = pose >= 0, np.maximum(pose, 0)
    ray = poses.positions[at] - surface.points if len(poses) else np.full((len(surface), 3), np.nan)
    distance = np.linalg.norm(ray, axis=1)
    cosine = (ray * surface.outward).sum(axis=1) / np.maximum(distance, 1e-12)
    incidence = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return np.where(there, distance, np.nan), np.where(there, incidence, np.nan)


def _looking(flown: Trajectory, photo_s: Floats | None) -> Trajectory:
    """The poses at which the camera sees: of the photos, or closely spaced along all that was recorded."""
    if photo_s is not None:
        inside = photo_s[(photo_s >= flown.t_s[0]) & (photo_s <= flown.t_s[-1])]
        return interpolate(flown, recorded(flown, np.sort(inside)))
    return in_a_row([stations(flown.take(part)) for part in pieces(flown)])


def pieces(flown: Trajectory) -> list[Ints]:
    """The poses between silences."""
    ends = np.flatnonzero(np.diff(flown.t_s) > silence_s(flown)) + 1
    return np.split(np.arange(len(flown)), ends)


def recorded(flown: Trajectory, moments: Floats) -> Floats:
    """Those of the moments at which the log is not silent, or has a pose."""
    after = np.clip(np.searchsorted(flown.t_s, moments), 1, len(flown) - 1)
    known = flown.t_s[after] - flown.t_s[after - 1] <= silence_s(flown)
    return moments[known | np.isin(moments, flown.t_s)]


@njit(cache=True)
def _best(poses: Floats, points: Floats, normals: Floats, seen: Bools, far_m: float, frontal: bool) -> Ints:
    """For each point the pose that sees it from nearest, or most frontally, within a distance; or -1."""
    best, which = np.full(len(points), np.inf), np.full(len(points), -1, np.int64)
    for pose in range(len(poses)):
        for index in range(len(points)):
            if seen[pose, index]:
                gap, along = 0.0, 0.0
                for axis in range(3):
                    ray = poses[pose, axis] - points[index, axis]
                    gap += ray * ray
                    along += ray * normals[index, axis]
                if gap > far_m * far_m:
                    continue
                cost = -along / np.sqrt(max(gap, 1e-24)) if frontal else gap
                if cost < best[index]:
                    best[index], which[index] = cost, pose
    return which


def _speeds(flown: Trajectory) -> Floats:
    """Speed (N,) at each pose, m/s, over a second around it."""
    after, before = flown.t_s + 0.5, flown.t_s - 0.5
    ahead, behind = (interpolated(end, flown.t_s, flown.positions) for end in (after, before))
    span = np.minimum(after, flown.t_s[-1]) - np.maximum(before, flown.t_s[0])
    return np.asarray(np.linalg.norm(ahead - behind, axis=1) / np.maximum(span, 1e-9))
