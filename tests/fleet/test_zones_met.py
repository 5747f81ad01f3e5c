"""When a zone is met: every demand by one look, and what no safe camera can see does not count."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.proof.zones import Demand, Looked, judged
from upplied.records import Camera

N = 10
ALL, NONE = np.ones(N, bool), np.zeros(N, bool)
CAMERA = Camera(90.0, 60.0, 1.0, 40.0, 2000, 1500)  # 1 mm a pixel at 1 m


def look(distance=3.0, incidence=20.0, age=0.0, seen=ALL, camera=CAMERA, pictures=None, more=()) -> Looked:
    every = [np.where(seen, value, np.nan) for value in (distance, incidence, *more)]
    return Looked(every[0], every[1], age, camera, pictures, (tuple(every[2:]),) if more else ())


@pytest.mark.parametrize(
    ("demand", "looks", "status", "why"),
    [
        ({}, [look()], "met", ""),
        ({}, [], "missed", "100.0 % was not seen"),
        ({}, [look(seen=np.arange(N) < 6)], "missed", "40.0 % was not seen"),
        ({}, [look(seen=np.arange(N) < 6), look(seen=np.arange(N) >= 6)], "met", ""),
        ({"gsd_mm": 2.0}, [look(3.0)], "missed", "100.0 % was seen from too far for 2 mm a pixel"),
        ({"gsd_mm": 3.5}, [look(3.0)], "met", ""),
        # a pixel covers 3 mm of what it sees frontally, 4.7 mm at 50 degrees
        ({"gsd_mm": 3.5}, [look(3.0, 50.0)], "missed", "100.0 % was seen from too far for 3.5 mm a pixel"),
        ({"gsd_mm": 3.5}, [look(camera=Camera())], "missed", "unknown resolution"),
        ({"incidence_deg": 10.0}, [look()], "missed", "more obliquely than 10 deg"),
        ({"max_age_days": 30.0}, [look(age=31.0)], "missed", "longer ago than 30 days"),
        ({"max_age_days": 30.0}, [look(age=31.0), look(age=2.0)], "met", ""),
        ({"looks": 2}, [look()], "missed", "100.0 % was seen in fewer than 2 pictures"),
        ({"looks": 2}, [look(), look()], "met", ""),
        ({"looks": 3}, [look(pictures=np.arange(N) // 5 * 3)], "missed", "50.0 % was seen in fewer than 3"),
        ({"looks": 3}, [look(pictures=ALL * 2), look(incidence=80.0)], "met", ""),
        ({"looks": 2, "max_age_days": 30.0}, [look(age=31.0), look()], "missed", "fewer than 2 pictures"),
        # near but oblique on one day, frontal but far on another: no look keeps both
        ({"gsd_mm": 5.0, "incidence_deg": 30.0}, [look(3.0, 50.0), look(9.0, 5.0)], "missed", "obliquely"),
        # the nearest look of a flight was oblique, another one of it was frontal
        ({"incidence_deg": 30.0}, [look(3.0, 50.0, more=(9.0, 5.0))], "met", ""),
        ({"gsd_mm": 5.0, "incidence_deg": 30.0}, [look(3.0, 50.0, more=(9.0, 5.0))], "missed", "obliquely"),
        ({"looks": 2}, [look(more=(9.0, 5.0))], "missed", "fewer than 2 pictures"),
    ],
)
def test_a_zone_is_met_where_every_patch_has_one_look_that_keeps_every_demand(demand, looks, status, why):
    verdict = judged(Demand("seam", "part_0", **demand), ALL, ALL, looks)
    assert verdict.status == status and why in verdict.why
    assert (verdict.shown_pct == 100) == (status == "met")


def test_what_no_safe_camera_can_see_does_not_count_and_is_told():
    half = np.arange(N) < 5
    verdict = judged(Demand("seam", "part_0"), ALL, half, [look(seen=half)])
    assert verdict.status == "met" and "50.0 % of it no safe camera can see" in verdict.why
    assert judged(Demand("seam", "part_0"), ALL, NONE, [look()]).status == "unattainable"
