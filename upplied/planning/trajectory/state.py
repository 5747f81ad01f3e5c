"""What the optimisation varies: a smooth displacement of the demonstrated path and of its camera."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, PchipInterpolator
from scipy.sparse import csr_matrix

from upplied.geometry.polylines import cumulated, interpolated, leg_lengths, pieces_of_legs
from upplied.records import Floats, Record, Rows

_DEGREE = 3
_STILL_M = 1e-6  # a shorter leg is none
_MOST_PIECES = 40  # of a leg


@dataclass(frozen=True, eq=False, repr=False)
class Flown(Rows):
    """A path as flown at M stations; of slopes, the same fields hold derivatives."""

    positions: Floats  # (M, 3) m
    yaw: Floats  # (M,) rad, unwrapped
    pitch: Floats  # (M,) rad

    @property
    def columns(self) -> Floats:
        """Positions, yaw and pitch, (M, 5)."""
        return np.column_stack([self.positions, self.yaw, self.pitch])

    def between(self, stations: Floats) -> "Flown":
        """The path at fractions of stations (N,)."""
        poses = between(stations, self.columns)
        return Flown(poses[:, :3].copy(), *poses[:, 3:].T.copy())


def between(stations: Floats, values: Floats) -> Floats:
    """Values (M,) or (M, k) of stations at fractions of them (N,)."""
    number = np.arange(float(len(values)))
    return np.interp(stations, number, values) if values.ndim == 1 else interpolated(stations, number, values)


class Term(Protocol):
    """What a path is asked for, as a number that is to become small."""

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """The number in the term's unit, and its slope: derivatives by positions, yaw and pitch."""
        ...


@dataclass(frozen=True, eq=False, repr=False)
class State(Record):
    """A base path and the B-splines along it that displace it and turn its camera.

    The variables are K control points of five coordinates: the displacement along three axes, in units of
    `unit`, and the changes of yaw and pitch, rad.
    """

    base: Flown
    share: Floats  # (M,) of the way along the path, 0 to 1, at which each station lies
    unit: Floats  # (5,) m along each axis (0: the path keeps its coordinate), and 1 rad
    basis: csr_matrix  # (M, K)
    back: csr_matrix  # (K, M), the same the other way round, by rows

    @classmethod
    def of(cls, base: Flown, share: Floats, unit_m: Floats, pieces: int) -> "State":
        """The state with splines of so many pieces."""
        basis = _splines(share, pieces)
        return cls(base, share, np.append(unit_m, [1.0, 1.0]), basis, basis.T.tocsr())

    def flown(self, variables: Floats) -> Flown:
        """The path at the stations of the base."""
        return self._with(self.base, variables, self.basis)

    def pulled_back(self, slope: Flown) -> Floats:
        """The slope with respect to the variables, from that with respect to the path at its stations."""
        return np.asarray((self.back @ slope.columns * self.unit).ravel())

    def curve(self, variables: Floats, step_m: float) -> tuple[Floats, Flown]:
        """The path as a curve with legs of about `step_m`, and the station (a fraction) of each vertex.

        A polyline has all its turning at its vertices, where a vehicle would slow down; the curve turns
        steadily. Its stations are among its vertices. It is a cubic spline by arc length; straight where too
        few stations are apart.
        """
        stations = self.base.positions
        leg = leg_lengths(stations)
        number, share = pieces_of_legs(np.clip(np.ceil(leg / step_m - 1e-9).astype(int), 1, _MOST_PIECES))
        at, along = np.append(number + share, float(len(leg))), cumulated(leg)
        apart = np.concatenate([[True], leg > _STILL_M])
        where = np.interp(at, np.arange(float(len(stations))), along)
        if apart.sum() < 4:
            positions = interpolated(where, along, stations)
        else:
            positions = CubicSpline(along[apart], stations[apart], bc_type="natural")(where)
        index = np.arange(float(len(self.base)))
        angles = np.column_stack([self.base.yaw, self.base.pitch])
        if len(index) > 1:
            angles = PchipInterpolator(index, angles)(at)
        base = Flown(positions, *angles.T)
        splines = _splines(np.interp(at, index, self.share), self.basis.shape[1] - _DEGREE)
        return at, self._with(base, variables, splines)

    def _with(self, base: Flown, variables: Floats, basis: csr_matrix) -> Flown:
        change = basis @ (variables.reshape(-1, len(self.unit)) * self.unit)
        return Flown(base.positions + change[:, :3], base.yaw + change[:, 3], base.pitch + change[:, 4])


def _splines(at: Floats, pieces: int) -> csr_matrix:
    """Clamped uniform cubic B-splines at places from 0 to 1, a row for each."""
    inner = np.linspace(0, 1, pieces + 1)
    knots = np.concatenate([np.zeros(_DEGREE), inner, np.ones(_DEGREE)])
    return csr_matrix(BSpline.design_matrix(at, knots, _DEGREE))
