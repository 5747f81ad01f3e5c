"""Flights of kept plans: simulated, judged again where a structure changed, and kept as demonstrations."""

from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, fields, replace

import numpy as np

from upplied import __version__
from upplied.catalog import Catalog, Recipe, open_catalog, recipe
from upplied.catalog.schema.plan_rows import transfer_id as id_of
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs.belonging import FLOWN
from upplied.catalog.verbs.recipes import settings_of
from upplied.catalog.verbs.roster import author
from upplied.checks import check_id
from upplied.config import digest
from upplied.errors import RefusedError, SettingsError, UppliedError
from upplied.fleet.flight_logs import judged_on_plan, keep_looks
from upplied.fleet.run import cores
from upplied.fleet.workers import JobKilled, Limits, Workers
from upplied.geometry.supposed_scene import scene_for
from upplied.outputs.mission_options import DRAFTS
from upplied.outputs.missions import gate
from upplied.outputs.missions.gate import planned
from upplied.outputs.render import keep_overruled, undecided
from upplied.outputs.reports import plan_of
from upplied.planning.airspace.rules import path_clearance
from upplied.planning.plan import METHOD_VERSION
from upplied.proof.align import as_simulated, silence_s
from upplied.proof.as_flown import LOOKED, SILENT, STOOD
from upplied.provenance import method
from upplied.records import Demonstration, Measures, Plan, Structure, SupposedSurface, Trajectory
from upplied.simulate import Vehicle, Wind, fly_trajectory, measure_flown


def fly_plan(
    catalog: Catalog, transfer_id: str, wind: Wind | None = None, seed: int = 0, force: tuple[str, ...] = ()
) -> Row:
    """Fly a plan of the catalog in wind and keep what came of it; the same flight is not flown twice.

    It passes the gate first, like a mission; `force` names rules that are overruled, which is kept. Returns
    the flight's row of `flights`; refused where the plan is not ok, breaks a rule of the gate that is not
    overruled, or the vehicle cannot hold its path in this wind.
    """
    wind, vehicle = wind or Wind(), Vehicle()
    row = catalog.transfer(transfer_id)
    if row["status"] != "ok":
        raise RefusedError(f"transfer {transfer_id}", f"is {row['status']}", "a plan that is ok")
    _through_gate(catalog, row, force)
    made_of = [transfer_id, row["waypoints_sha256"], asdict(wind), asdict(vehicle), seed]
    flight_id = digest(["flown", __version__, METHOD_VERSION, method(), *made_of])
    before = catalog.flights(transfer_id).to_dict("records")
    same = [each for each in before if each["flight_id"] == flight_id]
    if not same:
        basis, plan = recipe(catalog, transfer_id), plan_of(catalog, row)
        assert plan.trajectory is not None
        path = fly_trajectory(plan.trajectory, vehicle, wind, basis.target.floor_z_m, seed)
        inputs = (basis.demonstration, basis.source, basis.target, basis.settings)
        measures = asdict(measure_flown(path, plan, *inputs, catalog.cache, basis.siblings).measures)
    else:
        if same[-1] is before[-1]:
            return {str(name): value for name, value in same[-1].items()}
        path = catalog.flown(same[-1]["flight_sha256"])
        measures = {item.name: same[-1].get(item.name) for item in fields(Measures)}
    air = {"wind_mps": wind.speed_mps, "towards_deg": wind.towards_deg, "gusts": wind.gusts, "seed": seed}
    flight = simulated_row(catalog, flight_id, row, path, air | measures)
    catalog.add_flight(flight, path)  # reports tell of the last
    return flight


def fly_drafts(catalog: Catalog, keys: Iterable[str]) -> list[str]:
    """Fly those of some plans that are to be flown, in the usual wind; what a person should see, in words."""
    problems = []
    for key in keys:
        try:
            row = catalog.transfer(id_of(key))
            if row["status"] != "ok" or row["preset"] != FLOWN or not row["flyable"]:
                continue
            nearest = fly_plan(catalog, row["transfer_id"])["min_clearance_m"]
        except UppliedError as error:
            problems.append(f"{id_of(key)}, flown in simulation: {error}")
            continue
        limit_m = settings_of(row["settings_json"]).route.clearance_m
        if nearest < limit_m:
            what = f"{id_of(key)} of {row['target_id']}, flown in simulation"
            problems.append(f"{what}: comes within {nearest:.2f} m (limit {limit_m:g} m)")
    return problems


def simulated_row(catalog: Catalog, flight_id: str, row: Row, path: Trajectory, columns: Row) -> Row:
    plan, target = catalog.plan(row["transfer_id"]), catalog.structure(row["target_id"])
    assert plan.trajectory is not None
    scene = scene_for(target, plan.supposed)
    judged = judged_on_plan(catalog, row, as_simulated(plan.trajectory, path), path, scene)
    return {
        **judged.row,
        **columns,
        "flight_id": flight_id,
        "findings": "",
        "kind": "simulated",
        "flown_at": catalog.clock.now(),
        "looks_sha256": keep_looks(catalog, judged),
    }


