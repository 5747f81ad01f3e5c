"""Coverage: the share of what is to be shown that no station shows, made differentiable, and hidden surface.

A station shows a sample by a share from 0 to 1 that falls smoothly across the limit of the incidence,
the borders of the picture and the farthest distance; the path shows it unless every station fails to.
What stands in the way is found by rays from the path as it is, and holds until they are cast again.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.geometry.poses import from_yaw_pitch
from upplied.planning.airspace.rules import Airspace
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import ALIKE, BORDER, View, places_beside
from upplied.planning.visibility.line_of_sight import coarseness
from upplied.records import Bools, Floats, Ints, Record

_MOST = 0.98  # that one station shows: a second look at the same sample is worth a little
_BATCH = 128  # samples that are asked at a time, without a branch: several at once in a processor
_SURFACE = 8  # numbers of a sample: place, normal, farthest distance, least cosine
_RESULT = 6  # numbers of a look: its share, and the slopes with respect to x, y, z, yaw and pitch
_CHOOSY = 8.0  # power of what a place shows for a metre aside, by which what several show is shared
_LITTLE = 1e-4  # of all that is missed, for which a place is left out
_AT_START = 1 - np.exp(-0.5)  # of its pull, that a place keeps at its own distance from the path


@dataclass(frozen=True, eq=False, repr=False)
class Coverage(Record):
    """Share of the need that is not shown, 0 to 1."""

    surface: Floats  # (N, 8) place in m, normal, farthest distance in m, least cosine of the incidence
    need: Floats  # (N,) sums to 1
    start: Ints  # (M + 1,) of each station's samples in `sample`
    sample: Ints  # (P,) to which a station has a free line of sight
    half_rad: Floats  # (M, 2) half the field of view, across and up
    coarse: Floats  # (M,) what each station's distances are taken times
    width: float  # over which a share falls, as `view.BORDER`

    @classmethod
    def of(cls, view: View, chosen: Ints, need: Floats, free: Bools, width: float = BORDER) -> "Coverage":
        """The term for some samples (N,) of a view, with the free lines of sight (M, N) to them."""
        station, sample = np.nonzero(free)
        fov_deg = view.fov_deg
        if fov_deg is None:
            fov_deg = np.tile([view.camera.hfov_deg, view.camera.vfov_deg], (len(free), 1))
        halves, coarse = np.radians(fov_deg) / 2, coarseness(view.camera, view.fov_deg)
        usual = float(np.cos(np.radians(view.settings.max_incidence_deg)))
        least = np.full(len(chosen), usual)
        if view.least_cosine is not None:
            least = np.maximum(view.least_cosine[chosen], usual)
        place, normal, farthest_m = view.cloud.points, view.cloud.outward, view.farthest_m
        return cls(
            surface=np.column_stack([place[chosen], normal[chosen], farthest_m[chosen], least]),
            need=need / need.sum(),
            start=np.searchsorted(station, np.arange(len(free) + 1)),
            sample=sample,
            half_rad=halves,
            coarse=np.ones(len(halves)) if coarse is None else coarse,
            width=width,
        )

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Share of the need that is missed, and its slope."""
        poses = flown.positions, flown.yaw, flown.pitch
        looks = self.start, self.sample, self.half_rad, self.coarse
        missed, slope = _missed(*poses, self.surface, self.need, *looks, self.width)
        return missed, Flown(slope[:, :3], slope[:, 3], slope[:, 4])


@njit(cache=True, inline="always", error_model="numpy")
def _step(value: float, scale: float) -> tuple[float, float]:
    """Smooth step from 0 at half a width below zero to 1 at one and a half above, and its slope."""
    part = value * scale + 0.25
    part = 0.0 if part < 0.0 else part
    part = 1.0 if part > 1.0 else part
    return part * part * (3 - 2 * part), 6 * part * (1 - part) * scale


