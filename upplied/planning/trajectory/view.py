"""What a path is to show of its target: how much each sample is needed, and from how near."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from upplied.config import RetimeSettings, VisibilitySettings
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

    def sees(self, positions: Floats, quat_xyzw: Floats, asked: Ints) -> Bools:
        """(M, m) which of these samples each pose truly sees from near enough."""
        return self._seen(positions, quat_xyzw, asked, self.camera, self.settings)

    def reach(self, positions: Floats, asked: Ints, settings: VisibilitySettings | None = None) -> Bools:
        """(M, m) which of these samples each position would see with its camera turned anywhere."""
        camera = replace(self.camera, hfov_deg=360.0, vfov_deg=180.0)
        level = np.tile([0.0, 0.0, 0.0, 1.0], (len(positions), 1))
        return self._seen(positions, level, asked, camera, settings or self.settings)

    def missed(self, positions: Floats, quat_xyzw: Floats) -> Ints:
        """The needed samples that none of these poses truly sees from near enough."""
        needed = np.flatnonzero(self.need > 0)
        return needed[~self.sees(positions, quat_xyzw, needed).any(axis=0)]

    def _seen(
        self, positions: Floats, quat_xyzw: Floats, asked: Ints, camera: Camera, settings: VisibilitySettings
    ) -> Bools:
        normals = None if self.cloud.normals is None else self.cloud.normals[asked]
        part = Cloud(points=self.cloud.points[asked], normals=normals)
        seen = visible(positions, quat_xyzw, part, camera, settings, self.scene).seen
        pose, sample = np.nonzero(seen)
        ray = part.points[sample] - positions[pose]
        near = np.einsum("ij,ij->i", ray, ray) <= self.farthest_m[asked][sample] ** 2
        seen[pose, sample] = near
        return seen
