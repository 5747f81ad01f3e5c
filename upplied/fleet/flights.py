"""A kept plan flown in simulation, measured like a plan, and kept for the reports."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict

from upplied import __version__
from upplied.catalog import Catalog, Recipe, recipe
from upplied.catalog.schema.plan_rows import transfer_id as id_of
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs.belonging import FLOWN
from upplied.catalog.verbs.recipes import settings_of
from upplied.config import digest
from upplied.errors import RefusedError, UppliedError
from upplied.fleet.flight_logs import judged_on_plan, keep_looks
from upplied.outputs.flown import Flown, flight_row, flown_of
from upplied.outputs.mission_options import DRAFTS
from upplied.outputs.missions import gate
from upplied.outputs.render import keep_overruled, undecided
from upplied.outputs.reports import plan_of
from upplied.planning.plan import METHOD_VERSION
from upplied.proof.align import as_simulated
from upplied.provenance import method
from upplied.records import Measures, Plan, Structure
from upplied.simulate import Vehicle, Wind, fly_trajectory, measure_flown
from upplied.supposed_scene import scene_for


def fly_plan(
    catalog: Catalog,
    transfer_id: str,
    wind: Wind | None = None,
    seed: int = 0,
    force: tuple[str, ...] = (),
) -> Flown:
    """Fly a plan of the catalog in wind and keep what came of it; the same flight is not flown twice.

    It passes the gate first, like a mission; `force` names rules that are overruled, which is kept.

    Raises
    ------
    CatalogError
        If there is no such plan, or its inputs are gone.
    RefusedError
        If the plan is not ok, breaks a rule of the gate that is not overruled, or the vehicle cannot
        hold its path in this wind.
    """
    wind, vehicle = wind or Wind(), Vehicle()
    row = catalog.transfer(transfer_id)
    if row["status"] != "ok":
        raise RefusedError(f"transfer {transfer_id}", f"is {row['status']}", "a plan that is ok")
    _through_gate(catalog, row, force)
    parts = ["flown", __version__, METHOD_VERSION, method(), transfer_id, row["waypoints_sha256"]]
    flight_id = digest([*parts, asdict(wind), asdict(vehicle), seed])
    before = catalog.flights(transfer_id).to_dict("records")
    same = [each for each in before if each["flight_id"] == flight_id]
    if same:
        flown = flown_of(same[-1], catalog.flown(same[-1]["flight_sha256"]))
    else:
        flown = _flown(catalog, row, wind, vehicle, seed)
    if not same or same[-1] is not before[-1]:
        catalog.add_flight(_row(catalog, flight_id, row, flown), flown.trajectory)  # reports tell of the last
    return flown


def fly_drafts(catalog: Catalog, keys: Iterable[str]) -> list[str]:
    """Fly those of some plans that are to be flown, in the usual wind; what a person should see, in words."""
    problems = []
    for key in keys:
        try:
            row = catalog.transfer(id_of(key))
            if row["status"] != "ok" or row["preset"] != FLOWN or not row["flyable"]:
                continue
            nearest = fly_plan(catalog, row["transfer_id"]).measures.min_clearance_m
        except UppliedError as error:
            problems.append(f"{id_of(key)}, flown in simulation: {error}")
            continue
        limit_m = settings_of(row["settings_json"]).route.clearance_m
        if nearest < limit_m:
            reason = f"comes within {nearest:.2f} m (limit {limit_m:g} m)"
            problems.append(f"{id_of(key)} of {row['target_id']}, flown in simulation: {reason}")
    return problems


def _row(catalog: Catalog, flight_id: str, row: Row, flown: Flown) -> Row:
    """The row of a simulated flight: as of one that was flown, and its log lies on its plan as it is."""
    plan, target = catalog.plan(row["transfer_id"]), catalog.structure(row["target_id"])
    assert plan.trajectory is not None
    path = flown.trajectory
    scene = scene_for(target, plan.supposed)
    columns, surface, judged = judged_on_plan(catalog, row, as_simulated(plan.trajectory, path), path, scene)
    return {
        **columns,
        "findings": "",
        **flight_row(flight_id, flown),
        "kind": "simulated",
        "flown_at": catalog.clock.now(),
        "looks_sha256": keep_looks(catalog, surface, judged.looks),
    }


def _flown(catalog: Catalog, row: Row, wind: Wind, vehicle: Vehicle, seed: int) -> Flown:
    made_from = recipe(catalog, row["transfer_id"])
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
        made_from.siblings,
    )
    conditions = (wind.speed_mps, wind.towards_deg, wind.gusts, seed)
    return Flown(row["transfer_id"], row["waypoints_sha256"], *conditions, path, judged.measures)


def _through_gate(catalog: Catalog, row: Row, force: tuple[str, ...]) -> None:
    """Refuse a plan that breaks a rule of the gate; keep which rules were overruled."""
    limit_m = settings_of(row["settings_json"]).route.clearance_m
    target, state = catalog.structure(row["target_id"]), catalog.standing().of(row["transfer_id"])
    faults = [
        *gate.broken_by(plan_of(catalog, row), target, limit_m),
        *undecided(catalog, {**row, "state": state}),
    ]
    faults = [one for one in faults if one.rule not in DRAFTS]  # a simulation may be of any
    overruled = gate.pass_or_refuse(f"transfer {row['transfer_id']}", faults, force)
    keep_overruled(catalog, row, "fly", "", overruled)


def measured(made_from: Recipe, plan: Plan) -> Measures:
    """The measures of a plan, computed from its trajectory and its inputs."""
    assert plan.trajectory is not None
    inputs = (made_from.demonstration, made_from.source, made_from.target)
    settings, siblings = made_from.settings, made_from.siblings
    return measure_flown(plan.trajectory, plan, *inputs, settings, siblings=siblings).measures


def _ground_z_m(target: Structure) -> float:
    """Height of the ground, m: as declared, else where the structure ends."""
    ground = target.surroundings.ground_z_m
    return float(target.vertices[:, 2].min()) if ground is None else ground
