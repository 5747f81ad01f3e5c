"""What a run leaves in Prefect for people to read: a table and a few words."""

from __future__ import annotations

from collections.abc import Sequence

from prefect.artifacts import create_markdown_artifact, create_table_artifact

from upplied import fleet

MOST_ROWS = 500  # an artifact is for reading; the published table holds them all


def ingested_artifacts(key: str, ingested: Sequence[dict[str, str]]) -> str:
    """What became of each file; returns the same in one line."""
    counts = dict.fromkeys(("added", "unchanged", "retired", "failed"), 0)
    for item in ingested:
        counts[item["status"]] += 1
    summary = ", ".join(f"{count} {status}" for status, count in counts.items() if count) or "nothing"
    troubles = [item for item in ingested if item["status"] == "failed"]
    create_table_artifact(list(ingested[:MOST_ROWS]), key=f"{key}-files")
    create_markdown_artifact(f"## {key}\n\n{summary}\n\n{_listed(troubles)}", key=key)
    return summary


def transfer_artifacts(decision: fleet.Decision, result: fleet.Result, reports: str) -> str:
    """What was planned, why, and what did not succeed; returns the same in one line."""
    summary = f"{result}, {decision.unchanged} unchanged"
    why = "\n".join(f"* {count}: {reason}" for reason, count in decision.reasons.items())
    troubles = [{"name": job, "status": status, "reason": reason} for job, status, reason in result.troubles]
    rows = troubles or [{"name": "every plan", "status": "ok", "reason": ""}]
    create_table_artifact(rows[:MOST_ROWS], key="transfer-fleet-result")
    create_markdown_artifact(
        f"## transfer-fleet\n\n{summary}\n\n{why}\n\n{_listed(troubles)}\n\nReports: {reports}/index.html",
        key="transfer-fleet",
    )
    return summary


def maintenance_artifact(merged: dict[str, int], findings: Sequence[str]) -> str:
    """What maintenance did and found; returns the same in one line."""
    summary = f"{sum(merged.values())} files merged, {len(findings)} findings"
    listed = (
        "\n".join(f"* {finding}" for finding in findings[:MOST_ROWS]) or "Every reference and hash is right."
    )
    create_markdown_artifact(f"## maintain-catalog\n\n{summary}\n\n{listed}", key="maintain-catalog")
    return summary


def _listed(troubles: Sequence[dict[str, str]]) -> str:
    if not troubles:
        return "Nothing was refused or failed."
    lines = [f"* **{item['status']}** {item['name']}: {item['reason']}" for item in troubles[:MOST_ROWS]]
    return "\n".join(lines)