@njit(cache=True, inline="always", error_model="numpy")
def _look(
    pose: tuple[float, float, float, float, float],
    half_h: float,
    half_v: float,
    coarse: float,
    width: float,
    batch: Floats,
) -> None:
    """What a pose shows of the samples in `batch`, and its slopes, beside them in `batch`."""
    # One number of all samples after another: so a compiler decides several samples at a time.
    round_ = half_h >= np.pi / 2  # so wide a field that there is no picture plane
    sin_h, cos_h, sin_v, cos_v = np.sin(half_h), np.cos(half_h), np.sin(half_v), np.cos(half_v)
    at_x, at_y, at_z, yaw, pitch = pose
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    scale = 0.5 / width
    for k in range(_BATCH):
        ux, uy, uz = batch[k] - at_x, batch[_BATCH + k] - at_y, batch[2 * _BATCH + k] - at_z
        nx, ny, nz = batch[3 * _BATCH + k], batch[4 * _BATCH + k], batch[5 * _BATCH + k]
        d = np.sqrt(ux * ux + uy * uy + uz * uz) + 1e-9
        per_m = 1.0 / d
        ux, uy, uz = ux * per_m, uy * per_m, uz * per_m
        level = cy * ux + sy * uy
        x, y, z = cp * level + sp * uz, cy * uy - sy * ux, cp * uz - sp * level  # in the camera's frame
        side, above = np.copysign(1.0, y), np.copysign(1.0, z)
        ahead, fx, fy = x, 1.0, 0.0
        if round_:
            ahead = np.sqrt(x * x + y * y) + 1e-9
            fx, fy = x / ahead, y / ahead
        facing, rate = -(ux * nx + uy * ny + uz * nz), coarse / batch[6 * _BATCH + k]
        a, da = _step(facing - batch[7 * _BATCH + k], scale)
        b, db = _step(facing - d * rate, scale)  # fine enough, as obliquely as it is
        c, dc = _step(x * sin_h - side * y * cos_h, scale)  # sine of the angle to the border's plane
        e, de = _step(ahead * sin_v - above * z * cos_v, scale)
        batch[8 * _BATCH + k] = _MOST * a * b * c * e
        gb, gc, ge = a * db * c * e, a * b * dc * e, a * b * c * de
        ga = da * b * c * e + gb  # of the cosine of the incidence
        wx = gc * sin_h + ge * sin_v * fx
        wy = ge * sin_v * fy - gc * side * cos_h
        wz = -ge * above * cos_v
        # with respect to the unit ray u, then to the position: du / dp = -(I - u u^T) / d
        gx = wx * cp * cy - wy * sy - wz * sp * cy - ga * nx
        gy = wx * cp * sy + wy * cy - wz * sp * sy - ga * ny
        gz = wx * sp + wz * cp - ga * nz
        along = gx * ux + gy * uy + gz * uz
        batch[9 * _BATCH + k] = gb * rate * ux - (gx - along * ux) * per_m
        batch[10 * _BATCH + k] = gb * rate * uy - (gy - along * uy) * per_m
        batch[11 * _BATCH + k] = gb * rate * uz - (gz - along * uz) * per_m
        batch[12 * _BATCH + k] = wx * cp * y - wy * level - wz * sp * y
        batch[13 * _BATCH + k] = wx * z - wz * x


