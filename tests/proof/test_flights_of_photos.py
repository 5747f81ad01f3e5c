"""A folder of photos is a flight: what RTK says of its places, and that nothing is seen between photos."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_logs import Flight
from made_plans import plan_as_demonstrated
from made_sources import photos

from upplied.catalog import open_catalog
from upplied.config import CloudSettings
from upplied.fleet.flight_logs import judge_log
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import scene_of
from upplied.inputs.sidecar import LogOptions
from upplied.planning.surface.samples import surface_samples
from upplied.proof.looks import recorded
from upplied.records import Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

CUBE = member("cube-v1").structure
FLOWN = fly(CUBE, "sides", seed=1)
KEY = hashlib.sha256(b"plan").hexdigest()
FIXED = {"RtkFlag": "50", "RtkStdLon": "0.012", "RtkStdLat": "0.011", "RtkStdHgt": "0.023"}
BESIDE_M = np.array([0.8, -0.6, 0.1])


@pytest.fixture(scope="module")
def catalog(tmp_path_factory):
    catalog = open_catalog(tmp_path_factory.mktemp("rtk") / "catalog")
    catalog.add_structures([CUBE])
    catalog.add_demonstrations([FLOWN])
    surface = surface_samples(CUBE, scene_of(CUBE), CloudSettings(surface_samples=500))
    catalog.add_plans([(KEY, plan_as_demonstrated(CUBE, FLOWN, surface), {})])
    return catalog


def judged(catalog, folder: Path, off_m=0.0, sidecar: str = "", **fixed: str):
    """What is made of photos every second of a flight of the plan, so far beside it."""
    plan = catalog.plan(KEY[:20]).trajectory
    seconds = np.arange(0.0, plan.t_s[-1], 1.0)
    at = interpolate(plan, seconds)
    rng = np.random.default_rng(4)
    stray = np.cumsum(rng.normal(0.0, 0.02, at.positions.shape), axis=0).clip(-0.1, 0.1)
    flight = Flight(
        1_770_000_000_000_000_000 + np.round(seconds * 1e9).astype(np.int64),
        at.positions + stray + off_m, at.quat_xyzw,
    )  # fmt: skip
    path, facts = photos(folder, flight, **fixed)
    facts = facts | {"structure_alt_m": 440.0 if fixed.get("RtkFlag") == "50" else 400.0}  # ellipsoid's
    if sidecar:
        (path / "inspection.toml").write_text(f"[inspection]\n{sidecar}\n")
    return judge_log(catalog.location, str(path), KEY[:20], None, LogOptions(**facts))


def test_photos_that_rtk_fixed_are_corrected_by_no_more_than_they_state(catalog, tmp_path):
    row = judged(catalog, tmp_path / "fixed", BESIDE_M, **FIXED).row
    assert row["shift_m"] == 0 and "more than its stated accuracy: left as logged" in row["findings"]
    stated = np.sqrt(0.012**2 + 0.011**2 + 0.023**2)
    assert row["place_error_m"] == pytest.approx(2 * stated)
    assert row["inspected_if_corrected_pct"] is None
    unstated = judged(catalog, tmp_path / "flag", BESIDE_M, RtkFlag="50").row
    assert unstated["shift_m"] == 0 and unstated["place_error_m"] == pytest.approx(0.1)


@pytest.mark.parametrize("fixed", [{}, FIXED | {"RtkFlag": "34"}, FIXED | {"RtkFlag": "16"}])
def test_photos_that_rtk_did_not_fix_are_corrected(catalog, tmp_path, fixed):
    row = judged(catalog, tmp_path / "single", BESIDE_M, **fixed).row
    assert row["shift_m"] == pytest.approx(1.0, abs=0.15) and row["place_error_m"] > 1.0


def test_a_side_car_states_the_accuracy(catalog, tmp_path):
    row = judged(catalog, tmp_path / "stated", BESIDE_M, "accuracy_m = 0.1").row
    assert row["shift_m"] == 0 and row["place_error_m"] == pytest.approx(0.2)


def test_nothing_is_seen_between_the_photos_of_a_folder(catalog, tmp_path):
    flight = judged(catalog, tmp_path / "photos", **FIXED)
    assert flight.row["photos"] == len(flight.path)
    when = flight.flown.looks.t_s[flight.flown.looks.seen]
    assert np.isin(np.round(when, 3), np.round(flight.path.t_s, 3)).all()
    assert "no photo times are known" not in flight.row["findings"]


def test_a_photo_right_after_a_silence_counts():
    path = Trajectory(np.array([0.0, 1, 2, 9, 10, 11]), np.zeros((6, 3)), np.tile([0.0, 0, 0, 1], (6, 1)))
    moments = np.array([1.0, 5.0, 8.9, 9.0, 10.5])
    assert recorded(path, moments).tolist() == [1.0, 9.0, 10.5]


def test_logs_of_far_poses_say_that_the_way_between_them_is_not_known(catalog, tmp_path):
    row = judged(catalog, tmp_path / "often", **FIXED).row
    assert "the clearance between them is unknown" not in row["findings"]
    plan = catalog.plan(KEY[:20]).trajectory
    seconds = np.arange(0.0, plan.t_s[-1], 3.0)
    at = interpolate(plan, seconds)
    log = replace(at, positions=at.positions + np.random.default_rng(0).normal(0, 0.05, at.positions.shape))
    t_ns = 1_770_000_000_000_000_000 + np.round(seconds * 1e9).astype(np.int64)
    path, facts = photos(tmp_path / "seldom", Flight(t_ns, log.positions, log.quat_xyzw), **FIXED)
    facts = facts | {"structure_alt_m": 440.0}
    row = judge_log(catalog.location, str(path), KEY[:20], None, LogOptions(**facts)).row
    assert "its poses are 3.0 s apart: the clearance between them is unknown" in row["findings"]
