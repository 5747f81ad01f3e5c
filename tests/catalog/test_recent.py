"""Records at hand are the same records, and never more of them than allowed."""

from __future__ import annotations

import numpy as np

from upplied.fleet.planner import Recent, nbytes
from upplied.records import Cloud, Trajectory


def cloud(number: int) -> Cloud:
    return Cloud(np.zeros((number, 3)), area_m2=np.zeros(number))


def test_a_record_at_hand_is_not_asked_for_again():
    calls = []

    def memo(stage, record_type, key, compute):
        calls.append((stage, key))
        return compute()

    recent = Recent(memo)
    first = recent("clouds", Cloud, "a", lambda: cloud(5))
    assert recent("clouds", Cloud, "a", lambda: cloud(9)) is first
    assert recent("surface", Cloud, "a", lambda: cloud(9)) is not first
    assert calls == [("clouds", "a"), ("surface", "a")]


def test_what_was_used_longest_ago_goes_first():
    calls = []

    def memo(stage, record_type, key, compute):
        calls.append(key)
        return compute()

    recent = Recent(memo, max_bytes=2 * nbytes(cloud(10)))
    for key in "abacab":
        recent("clouds", Cloud, key, lambda: cloud(10))
    assert calls == ["a", "b", "c", "b"]


def test_a_record_larger_than_all_room_is_handed_on_all_the_same():
    recent = Recent(lambda stage, record_type, key, compute: compute(), max_bytes=10)
    for _ in range(2):
        assert len(recent("clouds", Cloud, "a", lambda: cloud(50))) == 50


def test_bytes_count_arrays_within_records():
    path = Trajectory(np.zeros(4), np.zeros((4, 3)), np.zeros((4, 4)))
    assert nbytes(path) == 4 * 8 * 8
    assert nbytes(cloud(2)) == 2 * 4 * 8
    assert nbytes("text") == 0
