"""Zones that must be seen: met, missed or unattainable, as planned and as flown, each with its reason."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

from upplied.catalog import open_catalog
from upplied.catalog.database import Catalog
from upplied.catalog.verbs.looks import put_looks
from upplied.cli import main
from upplied.config import CloudSettings
from upplied.errors import CatalogError, SettingsError
from upplied.outputs.publish import publish_pages
from upplied.outputs.zones import zones
from upplied.planning.surface.samples import surface_samples
from upplied.poses import interpolate
from upplied.proof.as_flown import looks_of
from upplied.proof.zones import Demand, Looked, judged
from upplied.records import Camera, Plan, Surroundings, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
from upplied.scene import scene_of

N = 10
ALL, NONE = np.ones(N, bool), np.zeros(N, bool)
CAMERA = Camera(90.0, 60.0, 1.0, 40.0, 2000, 1500)  # 1 mm a pixel at 1 m


def look(distance=3.0, incidence=20.0, age=0.0, seen=ALL, camera=CAMERA, pictures=None) -> Looked:
    return Looked(np.where(seen, distance, np.nan), np.where(seen, incidence, np.nan), age, camera, pictures)


@pytest.mark.parametrize(
    ("demand", "looks", "status", "why"),
    [
        ({}, [look()], "met", ""),
        ({}, [], "missed", "100.0 % was not seen"),
        ({}, [look(seen=np.arange(N) < 6)], "missed", "40.0 % was not seen"),
        ({}, [look(seen=np.arange(N) < 6), look(seen=np.arange(N) >= 6)], "met", ""),
        ({"gsd_mm": 2.0}, [look(3.0)], "missed", "100.0 % was seen from too far for 2 mm a pixel"),
        ({"gsd_mm": 3.5}, [look(3.0)], "met", ""),
        ({"gsd_mm": 3.5}, [look(camera=Camera())], "missed", "pixels are not known"),
        ({"incidence_deg": 10.0}, [look()], "missed", "more obliquely than 10 deg"),
        ({"max_age_days": 30.0}, [look(age=31.0)], "missed", "longer ago than 30 days"),
        ({"max_age_days": 30.0}, [look(age=31.0), look(age=2.0)], "met", ""),
        ({"looks": 2}, [look()], "missed", "100.0 % was seen in fewer than 2 pictures"),
        ({"looks": 2}, [look(), look()], "met", ""),
        ({"looks": 3}, [look(pictures=np.arange(N) // 5 * 3)], "missed", "50.0 % was seen in fewer than 3"),
        ({"looks": 3}, [look(pictures=ALL * 2), look(incidence=80.0)], "met", ""),
        ({"looks": 2, "max_age_days": 30.0}, [look(age=31.0), look()], "missed", "fewer than 2 pictures"),
        # near but oblique on one day, frontal but far on another: no look keeps both
        ({"gsd_mm": 3.5, "incidence_deg": 30.0}, [look(3.0, 50.0), look(9.0, 5.0)], "missed", "obliquely"),
    ],
)
def test_a_zone_is_met_where_every_patch_has_one_look_that_keeps_every_demand(demand, looks, status, why):
    found = judged(Demand("seam", "part_0", **demand), ALL, ALL, looks)
    assert found.status == status and why in found.why
    assert (found.shown_pct == 100) == (status == "met")


def test_what_no_safe_camera_can_see_does_not_count_and_is_told():
    half = np.arange(N) < 5
    found = judged(Demand("seam", "part_0"), ALL, half, [look(seen=half)])
    assert found.status == "met" and "50.0 % of it no safe camera can see" in found.why
    assert judged(Demand("seam", "part_0"), ALL, NONE, [look()]).status == "unattainable"


@pytest.fixture
def catalog(tmp_path) -> Catalog:
    """A cube on the ground whose sides were planned; its underside is unattainable, its top was not asked."""
    cube = replace(member("cube-v1").structure, surroundings=Surroundings(ground_z_m=0.0))
    flown = fly(cube, "sides", seed=1)
    path = interpolate(flown.trajectory, np.arange(0.0, flown.trajectory.t_s[-1], 0.5))
    plan = Plan(flown.demonstration_id, "cube-v1", "cube-v1", cube.kind, "recommended", "ok",
                trajectory=path, is_viewpoint=np.arange(len(path)) % 4 == 0, flyable=True)  # fmt: skip
    made = open_catalog(tmp_path / "catalog")
    made.add_structures([cube])
    made.add_demonstrations([flown])
    made.add_plans([(hashlib.sha256(b"plan").hexdigest(), plan, {})])
    return made


@pytest.mark.ci
def test_zones_are_judged_as_planned_and_as_flown(catalog, tmp_path, capsys):
    cube = catalog.structure("cube-v1")
    low, high = cube.vertices.min(axis=0), cube.vertices.max(axis=0)
    middle = (low + high) / 2
    corners = np.array([[high[0] - 0.01, *(middle - 2)[1:]], [high[0] + 0.01, *(middle + 2)[1:]]])
    corners[:, 2] = middle[2] + np.array([-1, 1])
    side = "box " + " ".join(map(str, corners.ravel()))
    roof = f"box {low[0]} {low[1]} {high[2] - 0.01} {high[0]} {high[1]} {high[2] + 0.01}"
    asked = tmp_path / "monthly.toml"
    asked.write_text(
        f'name = "monthly"\n[[zone]]\nzone = "side"\nwhere = "{side}"\nincidence_deg = 60\n'
        f'[[zone]]\nzone = "roof"\nwhere = "{roof}"\n'
    )
    where = ["--catalog", catalog.location]
    assert main(["require", cube.kind, str(asked), "--kind", "--by", "Ada", *where]) == 0
    capsys.readouterr()
    assert main(["zones", "cube-v1", "--json", *where]) == 1
    rows = {row["zone"]: row for row in json.loads(capsys.readouterr().out)}
    assert (rows["side"]["planned"], rows["side"]["flown"]) == ("met", "missed")
    assert rows["roof"]["planned"] == "missed" and "was not seen" in rows["roof"]["planned_why"]
    assert rows["side"]["asked_by"] == f"kind {cube.kind}" and rows["side"]["version"] == 1
    # a flight that saw the side closes it
    (plan,) = catalog.transfers()["transfer_id"]
    scene = scene_of(cube)
    surface = surface_samples(cube, scene, CloudSettings())
    path = catalog.trajectory(plan)
    seen = looks_of(Trajectory(path.t_s, path.positions, path.quat_xyzw), surface, catalog.demonstration(
        catalog.transfers()["demonstration_id"].iloc[0]).camera, scene)  # fmt: skip
    values = {name: getattr(seen, name) for name in ("distance_m", "incidence_deg", "speed_mps", "t_s")}
    row = catalog.transfer(plan)
    catalog.add_flight(
        {"flight_id": "f1", "transfer_id": plan, "kind": "flown", "target_id": "cube-v1",
         "demonstration_id": row["demonstration_id"], "flown_at": catalog.clock.now(),
         "looks_sha256": put_looks(catalog, surface.points, surface.normals, seen.seen, values)}, path,
    )  # fmt: skip
    main(["zones", "cube-v1", "--json", *where])
    assert {r["zone"]: r["flown"] for r in json.loads(capsys.readouterr().out)}["side"] == "met"
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


def test_a_zone_of_one_structure_is_asked_of_all_of_its_kind(catalog):
    cube = catalog.structure("cube-v1")
    cuboid = member("cuboid-v1").structure
    catalog.add_structures([cuboid])
    low, high = cube.vertices.min(axis=0), cube.vertices.max(axis=0)
    side = f"box {high[0] - 0.01} {low[1]} {low[2]} {high[0] + 0.01} {high[1]} {high[2]}"
    asked = {"zone": "side", "where": side, "on": "cube-v1"}
    catalog.require("kind", cube.kind, "monthly", [asked], "Ada")
    (own,), (other,) = zones(catalog, "cube-v1"), zones(catalog, "cuboid-v1")
    assert own["on"] == "" and "carried" not in own["planned_why"]
    assert other["on"] == "cube-v1" and "carried from cube-v1" in other["planned_why"]
    assert other["planned"] == "missed" and "was not seen" in other["planned_why"]  # nothing is planned there
    with pytest.raises(SettingsError, match="a structure of kind"):
        catalog.require("kind", cube.kind, "monthly", [{**asked, "on": "nobody"}], "Ada")
    with pytest.raises(SettingsError, match="the id of a structure"):
        catalog.require("kind", cube.kind, "monthly", [{**asked, "on": 3}], "Ada")


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