def _through_gate(catalog: Catalog, row: Row, force: tuple[str, ...]) -> None:
    limit_m = settings_of(row["settings_json"]).route.clearance_m
    target, state = catalog.structure(row["target_id"]), catalog.standing().of(row["transfer_id"])
    faults = [*gate.broken_by(plan_of(catalog, row), target, limit_m)]
    faults += undecided(catalog, {**row, "state": state})
    faults = [one for one in faults if one.rule not in DRAFTS]  # a simulation may be of any
    overruled = gate.pass_or_refuse(f"transfer {row['transfer_id']}", faults, force)
    keep_overruled(catalog, row, "fly", "", overruled)


def measured(basis: Recipe, plan: Plan) -> Measures:
    assert plan.trajectory is not None
    inputs = (basis.demonstration, basis.source, basis.target, basis.settings)
    return measure_flown(plan.trajectory, plan, *inputs, siblings=basis.siblings).measures


BY = "the check of changed structures"
_PLACE = ("finite", "clearance", "keep-out", "geofence", "ceiling", "ground")
USUAL_CLEARANCE_M = 2.0  # of plans that were asked to keep none: what missions keep
_LOST_POINTS = 1.0  # of inspected coverage, from which on a plan that stays in force is told as a trouble


@dataclass(frozen=True)
class Rechecked:
    transfer_id: str
    target_id: str
    recalled: bool
    note: str
    troubled: bool  # a person should look
    supposed_sha256: str = ""  # of what of the changed structure was never scanned

    def __str__(self) -> str:
        word = "RECALLED" if self.recalled else "still in force"
        return f"{word}: plan {self.transfer_id} of {self.target_id}: {self.note}"


def recheck(catalog: Catalog, limits: Limits | None = None) -> list[Rechecked]:
    """Judge every plan in force whose structure changed since it was last judged; decisions are kept."""
    force = catalog.in_force()
    changed = force[force["target_changed"]] if len(force) else force
    if not len(changed):
        return []
    verdicts = []
    with Workers(min(cores(), len(changed)), limits=limits or Limits()) as workers:
        for row in changed.to_dict("records"):
            target = catalog.newest("structures", row["target_id"])["sha256"]
            try:
                verdict: Rechecked = workers.run(judge_again, catalog.location, str(row["transfer_id"]))
            except (JobKilled, UppliedError) as error:
                note = f"it cannot be judged on the changed structure: {error}"
                verdict = Rechecked(str(row["transfer_id"]), str(row["target_id"]), True, note, True)
            judged = catalog.transfer(verdict.transfer_id), verdict.note, target, BY
            if verdict.recalled:
                catalog.recall(*judged)
            else:
                catalog.rechecked(*judged, verdict.supposed_sha256)
            verdicts.append(verdict)
    return verdicts


def judge_again(location: str, transfer_id: str) -> Rechecked:
    """In a worker: a plan at its structure as it now is, by the rules that it breaks and what it shows."""
    catalog = open_catalog(location)
    basis = recipe(catalog, transfer_id)
    plan = plan_of(catalog, basis.row)
    path, before = plan.trajectory, plan.measures.coverage_inspected_pct
    assert path is not None
    names, target = (transfer_id, plan.target_id), catalog.structure(plan.target_id)
    route = basis.settings.route
    limit_m = route.clearance_m if route.enforce else USUAL_CLEARANCE_M
    if not (broken := place_breaches(path, target, None, limit_m)):
        try:
            flown = (basis.demonstration, basis.source, target, basis.settings, catalog.cache)
            plan = measure_flown(path, plan, *flown, basis.siblings)
            shown = plan.measures.coverage_inspected_pct
            lost = bool(before - shown > _LOST_POINTS)
            note = f"it is safe there; it shows {shown:.1f} % of what was inspected ({before:.1f} % before)"
        except UppliedError as error:
            lost, note = True, f"it is safe; what it shows cannot be measured: {error}"
        broken = place_breaches(path, target, plan.supposed, limit_m)
    if broken:
        return Rechecked(*names, True, "; ".join(broken), True)
    supposed = catalog.keep_surface(replace(plan, surface=None, inspected=None)).supposed_sha256
    return Rechecked(*names, False, note, lost, supposed)


def place_breaches(
    path: Trajectory, target: Structure, supposed: SupposedSurface | None, clearance_m: float
) -> list[str]:
    """The rules of the place that a path breaks at a structure, and at what is supposed of it, in words."""
    limits = gate.Limits(clearance_m=clearance_m)
    breaches = gate.breaches(planned(path.positions, path.t_s), target, limits, supposed)
    return [str(breach) for breach in breaches if breach.rule in _PLACE]


