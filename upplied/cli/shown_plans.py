"""Plans and decisions, as `upplied transfer` and `upplied plan` show them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from upplied.cli.terminal import console, say, show

if TYPE_CHECKING:
    from upplied.catalog import Catalog
    from upplied.fleet import Decision, PlanRequest

COLUMNS = {
    "transfer_id": "transfer",
    "target_id": "target",
    "preset": "preset",
    "status": "status",
    "coverage_inspected_pct": "inspected %",
    "coverage_seen_pct": "seen %",
    "coverage_paper_pct": "paper %",
    "frechet_z": "Frechet",
    "min_clearance_m": "clear m",
    "camera_turn_ratio": "turned",
    "gsd_mm_p50": "gsd mm",
    "gsd_demonstrated_mm_p50": "flown mm",
    "gsd_within_pct": "as fine %",
    "standoff_mode": "stand-off",
    "duration_s": "time s",
}

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


def show_plans(demonstration: str, rows: list[dict[str, Any]], as_json: bool) -> None:
    """The measures of each plan, and under them why it has none, or what to look at before it is flown."""
    from json import loads

    from upplied.outputs.pairs import shown_status
    from upplied.outputs.verdicts import resolution

    if as_json:
        show("", [{**row, "warnings": loads(row["warnings"] or "[]")} for row in rows], as_json)
        return
    shown = [row | {"status": shown_status(row)} for row in rows]
    columns = [{title: row[name] for name, title in COLUMNS.items()} for row in shown]
    show(f"transfers of {demonstration}", columns, spare=_SPARE)
    for row in rows:
        status = shown_status(row)
        if status != "ok":
            why = row["reason"] or row["not_flyable"]
            say(f"{status}: {row['target_id']} ({row['preset']}): {why}")
            continue
        if fine := resolution(row):
            say(f"{row['target_id']} ({row['preset']}): {fine}")
        if warnings := loads(row["warnings"] or "[]"):
            say(f"check: {row['target_id']} ({row['preset']}): {'; '.join(warnings)}")


def show_decision(decision: Decision, as_json: bool) -> None:
    """What would be planned and why."""
    rows = [
        {
            "demonstration": job.demonstration_id,
            "target": job.target_id,
            "preset": job.settings.preset,
            "why": job.why,
        }
        for job in decision.jobs
    ]
    if not as_json:
        rows, more = rows[:40], len(rows) - 40
    show("would be planned", rows, as_json)
    if not as_json:
        if more > 0:
            console.print(f"... and {more} more; --json lists them all")
        for why, count in decision.reasons.items():
            console.print(f"{count:6d}  {why}")
        console.print(f"{decision.unchanged:6d}  unchanged")
