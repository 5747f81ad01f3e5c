"""Which structures are asked for the parts of a scan: few, the nearest, and only where there is a scan."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh
from catalog_records import plan
from made_structures import one_piece

from upplied import fleet, open_catalog
from upplied.catalog import Catalog, recipe
from upplied.fleet import ingest, planner
from upplied.fleet.decisions import SiblingsOf
from upplied.fleet.planner import read_shard, write_shards
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

RECOMMENDED = fleet.PlanRequest(("recommended",))


def table(**rows: tuple[str, bool | None, int, tuple[float, float, float]]) -> pd.DataFrame:
    """Structures as the catalog tells them: kind, whether pieces tell parts, triangles and size."""
    return pd.DataFrame(
        {
            "structure_id": list(rows),
            "kind": [row[0] for row in rows.values()],
            "sha256": [f"hash of {name}" for name in rows],
            "tells_parts": [row[1] for row in rows.values()],
            "n_triangles": [row[2] for row in rows.values()],
            **{f"size_{axis}_m": [row[3][at] for row in rows.values()] for at, axis in enumerate("xyz")},
        }
    )


FLEET = {
    "source": ("airliner", True, 9, (30.0, 30, 10)),
    "scan": ("airliner", False, 9, (60.0, 60, 20)),
    "like": ("airliner", True, 9, (31.0, 30, 10)),
    "longer": ("airliner", True, 9, (45.0, 30, 10)),
    "long": ("airliner", True, 9, (90.0, 30, 10)),
    "other-scan": ("airliner", False, 9, (60.0, 60, 20)),
    "boat": ("ship", True, 9, (60.0, 60, 20)),
}


def names(of: SiblingsOf, *arguments: str, most: int = 3) -> list[str]:
    return [name for name, _ in of(*arguments, most)]


def test_a_scan_has_the_nearest_of_its_kind_that_tell_parts() -> None:
    of = SiblingsOf(table(**FLEET))
    assert names(of, "source", "scan") == ["like", "long", "longer"]
    assert names(of, "source", "scan", most=2) == ["like", "longer"]
    assert names(of, "source", "scan", most=1) == ["like"] and names(of, "source", "scan", most=0) == []
    assert names(of, "like", "scan", most=2) == ["longer", "source"]  # never the source
    assert of("source", "scan", 1) == (("like", "hash of like"),)
    for name in ("like", "source", "boat"):
        assert names(of, "source", name) == []


def test_only_a_nearer_structure_changes_who_is_asked() -> None:
    before = SiblingsOf(table(**FLEET))("source", "scan", 2)
    far = SiblingsOf(table(**FLEET, farther=("airliner", True, 9, (300.0, 30, 10))))
    near = SiblingsOf(table(**FLEET, nearer=("airliner", True, 9, (15.0, 15, 5))))
    assert far("source", "scan", 2) == before
    assert names(near, "source", "scan", most=2) == ["like", "nearer"]
    again = SiblingsOf(table(**FLEET).iloc[::-1])
    assert again("source", "scan", 2) == before


def test_of_what_was_never_asked_a_cloud_is_a_scan_and_a_mesh_may_know() -> None:
    unasked = {name: (kind, None, n, size) for name, (kind, _, n, size) in FLEET.items()}
    of = SiblingsOf(table(**unasked, cloud=("airliner", None, 0, (60.0, 60, 20))))
    assert names(of, "source", "scan") == []
    assert names(of, "source", "cloud") == ["like", "other-scan", "scan"]


def airliners(location: Path, *more: str) -> Catalog:
    """A flight round an A320, a 747 that was scanned and others as modelled."""
    catalog = open_catalog(location)
    a320 = member("a320-v1").structure
    scan = one_piece(member("b747-v1").structure)
    catalog.add_structures(
        [
            replace(a320, tells_parts=True),
            replace(scan, sha256="scan", tells_parts=False),
            *(replace(member(name).structure, tells_parts=True) for name in more),
        ]
    )
    catalog.add_demonstrations([fly(a320, "engine_left", seed=2)])
    return catalog


def jobs_of(catalog: Catalog) -> dict[str, fleet.Job]:
    return {job.target_id: job for job in fleet.decide(catalog, RECOMMENDED).jobs}


@pytest.fixture
def prepared(monkeypatch):
    """A worker in this process."""

    def prepare(catalog: Catalog) -> None:
        monkeypatch.setattr(planner, "_catalog", open_catalog(catalog.location))
        planner._structure.cache_clear()
        planner._demonstration.cache_clear()

    yield prepare
    planner._structure.cache_clear()
    planner._demonstration.cache_clear()


def test_a_structure_more_is_asked_about_scans_alone(tmp_path) -> None:
    catalog = airliners(tmp_path / "catalog", "b777-v1")
    before = jobs_of(catalog)
    assert [name for name, _ in before["b747-v1-scan"].siblings] == ["b777-v1"]
    assert before["b777-v1"].siblings == ()
    catalog.add_structures([replace(member("beluga-v1").structure, tells_parts=True)])
    after = jobs_of(catalog)
    assert after["b777-v1"].key == before["b777-v1"].key
    assert after["b747-v1-scan"].key != before["b747-v1-scan"].key
    (shard,) = write_shards(catalog, "night", [tuple(after.values())])
    assert read_shard(str(catalog.location), shard) == list(after.values())
    off = fleet.PlanRequest(("recommended",), {"correspondence": {"siblings": 0}})
    assert all(job.siblings == () for job in fleet.decide(catalog, off).jobs)
    other = fleet.PlanRequest(("paper", "baseline"))
    assert all(job.siblings == () for job in fleet.decide(catalog, other).jobs)


def test_a_worker_gives_the_siblings_and_the_catalog_keeps_who_they_were(
    tmp_path, prepared, monkeypatch
) -> None:
    catalog = airliners(tmp_path / "catalog", "b777-v1", "beluga-v1")
    job = jobs_of(catalog)["b747-v1-scan"]
    prepared(catalog)
    siblings = []

    def planned(*arguments):
        siblings.extend(arguments[-1])
        return replace(plan("b747-v1-scan"), demonstration_id=job.demonstration_id,
                       source_id="a320-v1", parts_told_by="beluga-v1")  # fmt: skip

    monkeypatch.setattr(planner, "plan_transfer", planned)
    outcome = planner.plan_job(job)
    assert [one.structure_id for one in siblings] == ["b777-v1", "beluga-v1"]
    with fleet.Run(catalog, [job], "night") as run:
        run._keeper.add(outcome)
    (row,) = catalog.transfers().itertuples()
    assert row.parts_told_by == "beluga-v1" and row.key == job.key
    made_from = recipe(catalog, row.transfer_id)
    assert [(one.structure_id, one.sha256) for one in made_from.siblings] == list(job.siblings)
    assert fleet.decide(catalog, RECOMMENDED).unchanged == 1
    catalog.add_structures([replace(member("b777-v1").structure, sha256="changed", tells_parts=True)])
    assert jobs_of(catalog)["b747-v1-scan"].why == "siblings changed"
    planner._structure.cache_clear()
    assert planner.plan_job(job).plan.status == "superseded"


@pytest.mark.ci
def test_whether_pieces_tell_parts_is_found_out_when_a_structure_is_taken_in(tmp_path) -> None:
    for name, sample in (("model", "b777-v1"), ("scan", "cube-v1")):  # of many pieces, and of one
        structure = member(sample).structure
        trimesh.Trimesh(structure.vertices, structure.triangles, process=False).export(
            tmp_path / f"{name}.ply"
        )
    rows = "".join(
        f'[[structure]]\nid = "{name}"\nkind = "airliner"\npath = "{name}.ply"\nunits = "m"\n'
        'up = "+z"\nforward = "+x"\n' for name in ("model", "scan")
    )  # fmt: skip
    (tmp_path / "structures.toml").write_text(rows, encoding="utf-8")
    catalog = open_catalog(tmp_path / "catalog")
    items = ingest.ingest_structures(catalog, tmp_path / "structures.toml", workers=1)
    assert {one.status for one in items} == {"added"}, items
    tells_parts = catalog.structures().set_index("structure_id")["tells_parts"]
    assert tells_parts["model"] and not tells_parts["scan"]
    # Who adds the same again without having asked does not forget it.
    again = replace(catalog.structure("scan"), tells_parts=None)
    assert catalog.add_structures([again]) == 0
    assert catalog.structure("scan").tells_parts is False


@pytest.mark.slow
def test_a_plan_with_a_sibling_is_the_same_again_by_any_number_of_workers(tmp_path) -> None:
    hashes = []
    for workers in (1, 2):
        catalog = airliners(tmp_path / str(workers), "b777-v1")
        jobs = [job for job in fleet.decide(catalog, RECOMMENDED).jobs if job.siblings]
        fleet.transfer(catalog, jobs, "night", fleet.Resources(workers))
        (row,) = catalog.transfers().itertuples()
        hashes.append((row.key, row.status, row.waypoints_sha256, row.parts_told_by))
    assert hashes[0] == hashes[1]
    made_from = recipe(catalog, row.transfer_id)
    inputs = (made_from.demonstration, made_from.source, made_from.target, made_from.settings)
    assert made_from.differences(plan_transfer(*inputs, siblings=made_from.siblings)) == []
    assert np.isfinite(row.counterpart_probability)
