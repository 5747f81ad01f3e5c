"""Zones that must be seen: met, missed or unattainable, as planned and as flown, each with its reason."""

from __future__ import annotations

import hashlib
import json
import zipfile
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from cases import slow_after

from upplied.catalog import open_catalog
from upplied.catalog.database import Catalog
from upplied.catalog.verbs.belonging import Zones
from upplied.cli import main
from upplied.config import CloudSettings
from upplied.errors import CatalogError, SettingsError
from upplied.fleet import PlanRequest, Resources, decide, transfer
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import scene_of
from upplied.outputs.publish import publish_pages
from upplied.outputs.zones import zones
from upplied.planning.surface.samples import surface_samples
from upplied.proof.looks import looks_of
from upplied.proof.required_zones import RequiredZones
from upplied.records import Camera, Placement, Plan, Surroundings, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

CAMERA = Camera(90.0, 60.0, 1.0, 40.0, 2000, 1500)  # 1 mm a pixel at 1 m


@pytest.fixture
def catalog(tmp_path) -> Catalog:
    """A cube on the ground whose sides were planned; its underside is unattainable, its top was not asked."""
    cube = replace(member("cube-v1").structure, surroundings=Surroundings(ground_z_m=0.0),
                   placement=Placement(50.0, 8.0, 100.0, 0.0))  # fmt: skip
    flown = fly(cube, "sides", seed=1)
    path = interpolate(flown.trajectory, np.arange(0.0, flown.trajectory.t_s[-1], 0.5))
    plan = Plan(flown.demonstration_id, "cube-v1", "cube-v1", cube.kind, "recommended", "ok",
                trajectory=path, is_viewpoint=np.arange(len(path)) % 4 == 0, flyable=True)  # fmt: skip
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([cube])
    catalog.add_demonstrations([flown])
    catalog.add_plans([(hashlib.sha256(b"plan").hexdigest(), plan, {})])
    return catalog