_WHOLE_PCT = 98.0  # of the plan's length, and in view of what it shows: less is no whole inspection
_INSPECTED_PCT = 95.0  # as asked, of what the plan shows: flights of the sample fleet reach 96 and more
#: What a flight must keep to be shown to the database as an example, and why.
RULES = {
    "flown": "a vehicle flew it: a simulated flight shows nothing that its plan does not",
    "whole": f"{_WHOLE_PCT:g} % of the plan was flown and in view, {_INSPECTED_PCT:g} % inspected as planned",
    "recorded": "the log has no gap, and its camera pose never froze",
    "clearance": "it stayed within the clearance limit of its plan",
}


def promote_flight(
    catalog: Catalog, start: str, by: str, name: str = "", force: Collection[str] = ()
) -> Demonstration:
    """Keep a flight, by how its id begins, as a demonstration of the structure that it was flown round.

    `by` says that it is good; `force` names `RULES` that are overruled, which its notes say. Refused where
    another is broken, or there is a demonstration of that `name` (empty: the plan's, the structure and the
    day).
    """
    if unknown := sorted(set(force) - set(RULES)):
        raise SettingsError(f"rule {unknown[0]!r}", "is unknown", f"one of {', '.join(RULES)}")
    by = author(by, "a demonstration")
    row = catalog.flight(start)
    what = f"flight {str(row['flight_id'])[:12]}"
    plan = catalog.transfer(str(row["transfer_id"]))
    flown = catalog.flown(str(row["flight_sha256"]))
    structure = catalog.structure(str(row["target_id"]))
    scene = scene_for(structure, catalog.supposed(str(plan["transfer_id"])))
    broken = _broken(row, path_clearance(scene, flown.positions).distance_m, plan)
    if left := [(rule, fault) for rule, fault in broken if rule not in force]:
        reasons = "; ".join(fault for _, fault in left)
        raise RefusedError(what, reasons, RULES[left[0][0]], f"or overrule it: --force {left[0][0]}")
    usual_name = f"{plan['demonstration_id']}-{structure.structure_id}-{row['flown_at']:%Y%m%d}"[:64]
    name = check_id(name or usual_name, "demonstration id")
    if name in set(catalog.demonstrations(every=True)["demonstration_id"]):
        what = f"demonstration {name}"
        raise RefusedError(what, "is in the catalog", "a name of its own", "say --name NAME")
    before = catalog.demonstration(str(plan["demonstration_id"]))
    camera, start_ns = before.camera, int(row["flown_at"].value)
    if flown.fov_deg is not None:  # the narrowest field of view that the flight itself logged
        camera = camera.zoomed(flown.fov_deg[[flown.fov_deg[:, 0].argmin()]])[0]
    overruled = "".join(f"; overruled, {rule}: {fault}" for rule, fault in broken)
    note = f"promoted by {by} from {what}, which flew plan {plan['transfer_id']}{overruled}"
    demonstration = Demonstration(
        demonstration_id=name,
        structure_id=structure.structure_id,
        t_ns=start_ns + np.round(flown.t_s * 1e9).astype(np.int64),
        positions=flown.positions,
        quat_xyzw=flown.quat_xyzw,
        camera=camera,
        fov_deg=flown.fov_deg,
        operator=str(row["operator"] or ""),
        site=before.site if before.structure_id == structure.structure_id else "",
        sha256=digest(["flight", row["flight_id"], row["flight_sha256"]]),
        breaks=np.flatnonzero(np.diff(flown.t_s) > silence_s(flown)).astype(np.int64) + 1,
        clock="flight",
        topic=f"flight {row['flight_id']}",
        notes=note,
    )
    catalog.add_demonstrations([demonstration])
    return demonstration


def _broken(row: Row, clearance_m: float, plan: Row) -> list[tuple[str, str]]:
    broken = []
    if row["kind"] != "flown":
        broken.append(("flown", f"is {row['kind'] or 'simulated'}"))
    shares = {"flown_pct": "of its plan was flown", "required_pct": "of what it shows was in view"}
    for column, words in shares.items():
        if not (row[column] or 0.0) >= _WHOLE_PCT:
            broken.append(("whole", f"{row[column] or 0.0:.1f} % {words}"))
    inspected = row["inspected_pct"]
    if inspected is None or inspected != inspected:  # judged before there was such a figure
        broken.append(("whole", "the share inspected as planned is unknown"))
    elif inspected < _INSPECTED_PCT:
        broken.append(("whole", f"{inspected:.1f} % of its surface was inspected as planned"))
    for part in str(row["findings"] or "").split("; "):
        if part.startswith((SILENT, STOOD, LOOKED)):
            broken.append(("recorded", part))
    route = settings_of(plan["settings_json"]).route
    if route.enforce and clearance_m < route.clearance_m:
        broken.append(("clearance", f"comes within {clearance_m:.2f} m (limit {route.clearance_m:g} m)"))
    return broken
