"""Plans and decisions, as `upplied transfer` and `upplied plan` show them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from upplied.cli.terminal import Results, say
from upplied.outputs.labels import LABELS

if TYPE_CHECKING:
    from upplied.catalog import Catalog
    from upplied.fleet import Decision, PlanRequest

COLUMNS = LABELS["transfers"]
_SPARE = ("paper %", "Frechet", "time s", "flown mm", "as fine %", "stand-off", "gsd mm", "turned", "seen %")


def current(catalog: Catalog, plan_request: PlanRequest) -> list[dict[str, Any]]:
    """The newest plans of a request: with exactly these settings, whatever was planned since."""
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
    """The measures of each plan, and under them why it has none, or what to look at before it is flown."""
    from json import loads

    from upplied.outputs.pairs import shown_status
    from upplied.outputs.verdicts import resolution

    if results.json:
        results.show("", [{**row, "warnings": loads(row["warnings"] or "[]")} for row in rows])
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
        if warnings := loads(row["warnings"] or "[]"):
            say(f"check: {plan}: {'; '.join(warnings)}")


def show_decision(decision: Decision, results: Results) -> None:
    """What would be planned and why."""
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
