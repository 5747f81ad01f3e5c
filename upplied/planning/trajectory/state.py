"""What the optimisation varies: a smooth displacement of the demonstrated path and of its camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, PchipInterpolator
from scipy.linalg import solveh_banded
from scipy.sparse import csr_matrix

from upplied.geometry.polylines import cumulated, interpolated, leg_lengths, pieces_of_legs
from upplied.records import Floats, Record

_DEGREE = 3
_RIDGE = 1e-3  # of a control point's own weight: what the stations leave open stays small
_STILL_M = 1e-6  # a shorter leg is none
_MOST_PIECES = 40  # of a leg


@dataclass(frozen=True, eq=False, repr=False)
class Flown(Record):
    """A path as flown at M stations; of slopes, the same fields hold derivatives."""

    positions: Floats  # (M, 3) m
    yaw: Floats  # (M,) rad, unwrapped
    pitch: Floats  # (M,) rad

    def __len__(self) -> int:
        return len(self.yaw)


@dataclass(frozen=True, eq=False, repr=False)
class State(Record):
    """A base path and the B-splines over its stations that displace it.

    The variables are one vector: K control points of the displacement, in units of `unit_m`, then C of
    the yaw's and C of the pitch's change, rad.
    """

    base: Flown
    unit_m: Floats  # (3,) along each axis; 0: the path keeps its coordinate
    moving: csr_matrix  # (M, K) of the displacement
    turning: csr_matrix  # (M, C) of the camera's directions

    @classmethod
    def of(cls, base: Flown, unit_m: Floats, moving: int, turning: int) -> State:
        """The state with so many control points for the displacement and for each angle."""
        return cls(base, unit_m, _basis(len(base), moving), _basis(len(base), turning))

    def flown(self, variables: Floats) -> Flown:
        """The path at the stations of the base."""
        return self._with(self.base, variables, self.moving, self.turning)

    def pulled_back(self, slope: Flown) -> Floats:
        """The slope with respect to the variables, from that with respect to the path at its stations."""
        moved = (self.moving.T @ slope.positions) * self.unit_m
        return np.concatenate([moved.ravel(), self.turning.T @ slope.yaw, self.turning.T @ slope.pitch])

    def nearest(self, path: Flown) -> Floats:
        """The variables whose path comes nearest to one of as many stations (least squares)."""
        unit = np.where(self.unit_m > 0, self.unit_m, np.inf)
        moved = _fitted(self.moving, (path.positions - self.base.positions) / unit)
        angles = np.column_stack([path.yaw - self.base.yaw, path.pitch - self.base.pitch])
        return np.concatenate([moved.ravel(), _fitted(self.turning, angles).T.ravel()])

    def curve(self, variables: Floats, step_m: float) -> tuple[Floats, Flown]:
        """The path as a curve with legs of about `step_m`, and the station (a fraction) of each vertex.

        A polyline has all its turning at its vertices, where a vehicle would slow down; the curve turns
        steadily. Its stations are among its vertices.
        """
        at, positions = _curve(self.base.positions, step_m)
        index = np.arange(float(len(self.base)))
        angles = np.column_stack([self.base.yaw, self.base.pitch])
        if len(index) > 1:
            angles = PchipInterpolator(index, angles)(at)
        base = Flown(positions, *angles.T)
        share = at / max(index[-1], 1.0)
        bases = [_splines(share, of.shape[1]) for of in (self.moving, self.turning)]
        return at, self._with(base, variables, *bases)

    def _with(self, base: Flown, variables: Floats, moving: csr_matrix, turning: csr_matrix) -> Flown:
        moved, turned = np.split(variables, [3 * self.moving.shape[1]])
        yaw, pitch = turned.reshape(2, -1)
        offset = (moving @ moved.reshape(-1, 3)) * self.unit_m
        return Flown(base.positions + offset, base.yaw + turning @ yaw, base.pitch + turning @ pitch)


def _basis(stations: int, controls: int) -> csr_matrix:
    return _splines(np.linspace(0, 1, stations) if stations > 1 else np.zeros(1), controls)


def _splines(at: Floats, controls: int) -> csr_matrix:
    """Clamped uniform cubic B-splines at places from 0 to 1, a row for each."""
    inner = np.linspace(0, 1, controls - _DEGREE + 1)
    knots = np.concatenate([np.zeros(_DEGREE), inner, np.ones(_DEGREE)])
    return csr_matrix(BSpline.design_matrix(at, knots, _DEGREE))


def _fitted(basis: csr_matrix, values: Floats) -> Floats:
    """Control points (K, D) of the splines nearest to values (M, D); the normal equations are banded."""
    normal = (basis.T @ basis).tocsr()
    bands = np.zeros((_DEGREE + 1, basis.shape[1]))
    for offset in range(_DEGREE + 1):
        band = normal.diagonal(-offset)
        bands[offset, : len(band)] = band
    bands[0] += _RIDGE * max(float(bands[0].mean()), 1e-12)
    return np.asarray(solveh_banded(bands, basis.T @ values, lower=True))


def _curve(stations: Floats, step_m: float) -> tuple[Floats, Floats]:
    """Station numbers and positions on the cubic spline by arc length; straight where too few are apart."""
    leg = leg_lengths(stations)
    pieces = np.clip(np.ceil(leg / step_m - 1e-9).astype(int), 1, _MOST_PIECES)
    number, share = pieces_of_legs(pieces)
    at = np.append(number + share, float(len(leg)))
    along = cumulated(leg)
    apart = np.concatenate([[True], leg > _STILL_M])
    where = np.interp(at, np.arange(float(len(stations))), along)
    if apart.sum() < 4:
        return at, interpolated(where, along, stations)
    return at, CubicSpline(along[apart], stations[apart], bc_type="natural")(where)
