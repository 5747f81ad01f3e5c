"""What a path costs by where it is and how it turns: clearance, shape, leaving, stand-off, turning."""

from dataclasses import dataclass, replace

import numpy as np

from upplied.geometry.polylines import leg_lengths
from upplied.geometry.vectors import unit
from upplied.planning.airspace.rules import Airspace
from upplied.planning.carry.standoff import Standoff
from upplied.planning.constants import MOST_RATIO
from upplied.planning.geometry.frechet import spread
from upplied.planning.trajectory.state import Flown, between
from upplied.records import Bools, Floats, Record

_BEYOND_M = 0.05  # kept beyond the limits, for what lies between the stations
_HARMLESS_M = 0.01  # by which a path may be pushed away and shows the same
_SHORTEST = 0.1  # of the usual leg: what hovers is not torn apart


@dataclass(frozen=True, eq=False, repr=False)
class Clearance(Record):
    """Mean squared lack, m^2, of the height above the plane that bounds the surface nearest to each station.

    The planes hold until they are found again: past the nearest point, the surface goes on.
    """

    closest: Floats  # (M, 3) m
    outward: Floats  # (M, 3) unit vectors, from there to the path
    least_m: float
    floor_m: float
    ceiling_m: float

    @classmethod
    def of(cls, airspace: Airspace, path: Flown) -> "Clearance":
        """The term near a path."""
        closest, _ = airspace.scene.closest(path.positions)
        outward = unit(path.positions - closest)
        return cls(closest, outward, airspace.clearance_m + _BEYOND_M, airspace.floor_m, airspace.ceiling_m)

    def no_nearer(self, least_m: float) -> "Clearance":
        """The same, for a distance that is wished for and not demanded, without ground and ceiling."""
        return replace(self, least_m=least_m, floor_m=-np.inf, ceiling_m=np.inf)

    def broken(self, flown: Flown) -> Bools:
        """Which stations break the distance, the floor or the ceiling, not only what is kept beyond."""
        lack, low, high = self._lacks(flown)
        return np.asarray(np.maximum(lack - _BEYOND_M, np.maximum(low, high)) > _HARMLESS_M, bool)

    def _lacks(self, flown: Flown) -> tuple[Floats, Floats, Floats]:
        height = ((flown.positions - self.closest) * self.outward).sum(axis=1)
        low, high = self.floor_m - flown.positions[:, 2], flown.positions[:, 2] - self.ceiling_m
        return np.maximum(self.least_m - height, 0), np.maximum(low, 0), np.maximum(high, 0)

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared lack, and its slope."""
        lack, low, high = self._lacks(flown)
        slope = -2 * lack[:, None] * self.outward
        slope[:, 2] += 2 * (high - low)
        nothing = np.zeros(len(lack))
        return float((lack**2 + low**2 + high**2).mean()), Flown(slope / len(lack), nothing, nothing)


_LEVEL = 0.1  # of the largest deviation: a path with less along an axis is level and is not stretched there


@dataclass(frozen=True, eq=False, repr=False)
class Shape(Record):
    """Mean squared departure in units of the path's largest deviation: a metre up counts as one aside."""

    demonstrated: Floats  # (M, 3) m, about its mean, axes of the source; NaN where nothing was demonstrated
    standing: Floats  # (3, 3) turns the target's axes into the source's
    unit_m: float

    @classmethod
    def of(cls, demonstrated: Floats, standing: Floats) -> "Shape":
        """The shape of a path (M, 3), m, in the target's frame."""
        turned = demonstrated @ standing.T
        return cls(turned - turned.mean(axis=0), standing, float(spread(turned)[1].max()))

    def between(self, stations: Floats) -> "Shape":
        """The same at fractions of stations (N,)."""
        demonstrated = between(stations, self.demonstrated)
        return replace(self, demonstrated=demonstrated - np.nanmean(demonstrated, axis=0))

    def image(self, positions: Floats) -> Floats:
        """The shifted and stretched demonstrated path (M, 3), m, nearest to a path, target frame."""
        turned = positions @ self.standing.T
        return np.asarray(self._image(turned) @ self.standing)

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared departure, and its slope: that of the nearest image adds none (it is the nearest)."""
        own = np.isfinite(self.demonstrated[:, 0])
        turned = flown.positions[own] @ self.standing.T
        off = (turned - self._image(turned, own)) / self.unit_m
        slope, nothing = np.zeros_like(flown.positions), np.zeros(len(flown))
        slope[own] = (2 / len(off)) * (off / self.unit_m) @ self.standing
        return float((off**2).sum(axis=1).mean()), Flown(slope, nothing, nothing)

    def _image(self, turned: Floats, demonstrated: Bools | slice = slice(None)) -> Floats:
        middle, own = turned.mean(axis=0), self.demonstrated[demonstrated]
        square = np.maximum((own**2).mean(axis=0), 1e-12)
        wide = np.sqrt(square) > _LEVEL * np.sqrt(square.max())
        stretch = ((turned - middle) * own).mean(axis=0) / square
        return np.asarray(middle + np.where(wide, np.clip(stretch, 1 / MOST_RATIO, MOST_RATIO), 1.0) * own)


@dataclass(frozen=True, eq=False, repr=False)
class StandoffKept(Record):
    """Mean squared excess of the stand-off beyond its tolerance, in units of the wanted stand-off.

    What is asked for is a median distance, which has no slope; the mean distance stands for it, over
    the ratio of the two on the path as it was.
    """

    standoff: Standoff
    ratio: Floats  # (V,) mean over median distance
    tolerance: float

    @classmethod
    def of(cls, standoff: Standoff, path: Flown, tolerance: float) -> "StandoffKept":
        """The term near a path."""
        if len(standoff.station) == 0:
            return cls(standoff, np.ones(0), tolerance)
        distance = np.linalg.norm(path.positions[standoff.station][:, None] - standoff.seen, axis=2)
        return cls(standoff, distance.mean(axis=1) / np.median(distance, axis=1), tolerance)

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared excess, and its slope."""
        standoff, slope, nothing = self.standoff, np.zeros_like(flown.positions), np.zeros(len(flown))
        if len(standoff.station) == 0:
            return 0.0, Flown(slope, nothing, nothing)
        ray = flown.positions[standoff.station][:, None] - standoff.seen
        distance = np.maximum(np.linalg.norm(ray, axis=2), 1e-9)
        wanted = standoff.wanted_m * self.ratio
        off = distance.mean(axis=1) / wanted - 1
        excess = np.sign(off) * np.maximum(np.abs(off) - self.tolerance, 0)
        each = (ray / distance[:, :, None]).mean(axis=1) / wanted[:, None]
        np.add.at(slope, standoff.station, (2 / len(off) * excess)[:, None] * each)
        return float((excess**2).mean()), Flown(slope, nothing, nothing)


