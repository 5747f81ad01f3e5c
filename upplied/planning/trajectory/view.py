"""What a path is to show of its target: how much each sample is needed, and from how near."""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.poses import from_yaw_pitch, optical_axis
from upplied.geometry.scene import Scene
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.terms.axis import Axis, aims_of, axes
from upplied.planning.visibility.line_of_sight import Closeness, coarseness, seen_by_any, visible
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record

BORDER = 0.20  # over which soft coverage falls: of the cosine, of the border's angle in rad, of the distance
ALIKE = 0.01  # of the need, by which one path is no better than another: as near as coverage is known
_BESIDE = 48  # of the path, beside which places are tried
_AWAY = 0.4  # stand-offs, to all sides, and twice that
_OBLIQUE_DEG = 88.0  # up to which lines of sight are asked for: those beyond the limit may come within it


@dataclass(frozen=True, eq=False, repr=False)
class View(Record):
    """The target's samples, how much each is needed, and by which camera it is to be shown."""

    cloud: Cloud  # N surface samples of the target with normals
    need: Floats  # (N,) share of all that is to be shown; sums to 1, 0 where nothing is
    farthest_m: Floats  # (N,) from where a frontal look resolves each, an oblique one times its cosine
    inspected: Bools  # (N,) those that the demonstration was about; others are required besides
    camera: Camera
    settings: VisibilitySettings
    limits: RetimeSettings
    scene: Scene
    fov_deg: Floats | None = None  # (M, 2) of each station of the path, where the camera zooms
    least_cosine: Floats | None = None  # (N,) of the incidence, where single samples ask for more

    def shown(self, positions: Floats, quat_xyzw: Floats, chosen: Ints) -> Bools:
        """(m,) which of these samples some station's pose truly sees from near enough."""
        closeness = self._closeness(chosen, self.fov_deg)
        poses, part = (positions, quat_xyzw), self.cloud.at(chosen)
        return seen_by_any(*poses, part, self.camera, self.settings, self.scene, self.fov_deg, closeness)

    def seen(self, positions: Floats, quat_xyzw: Floats, chosen: Ints, station: Ints) -> Bools:
        """(S, m) which of these samples each pose sees, beside which station (S,) of the path it is."""
        fov_deg = None if self.fov_deg is None else self.fov_deg[station]
        closeness = self._closeness(chosen, fov_deg)
        poses, part = (positions, quat_xyzw), self.cloud.at(chosen)
        return visible(*poses, part, self.camera, self.settings, self.scene, fov_deg, closeness).seen

    def reach(self, positions: Floats, chosen: Ints, station: Ints | None = None) -> Bools:
        """(S, m) which of these samples each position would see with its camera turned anywhere.

        `station` (S,) says which stations of the path they are, where they are not all.
        """
        camera = replace(self.camera, hfov_deg=360.0, vfov_deg=180.0)
        level = np.tile([0.0, 0.0, 0.0, 1.0], (len(positions), 1))
        fov_deg = self.fov_deg if self.fov_deg is None or station is None else self.fov_deg[station]
        part, closeness = self.cloud.at(chosen), self._closeness(chosen, fov_deg)
        return visible(positions, level, part, camera, self.settings, self.scene, closeness=closeness).seen

    def missed(self, positions: Floats, quat_xyzw: Floats) -> Ints:
        """The needed samples that none of these poses truly sees from near enough."""
        needed = np.flatnonzero(self.need > 0)
        return needed[~self.shown(positions, quat_xyzw, needed)]

    def sampled(self, most: int) -> tuple[Ints, Floats]:
        """At most so many samples that stand for all, and their need; two thirds of them inspected ones."""
        chosen, needs = [], []
        inspected = np.flatnonzero((self.need > 0) & self.inspected)
        others = np.flatnonzero((self.need > 0) & ~self.inspected)
        first = min(len(inspected), max(2 * most // 3, most - len(others)))
        for group, count in ((inspected, first), (others, most - first)):
            if len(group) and count:
                few = group[:count]
                chosen.append(few)
                needs.append(self.need[few] * self.need[group].sum() / self.need[few].sum())
        if not chosen:
            return np.empty(0, np.int64), np.empty(0)
        return np.concatenate(chosen), np.concatenate(needs)

    def _closeness(self, chosen: Ints, fov_deg: Floats | None) -> Closeness:
        least = None if self.least_cosine is None else self.least_cosine[chosen]
        return Closeness(self.farthest_m[chosen], least, coarseness(self.camera, fov_deg))


@dataclass(frozen=True, eq=False, repr=False)
class Sight(Record):
    """What is in reach of S stations of a path."""

    free: Bools  # (S, m) which samples each would see with its camera turned there
    axis: Axis

    @classmethod
    def of(cls, path: Flown, view: View, samples: Ints, need: Floats, aside_rad: Floats) -> "Sight":
        """Of m samples with their need, by a path whose expert looked so far aside at its stations."""
        # As far again as a border reaches: the path moves until lines of sight are asked for again.
        farthest_m = (1 + 2 * BORDER) * view.farthest_m
        oblique = replace(view.settings, max_incidence_deg=_OBLIQUE_DEG)
        nearly = replace(view, farthest_m=farthest_m, settings=oblique, least_cosine=None)
        free = nearly.reach(path.positions, samples)
        inspected = np.where(view.inspected[samples], need, 0.0)
        aims = aims_of(
            path.positions, axes(path.yaw, path.pitch), view.cloud.points[samples], inspected, free
        )
        return cls(free, Axis(aims, aside_rad))


def places_beside(path: Flown, usual_m: float) -> tuple[Ints, Floats]:
    """The station of each place (C,), and how far it is aside (C, 3), m: none, and all round, as it looks."""
    stations = chosen_evenly(len(path), _BESIDE)
    ahead = optical_axis(from_yaw_pitch(path.yaw[stations], np.zeros(len(stations))))
    up = np.array([0.0, 0.0, 1.0])
    axes = np.stack([ahead, np.cross(up, ahead), np.broadcast_to(up, ahead.shape)], axis=1)
    ways = np.array([way for way in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(way)])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    steps = usual_m * np.concatenate([np.zeros((1, 3)), _AWAY * ways, 2 * _AWAY * ways])
    aside = np.einsum("ci,sij->scj", steps, axes).reshape(-1, 3)
    return np.repeat(stations, len(steps)), aside
