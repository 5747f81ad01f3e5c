"""A photogrammetry project becomes a structure and a flight round it in one command."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pymap3d
import pytest
import trimesh
from made_logs import Flight
from made_sources import WRITERS, photos
from scipy.spatial.transform import Rotation

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.cli import main
from upplied.errors import InputError
from upplied.fleet import reading
from upplied.fleet.ingest import passed_over
from upplied.geometry.poses import angle_between, look_at
from upplied.inputs.logs import LogOptions
from upplied.inputs.passport.rules import RULES
from upplied.inputs.sources.project_files import project_at

LEVEL = Rotation.identity()


class InProcess:
    """Workers that read here: that files are read in processes of their own, tests/fleet shows."""

    def __init__(self, count: int) -> None:
        self.count = count

    def __enter__(self) -> InProcess:
        return self

    def __exit__(self, *error: object) -> None:
        """Nothing was started."""

    def run(self, read: Callable[[object], object], item: object) -> object:
        return read(item)


@pytest.fixture(autouse=True)
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "Workers", InProcess)


Y_DOWN = Rotation.from_matrix([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # as COLMAP: y down, z ahead


def circled() -> Flight:
    """Photos of a box of 8 x 6 x 10 m on the ground, in two circles of 12 m."""
    angle = np.linspace(0, 4 * np.pi, 80, endpoint=False)
    places = np.column_stack([12 * np.cos(angle), 12 * np.sin(angle), np.linspace(3, 9, 80)])
    quats = look_at(places, np.column_stack([0 * angle, 0 * angle, places[:, 2] - 1]))
    return Flight(1_770_000_000_000_000_000 + np.arange(80) * 2_000_000_000, places, quats)


def colmap(folder: Path, turn: Rotation = LEVEL, scale: float = 1.0) -> Path:
    """The project of a flight: a sparse model, its meshed surface, and its photos."""
    flown = circled()
    box = trimesh.creation.box((8, 6, 10)).subdivide().subdivide()
    box.vertices += (0, 0, 5)
    box.vertices = turn.apply(box.vertices) * scale
    (folder / "sparse" / "0").mkdir(parents=True)
    (folder / "dense").mkdir()
    box.export(folder / "dense" / "meshed-poisson.ply")
    quats = (turn * Rotation.from_quat(flown.quat_xyzw)).as_quat()
    WRITERS["colmap text"](
        folder / "sparse" / "0", Flight(flown.t_ns, turn.apply(flown.positions) * scale, quats)
    )
    photos(folder / "images", Flight(*(part[::8] for part in (flown.t_ns, flown.positions, flown.quat_xyzw))))
    return folder


@pytest.mark.ci
def test_a_project_is_a_structure_and_a_flight(tmp_path: Path) -> None:
    project = colmap(tmp_path / "water tower", Y_DOWN, 0.25)
    catalog = open_catalog(tmp_path / "catalog")
    options = LogOptions(kind="tower", unit_m=4.0, allow=tuple(RULES))
    catalog.create()
    tried = fleet.ingest_demonstrations(catalog, [project], 1, options=options, dry_run=True)
    assert [item.status for item in tried] == ["readable", "readable"], tried
    assert not len(catalog.structures()) and not len(catalog.demonstrations())
    added = fleet.ingest_demonstrations(catalog, [project], 1, options=options)
    assert [(item.name, item.status) for item in added] == [
        ("water-tower", "added"), ("water-tower-flight", "added"),
    ]  # fmt: skip
    assert not [item for item in passed_over([project]) if "images" in item.file]
    structure, flight = catalog.structure("water-tower"), catalog.demonstration("water-tower-flight")
    assert structure.kind == "tower" and structure.surface == "scanned"
    assert np.ptp(structure.vertices, axis=0) == pytest.approx([8, 6, 10], abs=1e-3)
    assert np.abs(flight.positions - circled().positions).max() < 1e-3
    assert np.degrees(angle_between(flight.quat_xyzw, circled().quat_xyzw)).max() < 0.01


def test_a_project_of_opendronemap_is_placed_on_the_earth(tmp_path: Path) -> None:
    project, flown = tmp_path / "silo", circled()
    (project / "opensfm").mkdir(parents=True)
    (project / "odm_meshing").mkdir()
    box = trimesh.creation.box((8, 6, 10)).subdivide().subdivide()
    box.vertices += (0, 0, 5)
    box.export(project / "odm_meshing" / "odm_mesh.ply")
    path, _ = WRITERS["opensfm"](project / "opensfm", flown)
    content = json.loads(path.read_text())
    content[0]["reference_lla"] = {"latitude": 47.0, "longitude": 8.0, "altitude": 400.0}
    path.write_text(json.dumps(content))
    catalog = open_catalog(tmp_path / "catalog")
    options = LogOptions(kind="silo", allow=tuple(RULES))
    added = fleet.ingest_demonstrations(catalog, [project], 1, options=options)
    assert [item.status for item in added] == ["added", "added"], added
    place = catalog.structure("silo").placement
    assert place is not None and (place.lat_deg, place.lon_deg, place.datum) == (47.0, 8.0, "amsl")
    assert np.abs(catalog.demonstration("silo-flight").positions - flown.positions).max() < 1e-3
    assert pymap3d.enu2geodetic(0, 0, 0, 47, 8, 400)[0] == pytest.approx(place.lat_deg)


@pytest.mark.parametrize(
    ("facts", "message"),
    [({"unit_m": 1.0}, "--kind"), ({"kind": "tower"}, "--unit-m")],
)
def test_a_project_asks_for_what_it_does_not_hold(tmp_path: Path, facts: dict, message: str) -> None:
    images = colmap(tmp_path / "tower") / "sparse" / "0" / "images.txt"
    with pytest.raises(InputError, match=message):
        project_at(images, LogOptions(**facts))


def test_a_project_in_a_tilted_frame_is_refused_with_the_remedy(tmp_path: Path) -> None:
    project = colmap(tmp_path / "tower", Rotation.from_euler("x", 30, degrees=True))
    with pytest.raises(InputError, match=r"30 deg off.*aligner"):
        project_at(project / "sparse" / "0" / "images.txt", LogOptions(kind="tower", unit_m=1.0))


def test_the_command_adds_both(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project, catalog = colmap(tmp_path / "tower"), str(tmp_path / "catalog")
    command = f"demonstrations add {project} --kind tower --unit-m 1 --catalog {catalog}"
    assert main(command.split()) == 0
    assert "2 added" in capsys.readouterr().out
