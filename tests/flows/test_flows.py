"""The flows against a server of their own: what they do, what they refuse, what they leave to read."""

from __future__ import annotations

import json
import time
from pathlib import Path

import prefect_api
import pytest
from flow_runs import listed, python

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.fleet import planner
from upplied.flows.environment import ROOTS

pytestmark = [pytest.mark.slow, pytest.mark.server, pytest.mark.filterwarnings("default")]


@pytest.mark.ci
def test_the_whole_way_by_flows(server, place):
    process = python(
        server,
        place,
        """
from upplied.flows.ingest import ingest_demonstrations
from upplied.flows.transfer_fleet import transfer_fleet
print(ingest_demonstrations(["flight.mcap"], return_state=True).message)
print(transfer_fleet(presets=["paper"], targets=["box-random-1"], return_state=True).message)
print(transfer_fleet(presets=["paper"], reports="", return_state=True).message)
print(transfer_fleet(presets=["paper"], reports="", campaigns=["gone"], return_state=True).message)
""",
    )
    assert process.returncode == 0, process.stderr
    *lines, last = process.stdout.splitlines()
    assert last.startswith("0 ok, 0 refused, 0 failed, 2 unchanged") and "campaign gone: finding gone" in last
    assert lines == [
        "1 added",
        "1 ok, 0 refused, 0 failed, 0 unchanged",
        "1 ok, 0 refused, 0 failed, 1 unchanged",
    ]
    assert (place / "reports" / "transfers.parquet").is_dir()
    assert (place / "reports" / "index.html").is_file()
    assert set(open_catalog(place / "catalog").transfers()["planned_on"].str[-6:]) == {"/local"}


CAMPAIGN = """
from upplied.catalog import open_catalog
from upplied.findings.adding import add_marks
from upplied.findings.marks import Mark
from upplied.flows.ingest import ingest_demonstrations
from upplied.flows.transfer_fleet import transfer_fleet
ingest_demonstrations(["flight.mcap"], return_state=True)
cube = open_catalog("catalog").structure("cube-v1").vertices
place = (float(cube[:, 0].max()), float(cube[:, 1].mean()), float(cube[:, 2].mean()))
(name,) = add_marks(open_catalog("catalog"), [Mark("it", structure="cube-v1", place=place)], "Ada").ids
night = {"presets": ["recommended"], "targets": ["box-random-1"], "reports": "", "campaigns": [name]}
for mm_px in (8.0, 8.0, 0.01, 0.01):
    print(transfer_fleet(**night, campaign_mm_px=mm_px, return_state=True).message)
"""


