"""Where the vehicle may be: away from the structure, above the ground, in the fence, outside of boxes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from upplied.geometry.scene import Scene
from upplied.planning.airspace.clearance import legs_below
from upplied.records import Bools, Floats, Frame, Record, Surroundings

_BAND_M = 0.05  # about its plane: what a vehicle on the ground or the water does not leave


@dataclass(frozen=True, eq=False, repr=False)
class Airspace(Record):
    """The rules for positions and for the straight legs between them, in the frame of the scene.

    The surroundings keep to the declared frame of the structure: a keep-out box has its sides there.
    """

    scene: Scene
    clearance_m: float
    surroundings: Surroundings
    ground_clearance_m: float = 0.0  # least height above known ground
    frame: Frame = field(default_factory=Frame)  # where the scene stands in the declared frame

    @property
    def floor_m(self) -> float:
        """Lowest allowed z; -inf where no ground is known."""
        ground = self.surroundings.ground_z_m
        return -np.inf if ground is None else ground + self.ground_clearance_m

    @property
    def ceiling_m(self) -> float:
        """Highest allowed z; inf where there is none."""
        ceiling = self.surroundings.ceiling_z_m
        return np.inf if ceiling is None else ceiling

    def allowed(self, positions: Floats) -> Bools:
        """Which positions (N, 3) keep every rule."""
        allowed = self.in_bounds(positions)
        allowed[allowed] = self.scene.distance(positions[allowed]) >= self.clearance_m
        return allowed

    def in_bounds(self, positions: Floats) -> Bools:
        """Which positions (N, 3) keep the rules that do not concern the structure."""
        positions = self.frame.to_declared(positions)
        height = positions[:, 2]
        within = (height >= self.floor_m) & (height <= self.ceiling_m)
        for low, high in self.surroundings.keep_out_m:
            within &= ~((positions > low) & (positions < high)).all(axis=1)
        return np.asarray(within & inside_fence(self.surroundings.geofence_m, positions), bool)

    def broken(self, positions: Floats) -> Bools:
        """Which legs (N - 1,) of a path break a rule somewhere between or at their ends."""
        return self.broken_legs(positions[:-1], positions[1:])

    def broken_legs(self, start: Floats, end: Floats) -> Bools:
        """Which straight legs (N,) from `start` to `end` break a rule."""
        broken = ~(self.in_bounds(start) & self.in_bounds(end))
        begins, ends = self.frame.to_declared(start), self.frame.to_declared(end)
        for low, high in self.surroundings.keep_out_m:
            broken |= crosses_box(begins, ends, low, high)
        broken |= crosses_fence(self.surroundings.geofence_m, begins, ends)
        fine = np.flatnonzero(~broken)
        broken[fine] = legs_below(self.scene, start[fine], end[fine], self.clearance_m)
        return np.asarray(broken, bool)

    def in_plane(self, height_m: float) -> Airspace:
        """The part of it within 5 cm of a horizontal plane."""
        low, high = height_m - _BAND_M, height_m + _BAND_M
        band = replace(self.surroundings, ground_z_m=low, ceiling_z_m=high)
        return replace(self, surroundings=band, ground_clearance_m=0.0)

    def why(self, position: Floats) -> str:
        """What is wrong with a position, in words; empty where nothing is."""
        at = np.reshape(position, (1, 3))
        distance = float(self.scene.distance(at)[0])
        if distance < self.clearance_m:
            whole = (
                "what was never scanned of the structure"
                if self.scene.nearer_supposed(at)[0]
                else "the structure"
            )
            return f"{distance:.2f} m from {whole}, {self.clearance_m:g} m are required"
        if at[0, 2] < self.floor_m:
            return f"below {self.floor_m:.2f} m, the least height above the ground"
        if at[0, 2] > self.ceiling_m:
            return f"above the ceiling of {self.ceiling_m:.2f} m"
        if not inside_fence(self.surroundings.geofence_m, self.frame.to_declared(at))[0]:
            return "outside the geofence"
        return "" if self.in_bounds(at)[0] else "in a keep-out box"


def inside_fence(polygon: Floats, positions: Floats) -> Bools:
    """Which positions (N, 3) lie inside a polygon (G, 2) seen from above; all where there is no polygon.

    The fence itself is not inside.
    """
    if len(polygon) < 3:
        return np.ones(len(positions), bool)
    x, y = positions[:, None, 0], positions[:, None, 1]
    (ax, ay), (bx, by) = polygon.T, np.roll(polygon, -1, axis=0).T
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = ((ay > y) != (by > y)) & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
    odd = crossing.sum(axis=1) % 2 == 1
    return np.asarray(odd & ~crosses_fence(polygon, positions, positions), bool)


def crosses_fence(polygon: Floats, start: Floats, end: Floats) -> Bools:
    """Which segments (N,) touch or cross an edge of a polygon seen from above.

    Two segments have a point in common where neither lies to one side of the other, and, should they
    lie on one line, where their boxes overlap. So a leg through a vertex, or along an edge, is noticed.
    """
    if len(polygon) < 3:
        return np.zeros(len(start), bool)
    a, b = polygon[None], np.roll(polygon, -1, axis=0)[None]
    p, q = start[:, None, :2], end[:, None, :2]

    def side(u: Floats, v: Floats, w: Floats) -> Floats:
        return np.sign(
            (v[..., 0] - u[..., 0]) * (w[..., 1] - u[..., 1])
            - (v[..., 1] - u[..., 1]) * (w[..., 0] - u[..., 0])
        )

    overlap = (np.minimum(a, b) <= np.maximum(p, q)) & (np.minimum(p, q) <= np.maximum(a, b))
    both = (side(a, b, p) * side(a, b, q) <= 0) & (side(p, q, a) * side(p, q, b) <= 0)
    return np.asarray((overlap.all(axis=2) & both).any(axis=1), bool)


def crosses_box(start: Floats, end: Floats, low: Floats, high: Floats) -> Bools:
    """Which segments (N,) enter the inside of a box (slab test)."""
    ray = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        to_low, to_high = (low - start) / ray, (high - start) / ray
    still, between = ray == 0, (start > low) & (start < high)
    enter = np.where(still, np.where(between, -np.inf, np.inf), np.minimum(to_low, to_high))
    leave = np.where(still, np.where(between, np.inf, -np.inf), np.maximum(to_low, to_high))
    return np.asarray(np.maximum(enter.max(axis=1), 0.0) < np.minimum(leave.min(axis=1), 1.0) - 1e-12, bool)
