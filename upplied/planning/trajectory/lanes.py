"""Lanes beside a path: the flight again, swaths to its side, at its distance and angle to the surface.

A swath is what the camera shows finely enough across its way. Lanes follow the surface: round a hull they
bend with it, and they end where it ends.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from upplied.geometry.polylines import arc_length
from upplied.geometry.poses import from_yaw_pitch, optical_axis
from upplied.geometry.vectors import unit
from upplied.planning.airspace.rules import Airspace
from upplied.planning.constants import SAME_FACE
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.records import Bools, Floats, Ints, Record, Rows

_STEPS = 3  # from lane to lane, in which the surface is followed
_NEAREST = 12  # samples of the surface, whose mean plane a place is put on
_OFF = 0.4  # of a swath, that the next place may lie off the surface: an edge may be looked past
_EVENED = 2.5  # places of a lane, over which its distance from the path is evened out
_Places = tuple[Floats, Floats, Floats]  # (S, 3) each: on the surface, its normals, and the way of flight
_Samples = tuple[cKDTree, Floats, Floats]  # of the surface: a tree, points and normals (N, 3)
_SECTIONS = 16  # of the path, on each of which a pass is flown or not: so no single sample moves an end
_END_S = 10.0  # that beginning a pass takes, and ending it: to fly there, slow down and turn
_WINDOW = 3  # stations to each side, from which a sample is shown
_NEARER = 0.1  # of a swath, by which a lane must be nearer to a sample than the next one to the path


@dataclass(frozen=True, eq=False, repr=False)
class Lanes(Record):
    """Places beside S stations of a path on K lanes, from right to left; the middle one is the path."""

    station: Ints  # (S,) of the path
    poses: Floats  # (S, K, 5) m and rad: positions, yaw and pitch
    free: Bools  # (S, K) there is surface before the place, and the rules allow it
    surface: Floats  # (S, K, 3) m, before each place
    points: Floats  # (m, 3) m, the samples that were asked about
    shows: Bools  # (S, K, m) of them
    swath_m: float  # from lane to lane

    @property
    def middle(self) -> int:
        """The lane of the path."""
        return self.free.shape[1] // 2


def lanes_beside(
    path: Flown, view: View, airspace: Airspace, half_rad: float, needed: Ints, most: int
) -> Lanes | None:
    """Lanes beside a path; None where it looks past the surface.

    Parameters
    ----------
    path : Flown
        M stations.
    view, airspace
        What is to be shown, and the rules that the places keep.
    half_rad : float
        Half the angle across the way of flight within which a look at a wall is fine enough.
    needed : array of int, shape (m,)
        Samples that the lanes are asked about.
    most : int
        Lanes to each side.
    """
    axis = optical_axis(from_yaw_pitch(path.yaw, path.pitch))
    away = view.scene.cast(path.positions, axis)[0]
    hit = np.isfinite(away) & (away <= view.camera.max_range_m)
    if hit.sum() < 2:
        return None
    swath_m = 2 * float(np.median(away[hit])) * np.tan(half_rad)
    station = _apart(path.positions, hit, swath_m / _STEPS)
    way = np.gradient(gaussian_filter1d(path.positions, 2.0, axis=0, mode="nearest"), axis=0)[station]
    own, axis, away = path.positions[station], axis[station], away[station, None]
    samples = cKDTree(view.cloud.points), view.cloud.points, view.cloud.outward
    points, normals, on = _on_surface(own + away * axis, -axis, samples, np.inf)
    within = _within(way, normals)
    on &= np.linalg.norm(within, axis=1) > SAME_FACE * np.linalg.norm(way, axis=1)  # not towards the surface
    first = points, normals, unit(within)
    share = np.einsum("sij,sj->si", _frames(first), axis)
    shape = len(station), 2 * most + 1
    surface, positions, looks = (np.empty((*shape, 3)) for _ in range(3))
    free = np.zeros(shape, bool)
    surface[:, most], positions[:, most], looks[:, most], free[:, most] = points, own, axis, on
    for side in (1, -1):
        here, alive = first, on.copy()
        for at in most + side * np.arange(1, most + 1):
            for _ in range(_STEPS):
                here, still = _next_to(here, side * swath_m / _STEPS, samples, _OFF * swath_m)
                alive &= still
            surface[:, at], free[:, at] = here[0], alive
            looks[:, at] = np.einsum("si,sij->sj", share, _frames(here))
            positions[:, at] = here[0] - away * looks[:, at]
    aside = np.concatenate([positions, looks], axis=2) - np.concatenate([own, axis], axis=1)[:, None]
    aside = gaussian_filter1d(aside, _EVENED, axis=0, mode="nearest")
    positions, looks = own[:, None] + aside[..., :3], unit(axis[:, None] + aside[..., 3:])
    low, high = np.radians([view.limits.min_gimbal_pitch_deg, view.limits.max_gimbal_pitch_deg])
    pitch = np.clip(np.arcsin(np.clip(looks[..., 2], -1, 1)), low, high)
    angles = np.stack([np.arctan2(looks[..., 1], looks[..., 0]), pitch], axis=2)
    poses = np.concatenate([positions, angles], axis=2)
    free[free] = airspace.allowed(positions[free])
    shows = np.zeros((*shape, len(needed)), bool)
    places, beside = poses[free], station[np.nonzero(free)[0]]
    shows[free] = view.seen(places[:, :3], from_yaw_pitch(places[:, 3], places[:, 4]), needed, beside)
    return Lanes(station, poses, free, surface, view.cloud.points[needed], shows, swath_m)


def _apart(positions: Floats, useful: Bools, step_m: float) -> Ints:
    """Useful stations about a step apart along the path."""
    along = arc_length(positions)
    number = max(int(along[-1] / max(step_m, 1e-6)), 2)
    chosen = np.unique(np.searchsorted(along, np.linspace(0, along[-1], number)))
    return chosen[useful[np.clip(chosen, 0, len(useful) - 1)]]


def _next_to(here: _Places, step_m: float, samples: _Samples, most_m: float) -> tuple[_Places, Bools]:
    """Places on the surface a step to the left of the way, and which of them there are."""
    points, normals, ways = here
    points, normals, on = _on_surface(points + step_m * np.cross(normals, ways), normals, samples, most_m)
    return (points, normals, unit(_within(ways, normals))), on


def _on_surface(
    places: Floats, like: Floats, samples: _Samples, most_m: float
) -> tuple[Floats, Floats, Bools]:
    """Places (S, 3) put on the side of the surface that faces as `like` does, its normals, which are near."""
    tree, points, normals = samples
    distance, near = tree.query(places, k=min(_NEAREST, len(points)))
    weight = (np.einsum("kni,ki->kn", normals[near], like) > 0).astype(float)
    whole = np.maximum(weight.sum(axis=1, keepdims=True), 1.0)
    normal = np.einsum("kn,kni->ki", weight, normals[near]) / whole
    on = np.where(weight > 0, distance, np.inf).min(axis=1) <= most_m
    on &= np.linalg.norm(normal, axis=1) > SAME_FACE
    normal = unit(np.where(on[:, None], normal, like))
    middle = np.einsum("kn,kni->ki", weight, points[near]) / whole
    off = ((places - middle) * normal).sum(axis=1, keepdims=True)
    return places - np.where(on[:, None], off, 0.0) * normal, normal, on


def _frames(places: _Places) -> Floats:
    """Along the flight, to its left, and away from the surface (S, 3, 3), at places."""
    _, normals, ways = places
    return np.stack([ways, np.cross(normals, ways), normals], axis=1)


def _within(vectors: Floats, normals: Floats) -> Floats:
    return np.asarray(vectors - (vectors * normals).sum(axis=1, keepdims=True) * normals)


@dataclass(frozen=True, eq=False, repr=False)
class Pass(Rows):
    """A pass beside the demonstrated one, over R stations of the lanes that follow each other."""

    row: Ints  # (R,)
    lane: Ints  # (R,)

    def flown_with(self, flown: Bools) -> Bools:
        """The lanes that are flown (S, K), with this pass."""
        after = flown.copy()
        after[self.row, self.lane] = True
        return after


@dataclass(frozen=True, eq=False, repr=False)
class Cover(Record):
    """Which lanes show the samples (m,) that lie before each station."""

    owner: Ints  # (m,) the station that each lies before
    shown: Bools  # (K, m)
    need: Floats  # (m,)
    stations: int

    @classmethod
    def of(cls, lanes: Lanes, need: Floats) -> "Cover":
        """The samples that any lane shows; each lies before the place that is nearest to it of those."""
        row, lane, sample = np.nonzero(lanes.shows)
        apart = np.linalg.norm(lanes.surface[row, lane] - lanes.points[sample], axis=1)
        apart += _NEARER * lanes.swath_m * np.abs(lane - lanes.middle)
        order = np.lexsort((apart, sample))
        mine, first = np.unique(sample[order], return_index=True)
        owner = row[order][first]
        of_mine = np.searchsorted(mine, sample)
        beside = np.abs(row - owner[of_mine]) <= _WINDOW
        shown = np.zeros((lanes.shows.shape[1], len(mine)), bool)
        shown[lane[beside], of_mine[beside]] = True
        return cls(owner, shown, need[mine], len(lanes.station))

    def before(self, flown: Bools) -> Floats:
        """Share of the need (S,) that the lanes flown (S, K) show before each station."""
        seen = (flown[self.owner].T & self.shown).any(axis=0)
        return np.asarray(np.bincount(self.owner[seen], self.need[seen], self.stations), float)


def arranged(cover: Cover, seconds: Floats, price: float) -> list[Pass]:
    """The passes that are worth most over the whole path, the nearest to the demonstrated one first.

    One takes so many `seconds` beside each station (S,), each of which must show the `price`, of the need.
    """
    middle = len(cover.shown) // 2
    table = np.array(list(itertools.product(range(middle + 1), repeat=2)))  # passes right and left
    cost = np.empty((cover.stations, len(table)))
    for column, (right, left) in enumerate(table):
        flown = np.zeros((cover.stations, len(cover.shown)), bool)
        flown[:, middle - right : middle + left + 1] = True
        cost[:, column] = price * seconds * (1 + right + left) - cover.before(flown)
    section = np.arange(cover.stations) * min(_SECTIONS, cover.stations) // cover.stations
    cost = np.add.reduceat(cost, np.searchsorted(section, np.arange(section[-1] + 1)))
    change = price * _END_S * np.abs(table[:, None] - table[None]).sum(axis=2)
    total, came = cost[0] + change[0], np.zeros(cost.shape, np.int64)
    for row in range(1, len(cost)):
        after = total[:, None] + change
        came[row] = after.argmin(axis=0)
        total = after.min(axis=0) + cost[row]
    best = np.full(len(cost), int((total + change[0]).argmin()))
    for row in range(len(cost) - 1, 0, -1):
        best[row - 1] = came[row, best[row]]
    passes, state = [], table[best[section]]
    for number, (side, sign) in itertools.product(range(1, middle + 1), ((0, -1), (1, 1))):
        beside = np.flatnonzero(state[:, side] >= number)
        for rows in np.split(beside, np.flatnonzero(np.diff(beside) > 1) + 1) if len(beside) else []:
            passes.append(Pass(rows, np.full(len(rows), middle + sign * number)))
    return passes
