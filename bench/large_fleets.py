"""The fleets of bench/large.py: structures, demonstrations, and a plan of every pair, generated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import scale

from upplied import fleet
from upplied.catalog import Catalog
from upplied.catalog.schema import plan_rows, rows
from upplied.catalog.schema.tables import TABLES
from upplied.config import settings_for
from upplied.records import Demonstration, Measures, Plan, Trajectory

STEPS = 20  # waypoints of a generated plan
AT_ONCE = 10_000  # pairs of a commit of the generated catalog


def generate(catalog: Catalog, targets: str, demonstrations: str) -> str:
    """A catalog with a plan of every pair, as the stand-in would make them, but of one path."""
    stage(catalog, targets, demonstrations)
    request = fleet.PlanRequest(("baseline",), scale.CHANGES)
    settings = settings_for("baseline", **scale.CHANGES)
    jobs = fleet.decide(catalog, request).jobs
    flight = catalog.demonstration(jobs[0].demonstration_id)
    some = np.linspace(0, len(flight.positions) - 1, STEPS).astype(int)
    path = Trajectory(np.arange(STEPS) * 1.0, flight.positions[some], flight.quat_xyzw[some])
    for at in range(0, len(jobs), AT_ONCE):
        part = jobs[at : at + AT_ONCE]
        names = pa.array([plan_rows.transfer_id(job.key) for job in part])
        plan = Plan(
            "d", part[0].source_id, "t", part[0].kind, "baseline", "ok", trajectory=path,
            is_viewpoint=np.ones(STEPS, bool), measures=Measures(min_clearance_m=2.0),
        )  # fmt: skip
        one = plan_rows.waypoint_table({"x": plan})
        steps = one.take(pa.array(np.tile(np.arange(STEPS), len(part))))
        steps = put(steps, "transfer_id", names.take(pa.array(np.repeat(np.arange(len(part)), STEPS))))
        commit = catalog.tables["waypoints"].keep(steps, catalog.clock.now())
        recorded = {"settings": settings, "run_id": "generated", "planned_on": "here/1/pool"}
        row = {**plan_rows.transfer_row(part[0].key, plan, recorded), "commit_id": commit}
        table = rows.table_of(TABLES["transfers"], [row]).take(pa.array(np.zeros(len(part), int)))
        values = {
            "transfer_id": names,
            "key": pa.array([job.key for job in part]),
            "demonstration_id": pa.array([job.demonstration_id for job in part]),
            "target_id": pa.array([job.target_id for job in part]),
            **{
                f"{name}_sha256": pa.array([job.sha256[place] for job in part])
                for place, name in enumerate(("demonstration", "source", "target"))
            },
        }
        for name, column in values.items():
            table = put(table, name, column)
        catalog.tables["transfers"].append(table)
    return f"{len(jobs)} plans"


def put(table: pa.Table, name: str, column: pa.Array) -> pa.Table:
    """A table with another column of that name."""
    at = table.schema.get_field_index(name)
    return table.set_column(at, table.schema.field(at), column)


def stage(catalog: Catalog, targets: str, demonstrations: str) -> str:
    """Structures and demonstrations, nothing planned."""
    scale.fleet_of(Path(str(catalog.location)), int(targets))
    first = catalog.demonstration(catalog.demonstrations()["demonstration_id"].iloc[0])
    catalog.add_demonstrations(list(others(first, int(demonstrations))))
    return f"{len(catalog.structures())} structures, {len(catalog.demonstrations())} demonstrations"


def others(flight: Demonstration, many: int) -> Iterator[Demonstration]:
    """More flights, each a little aside of the first."""
    for number in range(1, many):
        yield replace(
            flight,
            demonstration_id=f"{flight.demonstration_id}-{number}",
            positions=flight.positions + 0.01 * number,
            sha256=f"{number:064d}",
        )
