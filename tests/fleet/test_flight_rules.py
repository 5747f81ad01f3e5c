"""Flights that come into a catalog are judged there, and what is found reaches the person."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_flights import FAULTS, flights, log_of

from upplied.catalog import open_catalog
from upplied.cli import main


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A catalog with one structure, and beside it a right log and one in north, east, down."""
    structure, flown = flights("box", 0)
    catalog = open_catalog(tmp_path / "catalog").create()
    catalog.add_structures([structure])
    log = replace(log_of(structure, flown, np.random.default_rng(1)), hfov_deg=None)
    log.write(tmp_path / "right.mcap")
    FAULTS["ned"](log, np.random.default_rng(0)).write(tmp_path / "wrong.mcap")
    return tmp_path


def run(place: Path, *words: str) -> int:
    return main(["demonstrations", *words, "--catalog", str(place / "catalog")])


@pytest.mark.ci
def test_findings_reach_the_person(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(place, "add", str(place / "right.mcap"), "--workers", "1") == 0
    assert "assumed: a camera of 75 x 75 deg" in capsys.readouterr().out
    assert run(place, "list", "--json") == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["verdict"] == "warned" and "assumed" in row["findings"] and row["flown_clearance_m"] > 1
    assert run(place, "show", "right") == 0
    output = capsys.readouterr().out
    assert "minimum clearance (m)" in output and "assumed: a camera" in output
    assert run(place, "show", "right", "--json") == 0
    assert json.loads(capsys.readouterr().out)["measured"]["axis_pct"] > 90
    passport = open_catalog(place / "catalog").demonstration("right").passport
    assert passport["verdict"] == "warned" and passport["bounds"]["least_clearance_m"] == 0.3


@pytest.mark.ci
def test_a_wrong_log_is_refused_by_name_and_may_be_overruled(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = str(place / "wrong.mcap")
    assert run(place, "add", wrong, "--workers", "1") == 1
    message = capsys.readouterr().err
    assert "fits-otherwise" in message and 'convention = "ned"' in message and "Traceback" not in message
    assert run(place, "add", wrong, "--allow", "no-such-rule") == 2
    assert "is no rule" in capsys.readouterr().err
    rules = ("fits-otherwise", "below-ground", "looks-away", "shows-nothing", "frame-name", "off-centre")
    allowed = [word for rule in rules for word in ("--allow", rule)]
    assert run(place, "add", wrong, "--workers", "1", *allowed) == 0
    stored = open_catalog(place / "catalog").demonstrations().set_index("demonstration_id").loc["wrong"]
    assert stored["verdict"] == "overruled"
    assert "below-ground" in json.loads(stored["passport_json"])["allowed"]


@pytest.mark.ci
def test_strict_and_bounds_decide_what_is_taken(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    right = str(place / "right.mcap")
    assert run(place, "add", right, "--workers", "1", "--strict") == 1
    assert "assumed" in capsys.readouterr().err
    assert run(place, "add", right, "--workers", "1", "--set", "max_speed_mps=0.1") == 1
    assert "too-fast" in capsys.readouterr().err
    assert open_catalog(place / "catalog").demonstrations().empty


def test_a_flight_of_an_unknown_structure_is_refused(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    open_catalog(place / "catalog").retire_structures(["box-random-0"])
    assert run(place, "add", str(place / "right.mcap"), "--workers", "1") == 1
    assert "not in the catalog" in " ".join(capsys.readouterr().err.split())
