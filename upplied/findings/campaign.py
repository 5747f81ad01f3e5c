"""One draft for each structure on which the place of a finding was not looked at yet: jobs of the fleet."""

import json
import logging
from collections.abc import Sequence
from typing import Any

import pandas as pd

from upplied.catalog import Catalog
from upplied.catalog.schema.plan_rows import transfer_id as id_of
from upplied.catalog.verbs.decisions import STATES
from upplied.catalog.verbs.queries import When
from upplied.config import digest
from upplied.errors import RefusedError, UppliedError
from upplied.findings.carried import Carrying
from upplied.findings.queries import photographed
from upplied.findings.reshoot import base_of, depends_on, mission
from upplied.fleet import new_run_id, planner, transfer
from upplied.fleet.decisions import Job
from upplied.records import Plan

log = logging.getLogger(__name__)

_PURPOSE = "campaign"  # how the purpose of its plans begins; its finding and mm/px follow


def selected_findings(catalog: Catalog, selection: str, structure_id: str) -> list[dict[str, Any]]:
    """The findings of ids that are listed with commas, or those of a state on a structure, one at least."""
    if selection.lower() not in STATES:
        return [catalog.finding(name.strip()) for name in selection.split(",") if name.strip()]
    rows = catalog.findings(structure=structure_id, state=selection.lower()).to_dict("records")
    if not rows:
        raise RefusedError(f"structure {structure_id}", f"has no {selection.lower()} finding", "one at least")
    return [{str(key): value for key, value in row.items()} for row in rows]


def plan_campaign(
    catalog: Catalog, row: dict[str, Any], mm_px: float, to: str = "kind", since: When | None = None
) -> list[dict[str, str]]:
    """Plan a mission to the place of a finding on each structure where no flight showed it.

    The row is of `findings`; `mm_px` is the largest ground sample distance, mm, of a look that counts, and of
    those that are planned. `to` is ``kind``, or ids with commas; looks before `since` do not count.

    Returned are of each structure its id, status (seen, refused, or the plan's: draft, released, rejected and
    others) and, in words, the look, the plan or why there is none.
    """
    jobs, results = campaign_jobs(catalog, row, mm_px, to, since)
    keys = [job.key for job in jobs]
    before = catalog.settled(keys)
    transfer(catalog, [job for job in jobs if job.key not in before], new_run_id(), plan=plan_job)
    columns, ids = ["transfer_id", "state", "warnings"], [id_of(key) for key in keys]
    rows = catalog.transfers(ids=ids, every=True, columns=columns).to_dict("records")
    plans = {one["transfer_id"]: one for one in rows}
    for job in jobs:
        status, words = catalog.settled([job.key]).get(job.key, ("failed", "its inputs changed"))
        if status == "ok":
            plan = plans[id_of(job.key)]
            texts = json.loads(plan["warnings"] or "[]")
            shown = next((text for text in texts if text.startswith("finding ")), "")
            status = str(plan["state"])
            words = f"{plan['transfer_id']}; {'planned before; ' if job.key in before else ''}{shown}"
        results.append({"structure_id": job.target_id, "status": status, "words": words})
    return sorted(results, key=lambda one: one["structure_id"])


def due_jobs(
    catalog: Catalog, findings: Sequence[str], mm_px: float, retry_failed: bool = False
) -> tuple[list[Job], list[str]]:
    """The jobs of the campaigns of findings that the catalog has no outcome of; and of others why, in words.

    They may include those that failed; what was refused is refused again only when its inputs change. See
    `plan_campaign`.
    """
    jobs, problems = list[Job](), []
    for start in findings:
        try:
            own, others = campaign_jobs(catalog, catalog.finding(start), mm_px)
        except UppliedError as error:
            problems.append(f"campaign {start}: {error}")
            continue
        jobs += own
        problems += [f"campaign {start}: {one['words']}" for one in others if one["status"] == "refused"]
    settled = catalog.settled([job.key for job in jobs], retry_failed=retry_failed)
    return [job for job in jobs if job.key not in settled], problems


def campaign_jobs(
    catalog: Catalog, row: dict[str, Any], mm_px: float, to: str = "kind", since: When | None = None
) -> tuple[list[Job], list[dict[str, str]]]:
    """A job for each structure where no flight showed the place of a finding; and, in words, of the others.

    Parameters are those of `plan_campaign`. The key of a job names all that its mission depends on.
    """
    carrying, jobs, others = Carrying(catalog), list[Job](), []
    names = ",".join(carrying.targets(str(row["target_id"]), to))
    if not names:
        raise RefusedError(f"finding {row['finding_id']}", "is on the only structure of its kind", "others")
    if not mm_px > 0:
        raise RefusedError("a campaign", f"was requested with {mm_px:g} mm a pixel", "more than 0")
    for there in photographed(catalog, row, names, mm_px, since, carrying=carrying).to_dict("records"):
        name = str(there["structure_id"])
        if not pd.isna(there["looked_at"]):
            words = f"{there['looked_at']:%Y-%m-%d} at {there['mm_px']:.2f} mm/px"
            others.append({"structure_id": name, "status": "seen", "words": words})
            continue
        try:
            base = base_of(catalog, name)
        except UppliedError as error:
            others.append({"structure_id": name, "status": "refused", "words": str(error)})
            continue
        key = digest([_PURPOSE, *depends_on(carrying, [row], base, mm_px)])
        pair = base.about["demonstration_id"], base.about["source_id"], name, base.target.kind
        reason = f"{name} was not looked at where finding {row['finding_id']} is"
        purpose = f"{_PURPOSE} {row['finding_id']} {mm_px!r}"
        jobs.append(Job(*pair, base.settings, key, reason, base.sha256, purpose))
    return jobs, others


def plan_job(job: Job) -> planner.Outcome:
    """Plan a job in a worker process: of a campaign its mission, any other as a transfer."""
    return planner.plan_job(job, _mission if job.purpose.startswith(f"{_PURPOSE} ") else _transferred)


def _transferred(catalog: Catalog, job: Job) -> Plan:
    """The plan of a transfer; its pair was studied for it, so questions about findings need not do so."""
    plan = planner.transferred(catalog, job)
    if (plan.status, job.settings.preset, job.purpose) == ("ok", "recommended", ""):
        try:
            carrying = Carrying(catalog)
            if job.source_id == carrying.reference(job.kind) != job.target_id:
                carrying.carried(job.source_id, job.target_id)
        except MemoryError:
            raise
        except Exception as error:  # no plan fails for a later question, whose answer then says why
            log.warning("%s: findings cannot be carried: %s", job, error)
    return plan


def _mission(catalog: Catalog, job: Job) -> Plan:
    _, finding_id, mm_px = job.purpose.split()
    base = base_of(catalog, job.target_id)
    if (base.sha256, base.settings.sha256) != (job.sha256, job.settings.sha256):
        return planner.superseded(job)
    return mission(Carrying(catalog), [catalog.finding(finding_id)], base, float(mm_px)).plan
