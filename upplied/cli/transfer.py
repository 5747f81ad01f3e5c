"""`upplied transfer` and `upplied plan`: plans from demonstrations, and dry runs."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from upplied import fleet
from upplied.cli.demonstrations import best as best_for
from upplied.cli.options import Choices, Cores, Texts
from upplied.cli.terminal import PRINTED, Results, Where, complain, errors, progress, say
from upplied.errors import InputError, RefusedError, SettingsError
from upplied.outputs.labels import LABELS

if TYPE_CHECKING:
    from upplied.catalog import Catalog
    from upplied.fleet import Decision, PlanRequest, Result

_PRESETS = "Presets: paper, recommended or baseline."
PresetOption = Annotated[Texts, Parameter(name="--preset", consume_multiple=True, help=_PRESETS)]
SetOption = Annotated[Texts, Parameter("--set", help="Parameter STAGE.NAME=VALUE; repeatable.")]
BestOption = Annotated[str, Parameter("--best", help="Structure for which to use the best demonstration.")]
ExperimentOption = Annotated[str, Parameter(help="Name of an experiment; its plans are never released.")]
ReproduceOption = Annotated[str | None, Parameter(help="ID of a plan to compute again and compare.")]
TimeoutOption = Annotated[float, Parameter(help="Time limit of one structure, in seconds.")]
DEFAULT_PRESETS = ("recommended", "baseline")
COLUMNS = LABELS["transfers"]
_SPARE = ("paper %", "Frechet", "time s", "demo mm/px", "as fine %", "stand-off", "mm/px",
          "rotation", "seen %")  # fmt: skip


def transfer(
    demonstration: str = "",
    /,
    *,
    to: Annotated[tuple[str, ...], Parameter(consume_multiple=True)] = (),
    preset: PresetOption = DEFAULT_PRESETS,
    set_: SetOption = (),
    choices: Choices | None = None,
    experiment: ExperimentOption = "",
    best: BestOption = "",
    reproduce: ReproduceOption = None,
    workers: Cores = 0,
    timeout: TimeoutOption = 600.0,
    results: Results = PRINTED,
) -> int:
    """Transfer one demonstration to target structures; existing plans are not computed again.

    Parameters
    ----------
    demonstration : str
        ID of the demonstration; omit it with --best.
    to : tuple of str
        IDs of the targets; by default every other structure of the kind.
    """
    if reproduce is not None:
        return _reproduced(results, reproduce)
    if best and (demonstration or to):
        rule = "either --best, or a demonstration and --to"
        raise SettingsError("transfer", "--best together with a demonstration or --to", rule)
    catalog = results.opened()
    if best:
        demonstration, to = best_for(catalog, best), (best,)
    if not demonstration:
        raise SettingsError("transfer", "no demonstration is named", "", "see: upplied demonstrations list")
    targets = fitting(catalog, demonstration, to)
    settings = (choices or Choices()).onto(changes(set_))
    plan_request = fleet.PlanRequest(preset, settings, (demonstration,), targets, False, experiment)
    run(catalog, fleet.decide(catalog, plan_request), workers, timeout)
    rows = current(catalog, plan_request)
    show_plans(demonstration, rows, results)
    if any(row["status"] == "ok" for row in rows):
        results.next_step("report", "publish the plans as pages")
    return int(len(targets) < len(to) or any(row["status"] != "ok" for row in rows))


def fitting(catalog: Catalog, demonstration: str, targets: tuple[str, ...]) -> tuple[str, ...]:
    """The targets of a demonstration's kind; the others are reported, or refused where none is left."""
    from upplied.checks import suggested

    if not targets:
        return ()
    structures = catalog.structures()
    kinds = dict(zip(structures["structure_id"], structures["kind"], strict=True))
    flown = catalog.newest("demonstrations", demonstration)["structure_id"]
    kind, targets_of_kind, reasons = kinds.get(flown, ""), [], []
    for name in dict.fromkeys(targets):
        if name not in kinds:
            reasons.append(f"structure {name}: is not in the catalog ({suggested(name, kinds)})")
        elif kind and kinds[name] != kind:
            reason = f"is of kind {kinds[name]}, and {demonstration} was flown on {flown}, of kind {kind}"
            reasons.append(f"structure {name}: {reason}: a demonstration is transferred within its kind")
        else:
            targets_of_kind.append(name)
    if not targets_of_kind:
        raise InputError("transfer", "; ".join(reasons))
    for reason in reasons:
        complain(f"refused: {reason}")
    return tuple(targets_of_kind)


def plan(
    *,
    dry_run: Annotated[bool, Parameter(help="Show what would be planned, and stop.")] = False,
    preset: PresetOption = DEFAULT_PRESETS,
    set_: SetOption = (),
    retry_failed: Annotated[bool, Parameter(help="Include pairs that failed before.")] = False,
    experiment: ExperimentOption = "",
    workers: Cores = 0,
    timeout: TimeoutOption = 600.0,
    results: Results = PRINTED,
) -> int:
    """Plan every pair whose inputs changed since it was planned, or show which those are."""
    catalog = results.opened()
    plan_request = fleet.PlanRequest(preset, changes(set_), retry_failed=retry_failed, experiment=experiment)
    with errors.status("comparing inputs"):
        decision = fleet.decide(catalog, plan_request)
    if dry_run:
        show_decision(decision, results)
        if decision.jobs:
            results.next_step("plan", "plan them")
        return 0
    checked = fleet.recheck(catalog, fleet.Limits(timeout))
    for structure in checked:
        (complain if structure.troubled else say)(structure)
    result = run(catalog, decision, workers, timeout)
    say(f"{result}, {decision.unchanged} unchanged")
    results.next_step("report", "publish the plans as pages")
    return int(result.ok < result.total or any(structure.troubled for structure in checked))


