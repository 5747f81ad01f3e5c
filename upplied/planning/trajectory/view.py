"""What a path is to show of its target: how much each sample is needed, and from how near."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.geometry.scene import Scene
from upplied.planning.visibility.frustum import coarseness
from upplied.planning.visibility.line_of_sight import seen_by_any, visible
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record


@dataclass(frozen=True, eq=False, repr=False)
class View(Record):
    """The target's samples, how much each is needed, and by which camera it is to be shown."""

    cloud: Cloud  # N surface samples of the target with normals
    need: Floats  # (N,) share of all that is to be shown; sums to 1, 0 where nothing is
    farthest_m: (
        Floats  # (N,) from where a frontal look resolves each well enough, an oblique one times its cosine
    )
    inspected: Bools  # (N,) those that the demonstration was about; the others lay behind them
    camera: Camera
    settings: VisibilitySettings
    limits: RetimeSettings
    scene: Scene
    fov_deg: Floats | None = None  # (M, 2) of each station of the path, where the camera zooms
    least_cosine: Floats | None = None  # (N,) of the incidence, where single samples ask for more

    def shown(self, positions: Floats, quat_xyzw: Floats, chosen: Ints) -> Bools:
        """(m,) which of these samples some station's pose truly sees from near enough."""
        coarse = coarseness(self.camera, self.fov_deg)

        def counts(pose: Ints, sample: Ints) -> Bools:
            near = self._near(pose, sample, positions, chosen, coarse)
            return near & self._frontal(pose, sample, positions, chosen)

        part, camera = self.cloud.at(chosen), self._as_far_as(chosen, self.camera)
        poses = positions, quat_xyzw
        return seen_by_any(*poses, part, camera, self.settings, self.scene, self.fov_deg, counts)

    def reach(
        self,
        positions: Floats,
        chosen: Ints,
        settings: VisibilitySettings | None = None,
        station: Ints | None = None,
    ) -> Bools:
        """(S, m) which of these samples each position would see with its camera turned anywhere.

        `station` (S,) says which stations of the path they are, where they are not all.
        """
        camera = replace(self.camera, hfov_deg=360.0, vfov_deg=180.0)
        level = np.tile([0.0, 0.0, 0.0, 1.0], (len(positions), 1))
        part, camera = self.cloud.at(chosen), self._as_far_as(chosen, camera)
        seen = visible(positions, level, part, camera, settings or self.settings, self.scene).seen
        pose, sample = np.nonzero(seen)
        fov_deg = self.fov_deg if self.fov_deg is None or station is None else self.fov_deg[station]
        counts = self._near(pose, sample, positions, chosen, coarseness(self.camera, fov_deg))
        if not settings:
            counts &= self._frontal(pose, sample, positions, chosen)
        seen[pose, sample] = counts
        return seen

    def missed(self, positions: Floats, quat_xyzw: Floats) -> Ints:
        """The needed samples that none of these poses truly sees from near enough."""
        needed = np.flatnonzero(self.need > 0)
        return needed[~self.shown(positions, quat_xyzw, needed)]

    def sampled(self, most: int) -> tuple[Ints, Floats]:
        """At most so many samples that stand for all, and their need; two thirds of them inspected ones."""
        chosen, needs = [], []
        inspected = np.flatnonzero((self.need > 0) & self.inspected)
        context = np.flatnonzero((self.need > 0) & ~self.inspected)
        first = min(len(inspected), max(2 * most // 3, most - len(context)))
        for group, count in ((inspected, first), (context, most - first)):
            if len(group) and count:
                few = group[:count]
                chosen.append(few)
                needs.append(self.need[few] * self.need[group].sum() / self.need[few].sum())
        if not chosen:
            return np.empty(0, np.int64), np.empty(0)
        return np.concatenate(chosen), np.concatenate(needs)

    def halves_rad(self, stations: int) -> Floats:
        """Half the field of view of each station (M, 2), across and up."""
        if self.fov_deg is not None:
            return np.radians(self.fov_deg) / 2
        return np.tile(np.radians([self.camera.hfov_deg, self.camera.vfov_deg]) / 2, (stations, 1))

    def _as_far_as(self, chosen: Ints, camera: Camera) -> Camera:
        """The camera with no more range than any of these samples asks for: fewer rays."""
        farthest_m = float(self.farthest_m[chosen].max(initial=0.0))
        if self.fov_deg is not None or farthest_m <= camera.min_range_m:
            return camera
        return replace(camera, max_range_m=min(camera.max_range_m, farthest_m))

    def _near(
        self, pose: Ints, sample: Ints, positions: Floats, chosen: Ints, coarse: Floats | None
    ) -> Bools:
        ray = self.cloud.points[chosen][sample] - positions[pose]
        squared = np.einsum("ij,ij->i", ray, ray)
        reach = np.sqrt(squared)  # times the cosine of the incidence, where there is one
        if self.cloud.normals is not None:
            reach = -np.einsum("ij,ij->i", ray, self.cloud.normals[chosen][sample])
        wide = 1.0 if coarse is None else coarse[pose]
        return np.asarray(squared * wide <= self.farthest_m[chosen][sample] * reach)

    def _frontal(self, pose: Ints, sample: Ints, positions: Floats, chosen: Ints) -> Bools:
        """Those that are seen as frontally as single samples ask for."""
        frontal = np.ones(len(pose), bool)
        if self.least_cosine is None or self.cloud.normals is None:
            return frontal
        own = self.least_cosine[chosen][sample]
        strict = own > np.cos(np.radians(self.settings.max_incidence_deg))
        pose, sample = pose[strict], sample[strict]
        ray = positions[pose] - self.cloud.points[chosen][sample]
        along = np.einsum("ij,ij->i", ray, self.cloud.normals[chosen][sample])
        frontal[strict] = along >= own[strict] * np.linalg.norm(ray, axis=1)
        return frontal
