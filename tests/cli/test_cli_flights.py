"""Flights of every kind come in by one command, and no file is passed over in silence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_logs import Flight
from made_sources import WRITERS

from upplied.catalog import open_catalog
from upplied.cli import main
from upplied.samples.fleet import member
from upplied.samples.pilot import fly


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A catalog with a cube, and a folder with one flight round it as MCAP and as a PX4 log."""
    cube = member("cube-v1").structure
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([cube])
    flown = fly(cube, "sides")
    for form, end in (("mcap", ".mcap"), ("ulog", ".ulg")):
        folder = tmp_path / "flights" / form
        folder.mkdir(parents=True)
        path, _ = WRITERS[form](folder, Flight(flown.t_ns, flown.positions, flown.quat_xyzw))
        path.rename(path.with_name(f"by-{form}{end}"))
        (folder / f"by-{form}.toml").write_text(
            '[inspection]\nstructure_id = "cube-v1"\nbody_frame = "camera"\n'
        )
    return tmp_path


def table(capsys: pytest.CaptureFixture[str]) -> str:
    printed = capsys.readouterr()
    return "".join((printed.out + printed.err).split())


@pytest.mark.ci
def test_a_trial_shows_every_file_and_keeps_nothing(place: Path, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    (place / "flights" / "notes.md").write_text("fine weather")
    catalog = str(place / "catalog")
    assert main(["demonstrations", "add", str(place / "flights"), "--dry-run", "--catalog", catalog]) == 0
    shown = table(capsys)
    for word in (
        "by-mcap.mcap",
        "by-ulog.ulg",
        "PX4log",
        "cube-v1",
        "75x75deg",
        "notes.md",
        "2readable",
        "1passedover",
    ):
        assert word in shown
    assert open_catalog(catalog).demonstrations().empty


@pytest.mark.ci
def test_what_looked_like_a_flight_and_was_not_taken_is_exit_code_1(place: Path, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    (place / "flights" / "cut.bag").write_bytes(b"#ROSBAG V2.0\n")
    catalog = str(place / "catalog")
    assert main(["demonstrations", "add", str(place / "flights"), "--catalog", catalog]) == 1
    assert "cannotbereadasaROS1bag" in table(capsys)
    known = open_catalog(catalog)
    flights = [known.demonstration(name) for name in ("by-mcap", "by-ulog")]
    assert np.abs(flights[0].positions - flights[1].positions).max() < 0.01


@pytest.mark.ci
def test_a_structure_is_said_for_flights_without_side_cars(place: Path, capsys) -> None:
    for side in (place / "flights").rglob("*.toml"):
        side.unlink()
    catalog = str(place / "catalog")
    logs = str(place / "flights" / "ulog")
    assert main(["demonstrations", "add", logs, "--catalog", catalog]) == 1
    assert main(["demonstrations", "add", logs, "--structure", "cube-v1", "--catalog", catalog]) == 0
    assert list(open_catalog(catalog).demonstrations()["demonstration_id"]) == ["by-ulog"]
