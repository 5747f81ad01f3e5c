"""A structure is brought onto another by what both are, whichever pair was asked before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from upplied.planning.correspondence.coherent_point_drift import brought_onto
from upplied.records import Cloud


def ball(size: list[float]) -> Cloud:
    normals = np.random.default_rng(0).normal(size=(600, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Cloud(normals * size, normals, np.ones(600), np.zeros(600, np.int64))


def test_what_is_brought_lies_on_the_other_and_keeps_its_own_parts() -> None:
    known, wide, high = ball([5.0, 5.0, 5.0]), ball([5.3, 5.0, 5.0]), ball([5.0, 5.0, 5.3])
    onto_wide, onto_high = brought_onto(wide, known), brought_onto(high, known)
    assert np.ptp(onto_wide.points[:, 0]) > 10.4 > np.ptp(onto_high.points[:, 0])
    again = replace(known, part=np.arange(600) % 2)
    moved = brought_onto(replace(wide, part=np.ones(600, np.int64)), again)
    np.testing.assert_array_equal(moved.points, onto_wide.points)
    np.testing.assert_array_equal(moved.part, again.part)