@pytest.mark.ci
def test_maintenance_checks_the_catalog_and_says_what_is_wrong_with_it(server, place):
    code = """
from upplied.flows.upkeep import maintain_catalog
state = maintain_catalog(catalog="catalog", return_state=True)
print(state.type.value, state.message)
"""
    process = python(server, place, code)
    assert process.returncode == 0, process.stderr
    assert process.stdout.startswith("COMPLETED") and "0 findings" in process.stdout
    mesh = sorted((place / "catalog" / "meshes").glob("*.parquet"))[0]
    whole = mesh.read_bytes()
    try:
        mesh.write_bytes(whole[: len(whole) // 2])
        process = python(server, place, code)
        assert process.stdout.startswith("FAILED") and "1 findings" in process.stdout
    finally:
        mesh.write_bytes(whole)


@pytest.mark.ci
def test_runs_say_what_they_do_and_leave_something_to_read(server, place):
    names = {run["name"] for run in listed(server, "flow_runs")}
    assert {"demonstrations of flight.mcap", "every demonstration to box-random-1"} <= names
    left = {item["key"]: item for item in listed(server, "artifacts/latest")}
    assert {key: left[key]["type"] for key in left if key and key.startswith("transfer-fleet")} == {
        "transfer-fleet": "markdown",
        "transfer-fleet-result": "table",
        "transfer-fleet-report": "markdown",
        "transfer-fleet-progress": "progress",
    }
    assert left["transfer-fleet-progress"]["data"] == 100.0
    assert "2 unchanged" in left["transfer-fleet"]["data"]
    assert (place / "reports" / "index.html").as_uri() in left["transfer-fleet-report"]["data"]


@pytest.mark.ci
def test_assets_say_what_was_made_of_what(server, place):
    query = {"filter": {"event": {"prefix": ["prefect.asset."]}}, "limit": 50}
    here, deadline = place.resolve().as_uri(), time.monotonic() + 600
    origins: dict[str, set[str]] = {}
    while len(origins) < 3 and time.monotonic() < deadline:
        for event in prefect_api.ask(server.api_url, "events/filter", query, server.password)["events"]:
            if event["event"] == "prefect.asset.materialization.succeeded":
                key = event["resource"]["prefect.resource.id"]
                if not key.startswith(here):
                    continue
                related = [item for item in event["related"] if item["prefect.resource.role"] == "asset"]
                origins.setdefault(key, set()).update(item["prefect.resource.id"] for item in related)
        time.sleep(0.5)
    assert origins == {
        f"{here}/catalog/demonstrations": {f"{here}/flight.mcap"},
        f"{here}/catalog/transfers": {f"{here}/catalog/structures", f"{here}/catalog/demonstrations"},
        f"{here}/reports": {f"{here}/catalog/transfers"},
    }


@pytest.mark.ci
def test_a_store_that_was_away_is_asked_again_and_a_wrong_input_is_not(server, place):
    process = python(
        server,
        place,
        """
from prefect import task
from upplied.errors import CatalogError, InputError
from upplied.flows import tasks
tried = []
@task(**{**tasks.STORED, "retry_delay_seconds": 0})
def attempt(error, times):
    tried.append(error)
    if tried.count(error) <= times:
        raise {"store": CatalogError("transfers", "is away"), "input": InputError("log", "is broken")}[error]
    return "done"
print(attempt("store", 2))
for error in ("store", "input"):
    print(attempt(error, 99, return_state=True).type.value)
print(tried.count("input"))
""",
    )
    assert process.stdout.split() == ["done", "FAILED", "FAILED", "1"], process.stdout + process.stderr


@pytest.mark.ci
def test_a_plan_is_followed_from_its_log_to_its_page(server, place):
    tables = [item for item in listed(server, "artifacts") if item["key"] == "transfer-fleet-result"]
    rows = [row for item in tables for row in json.loads(item["data"])]
    (row,) = [row for row in rows if place.resolve().as_uri() in row.get("page", "")]
    catalog = open_catalog(place / "catalog")
    (flown,) = catalog.demonstrations().to_dict("records")
    assert (row["log (sha256)"], row["demonstration"]) == (flown["sha256"], flown["demonstration_id"])
    assert len(catalog.waypoints(row["trajectory"])) > 0  # of a plan for comparison, which is not to be flown
    assert row["status"] == "ok"
    page = (place / "reports" / "transfers" / f"{row['demonstration']}--box-random-1.html").resolve()
    assert row["page"].endswith(f"({page.as_uri()})")
    assert page.is_file()


@pytest.mark.slow
def test_a_shard_plans_what_it_is_named_and_nothing_twice(server, place):
    """What a machine of the work pool does; two machines do it in test_machines.py."""
    changes = {"viewpoints": {"shared": 0.5}}
    catalog = open_catalog(place / "catalog")
    jobs = fleet.decide(catalog, fleet.PlanRequest(("paper",), changes)).jobs
    assert len(jobs) == 2
    (shard,) = planner.write_shards(catalog, "night", [(jobs[0],)])
    assert planner.read_shard(str(catalog.location), shard) == [jobs[0]]
    code = f"""
from upplied.flows.engines import plan_shard
from upplied.flows.transfer_fleet import transfer_fleet
for _ in range(2):
    print(plan_shard("catalog", "night", "{shard}", return_state=True).message)
for name in ("night/00001.parquet", "../transfers/x.parquet"):
    print(plan_shard("catalog", "night", name, return_state=True).type.value)
asked = {{"presets": ["paper"], "changes": {changes}}}
print(transfer_fleet(reports="", resources={{"engine": "pool"}}, **asked, return_state=True).message)
"""
    process = python(server, place, code)
    lines = process.stdout.splitlines()
    assert lines[:4] == ["1 ok, 0 refused, 0 failed", "0 ok, 0 refused, 0 failed", "FAILED", "FAILED"], (
        process.stderr
    )
    assert "prefect worker start --pool planners" in lines[4], "nobody takes shards, and it was not told"
    planner.remove_shards(catalog, "night")
    assert not list(catalog.shards.names())
    rows = catalog.transfers(every=True)
    assert rows[rows["run_id"] == "night"]["key"].tolist() == [jobs[0].key]
    result, missing = fleet.known_outcomes(catalog, jobs)
    assert (result.ok, missing) == (1, jobs[1:])


@pytest.mark.ci
def test_prefect_keeps_no_results(server, place):
    home = Path(server.environment["PREFECT_HOME"])
    assert not [path for path in home.rglob("storage/*") if path.is_file()]


WRONG = (
    "presets=['best']",
    "presets=[]",
    "changes={'route': {'clearance': 3}}",
    "targets=['../../etc']",
    "resources={'workers': -1}",
    "campaign_mm_px=0",
)


@pytest.mark.ci
def test_wrong_parameters_are_refused_before_anything_runs(server, place):
    calls = "\n".join(f"attempt(lambda: transfer_fleet({wrong}))" for wrong in WRONG)
    code = f"""
from prefect.exceptions import ParameterTypeError
from upplied.flows.transfer_fleet import transfer_fleet
def attempt(call):
    try:
        call()
    except ParameterTypeError as error:
        print("refused:", str(error).splitlines()[1])
{calls}
"""
    process = python(server, place, code)
    lines = [line for line in process.stdout.splitlines() if line.startswith("refused:")]
    assert len(lines) == len(WRONG), process.stdout + process.stderr


@pytest.mark.slow
def test_failed_runs_say_so_and_name_what_failed(server, place):
    """A state of a type or a name of its own is what an alert can match."""
    (place / "broken").mkdir()
    (place / "broken" / "broken.mcap").write_bytes(b"not a log")
    (place / "mixed").mkdir()
    for name, source in {"broken": place / "broken" / "broken.mcap", "flight": place / "flight.mcap"}.items():
        (place / "mixed" / f"{name}.mcap").write_bytes(source.read_bytes())
    process = python(
        server,
        place,
        """
from upplied.flows.ingest import ingest_demonstrations
from upplied.flows.transfer_fleet import transfer_fleet
def say(state):
    print(state.type.value, state.name, "|", state.message)
say(ingest_demonstrations(["broken"], return_state=True))
say(ingest_demonstrations(["mixed"], return_state=True))
say(ingest_demonstrations(["nowhere"], return_state=True))
hasty = {"timeout_s": 0.001, "workers": 1}
asked = {"reports": "", "presets": ["paper"], "changes": {"viewpoints": {"shared": 0.6}}}
say(transfer_fleet(**asked, resources=hasty, return_state=True))
say(transfer_fleet(**asked, logs=["mixed"], retry_failed=True, return_state=True))
open("wrong.toml", "w").write("[[structures]]")
say(transfer_fleet("not-yet", manifest="wrong.toml", return_state=True))
""",
    )
    lines = [line.split(" | ") for line in process.stdout.splitlines()]
    assert [state for state, _ in lines] == [
        "FAILED Failed",
        "COMPLETED CompletedWithFailures",
        "FAILED Failed",
        "FAILED Failed",
        "COMPLETED CompletedWithFailures",
        "FAILED Failed",
    ], process.stdout + process.stderr
    for (_, message), words in zip(
        lines,
        ("broken.mcap", "broken.mcap", "does not exist", "longer than 0.001 s", "broken.mcap", "wrong.toml"),
        strict=True,
    ):
        assert words in message
    assert "2 ok" in lines[4][1], "what could be planned was not"


@pytest.mark.slow
def test_runs_keep_to_the_declared_roots(server, place, tmp_path):
    code = f"""
import os
from unittest.mock import patch
from upplied.flows.upkeep import maintain_catalog, publish_reports
with patch.dict(os.environ, {{"{ROOTS}": "{place},s3://bucket/fleet"}}):
    for call in CALLS:
        state = eval(call)
        print(state.type.value, state.message)
"""
    calls = [
        f"publish_reports('{tmp_path}/elsewhere', return_state=True)",
        f"publish_reports('reports', '{tmp_path}/catalog', return_state=True)",
        "publish_reports('s3://bucket/other', return_state=True)",
        "maintain_catalog('../../catalog', return_state=True)",
        "publish_reports('link', return_state=True)",
        "publish_reports('reports', return_state=True)",
    ]
    (place / "link").symlink_to(tmp_path)
    process = python(server, place, code.replace("CALLS", repr(calls)))
    lines = process.stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["FAILED"] * 5 + ["COMPLETED"], (
        process.stdout + process.stderr
    )
    assert all("outside the roots" in line and "--root" in line for line in lines[:5])
    assert not list(tmp_path.iterdir())


def test_a_campaign_is_planned_with_the_fleet_once_and_refused_once(server, place):
    process = python(server, place, CAMPAIGN)
    assert process.returncode == 0, process.stderr
    first, again, refused, last = process.stdout.splitlines()
    assert first.startswith("2 ok, 0 refused, 0 failed") and again.startswith("0 ok, 0 refused, 0 failed")
    assert refused.startswith("0 ok, 1 refused, 0 failed") and last.startswith("0 ok, 0 refused, 0 failed")
    assert all("box-random-2: has neither plan nor" in text for text in (first, again, refused, last))
    plans = open_catalog(place / "catalog").transfers(structure="box-random-1", every=True)
    ours = plans[plans["purpose"].str.startswith("campaign ")]
    assert sorted(ours["status"]) == ["ok", "refused"] and set(ours["planned_on"].str[-6:]) == {"/local"}
