"""What lands: flights of plans, and demonstrations while a run is at work."""

from __future__ import annotations

import pytest
from flow_runs import python
from random_members import random_member

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

pytestmark = [pytest.mark.slow, pytest.mark.server, pytest.mark.filterwarnings("default")]


def test_a_flight_that_lands_is_judged_and_what_it_left_out_is_planned(server, place):
    process = python(
        server,
        place,
        """
from dataclasses import replace
from upplied.catalog import open_catalog
from upplied.outputs.logs import write_log
from upplied.flows.ingest import ingest_flights
from upplied.flows.transfer_fleet import transfer_fleet
from upplied.samples.fleet import member
from random_members import random_member
from upplied.samples.pilot import fly
from upplied.simulate import fly_trajectory
cube = member("cube-v1").structure
flown = open_catalog("flown")  # what is planned here is none of the other tests' business
flown.add_structures([cube, random_member("box", 1).structure])
flown.add_demonstrations([fly(cube, "sides", seed=1)])
transfer_fleet("flown", presets=["recommended"], targets=["box-random-1"], reports="")
catalog = open_catalog("flown")
plan = catalog.transfers(preset="recommended", status="ok").iloc[0]
path = fly_trajectory(catalog.trajectory(plan["transfer_id"]), seed=1)
part = path.t_s <= 0.6 * path.t_s[-1]
demonstration = catalog.demonstration(plan["demonstration_id"])
flown = replace(
    demonstration, demonstration_id="came-back", structure_id=plan["target_id"],
    t_ns=demonstration.t_ns[0] + (path.t_s[part] * 1e9).astype("int64"),
    positions=path.positions[part], quat_xyzw=path.quat_xyzw[part],
)
write_log("came-back.mcap", flown, catalog.structure(plan["target_id"]), heavy_topic=False)
open("broken.mcap", "wb").write(b"nothing")
print(ingest_flights(["came-back.mcap", "broken.mcap"], "flown", "pages", return_state=True).name)
print(ingest_flights(["came-back.mcap"], "flown", "pages", return_state=True).name)
print(len(catalog.flights(kind="flown")))
every = catalog.transfers(every=True)
print(every["purpose"].str.startswith("gap ").sum())
""",
    )
    assert process.returncode == 0, process.stderr
    assert process.stdout.splitlines() == ["CompletedWithFailures", "Completed", "1", "1"]


def test_what_lands_while_a_run_plans_is_planned_by_it(server, tmp_path):
    """A run that is started meanwhile is cancelled, and nothing starts another before the next night."""
    catalog, cube = open_catalog(tmp_path / "catalog"), member("cube-v1").structure
    catalog.add_structures([cube, random_member("box", 1).structure])
    catalog.add_demonstrations([fly(cube, "sides")])
    code = """
import importlib
from dataclasses import replace
from upplied.catalog import open_catalog
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
night = importlib.import_module("upplied.flows.transfer_fleet")
landing, flight, plan = ["first", "second"], fly(member("cube-v1").structure, "sides"), night.plan
def while_planning(catalog, *given):
    made = plan(catalog, *given)
    for name in landing[:1]:
        landing.remove(name)
        open_catalog(catalog).add_demonstrations([replace(flight, demonstration_id=name, sha256="")])
    return made
night.plan = while_planning
print(night.transfer_fleet(presets=["baseline"], reports="", return_state=True).message)
"""
    process = python(server, tmp_path, code)
    assert process.stdout == "3 ok, 0 refused, 0 failed, 0 unchanged\n", process.stdout + process.stderr
    assert fleet.decide(catalog, fleet.PlanRequest(("baseline",))).jobs == []
    assert catalog.transfers(every=True)["run_id"].nunique() == 1