@pytest.mark.slow
def test_zones_are_judged_as_planned_and_as_flown(catalog, tmp_path, capsys):
    cube = catalog.structure("cube-v1")
    low, high = cube.vertices.min(axis=0), cube.vertices.max(axis=0)
    middle = (low + high) / 2
    corners = np.array([[high[0] - 0.01, *(middle - 2)[1:]], [high[0] + 0.01, *(middle + 2)[1:]]])
    corners[:, 2] = middle[2] + np.array([-1, 1])
    side = "box " + " ".join(map(str, corners.ravel()))
    roof = f"box {low[0]} {low[1]} {high[2] - 0.01} {high[0]} {high[1]} {high[2] + 0.01}"
    file = tmp_path / "monthly.toml"
    file.write_text(
        f'name = "monthly"\n[[zone]]\nzone = "side"\nwhere = "{side}"\nincidence_deg = 60\n'
        f'[[zone]]\nzone = "roof"\nwhere = "{roof}"\n'
    )
    where = ["--catalog", catalog.location]
    assert main(["require", cube.kind, str(file), "--kind", "--by", "Ada", *where]) == 0
    capsys.readouterr()
    assert main(["zones", "cube-v1", "--json", *where]) == 1
    rows = {row["zone"]: row for row in json.loads(capsys.readouterr().out)}
    assert (rows["side"]["planned"], rows["side"]["flown"]) == ("met", "missed")
    assert rows["side"]["last_seen"] == ""
    # a mission says what becomes of each zone, in its file and beside it
    (plan,) = catalog.transfers()["transfer_id"]
    goal = tmp_path / "mission.geojson"
    command = ["export", plan, "--to", "geojson", "-o", str(goal), "--draft", "--photos", "none", *where]
    assert main(command) == 0
    notes = json.loads(goal.read_text())["features"][0]["properties"]["notes"]
    assert "zone side (monthly 1): met, 100.0 % shown" in notes
    assert any(note.startswith("zone roof (monthly 1): missed, 0.0 %") for note in notes)
    beside = {row["zone"]: row for row in json.loads((tmp_path / "mission.geojson.zones.json").read_text())}
    assert beside["side"]["status"] == "met" and "was not seen" in beside["roof"]["why"]
    assert main(["brief", plan, "-o", str(tmp_path / "b.html"), "--draft", "--photos", "none", *where]) == 0
    assert "Required zones" in (tmp_path / "b.html").read_text()
    for form, word in (("qgc-plan", b"zone roof"), ("dji-wpml", b""), ("mcap", b"zone roof"), ("csv", b"")):
        goal = tmp_path / f"mission.{form}"
        kind = ["--to", form, "-o", str(goal), "--draft", "--photos", "none", *where]
        assert main(["export", plan, *kind, *(["--drone", "m30t"] if form == "dji-wpml" else [])]) == 0
        assert word in goal.read_bytes() and (tmp_path / f"mission.{form}.zones.json").exists()
    with zipfile.ZipFile(tmp_path / "mission.dji-wpml") as packed:
        assert b"zone roof" in packed.read("wpmz/template.kml")
    capsys.readouterr()
    assert rows["roof"]["planned"] == "missed" and "was not seen" in rows["roof"]["planned_why"]
    assert rows["side"]["asked_by"] == f"kind {cube.kind}" and rows["side"]["version"] == 1
    # a flight that saw the side closes it
    (plan,) = catalog.transfers()["transfer_id"]
    scene = scene_of(cube)
    surface = surface_samples(cube, scene, CloudSettings())
    path = catalog.trajectory(plan)
    seen = looks_of(Trajectory(path.t_s, path.positions, path.quat_xyzw), surface, catalog.demonstration(
        catalog.transfers()["demonstration_id"].iloc[0]).camera, scene)  # fmt: skip
    row = catalog.transfer(plan)
    catalog.add_flight(
        {"flight_id": "f1", "transfer_id": plan, "kind": "flown", "target_id": "cube-v1",
         "demonstration_id": row["demonstration_id"], "flown_at": catalog.clock.now(),
         "looks_sha256": catalog.put_looks(surface.points, surface.normals, seen.seen, seen.values)}, path,
    )  # fmt: skip
    main(["zones", "cube-v1", "--json", *where])
    (side_row,) = (r for r in json.loads(capsys.readouterr().out) if r["zone"] == "side")
    (flown_at,) = catalog.flights()["flown_at"]
    assert (side_row["flown"], side_row["last_seen"]) == ("met", f"{flown_at:%Y-%m-%d %H:%M}")
    # the page says so too, and is written anew when what is asked for changes
    publish_pages(catalog, tmp_path / "reports", pictures=0)
    (page,) = (tmp_path / "reports" / "transfers").glob("*.html")
    assert '"zone":"roof"' in page.read_text() and '"flown":"met"' in page.read_text()
    assert not publish_pages(catalog, tmp_path / "reports", pictures=0).written
    # the next version of the set, and none
    catalog.require("kind", cube.kind, "monthly", [{"zone": "side", "where": side}], "Ada")
    assert publish_pages(catalog, tmp_path / "reports", pictures=0).written
    assert '"zone":"roof"' not in page.read_text()
    catalog.require("kind", cube.kind, "odd", [{"zone": "mast", "where": "no_such_landmark"}], "Ada")
    publish_pages(catalog, tmp_path / "reports", pictures=0)
    assert "not judged" in page.read_text() and "no_such_landmark" in page.read_text()
    catalog.require("kind", cube.kind, "odd", [], "Ada")
    assert list(catalog.requirements()["version"]) == [2] and len(catalog.requirements(every=True)) == 4
    catalog.require("kind", cube.kind, "monthly", [], "Ada")
    assert main(["zones", "cube-v1", *where]) == 0 and not len(catalog.requirements())


@pytest.mark.ci
def test_a_zone_of_one_structure_is_asked_of_all_of_its_kind(catalog):
    cube = catalog.structure("cube-v1")
    cuboid = member("cuboid-v1").structure
    catalog.add_structures([cuboid])
    low, high = cube.vertices.min(axis=0), cube.vertices.max(axis=0)
    side = f"box {high[0] - 0.01} {low[1]} {low[2]} {high[0] + 0.01} {high[1]} {high[2]}"
    zone = {"zone": "side", "where": side, "on": "cube-v1"}
    catalog.require("kind", cube.kind, "monthly", [zone], "Ada")
    (own,), (other,) = zones(catalog, "cube-v1"), zones(catalog, "cuboid-v1")
    assert own["on"] == "" and "carried" not in own["planned_why"]
    assert other["on"] == "cube-v1" and "carried from cube-v1" in other["planned_why"]
    assert other["planned"] == "missed" and "was not seen" in other["planned_why"]  # nothing is planned there
    with pytest.raises(SettingsError, match="a structure of kind"):
        catalog.require("kind", cube.kind, "monthly", [{**zone, "on": "nobody"}], "Ada")
    with pytest.raises(SettingsError, match="the id of a structure"):
        catalog.require("kind", cube.kind, "monthly", [{**zone, "on": 3}], "Ada")


