"""A kept plan flown in simulation, measured like a plan, and kept for the reports."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict

from upplied import __version__
from upplied.catalog import Catalog, Recipe, recipe
from upplied.catalog.schema.plan_rows import transfer_id as id_of
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs.belonging import FLOWN
from upplied.catalog.verbs.looks import put_looks
from upplied.catalog.verbs.recipes import settings_of
from upplied.config import digest
from upplied.errors import RefusedError, UppliedError
from upplied.fleet.flight_logs import flight_columns, required_of, viewpoint_index
from upplied.outputs.flown import Flown, flight_row, flown_of
from upplied.outputs.missions import gate
from upplied.outputs.missions.options import DRAFTS
from upplied.outputs.render import keep_overruled, undecided
from upplied.outputs.reports import plan_of
from upplied.planning.plan import METHOD_VERSION
from upplied.proof.align import as_simulated
from upplied.proof.as_flown import as_flown
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
        found = flown_of(same[-1], catalog.flown(same[-1]["flight_sha256"]))
    else:
        found = _flown(catalog, row, wind, vehicle, seed)
    if not same or same[-1] is not before[-1]:
        catalog.add_flight(_row(catalog, flight_id, row, found), found.trajectory)  # reports tell of the last
    return found


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
        asked = settings_of(row["settings_json"]).route.clearance_m
        if nearest < asked:
            found = f"comes within {nearest:.2f} m, {asked:g} m are asked for"
            problems.append(f"{id_of(key)} of {row['target_id']}, flown in simulation: {found}")
    return problems


def _row(catalog: Catalog, flight_id: str, row: Row, flown: Flown) -> Row:
    """The row of a simulated flight: as of one that was flown, and its log lies on its plan as it is."""
    plan, target = catalog.plan(row["transfer_id"]), catalog.structure(row["target_id"])
    camera = catalog.demonstration(row["demonstration_id"]).camera
    surface, required = required_of(catalog, row, plan, target, camera)
    assert plan.trajectory is not None
    path, moments = flown.trajectory, plan.trajectory.t_s[viewpoint_index(plan)]
    found = as_simulated(plan.trajectory, path)
    said = as_flown(plan.trajectory, moments, found, path, surface, camera, scene_for(target, plan.supposed))
    looks = said.looks
    return {
        **flight_columns(row, found, said, required),
        "findings": "",
        **flight_row(flight_id, flown),
        "kind": "simulated",
        "flown_at": catalog.clock.now(),
        "looks_sha256": put_looks(
            catalog, surface.points, surface.normals, looks.seen, looks.values, looks.pictures
        ),
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
    said = (wind.speed_mps, wind.towards_deg, wind.gusts, seed)
    return Flown(row["transfer_id"], row["waypoints_sha256"], *said, path, judged.measures)


def _through_gate(catalog: Catalog, row: Row, force: tuple[str, ...]) -> None:
    """Refuse a plan that breaks a rule of the gate; keep which rules were overruled."""
    asked = settings_of(row["settings_json"]).route.clearance_m
    target, state = catalog.structure(row["target_id"]), catalog.standing().of(row["transfer_id"])
    found = [
        *gate.broken_by(plan_of(catalog, row), target, asked),
        *undecided(catalog, {**row, "state": state}),
    ]
    found = [breach for breach in found if breach.rule not in DRAFTS]  # a flight in simulation may be of any
    overruled = gate.pass_or_refuse(f"transfer {row['transfer_id']}", found, force)
    keep_overruled(catalog, row, "fly", "", overruled)


def measured(made_from: Recipe, plan: Plan) -> Measures:
    """The measures of a plan, computed from its trajectory and its inputs."""
    assert plan.trajectory is not None
    inputs = (made_from.demonstration, made_from.source, made_from.target)
    found = measure_flown(plan.trajectory, plan, *inputs, made_from.settings, siblings=made_from.siblings)
    return found.measures


def _ground_z_m(target: Structure) -> float:
    """Height of the ground, m: as declared, else where the structure ends."""
    ground = target.surroundings.ground_z_m
    return float(target.vertices[:, 2].min()) if ground is None else ground
