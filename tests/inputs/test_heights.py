"""Datums of heights, lever arms of antennas, and clocks that count otherwise."""

from __future__ import annotations

import struct
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_logs import Flight, flight
from made_sources import PLACE, WRITERS
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.inputs.flight.tracks import Track
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.inputs.passport import rules
from upplied.inputs.passport.measured import Measured
from upplied.inputs.passport.sight import steadiness
from upplied.inputs.rules import PassportSettings
from upplied.inputs.schemas import geodetic

OPTIONS = LogOptions(structure_id="tank", **(PLACE | {"structure_datum": "ellipsoid"}))


def _grid(folder: Path, height_m: float) -> None:
    """A geoid of one height around the place, as PROJ's GTX has it."""
    head = struct.pack(">ddddii", 46.0, 7.0, 1.0, 1.0, 3, 3)
    (folder / "egm96_15.gtx").write_bytes(head + struct.pack(">9f", *[height_m] * 9))


def test_mean_sea_level_comes_from_a_grid_that_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """ArduPilot logs heights above the sea, the structure stands above the ellipsoid."""
    pyproj = pytest.importorskip("pyproj")
    path, _ = WRITERS["dataflash"](tmp_path, flight(120, 10.0))
    place = replace(OPTIONS, structure_datum="ellipsoid")
    monkeypatch.setattr(geodetic, "GRIDS", ("egm96_15.gtx",))
    with pytest.raises(InputError, match=r"geoid_undulation_m, or a grid: none of PROJ's"):
        read_demonstration(path, place)
    _grid(tmp_path, 47.5)
    folders = pyproj.datadir.get_data_dir()
    request.addfinalizer(lambda: pyproj.datadir.set_data_dir(folders))
    pyproj.datadir.append_data_dir(str(tmp_path))
    by_grid = read_demonstration(path, place)
    stated = read_demonstration(path, replace(place, geoid_undulation_m=47.5))
    assert "47.5 m above the ellipsoid, by the grid egm96_15.gtx" in by_grid.notes
    assert np.abs(by_grid.positions - stated.positions).max() < 1e-6


def test_without_the_library_the_message_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyproj", None)
    path, _ = WRITERS["dataflash"](tmp_path, flight(120, 10.0))
    with pytest.raises(InputError, match=r"pip install \"upplied\[geoid\]\""):
        read_demonstration(path, OPTIONS)


def test_the_antenna_of_the_receiver_is_not_the_body(tmp_path: Path) -> None:
    """An antenna 1 m before and 0.5 m above the body: its places come back to the body's."""
    flown, arm = flight(120, 10.0), np.array([1.0, 0.0, 0.5])
    of_antenna = flown.positions + Rotation.from_quat(flown.quat_xyzw).apply(arm)
    path, facts = WRITERS["dataflash"](tmp_path, Flight(flown.t_ns, of_antenna, flown.quat_xyzw))
    options = LogOptions(structure_id="tank", body_T_antenna_position_m=tuple(arm), **facts)
    actual = read_demonstration(path, options)
    assert np.abs(actual.positions - flown.positions).max() < 0.02
    without = read_demonstration(path, replace(options, body_T_antenna_position_m=None))
    assert np.abs(without.positions - of_antenna).max() < 0.02 and without.sha256 != actual.sha256


@pytest.mark.parametrize(("ahead_s", "rule"), [(18.0, True), (37.1, True), (0.2, False), (25.0, False)])
def test_stamps_without_leap_seconds_are_named(ahead_s: float, rule: bool) -> None:
    flown = flight(600, 10.0)
    log_ns = flown.t_ns - round(ahead_s * 1e9)
    track = Track(flown.t_ns, flown.positions, flown.quat_xyzw, log_ns)
    figures = steadiness(track, track, 0.5)
    assert figures.clock_ahead_s == pytest.approx(ahead_s, abs=1e-6)
    good = Measured(axis_pct=98.0, shown_pct=100.0, fit_pct=99.0, year=2026, clock_ahead_s=ahead_s)
    names = [item.rule for item in rules.judged(good, PassportSettings())]
    assert names == (["leap-seconds"] if rule else [])


def test_a_receiver_whose_weeks_rolled_over_is_named() -> None:
    good = Measured(axis_pct=98.0, shown_pct=100.0, fit_pct=99.0, year=2006)
    (finding,) = rules.judged(good, PassportSettings())
    assert finding.rule == "undated" and "2026 if its receiver counts 1024 weeks" in finding.found