@pytest.mark.slow
def test_a_run_plans_for_what_is_required_and_the_same_comes_of_it_again(catalog, capsys):
    cuboid = member("cuboid-v1").structure
    catalog.add_structures([cuboid])
    low, high = cuboid.vertices.min(axis=0), cuboid.vertices.max(axis=0)
    wall = f"box {low[0]} {low[1] - 0.01} {low[2]} {high[0]} {low[1] + 0.01} {high[2]}"
    wall = {"zone": "wall", "where": wall, "incidence_deg": 30}
    request = PlanRequest(("recommended",))
    transfer(catalog, decide(catalog, request).jobs, "usual", Resources(workers=1))
    (before,) = zones_shown(catalog, wall)
    odd = {"zone": "mast", "where": "no_such_landmark"}
    catalog.require("structure", "cuboid-v1", "monthly", [wall, odd], "Ada")
    jobs = decide(catalog, request).jobs
    assert [job.target_id for job in jobs] == ["cuboid-v1"]
    transfer(catalog, jobs, "asked", Resources(workers=1))
    assert not decide(catalog, request).jobs
    (after,) = zones_shown(catalog, wall)
    assert after > before + 5
    plan = catalog.transfers(preset="recommended", structure="cuboid-v1").iloc[0]
    assert "zone mast is not planned for" in plan["warnings"]
    where = ["--catalog", catalog.location]
    assert main(["transfer", "--reproduce", plan["transfer_id"], *where]) == 0
    assert "the result is the same" in capsys.readouterr().out
    assert main(["zones", "cuboid-v1", "--json", *where]) == 1
    rows = {row["zone"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["mast"]["planned"] == rows["mast"]["flown"] == "not judged"
    assert "no_such_landmark" in rows["mast"]["planned_why"] and rows["wall"]["planned"] != "not judged"
    # asked for otherwise since: the plan is still the one that it was
    catalog.require("structure", "cuboid-v1", "monthly", [], "Ada")
    assert main(["transfer", "--reproduce", plan["transfer_id"], *where]) == 0


def zones_shown(catalog, zone: dict[str, object]) -> list[float]:
    """How much of a zone the newest plan of the cuboid shows, %."""
    catalog.require("structure", "cuboid-v1", "asked", [zone], "Ada")
    shares = [row["planned_pct"] for row in zones(catalog, "cuboid-v1") if row["set"] == "asked"]
    catalog.require("structure", "cuboid-v1", "asked", [], "Ada")
    return shares


@pytest.mark.parametrize(
    "zone",
    [
        {"zone": "a"},
        {"where": "part_0"},
        {"zone": "a", "where": "part_0", "looks": 0},
        {"zone": "a", "where": "part_0", "pictures": 3},
        {"zone": "a", "where": "part_0", "gsd_mm": 0},
        {"zone": "a", "where": "part_0", "incidence_deg": 91},
        {"zone": "a", "where": "part_0", "max_age_days": True},
    ],
)
def test_a_zone_that_asks_wrongly_is_told(catalog, zone):
    with pytest.raises(SettingsError, match="requirements monthly, zone"):
        catalog.require("structure", "cube-v1", "monthly", [zone], "Ada")
    with pytest.raises(SettingsError, match="a zone twice"):
        catalog.require("structure", "cube-v1", "monthly", [{"zone": "a", "where": "part_0"}] * 2, "Ada")
    with pytest.raises(CatalogError, match="is not in the catalog"):
        catalog.require("structure", "nobody", "monthly", [], "Ada")
    assert not len(catalog.requirements(every=True))


def labels_of(structure) -> list[str]:
    """The top of a structure, and the rest of it, face by face."""
    corners = structure.vertices[structure.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    up = normal[:, 2] / np.linalg.norm(normal, axis=1) > 0.9
    return ["roof" if each else "7" for each in up]


def written(path, labels: list[str]):
    numbers = [int(label.replace("roof", "3")) for label in labels]
    order = np.random.default_rng(0).permutation(len(labels))
    if path.suffix == ".npy":
        np.save(path, np.array(numbers) if "numbers" in path.stem else np.array(labels))
    elif path.suffix == ".txt":
        path.write_text("\n".join(labels))
    elif path.suffix == ".csv":
        path.write_text("face,label\n" + "\n".join(f"{at},{labels[at]}" for at in order))
    else:
        pq.write_table(pa.table({"label": labels}), path)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("name", slow_after(2, ["a.npy", "numbers.npy", "a.txt", "a.csv", "a.parquet"]))
def test_a_zone_is_labelled_face_by_face(catalog, tmp_path, capsys, name):
    cube = catalog.structure("cube-v1")
    written(tmp_path / name, labels_of(cube))
    label = "3" if name.startswith("numbers") else '"roof"'
    file = tmp_path / "monthly.toml"
    file.write_text(f'labels = "{name}"\n[[zone]]\nzone = "roof"\nlabel = {label}\n')
    where = ["--catalog", catalog.location]
    assert main(["require", "cube-v1", str(file), "--by", "Ada", *where]) == 0
    (row,) = Zones(catalog).of(cube.kind, "cube-v1")
    asking = RequiredZones(catalog.structure, catalog.cache, cube, None, CAMERA, [row],
                    catalog.faces_labelled)  # fmt: skip
    surface, _ = asking.required()
    assert (surface.zone == (surface.normals[:, 2] > 0.9)).all() and surface.zone.any()
    # the mesh changed: the labels are of no use, and that is told
    turned = replace(cube, triangles=cube.triangles[::-1], sha256="other")
    catalog.add_structures([turned])
    (row,) = zones(catalog, "cube-v1")
    assert row["planned"] == "not judged" and "another mesh" in row["planned_why"]


@pytest.mark.ci
def test_labels_of_one_structure_are_carried_to_its_kind(catalog, tmp_path):
    cube, cuboid = catalog.structure("cube-v1"), member("cuboid-v1").structure
    catalog.add_structures([cuboid])
    written(tmp_path / "a.txt", labels_of(cube))
    file = tmp_path / "monthly.toml"
    file.write_text('labels = "a.txt"\n[[zone]]\nzone = "roof"\nlabel = "roof"\non = "cube-v1"\n')
    where = ["--by", "Ada", "--catalog", catalog.location]
    assert main(["require", cube.kind, str(file), "--kind", *where]) == 0
    (row,) = Zones(catalog).of(cube.kind, "cuboid-v1")
    asking = RequiredZones(catalog.structure, catalog.cache, cuboid, None, CAMERA, [row],
                    catalog.faces_labelled)  # fmt: skip
    surface, untold = asking.required()
    up = surface.normals[:, 2] > 0.9
    assert not untold and surface.zone[up].mean() > 0.9 and surface.zone[~up].mean() < 0.05


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.txt", b"roof " * 11, "has 11 labels, cube-v1 has 1728 faces"),
        ("a.txt", b"\xff\xfe\x00", "cannot be read"),
        ("a.csv", b"face,name\n0,roof\n", "has no column 'label'"),
        ("a.csv", b"face,label\n" + b"0,roof\n" * 1728, "does not name each of 0 to 1727 once"),
        ("a.csv", b"label\n" + b'"a b"\n' * 1728, "without spaces or commas"),
        ("a.npy", b"no array", "cannot be read"),
        ("a.npy", b"pickle", "cannot be read"),
        ("a.parquet", b"no table", "cannot be read"),
        ("a.ply", b"", "has the suffix '.ply'"),
    ],
    ids=["few", "bytes", "column", "faces", "words", "npy", "pickle", "parquet", "suffix"],
)
def test_labels_that_do_not_fit_are_told(catalog, tmp_path, capsys, name, content, message):
    if content == b"pickle":
        np.save(tmp_path / name, np.array([{"a": 1}] * 1728, dtype=object), allow_pickle=True)
    else:
        (tmp_path / name).write_bytes(content)
    file = tmp_path / "monthly.toml"
    file.write_text(f'labels = "{name}"\n[[zone]]\nzone = "roof"\nlabel = "roof"\n')
    where = ["--by", "Ada", "--catalog", catalog.location]
    assert main(["require", "cube-v1", str(file), *where]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert main(["require", "box", str(file), "--kind", *where]) == 2
    file.write_text('[[zone]]\nzone = "roof"\nlabel = "roof"\n')
    assert main(["require", "cube-v1", str(file), *where]) == 2
    assert "names no file of labels" in " ".join(capsys.readouterr().err.split())
    assert main(["zones", "cube-v1", "--mesh", str(tmp_path / "m.ply"), "--catalog", catalog.location]) == 0
    assert "1728 faces" in capsys.readouterr().out and (tmp_path / "m.ply").read_bytes()[:3] == b"ply"