def changes(texts: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    stages: dict[str, dict[str, Any]] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        stage, dot, setting = name.partition(".")
        if not (equals and dot):
            raise SettingsError(f"--set {text}", "cannot be read", "STAGE.NAME=VALUE")
        try:
            stages.setdefault(stage, {})[setting] = json.loads(value)
        except ValueError:
            stages.setdefault(stage, {})[setting] = value
    return stages


def run(catalog: Catalog, decision: Decision, workers: int, timeout: float) -> Result:
    from upplied.fleet.edits import carry_edits

    resources = fleet.Resources(workers, fleet.Limits(timeout))
    with progress("planning", len(decision.jobs)) as advance:
        result = fleet.transfer(catalog, decision.jobs, fleet.new_run_id(), resources, lambda _: advance())
    for message in carry_edits(catalog):
        complain(message)
    return result


def current(catalog: Catalog, plan_request: PlanRequest) -> list[dict[str, Any]]:
    from upplied.fleet.decisions import SettingsOf

    table = catalog.transfers(every=True)
    selected = table["demonstration_id"].isin(plan_request.demonstrations)
    selected &= table["purpose"] == plan_request.purpose
    selected &= table["target_id"].isin(plan_request.targets or catalog.structures()["structure_id"])
    table = table[selected & table["preset"].isin(plan_request.presets)]
    settings_of = SettingsOf(catalog, plan_request)
    hashes = [settings_of(*row).sha256 for row in table[["preset", "kind", "target_id"]].to_numpy().tolist()]
    table = table[table["settings_sha256"] == hashes]
    newest = table.drop_duplicates(["target_id", "preset"], keep="last")
    unasked = ["settings_json", "registration_json", "commit_id", "commit_version"]
    rows = newest.sort_values(["target_id", "preset"]).drop(columns=unasked)
    return rows.astype(object).where(rows.notna(), None).to_dict("records")


def show_plans(demonstration: str, rows: list[dict[str, Any]], results: Results) -> None:
    from upplied.outputs.pairs import shown_status
    from upplied.outputs.verdicts import resolution

    if results.json:
        results.show("", [{**row, "warnings": json.loads(row["warnings"] or "[]")} for row in rows])
        return
    shown = [row | {"status": shown_status(row)} for row in rows]
    columns = [{title: row[name] for name, title in COLUMNS.items()} for row in shown]
    results.show(f"transfers of {demonstration}", columns, _SPARE)
    for row in shown:
        plan = f"{row['target_id']} ({row['preset']})"
        if row["status"] != "ok":
            say(f"{row['status']}: {plan}: {row['reason'] or row['not_flyable']}")
            continue
        if fine := resolution(row):
            say(f"{plan}: {fine}")
        if warnings := json.loads(row["warnings"] or "[]"):
            say(f"check: {plan}: {'; '.join(warnings)}")


def show_decision(decision: Decision, results: Results) -> None:
    columns = ("demonstration", "target", "preset", "why")
    pairs = [(job.demonstration_id, job.target_id, job.settings.preset, job.why) for job in decision.jobs]
    most = len(pairs) if results.json else 40
    results.show("would be planned", [dict(zip(columns, pair, strict=True)) for pair in pairs[:most]])
    if results.json:
        return
    if len(pairs) > most:
        say(f"... and {len(pairs) - most} more; --json lists them all")
    for why, count in {**decision.reasons, "unchanged": decision.unchanged}.items():
        say(f"{count:6d}  {why}")


def _reproduced(where: Where, transfer_id: str) -> int:
    """Plan a transfer again from its recorded inputs; 0 if the plan is the same, else 1."""
    from upplied.catalog import recipe
    from upplied.fleet.planner import required_surface
    from upplied.planning.correspondence.memo import no_memo
    from upplied.planning.plan import METHOD_VERSION, plan_transfer
    from upplied.provenance import causes

    store, transfer = where.plan(transfer_id)
    basis = recipe(store, transfer)
    row, what = basis.row, f"plan {transfer_id}"
    purpose, _, subject = (row["purpose"] or "").partition(" ")
    if purpose == "gap":
        remedy = f"plan it again: upplied flights gap {subject}"
        raise RefusedError(what, "was planned from a flight", "", remedy)
    if purpose in ("reshoot", "campaign"):
        remedy = f"plan it again: upplied reshoot --on {row['target_id']}"
        raise RefusedError(what, "was planned from findings", "", remedy)
    with errors.status("planning again"):
        settings = basis.settings
        zones, unnamed = required_surface(store, store.cache, basis.target, settings.required.zones)
        inputs = (basis.demonstration, basis.source, basis.target)
        plan = plan_transfer(*inputs, settings, no_memo, zones, basis.siblings)
        plan = replace(plan, warnings=(*plan.warnings, *unnamed))
    for doubt in basis.doubts:
        say(f"note: {doubt}")
    if not (different := basis.differences(plan)):
        what = f"{row['n_waypoints']} waypoints" if row["status"] == "ok" else row["status"]
        say(f"{transfer_id}: the result is the same ({what})")
        return 0
    say(f"{transfer_id}: differs in {', '.join(different)}")
    why = causes(row, METHOD_VERSION)
    unchanged = "Method, sources, libraries and machine are unchanged: please report this as a fault."
    cause = f"Cause: {'; '.join(why)}." if why else unchanged
    say(f"It was planned by method {row['method_version']}, code {row['code_version']}. {cause}")
    return 1
