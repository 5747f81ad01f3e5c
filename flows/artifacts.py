"""What a run leaves in Prefect for people to read: tables, a few words, and where the report is."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Sequence
from html import escape
from itertools import islice
from pathlib import Path
from typing import Any

from prefect.artifacts import create_link_artifact, create_markdown_artifact, create_table_artifact

from upplied import fleet
from upplied.catalog import Catalog
from upplied.catalog.schema.plan_rows import transfer_id
from upplied.checks import pair_name

from .environment import home

ADDRESS = "UPPLIED_REPORTS_URL"  # of the pages, where a server shows them
_OUTCOMES = ("added", "unchanged", "retired", "failed", "passed over")  # of a file
MOST_ROWS = 500  # an artifact is for reading; the published table holds them all


def ingested_artifacts(
    key: str, ingested: Sequence[fleet.Ingested | dict[str, str]]
) -> tuple[str, list[dict[str, str]]]:
    """What became of each file; returns the same in one line, and as texts."""
    files = [
        item if isinstance(item, dict) else {**vars(item), "findings": "; ".join(item.findings)}
        for item in ingested
    ]
    counts = Counter(item["status"] for item in files)
    summary = ", ".join(f"{counts[status]} {status}" for status in _OUTCOMES if counts[status]) or "nothing"
    troubles = [item for item in files if item["status"] == "failed"]
    rows = [{name: _readable(value) for name, value in item.items()} for item in files[:MOST_ROWS]]
    create_table_artifact(rows, key=f"{key}-files")
    create_markdown_artifact(f"## {key}\n\n{summary}\n\n{_listed(troubles)}", key=key)
    return summary, files


def transfer_artifacts(catalog: Catalog, decision: fleet.Decision, result: fleet.Result, reports: str) -> str:
    """What was planned, why, what did not succeed, and from which log to which page; the same in one line."""
    summary = f"{result}, {decision.unchanged} unchanged"
    why = "\n".join(f"* {count}: {reason}" for reason, count in decision.reasons.items())
    troubles = [{"name": job, "status": status, "reason": reason} for job, status, reason in result.troubles]
    if decision.jobs:  # else the last run that planned something stays the one to read
        create_table_artifact(_planned(catalog, decision, result, reports), key="transfer-fleet-result")
    text = f"## transfer-fleet\n\n{summary}\n\n{why}\n\n{_listed(troubles)}"
    if reports:
        index = address(reports, "index.html")
        text += f"\n\nReports: [{Path(reports).absolute() / 'index.html'}]({index})"
        create_link_artifact(index, link_text="the fleet's report", key="transfer-fleet-report")
    create_markdown_artifact(text, key="transfer-fleet")
    return summary


def _planned(
    catalog: Catalog, decision: fleet.Decision, result: fleet.Result, reports: str
) -> list[dict[str, Any]]:
    """The plans of a run with where each came from, log to page; those that did not succeed come first."""
    troubled = {name for name, _, _ in result.troubles}
    first = [job for job in decision.jobs if str(job) in troubled][:MOST_ROWS]
    rest = islice((job for job in decision.jobs if str(job) not in troubled), MOST_ROWS - len(first))
    ids = [transfer_id(job.key) for job in (*first, *rest)]
    plans = catalog.transfers(every=True, ids=ids, columns=["planned_at", *_LINEAGE])
    plans = plans.sort_values("planned_at").drop_duplicates("transfer_id", keep="last")
    plans = plans.assign(fine=plans["status"] == "ok")
    plans = plans.sort_values(["fine", "demonstration_id", "target_id", "preset"]).head(MOST_ROWS)
    rows = []
    for plan in plans[list(_LINEAGE)].to_dict("records"):
        page = f"transfers/{pair_name(plan['demonstration_id'], plan['target_id'])}.html"
        link = {"page": f"[open]({address(reports, page)})"} if reports else {}
        rows.append(link | {_LINEAGE[name]: _readable(value) for name, value in plan.items()})
    return rows


# From the log to the trajectory: column of the catalog, and how it is headed. What people look for first.
_LINEAGE = {
    "demonstration_id": "demonstration",
    "target_id": "target",
    "preset": "preset",
    "status": "status",
    "coverage_inspected_pct": "inspected %",
    "coverage_seen_pct": "coverage seen %",
    "frechet_z": "Frechet z",
    "min_clearance_m": "clearance m",
    "planning_s": "planning s",
    "reason": "reason",
    "transfer_id": "trajectory",
    "demonstration_sha256": "log (sha256)",
}


def _readable(value: object) -> object:
    """A number to two places, nothing for none, and text as text: names and reasons come from files."""
    if isinstance(value, float):
        return "" if math.isnan(value) else round(value, 2)
    return escape(value, quote=False) if isinstance(value, str) else value


def maintenance_artifact(merged: dict[str, int], findings: Sequence[str]) -> str:
    """What maintenance did and found; returns the same in one line."""
    summary = f"{sum(merged.values())} files merged, {len(findings)} findings"
    listed = "\n".join(f"* {finding}" for finding in findings[:MOST_ROWS])
    listed = listed or "Every reference and hash is right."
    create_markdown_artifact(f"## maintain-catalog\n\n{summary}\n\n{listed}", key="maintain-catalog")
    return summary


def _listed(troubles: Sequence[dict[str, str]]) -> str:
    if not troubles:
        return "Nothing was refused or failed."
    lines = [
        f"* **{item['status']}** {_readable(item['name'])}: {_readable(item['reason'])}"
        for item in troubles[:MOST_ROWS]
    ]
    return "\n".join(lines)


def address(reports: str, page: str) -> str:
    """Address of a page: over HTTP where a server shows this fleet, else of a file in the reports' folder."""
    folder, url = Path(reports).absolute(), os.environ.get(ADDRESS)
    served = url and folder == home() / "reports"
    return f"{url.rstrip('/')}/{page}" if url and served else (folder / page).as_uri()
