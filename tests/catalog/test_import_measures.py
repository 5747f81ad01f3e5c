"""What a dataset says of its plans is marked as its word, or computed again."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from random_members import random_member

from upplied import fleet
from upplied.catalog import export_dataset, open_catalog
from upplied.cli import main
from upplied.fleet import planner
from upplied.samples.fleet import member
from upplied.samples.pilot import fly


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Path:
    """A dataset of one plan, really planned."""
    place = tmp_path_factory.mktemp("measured")
    cube = member("cube-v1").structure
    catalog = open_catalog(place / "from")
    catalog.add_structures([cube, random_member("box", 1).structure])
    catalog.add_demonstrations([fly(cube, "sides")])
    (job,) = fleet.decide(catalog, fleet.PlanRequest(("baseline",))).jobs
    planner.prepare(catalog.location)
    outcome = planner.plan_job(job)
    assert outcome.plan.status == "ok", outcome.plan.reason
    catalog.add_plans([(job.key, outcome.plan, {"settings": job.settings})])
    export_dataset(catalog, place / "set", "boxes-v1", catalog.transfers(), "CC0-1.0")
    return place / "set"


def forged(dataset: Path, place: Path) -> Path:
    """The same with another clearance, sealed again."""
    shutil.copytree(dataset, place)
    path = place / "transfers.parquet"
    rows = pd.read_parquet(path)
    schema = pq.read_schema(path)
    rows["min_clearance_m"] += 3.0
    pq.write_table(pa.Table.from_pandas(rows, schema, preserve_index=False), path)
    about = json.loads((place / "dataset.json").read_text())
    about["files"]["transfers.parquet"] = hashlib.sha256(path.read_bytes()).hexdigest()
    (place / "dataset.json").write_text(json.dumps(about))
    return place


@pytest.mark.ci
def test_measures_of_a_dataset_are_marked_as_its_word(dataset, tmp_path):
    place = forged(dataset, tmp_path / "forged")
    assert main(["catalog", "import", str(place), "--catalog", str(tmp_path / "to")]) == 0
    (origin,) = open_catalog(tmp_path / "to").transfers()["imported_from"]
    assert origin == "boxes-v1, measures as it says"


@pytest.mark.ci
def test_forged_measures_are_told_when_they_are_computed_again(dataset, tmp_path, capsys):
    arguments = ["catalog", "import", "--verify", "--catalog", str(tmp_path / "to")]
    assert main([*arguments, str(forged(dataset, tmp_path / "forged"))]) == 2
    assert "min_clearance_m is stated as" in capsys.readouterr().err
    assert not (tmp_path / "to").exists()
    assert main([*arguments, str(dataset)]) == 0
    (origin,) = open_catalog(tmp_path / "to").transfers()["imported_from"]
    assert origin.startswith("boxes-v1, measures computed again")
    assert "clearance" not in origin and "coverage_seen" not in origin
