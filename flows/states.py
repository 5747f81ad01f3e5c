"""How a run ended, in a state that an alert can tell from another, and what it leaves for people to read."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Sequence
from functools import wraps
from html import escape
from inspect import signature
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

from prefect.artifacts import create_link_artifact, create_markdown_artifact, create_table_artifact
from prefect.states import Completed, Failed, State

from upplied import fleet
from upplied.catalog import Catalog
from upplied.catalog.schema.plan_rows import transfer_id
from upplied.checks import pair_name
from upplied.errors import UppliedError
from upplied.outputs.labels import LABELS

from .environment import ADDRESS, home

if TYPE_CHECKING:
    from .engines import Planned

TROUBLED = "CompletedWithFailures"  # the run did its work, and some of it failed
LAST_WORDS = 3  # of what failed, in a state's message; the artifact has them all

P = ParamSpec("P")


def errors_in_words(flow: Callable[P, State]) -> Callable[P, State]:
    """A flow whose errors that a person can mend end it in their own words, not in a traceback."""

    @wraps(flow)
    def run(*args: P.args, **kwargs: P.kwargs) -> State:
        try:
            return flow(*args, **kwargs)
        except UppliedError as error:
            return Failed(message=str(error))
        except OSError as error:  # of the machine: a full disk, a right that is missing
            return Failed(message=f"{error.filename or type(error).__name__}: {error.strerror or error}")

    # Prefect makes its form of the parameters from these, in whose module the names may not be known.
    run.__signature__ = signature(flow, eval_str=True)  # type: ignore[attr-defined]
    return run


def planned(summary: str, outcome: Planned, problems: Sequence[str], most_lost: float) -> State:
    """The state of a run that planned: failed where all of it failed, or the engine lost more than its share.

    `problems` went wrong besides; `most_lost` is the share of shards that the engine may lose.
    """
    failures = [f"{job}: {reason}" for job, status, reason in outcome.result.troubles if status == "failed"]
    message = ". ".join(filter(None, (summary, outcome.loss)))
    if len(outcome.lost) > most_lost * outcome.shards:
        return Failed(message=f"{message}. More than {most_lost:.0%} of the shards were lost")
    recalls = [text for text in problems if text.startswith("RECALLED")]  # before all else
    others = [text for text in problems if text not in recalls]
    every = bool(failures) and len(failures) == outcome.result.total
    return ended(message, [*recalls, *failures, *others], every)


def ingested(summary: str, files: Sequence[dict[str, str]], problems: Sequence[str] = ()) -> State:
    """The state of a run that read files: failed where none could be read; `problems` went wrong besides."""
    failures = [item["reason"] for item in files if item["status"] == "failed"]
    return ended(summary, [*failures, *problems], bool(failures) and len(failures) == len(files))


def ended(summary: str, problems: Sequence[str], all_failed: bool = False) -> State:
    """Completed; completed with failures where there are problems, the first of which are told; or failed."""
    if not problems:
        return Completed(message=summary)
    more = f"; and {len(problems) - LAST_WORDS} more" if len(problems) > LAST_WORDS else ""
    message = f"{summary}. {'; '.join(problems[:LAST_WORDS])}{more}"
    return Failed(message=message) if all_failed else Completed(name=TROUBLED, message=message)


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
    titles = LABELS["lineage"]  # what people look for first
    plans = catalog.transfers(every=True, ids=ids, columns=["planned_at", *titles])
    plans = plans.sort_values("planned_at").drop_duplicates("transfer_id", keep="last")
    plans = plans.assign(fine=plans["status"] == "ok")
    plans = plans.sort_values(["fine", "demonstration_id", "target_id", "preset"]).head(MOST_ROWS)
    rows = []
    for plan in plans[list(titles)].to_dict("records"):
        page = f"transfers/{pair_name(plan['demonstration_id'], plan['target_id'])}.html"
        link = {"page": f"[open]({address(reports, page)})"} if reports else {}
        rows.append(link | {titles[name]: _readable(value) for name, value in plan.items()})
    return rows


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
