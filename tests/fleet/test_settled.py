"""There is one answer to the question what is done, and everybody who asks gets it."""

from __future__ import annotations

from collections.abc import Iterable

import pyarrow as pa
import pytest
from catalog_records import demonstration, plan, structure

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.catalog.database import Catalog
from upplied.catalog.verbs import ordering
from upplied.config import settings_for
from upplied.fleet import run
from upplied.fleet.decisions import Job
from upplied.fleet.planner import Outcome

A = fleet.PlanRequest(("baseline",))
B = fleet.PlanRequest(("baseline",), {"viewpoints": {"shared": 0.4}})


@pytest.fixture
def catalog(tmp_path) -> Catalog:
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([structure("boxy"), *(structure(f"t{at}", at) for at in range(3))])
    catalog.add_demonstrations([demonstration()])
    return catalog


@pytest.fixture
def planned(monkeypatch) -> list[Job]:
    """Jobs that were really planned; a planner that needs no time stands for the method."""
    seen: list[Job] = []

    def one(workers: object, job: Job, _: object) -> Outcome:
        seen.append(job)
        status = "failed" if job.target_id in failing else "ok"
        return Outcome(job, plan(job.target_id, len(seen), status=status, preset="baseline"), 0.1)

    monkeypatch.setattr(run, "attempt", one)
    failing.clear()
    return seen


failing: set[str] = set()


def night(catalog: Catalog, plan_request: fleet.PlanRequest, run_id: str) -> fleet.Result:
    """A run whose shards are planned elsewhere, and one of them twice."""
    jobs = fleet.decide(catalog, plan_request).jobs
    fleet.plan_here(str(catalog.location), jobs, run_id, "dask")
    fleet.plan_here(str(catalog.location), jobs[:1], run_id, "dask")
    result, missing = fleet.known_outcomes(catalog, jobs, run_id)
    assert missing == []
    return result


def current(catalog: Catalog) -> set[str]:
    return set(catalog.transfers()["settings_sha256"])


@pytest.mark.ci
def test_earlier_settings_become_current_again(catalog, planned):
    for number, plan_request in enumerate((A, B, A, B, B, A)):
        result = night(catalog, plan_request, f"run-{number}")
        settings = settings_for(*plan_request.presets, **plan_request.changes)
        assert current(catalog) == {settings.sha256}
        assert (result.ok, result.failed) == ((3, 0) if number != 4 else (0, 0))
        assert fleet.decide(catalog, plan_request).jobs == []
    assert len(planned) == 5 * 3  # a shard that is started twice is planned once


def test_an_old_failure_is_not_the_result_of_a_later_run(catalog, planned):
    failing.add("t1")
    assert night(catalog, A, "first").failed == 1
    assert fleet.decide(catalog, A).jobs == []
    again = fleet.PlanRequest(A.presets, retry_failed=True)
    jobs = fleet.decide(catalog, again).jobs
    assert [job.target_id for job in jobs] == ["t1"]
    assert fleet.known_outcomes(catalog, jobs, "second") == (fleet.Result(), jobs)  # its machine was lost
    assert night(catalog, again, "second").failed == 1
    assert len(planned) == 4
    rows = catalog.transfers(structure="t1", every=True)
    assert list(rows["run_id"]) == ["second"]
    failing.clear()
    assert night(catalog, again, "third").ok == 1


@pytest.mark.parametrize("few", [0, 10_000])
def test_everybody_asks_the_same(catalog, planned, monkeypatch, few):
    monkeypatch.setattr(ordering, "_FEW_KEYS", few)
    night(catalog, A, "first")
    failing.add("t2")
    night(catalog, B, "second")
    for plan_request in (A, B):
        keys = [job.key for job in every(catalog, plan_request)]
        for retry in (False, True):
            request = fleet.PlanRequest(plan_request.presets, plan_request.changes, retry_failed=retry)
            settled = set(catalog.settled(keys, retry_failed=retry))
            assert {job.key for job in fleet.decide(catalog, request).jobs} == set(keys) - settled
            assert len(settled) == (0 if plan_request is A else 3 - retry)
            open_ones = catalog.unsettled(pa.array(keys), retry_failed=retry)
            assert {key for key, is_open in zip(keys, open_ones, strict=True) if not is_open} == settled
            if retry:
                assert set(catalog.settled(keys, retry_failed=True)) == settled
    assert catalog.settled([]) == {}


def every(catalog: Catalog, plan_request: fleet.PlanRequest) -> Iterable[Job]:
    """What would be planned from nothing."""
    empty = open_catalog(str(catalog.location) + "-empty")
    empty.add_structures([structure("boxy"), *(structure(f"t{at}", at) for at in range(3))])
    empty.add_demonstrations([demonstration()])
    return fleet.decide(empty, plan_request).jobs
