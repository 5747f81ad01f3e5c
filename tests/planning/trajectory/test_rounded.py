"""A path of stations made a curve: through all of them, steadily turning, straight where it has to be."""

import numpy as np
import pytest

from upplied.config import RetimeSettings
from upplied.planning.trajectory.retime import retime
from upplied.planning.trajectory.rounded import rounded
from upplied.poses import from_yaw_pitch
from upplied.records import Trajectory, Waypoints


def ring(count=24, radius=10.0):
    """A polygon of 2.6 m legs round the origin."""
    angle = np.linspace(0, 2 * np.pi, count)
    at = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, 5.0)])
    viewpoint = np.arange(count) % 3 == 0
    return Waypoints(at, from_yaw_pitch(angle + np.pi, np.zeros(count)), np.arange(float(count)), viewpoint)


def free(at):
    return np.zeros(len(at) - 1, bool)


def test_the_curve_is_the_circle_that_the_stations_lie_on():
    path, curve = ring(), rounded(ring(), free)
    radius = np.linalg.norm(curve.positions[:, :2], axis=1)
    inner = slice(20, -20)  # a spline without tangents at its ends is less round there
    assert np.abs(radius[inner] - 10).max() < 0.005
    assert np.linalg.norm(np.diff(curve.positions, axis=0), axis=1).max() < 0.52
    own = [np.linalg.norm(curve.positions - place, axis=1).argmin() for place in path.positions]
    np.testing.assert_allclose(curve.positions[own], path.positions, atol=1e-12)
    np.testing.assert_allclose(curve.t_s[own], path.t_s)
    assert list(np.flatnonzero(curve.is_viewpoint)) == [own[k] for k in range(0, 24, 3)]
    assert (np.diff(curve.t_s) > 0).all()


def test_a_leg_that_may_not_bulge_stays_straight():
    path = ring()
    curve = rounded(path, lambda at: np.linalg.norm(at[1:, :2], axis=1) > 9.99 + 1e-9)
    assert np.linalg.norm(curve.positions[:, :2], axis=1).max() <= 10 + 1e-9
    first, second = path.positions[4:6]
    between = curve.positions[(curve.t_s > 4) & (curve.t_s < 5)]
    cross = np.linalg.norm(np.cross(between - first, second - first), axis=1)
    assert cross.max() < 1e-9


@pytest.mark.parametrize("count", [0, 1, 3])
def test_few_waypoints_stay_as_they_are(count):
    path = ring()[:count]
    assert rounded(path, free) is path


def test_a_vehicle_flies_a_curve_at_a_steady_speed():
    path = ring(48)
    flight = Trajectory(path.t_s / 9, path.positions, path.quat_xyzw)  # faster than the curve allows
    limits = RetimeSettings(limits=True, max_yaw_rate_degps=1000.0)

    def speeds(way):
        planned, _, _ = retime(way, flight, limits)
        speed = np.linalg.norm(np.diff(planned.positions, axis=0), axis=1) / np.diff(planned.t_s)
        return speed[len(speed) // 3 : -len(speed) // 3]

    steady, ragged = speeds(rounded(path, free)), speeds(path)
    assert np.ptp(steady) < 0.05 * steady.mean()
    assert steady.mean() > 1.3 * ragged.mean()  # sqrt(2 m/s^2 * 10 m), not that of the polygon's corners
    assert steady.mean() == pytest.approx(np.sqrt(2.0 * 10), rel=0.05)