_LITTLE_RAD = np.radians(0.3)  # between stations: smaller turns cost little, so that there is a slope


@dataclass(frozen=True, eq=False, repr=False)
class Turning(Record):
    """Total variation of the change of the camera's direction, over all that the demonstration turns.

    A change that stays costs nothing, a look aside costs the way there and back.
    """

    yaw: Floats  # (M,) rad, as carried
    pitch: Floats  # (M,) rad
    demonstrated_rad: float

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Added over demonstrated turning, and its slope."""
        level = np.cos((self.pitch[1:] + self.pitch[:-1]) / 2) ** 2
        across, up = np.diff(flown.yaw - self.yaw), np.diff(flown.pitch - self.pitch)
        length = np.sqrt(level * across**2 + up**2 + _LITTLE_RAD**2)
        by_yaw = -np.diff(level * across / length, prepend=0.0, append=0.0)
        by_pitch = -np.diff(up / length, prepend=0.0, append=0.0)
        value = float((length - _LITTLE_RAD).sum()) / self.demonstrated_rad
        nothing = np.zeros_like(flown.positions)
        return value, Flown(nothing, by_yaw / self.demonstrated_rad, by_pitch / self.demonstrated_rad)


@dataclass(frozen=True, eq=False, repr=False)
class Leaving(Record):
    """Mean squared distance from the carried flight, and mean squared change of it on the way; in stand-offs.

    What shows as much from many places is flown where the expert's flight lies, whatever else changes.
    """

    carried: Floats  # (M, 3) m
    usual_m: float  # the stand-off
    share: Floats  # (M - 1,) of each leg, what a change over it counts

    @classmethod
    def of(cls, carried: Floats, usual_m: float) -> "Leaving":
        """Leaving a flight (M, 3), m, of a usual stand-off."""
        leg = leg_lengths(carried) / usual_m
        leg = np.maximum(leg, max(_SHORTEST * float(leg.mean()), 1e-6)) if len(leg) else leg
        return cls(carried, usual_m, 1 / (leg * max(float(leg.sum()), 1.0)))

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared distance and change, and their slope."""
        off = (flown.positions - self.carried) / self.usual_m
        change = np.diff(off, axis=0)
        pull = self.share[:, None] * change
        slope = 2 / len(off) * off
        slope[1:] += 2 * pull
        slope[:-1] -= 2 * pull
        nothing = np.zeros(len(off))
        value = (off**2).sum() / len(off) + (pull * change).sum()
        return float(value), Flown(slope / self.usual_m, nothing, nothing)
