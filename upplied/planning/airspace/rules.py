"""Where the vehicle may be: away from the structure, above the ground, in the fence, outside of boxes.

How near a path comes counts along its legs, too. Around a point at distance d from the surface, the ball of
radius d is free: the balls of both ends of a piece of a leg bound the clearance of all of it, and only the
pieces that could still matter are halved, on the unsigned distance (real meshes are seldom watertight).
Positions that come a little too near are pushed out smoothly along the path.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse import csr_matrix

from upplied.geometry.polylines import arc_length, leg_lengths
from upplied.geometry.scene import Scene
from upplied.records import Bools, Floats, Frame, Ints, Record, Rows, Surroundings

_TOLERANCE_M = 0.005
_PUSHES = 24
_INSIDE_M = 0.05  # of the fence
_BAND_M = 0.05  # about its plane: what a vehicle on the ground or the water does not leave


@dataclass(frozen=True, eq=False, repr=False)
class Nearest(Record):
    """Where a path comes nearest to the structure."""

    distance_m: float  # of `position`; no point of the path is nearer than this less 5 mm
    position: Floats  # (3,) m, on the path
    leg: int  # index of the leg it lies on; 0 for a path of one point

    @property
    def certain_m(self) -> float:
        """What the whole path keeps for certain, m."""
        return self.distance_m - _TOLERANCE_M


def path_clearance(scene: Scene, positions: Floats) -> Nearest:
    """The smallest distance between a path of straight legs, (N, 3), m, and the structure."""
    positions = np.asarray(positions, float).reshape(-1, 3)
    free = scene.distance(positions)
    best = int(free.argmin())
    distance, place, leg = float(free[best]), positions[best], max(min(best, len(positions) - 2), 0)
    pieces = _Pieces(positions[:-1], positions[1:], free[:-1], free[1:], np.arange(len(positions) - 1))
    while len(pieces.leg):
        pieces = pieces.rows(pieces.bound_m() < distance - _TOLERANCE_M).halved(scene)
        if len(pieces.leg) and pieces.free_b.min() < distance:
            best = int(pieces.free_b.argmin())
            distance, place, leg = float(pieces.free_b[best]), pieces.b[best], int(pieces.leg[best])
    return Nearest(distance, np.array(place), leg)


def legs_below(scene: Scene, start: Floats, end: Floats, limit_m: float) -> Bools:
    """Which straight legs (N,), m, structure frame, come nearer to the structure than a limit.

    A leg that stays within 5 mm above the limit may be called too near, never the reverse.
    """
    if np.array_equal(start[1:], end[:-1]):  # the legs of a path share their ends
        along = scene.distance(np.concatenate([start, end[-1:]]))
        free = np.concatenate([along[:-1], along[1:]])
    else:
        free = scene.distance(np.concatenate([start, end]))
    free_a, free_b = free[: len(start)], free[len(start) :]
    below = (free_a < limit_m) | (free_b < limit_m)
    pieces = _Pieces(start, end, free_a, free_b, np.arange(len(start)))
    while len(pieces.leg):
        pieces = pieces.rows((pieces.bound_m() < limit_m) & ~below[pieces.leg])
        below[pieces.leg[pieces.length_m() <= _TOLERANCE_M]] = True
        pieces = pieces.rows(~below[pieces.leg]).halved(scene)
        below[pieces.leg[pieces.free_b < limit_m]] = True
    return below


@dataclass(frozen=True, eq=False, repr=False)
class _Pieces(Rows):
    """Straight pieces from a to b with the distance of their ends from the surface."""

    a: Floats  # (K, 3) m
    b: Floats  # (K, 3) m
    free_a: Floats  # (K,) m
    free_b: Floats  # (K,) m
    leg: Ints  # (K,)

    def length_m(self) -> Floats:
        return np.linalg.norm(self.b - self.a, axis=1)

    def bound_m(self) -> Floats:
        """No point of the piece is nearer: the surface lies outside both balls, so beyond the circle
        in which they meet, unless one ball holds the other's share of the piece.
        """
        length = np.maximum(self.length_m(), 1e-12)
        plane = (length**2 + self.free_a**2 - self.free_b**2) / (2 * length)  # of the circle, from a
        circle = np.sqrt(np.maximum(self.free_a**2 - plane**2, 0))
        return np.where(plane <= 0, self.free_a, np.where(plane >= length, self.free_b, circle))

    def halved(self, scene: Scene) -> "_Pieces":
        """Both halves of each piece; the first halves come first and end in the new points."""
        if len(self.leg) == 0:
            return self
        middle = (self.a + self.b) / 2
        free = scene.distance(middle)
        first = _Pieces(self.a, middle, self.free_a, free, self.leg)
        return _Pieces.stacked([first, _Pieces(middle, self.b, free, self.free_b, self.leg)])


@dataclass(frozen=True, eq=False, repr=False)
class Airspace(Record):
    """The rules for positions and for the straight legs between them, in the frame of the scene."""

    scene: Scene
    clearance_m: float
    surroundings: Surroundings  # in the declared frame of the structure: a keep-out box has its sides there
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

    def in_plane(self, height_m: float) -> "Airspace":
        """The part of it within 5 cm of a horizontal plane."""
        low, high = height_m - _BAND_M, height_m + _BAND_M
        band = replace(self.surroundings, ground_z_m=low, ceiling_z_m=high)
        return replace(self, surroundings=band, ground_clearance_m=0.0)

    def why(self, position: Floats) -> str:
        """What is wrong with a position, in words; empty where nothing is."""
        at = np.reshape(position, (1, 3))
        distance = float(self.scene.distance(at)[0])
        if distance < self.clearance_m:
            part = "what was never scanned of " if self.scene.nearer_supposed(at)[0] else ""
            return f"{distance:.2f} m from {part}the structure, {self.clearance_m:g} m are required"
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
        along, off = v - u, w - u
        return np.sign(along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0])

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


def pushed_out(positions: Floats, airspace: Airspace) -> Floats:
    """Each position (M, 3), m, moved to where it is allowed, its neighbours along the path with it.

    It ends with what it can reach: places between two near surfaces, or inside the structure, may
    stay too near.
    """
    moved = np.array(positions, float)
    weights = _kernel(positions, reach=2 * airspace.clearance_m)
    for turn in range(_PUSHES):
        between = (moved[1:] + moved[:-1]) / 2  # so that corners are rounded, too
        out, middle = np.split(push(np.concatenate([moved, between]), airspace), [len(moved)])
        middle[leg_lengths(moved) > airspace.clearance_m] = 0.0
        for ends in (out[1:], out[:-1]):
            more = np.linalg.norm(middle, axis=1) > np.linalg.norm(ends, axis=1)
            ends[more] = middle[more]
        if not out.any():
            break
        moved += weights @ out if turn < _PUSHES // 2 else out
    return moved


def push(positions: Floats, airspace: Airspace) -> Floats:
    """The shortest way (M, 3) out of what each position breaks."""
    closest, _ = airspace.scene.closest(positions)
    away = positions - closest
    distance = np.linalg.norm(away, axis=1)
    lack = np.maximum(airspace.clearance_m + 0.02 - distance, 0)
    out = np.where(lack > 0, lack / np.maximum(distance, 1e-6), 0)[:, None] * away
    out[:, 2] += np.maximum(airspace.floor_m - positions[:, 2], 0)
    out[:, 2] -= np.maximum(positions[:, 2] - airspace.ceiling_m, 0)
    declared, limits = airspace.frame.to_declared(positions), np.zeros_like(out)
    for low, high in airspace.surroundings.keep_out_m:
        inside = ((declared > low) & (declared < high)).all(axis=1)
        gaps = np.concatenate([low - declared, high - declared], axis=1)[inside]
        nearest = np.abs(gaps).argmin(axis=1)
        step = gaps[np.arange(len(gaps)), nearest]
        limits[np.flatnonzero(inside), nearest % 3] += step + np.sign(step) * 0.02
    fence = airspace.surroundings.geofence_m
    outside = ~inside_fence(fence, declared)
    if outside.any():  # or on the fence: to a little inside of the nearest edge
        xy, edge = declared[outside, :2], np.roll(fence, -1, axis=0) - fence
        share = ((xy[:, None] - fence) * edge).sum(axis=2) / np.maximum((edge**2).sum(axis=1), 1e-12)
        gap = fence + np.clip(share, 0, 1)[..., None] * edge - xy[:, None]
        nearest = np.linalg.norm(gap, axis=2).argmin(axis=1)
        step, way = gap[np.arange(len(xy)), nearest], edge[nearest]
        across = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(np.hypot(*way.T), 1e-12)[:, None]
        beyond = step + _INSIDE_M * across
        inwards = np.where(inside_fence(fence, xy + beyond)[:, None], across, -across)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        inwards = np.where(length > _INSIDE_M, step / np.maximum(length, 1e-12), inwards)
        limits[outside, :2] += step + _INSIDE_M * inwards
    return out + limits @ airspace.frame.turn


def _kernel(positions: Floats, reach: float) -> csr_matrix:
    """(M, M) weights of a running mean of the pushes along the path: a raised cosine, each row sums to 1."""
    # What is farther along the path than `reach` has no weight, and takes no place.
    along = arc_length(positions)
    first = np.searchsorted(along, along - reach, side="left")
    count = np.searchsorted(along, along + reach, side="right") - first
    start = np.concatenate([[0], np.cumsum(count)])
    row = np.repeat(np.arange(len(along)), count)
    column = np.arange(start[-1]) + np.repeat(first - start[:-1], count)
    weight = 0.5 + 0.5 * np.cos(np.pi * np.minimum(np.abs(along[row] - along[column]) / reach, 1))
    whole = np.bincount(row, weights=weight)
    return csr_matrix((weight / whole[row], column, start), shape=(len(along), len(along)))
