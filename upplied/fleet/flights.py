"""A kept plan flown in simulation, measured like a plan, and kept for the reports."""

from __future__ import annotations

from dataclasses import asdict

from upplied import __version__
from upplied.catalog import Catalog, recipe
from upplied.config import digest
from upplied.errors import RefusedError
from upplied.outputs.flown import STAGE, Flown, last_key
from upplied.outputs.reports import plan_of
from upplied.planning.plan import METHOD_VERSION
from upplied.records import Structure
from upplied.simulate import Vehicle, Wind, fly_trajectory, measure_flown


def fly_plan(catalog: Catalog, transfer_id: str, wind: Wind | None = None, seed: int = 0) -> Flown:
    """Fly a plan of the catalog in wind and keep what came of it; the same flight is not flown twice.

    Raises
    ------
    CatalogError
        If there is no such plan, or its inputs are gone.
    RefusedError
        If the plan is not ok, or the vehicle cannot hold its path in this wind.
    """
    wind, vehicle = wind or Wind(), Vehicle()
    row = catalog.transfer(transfer_id)
    if row["status"] != "ok":
        raise RefusedError(f"transfer {transfer_id}", f"is {row['status']}", "a plan that is ok")
    parts = [STAGE, __version__, METHOD_VERSION, transfer_id, row["waypoints_sha256"]]
    key = digest([*parts, asdict(wind), asdict(vehicle), seed])

    def flown() -> Flown:
        made_from = recipe(catalog, transfer_id)
        plan = plan_of(catalog, row)
        assert plan.trajectory is not None
        path = fly_trajectory(plan.trajectory, vehicle, wind, _ground_z_m(made_from.target), seed)
        judged = measure_flown(
            path,
            plan,
            made_from.demonstration,
            made_from.source,
            made_from.target,
            made_from.settings,
            catalog.cache,
        )
        said = (wind.speed_mps, wind.towards_deg, wind.gusts, seed)
        return Flown(transfer_id, row["waypoints_sha256"], *said, path, judged.measures)

    record = catalog.cache(STAGE, Flown, key, flown)
    catalog.cache.put(STAGE, last_key(transfer_id), record)
    return record


def _ground_z_m(target: Structure) -> float:
    """Height of the ground, m: as declared, else where the structure ends."""
    ground = target.surroundings.ground_z_m
    return float(target.vertices[:, 2].min()) if ground is None else ground
