"""Plans in force whose structure changed, judged again on it; what is not safe is recalled.

Safe means the gate's rules of the place; what cannot be judged is not safe. A plan that shows less than
before stays in force and is told: only a person knows whether that is enough.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from upplied.catalog import Catalog, open_catalog, recipe
from upplied.catalog.schema.rows import Row
from upplied.errors import UppliedError
from upplied.fleet.run import cores
from upplied.fleet.workers import JobKilled, Limits, Workers
from upplied.outputs.missions import gate
from upplied.outputs.missions.gate import planned
from upplied.outputs.reports import plan_of
from upplied.records import Structure, SupposedSurface, Trajectory
from upplied.simulate import measure_flown

BY = "the check of changed structures"
_PLACE = ("finite", "clearance", "keep-out", "geofence", "ceiling", "ground")
USUAL_CLEARANCE_M = 2.0  # of plans that were asked to keep none: what missions keep
_LOST_POINTS = 1.0  # of inspected coverage, from which on a plan that stays in force is told as a trouble


@dataclass(frozen=True)
class Rechecked:
    """What came of judging one plan in force again."""

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
    done = []
    with Workers(min(cores(), len(changed)), limits=limits or Limits()) as workers:
        for row in changed.to_dict("records"):
            target = catalog.newest("structures", row["target_id"])["sha256"]
            verdicts = _judged(workers, catalog.location, {str(name): value for name, value in row.items()})
            judged = catalog.transfer(verdicts.transfer_id), verdicts.note, target, BY
            if verdicts.recalled:
                catalog.recall(*judged)
            else:
                catalog.rechecked(*judged, verdicts.supposed_sha256)
            done.append(verdicts)
    return done


def _judged(workers: Workers, location: str, row: Row) -> Rechecked:
    names = (str(row["transfer_id"]), str(row["target_id"]))
    try:
        broken, shown, supposed = workers.run(judge_again, location, names[0])
    except (JobKilled, UppliedError) as error:
        return Rechecked(*names, True, f"it cannot be judged on the changed structure: {error}", True)
    if broken:
        return Rechecked(*names, True, "; ".join(broken), True)
    before = row["coverage_inspected_pct"]
    if isinstance(shown, str):
        words = f"it is safe; what it shows cannot be measured: {shown}"
        return Rechecked(*names, False, words, True, supposed)
    lost = before - shown > _LOST_POINTS
    note = f"it is safe there; it shows {shown:.1f} % of what was inspected ({before:.1f} % before)"
    return Rechecked(*names, False, note, bool(lost), supposed)


def judge_again(location: str, transfer_id: str) -> tuple[list[str], float | str, str]:
    """In a worker: the rules that a plan breaks at its structure as it now is, and what it shows there.

    Returns these in words; the share of what was inspected that is shown, %, or why that cannot be
    measured; and the hash of what of the structure was never scanned.
    """
    catalog = open_catalog(location)
    basis = recipe(catalog, transfer_id)
    plan = plan_of(catalog, basis.row)
    assert plan.trajectory is not None
    target = catalog.structure(plan.target_id)
    route = basis.settings.route
    limit_m = route.clearance_m if route.enforce else USUAL_CLEARANCE_M
    broken = place_breaches(plan.trajectory, target, None, limit_m)
    if broken:
        return broken, float("nan"), ""
    shown: float | str
    try:
        flown = (basis.demonstration, basis.source, target, basis.settings, catalog.cache)
        plan = measure_flown(plan.trajectory, plan, *flown, basis.siblings)
        shown = plan.measures.coverage_inspected_pct
    except UppliedError as error:
        shown = str(error)
    assert plan.trajectory is not None
    broken = place_breaches(plan.trajectory, target, plan.supposed, limit_m)
    return broken, shown, catalog.keep_surface(replace(plan, surface=None, inspected=None)).supposed_sha256


def place_breaches(
    path: Trajectory, target: Structure, supposed: SupposedSurface | None, clearance_m: float
) -> list[str]:
    """The rules of the place that a path breaks at a structure, and at what is supposed of it, in words."""
    limits = gate.Limits(clearance_m=clearance_m)
    breaches = gate.breaches(planned(path.positions, path.t_s), target, limits, supposed)
    return [str(breach) for breach in breaches if breach.rule in _PLACE]
