"""Segments by lambda, and the viewpoint of each."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from upplied.config import ViewpointSettings
from upplied.geometry.poses import from_yaw_pitch
from upplied.planning.demonstration.stations import find_viewpoints, segment
from upplied.records import Trajectory, Visibility

views = arrays(bool, st.tuples(st.integers(1, 25), st.integers(1, 12)))


@given(views, st.floats(0.05, 1.0))
def test_segments_follow_the_definition(seen, shared):
    bounds = segment(Visibility(seen), shared)
    assert bounds[0] == 0 and bounds[-1] == len(seen) and (np.diff(bounds) > 0).all()
    for start, stop in itertools.pairwise(bounds):
        first = seen[start]
        for q in range(start + 1, len(seen)):
            common = (first & seen[q]).sum()
            ends = common < shared * first.sum() if first.any() else seen[q].any()
            assert ends == (q == stop) or q > stop
            if q == stop:
                break


@given(views)
def test_viewpoints_together_see_what_the_flight_saw(seen):
    count = len(seen)
    flight = Trajectory(
        np.arange(count, dtype=float),
        np.random.default_rng(0).random((count, 3)),
        from_yaw_pitch(np.zeros(count), np.zeros(count)),
    )
    viewpoints = find_viewpoints(flight, Visibility(seen), ViewpointSettings())
    np.testing.assert_array_equal(viewpoints.seen.any(axis=0), seen.any(axis=0))
    for index in range(len(viewpoints)):
        span = slice(viewpoints.start[index], viewpoints.stop[index])
        np.testing.assert_allclose(viewpoints.positions[index], flight.positions[span].mean(axis=0))


def test_a_gap_in_the_log_always_starts_a_segment():
    seen = np.ones((6, 4), bool)
    assert segment(Visibility(seen), 0.5, np.array([4])).tolist() == [0, 4, 6]


def test_a_higher_lambda_never_gives_fewer_segments_on_a_steady_sweep():
    window = np.abs(np.arange(200)[:, None] * 0.5 - np.arange(120)[None, :]) < 10
    counts = [len(segment(Visibility(window), shared)) for shared in (0.2, 0.4, 0.6, 0.8)]
    assert counts == sorted(counts) and counts[0] < counts[-1]
