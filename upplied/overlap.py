"""How much of one picture another one shows too: the overlap of photos, by rays through both."""

from functools import cached_property

import numpy as np

from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.poses import matrices
from upplied.geometry.scene import Scene
from upplied.geometry.vectors import unit
from upplied.records import Bools, Camera, Floats, Trajectory

_RAYS = 768  # of a picture: a share is known to a percent where most of them meet the surface
_FEW = 384  # of them that meet it, below which only the part of the picture that shows it is asked again
_CLOSER = 2  # times, at most
_GOLDEN = (5**0.5 - 1) / 2
_SLACK = 0.01  # of a sight line, at its end
_GROWN = 0.02  # more than rays tell apart
_MOST_SAMPLED = 40  # pictures whose overlap with other passes is computed


class Frames:
    """The pictures that a camera would take at P poses; where they zoom, each has its own field of view."""

    def __init__(self, poses: Trajectory, camera: Camera, scene: Scene) -> None:
        self.poses, self.camera, self.scene = poses, camera, scene
        fixed = np.tile([camera.hfov_deg, camera.vfov_deg], (len(poses), 1))
        fields = fixed if poses.fov_deg is None else poses.fov_deg
        self.slopes = np.tan(np.radians(np.minimum(fields, 179.0)) / 2)
        self.turns = matrices(poses.quat_xyzw)
        self._hits: dict[int, Floats] = {}

    def shows(self, at: int, points: Floats) -> Bools:
        """Which points (N, 3) are in the frustum and range of a pose, with nothing between."""
        position = self.poses.positions[at]
        local = (points - position) @ self.turns[at]
        reach = np.linalg.norm(local, axis=1)
        inside = (local[:, 0] > 0) & (np.abs(local[:, 1:]) <= local[:, :1] * self.slopes[at]).all(axis=1)
        inside &= (reach >= self.camera.min_range_m) & (reach <= self.camera.max_range_m)
        looked = np.flatnonzero(inside)
        if len(looked):
            origins = np.broadcast_to(position, (len(looked), 3))
            inside[looked] = ~self.scene.occluded(origins, points[looked], _SLACK)
        return inside

    def hits(self, at: int) -> Floats:
        """What rays, spread over the part of the picture that shows the surface, meet of it (K, 3), m."""
        if at not in self._hits:
            places = self._grid
            points, near = self._met(at, places)
            for _ in range(_CLOSER):
                if not 0 < len(points) < _FEW:
                    break
                beside = np.ptp(places, axis=0) / _RAYS**0.5
                low = np.maximum(places[near].min(axis=0) - beside, -1)
                high = np.minimum(places[near].max(axis=0) + beside, 1)
                places = low + (high - low) * (self._grid + 1) / 2
                points, near = self._met(at, places)
            self._hits[at] = points
        return self._hits[at]

    def _met(self, at: int, places: Floats) -> tuple[Floats, Bools]:
        """What rays through places (R, 2) of a picture meet within range (K, 3), m; which of them do (R,)."""
        ways = np.column_stack([np.ones(len(places)), places * self.slopes[at]]) @ self.turns[at].T
        origin = self.poses.positions[at]
        reach = self.scene.cast(np.broadcast_to(origin, ways.shape), ways)[0] * np.linalg.norm(ways, axis=1)
        near = (reach >= self.camera.min_range_m) & (reach <= self.camera.max_range_m)
        return origin + unit(ways[near]) * reach[near, None], near

    @cached_property
    def _grid(self) -> Floats:
        """Places (K, 2) in a picture, -1 to 1: a Fibonacci lattice, no two of them in a row or a column."""
        # A picture that moves by less than a row of an upright grid, along a tower, would count as the same.
        order = np.arange(_RAYS)
        return 2 * np.column_stack([(order + 0.5) / _RAYS, (order + 0.5) * _GOLDEN % 1]) - 1

    def overlap(self, first: int, second: int) -> float:
        """Share, 0 to 1, of what the second picture shows of the surface that the first shows too."""
        points = self.hits(second)
        return float(self.shows(first, points).mean()) if len(points) else float("nan")

    def across(self) -> Floats:
        """The largest share (K,) of some pictures that one of another pass shows, 0 where none does.

        A pass ends where overlap, on the way before or behind, grows again.
        """
        number = len(self.poses)
        chosen = [at for at in chosen_evenly(number, _MOST_SAMPLED) if len(self.hits(at))]
        shares = np.zeros(len(chosen))
        for index, at in enumerate(chosen):
            points = self.hits(at)
            mine = np.array([self.shows(other, points).mean() for other in range(number)])
            for way in (range(at, number), range(at - 1, -1, -1)):
                least = 1.0
                for other in way:
                    if mine[other] > least + _GROWN:
                        break
                    least, mine[other] = min(least, mine[other]), 0.0
            shares[index] = mine.max()
        return shares
