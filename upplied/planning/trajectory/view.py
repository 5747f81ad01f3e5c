"""What a path is to show of its target: how much each sample is needed, and from how near."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.planning.visibility.frustum import coarseness
from upplied.planning.visibility.line_of_sight import visible
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record
from upplied.scene import Scene


@dataclass(frozen=True, eq=False, repr=False)
class View(Record):
    """The target's samples, how much each is needed, and by which camera it is to be shown."""

    cloud: Cloud  # N surface samples of the target with normals
    need: Floats  # (N,) share of all that is to be shown; sums to 1, 0 where nothing is
    farthest_m: Floats  # (N,) from where each is still resolved well enough
    inspected: Bools  # (N,) those that the demonstration was about; the others lay behind them
    camera: Camera
    settings: VisibilitySettings
    limits: RetimeSettings
    scene: Scene
    fov_deg: Floats | None = None  # (M, 2) of each station of the path, where the camera zooms
    least_cosine: Floats | None = None  # (N,) of the incidence, where single samples ask for more

    def sees(self, positions: Floats, quat_xyzw: Floats, asked: Ints) -> Bools:
        """(M, m) which of these samples each station's pose truly sees from near enough."""
        seen = self._visible(positions, quat_xyzw, asked, self.camera, self.settings, self.fov_deg)
        near = self._near(seen, positions, asked, coarseness(self.camera, self.fov_deg))
        return self._frontal(near, positions, asked)

    def reach(
        self,
        positions: Floats,
        asked: Ints,
        settings: VisibilitySettings | None = None,
        station: Ints | None = None,
    ) -> Bools:
        """(S, m) which of these samples each position would see with its camera turned anywhere.

        `station` (S,) says which stations of the path they are, where they are not all.
        """
        camera = replace(self.camera, hfov_deg=360.0, vfov_deg=180.0)
        level = np.tile([0.0, 0.0, 0.0, 1.0], (len(positions), 1))
        seen = self._visible(positions, level, asked, camera, settings or self.settings)
        fov_deg = self.fov_deg if self.fov_deg is None or station is None else self.fov_deg[station]
        near = self._near(seen, positions, asked, coarseness(self.camera, fov_deg))
        return near if settings else self._frontal(near, positions, asked)

    def missed(self, positions: Floats, quat_xyzw: Floats) -> Ints:
        """The needed samples that none of these poses truly sees from near enough."""
        needed = np.flatnonzero(self.need > 0)
        return needed[~self.sees(positions, quat_xyzw, needed).any(axis=0)]

    def halves_rad(self, stations: int) -> Floats:
        """Half the field of view of each station (M, 2), across and up."""
        if self.fov_deg is not None:
            return np.radians(self.fov_deg) / 2
        return np.tile(np.radians([self.camera.hfov_deg, self.camera.vfov_deg]) / 2, (stations, 1))

    def _visible(
        self,
        positions: Floats,
        quat_xyzw: Floats,
        asked: Ints,
        camera: Camera,
        settings: VisibilitySettings,
        fov_deg: Floats | None = None,
    ) -> Bools:
        part, farthest_m = self.cloud.at(asked), float(self.farthest_m[asked].max(initial=0.0))
        if fov_deg is None and self.fov_deg is None and farthest_m > camera.min_range_m:  # fewer rays
            camera = replace(camera, max_range_m=min(camera.max_range_m, farthest_m))
        return visible(positions, quat_xyzw, part, camera, settings, self.scene, fov_deg=fov_deg).seen

    def _near(self, seen: Bools, positions: Floats, asked: Ints, coarse: Floats | None) -> Bools:
        pose, sample = np.nonzero(seen)
        ray = self.cloud.points[asked][sample] - positions[pose]
        squared = np.einsum("ij,ij->i", ray, ray) * (1.0 if coarse is None else coarse[pose] ** 2)
        seen[pose, sample] = squared <= self.farthest_m[asked][sample] ** 2
        return seen

    def _frontal(self, seen: Bools, positions: Floats, asked: Ints) -> Bools:
        if self.least_cosine is None or self.cloud.normals is None:
            return seen
        strict = self.least_cosine[asked] > np.cos(np.radians(self.settings.max_incidence_deg))
        pose, sample = np.nonzero(seen & strict)
        ray = positions[pose] - self.cloud.points[asked][sample]
        along = np.einsum("ij,ij->i", ray, self.cloud.normals[asked][sample])
        least = self.least_cosine[asked][sample] * np.linalg.norm(ray, axis=1)
        seen[pose, sample] = along >= least
        return seen