@njit(cache=True, error_model="numpy")
def _missed(
    positions: Floats,
    yaw: Floats,
    pitch: Floats,
    surface: Floats,
    need: Floats,
    start: Ints,
    sample: Ints,
    half_rad: Floats,
    coarse: Floats,
    width: float,
) -> tuple[float, Floats]:
    """Missed share, and its slope (M, 5) with respect to x, y, z, yaw and pitch of each station."""
    # Of the pairs that are shown at all, one after another: what is not shown is not written either.
    shown, slopes = np.empty(len(sample)), np.empty((len(sample), 5))
    what, first, count = np.empty(len(sample), np.int64), np.zeros(len(positions) + 1, np.int64), 0
    left, batch = np.ones(len(need)), np.ones((_SURFACE + _RESULT) * _BATCH)
    for m in range(len(positions)):
        pose = positions[m, 0], positions[m, 1], positions[m, 2], yaw[m], pitch[m]
        for begin in range(start[m], start[m + 1], _BATCH):
            number = min(_BATCH, start[m + 1] - begin)
            for k in range(number):
                for column in range(_SURFACE):
                    batch[column * _BATCH + k] = surface[sample[begin + k], column]
            _look(pose, half_rad[m, 0], half_rad[m, 1], coarse[m], width, batch)
            for k in range(number):
                share = batch[_SURFACE * _BATCH + k]
                if share > 0.0:
                    shown[count], what[count] = share, sample[begin + k]
                    left[what[count]] *= 1.0 - share
                    for axis in range(5):
                        slopes[count, axis] = batch[(_SURFACE + 1 + axis) * _BATCH + k]
                    count += 1
        first[m + 1] = count
    total = np.zeros((len(positions), 5))
    for m in range(len(positions)):
        for k in range(first[m], first[m + 1]):
            factor = -_MOST * need[what[k]] * left[what[k]] / (1.0 - shown[k])
            for axis in range(5):
                total[m, axis] += factor * slopes[k, axis]
    missed = 0.0
    for i in range(len(need)):
        missed += need[i] * left[i]
    return missed, total


@dataclass(frozen=True, eq=False, repr=False)
class Hidden(Record):
    """Share of the need that K places would show, and the path does not, by how far it is from them.

    The slope of the coverage is zero for what is hidden from the path, faces away or lies too far off. So
    places to all sides of the path are asked what they show of it, as the camera looks there. Each pulls the
    station it belongs to by its share of what it shows, the larger the more it shows and the nearer to the
    path it is; by less, the less of the need they show together: single samples hardly draw it.
    """

    station: Ints  # (K,)
    place: Floats  # (K, 3) m
    need: Floats  # (K,) that each shows
    away_m: Floats  # (K,) from the station, as the path was

    @classmethod
    def of(cls, view: View, airspace: Airspace, path: Flown, usual_m: float) -> "Hidden":
        """The term near a path with a usual stand-off, of places that keep the rules of its airspace.

        Without places where nothing is missed that any of them shows.
        """
        missed = view.missed(path.positions, from_yaw_pitch(path.yaw, path.pitch))
        at, off = places_beside(path, usual_m)
        beside = airspace.allowed(path.positions[at] + off) & off.any(axis=1)
        at, off = at[beside], off[beside]
        left, away_m = view.need[missed], np.linalg.norm(off, axis=1)
        places, shows = path.positions[at] + off, np.zeros((len(at), len(missed)), bool)
        if shows.size:  # with the camera as it looks from their stations
            shows = view.seen(places, from_yaw_pitch(path.yaw[at], path.pitch[at]), missed, at)
        need = _shared(shows, left, away_m)
        need *= need.sum() / (need.sum() + ALIKE)
        row = np.flatnonzero(need > _LITTLE * need.sum())
        return cls(at[row], places[row], need[row], away_m[row])

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Need of the places, times how much farther than at them the path is, and its slope."""
        off = flown.positions[self.station] - self.place
        near = np.exp(-(off**2).sum(axis=1) / (2 * self.away_m**2))
        need, nothing = self.need / _AT_START, np.zeros(len(flown))
        slope = np.zeros_like(flown.positions)
        np.add.at(slope, self.station, (need * near / self.away_m**2)[:, None] * off)
        return float((need * (1 - near)).sum()), Flown(slope, nothing, nothing)


def _shared(shows: Bools, need: Floats, away_m: Floats) -> Floats:
    """(C,) the need that each place has of the samples (C, m) that it shows: more, the better it is."""
    # Each sample's need is shared by all places that show it, so that none is chosen by a hair's breadth.
    worth = (shows @ need) / away_m
    worth = (worth / worth.max(initial=1e-300)) ** _CHOOSY
    total = worth @ shows
    return worth * (shows @ np.where(total > 0, need / np.maximum(total, 1e-300), 0.0))
