"""`pip install upplied` without the extra that plans: what it is for works, and the rest names the extra."""

from __future__ import annotations

import json
import os
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import trimesh
from cases import slow_after
from flow_runs import Session
from random_members import random_member

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.outputs.logs import write_log
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

# A child where what the extra brings cannot be imported.
SLIM = """
import sys
ABSENT = {"open3d", "libusb_package", "dash", "flask"}
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ABSENT:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
"""
# A command in it; then what it loaded, with those before it.
COMMAND = """
import json, sys
from upplied.cli import main
code = main({words})
print(json.dumps(sorted({{name.split(".")[0] for name in sys.modules}})), file=sys.stderr)
sys.exit(code)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> tuple[Path, str]:
    """A folder with a catalog, a log and a mesh; and the name of a plan."""
    place = tmp_path_factory.mktemp("slim")
    cube = member("cube-v1").structure
    catalog = open_catalog(place / "catalog")
    catalog.add_structures([cube, random_member("box", 1).structure])
    catalog.add_demonstrations([fly(cube, "sides")])
    jobs = fleet.decide(catalog, fleet.PlanRequest(("recommended",))).jobs
    assert fleet.transfer(catalog, jobs, "run", fleet.Resources(1)).ok == 1
    write_log(place / "flight.mcap", fly(cube, "sides"), cube)
    trimesh.Trimesh(cube.vertices, cube.triangles).export(place / "cube.stl")
    (place / "structures.toml").write_text(
        '[[structure]]\nid = "other"\nkind = "box"\npath = "cube.stl"\nunits = "m"\nup = "z"\nforward = "x"\n'
    )
    return place, catalog.transfers()["transfer_id"].iloc[0]


@pytest.fixture(scope="module")
def slim(place) -> Iterator[Callable[[str], subprocess.CompletedProcess[str]]]:
    """Runs a command in the folder, all of them in one process without what the extra brings."""
    folder, plan = place
    session = Session(dict(os.environ), folder)
    assert session.run(SLIM).returncode == 0
    yield lambda words: session.run(COMMAND.format(words=words.replace("PLAN", plan).split()))
    session.close()


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("catalog transfers --json", "box-random-1"),
        ("catalog history", "transfers"),
        ("catalog verify", "no findings"),
        ("plan --dry-run --preset paper", "new pair"),
        ("demonstrations add flight.mcap --workers 1", "1 "),
        ("demonstrations list", "cube-sides-v1"),
        ("structures list", "box-random-1"),
        ("catalog export set-v1 --licence CC0-1.0", "1 transfers"),
        ("catalog import set-v1 --catalog other", "added rows"),
        ("catalog export lerobot --format lerobot", "frames"),
        ("catalog export tum --format tum", "1 plans"),
        ("release PLAN --by Ada", "in force"),
        ("in-force", "Ada"),
    ],
)
def test_reading_asking_deciding_and_giving_away_need_no_ray_caster(slim, words, what):
    child = slim(words)
    assert child.returncode == 0, child.stdout + child.stderr
    assert what in child.stdout + child.stderr
    assert not {"open3d", "prefect"} & set(json.loads(child.stderr.splitlines()[-1]))


@pytest.mark.ci
@pytest.mark.parametrize(
    "words",
    slow_after(
        3,
        [
            "transfer cube-sides-v1 --preset paper",
            "transfer --reproduce PLAN",
            "structures add structures.toml --workers 1",
            "structures check structures.toml --workers 1",
            "export PLAN --draft --to mcap -o plan.mcap",
            "render transfer PLAN -o box.png",
            "fly PLAN",
            "samples write more",
        ],
    ),
)
def test_what_casts_rays_names_the_extra_in_a_line(slim, place, words):
    before = sorted(open_catalog(place[0] / "catalog").structures()["structure_id"])
    child = slim(words)
    assert child.returncode == 2, child.stdout + child.stderr
    messages = [line for line in child.stderr.splitlines() if line.startswith("error: ")]
    assert len(messages) == 1 and messages[0].endswith('Install it: pip install "upplied[plan]"'), (
        child.stderr
    )
    assert re.search("package (open3d|libusb_package): is not installed", messages[0])
    assert "Traceback" not in child.stderr
    assert sorted(open_catalog(place[0] / "catalog").structures()["structure_id"]) == before


def test_doctor_says_that_a_slim_install_plans_nothing(slim):
    child = slim("doctor --json")
    rows = {row["check"]: row for row in json.loads(child.stdout)}
    assert rows["Open3D"]["result"] == "bad" and 'pip install "upplied[plan]"' in rows["Open3D"]["details"]
    assert {rows[name]["result"] for name in ("Python", "numba", "catalog")} == {"good"}
