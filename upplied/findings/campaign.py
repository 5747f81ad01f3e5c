"""One draft for each structure on which the place of a finding was not looked at yet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from upplied.catalog import Catalog
from upplied.catalog.verbs.findings import STATES
from upplied.catalog.verbs.queries import When
from upplied.errors import RefusedError, UppliedError
from upplied.findings.carried import Carrying
from upplied.findings.queries import photographed
from upplied.findings.reshoot import plan_reshoot, purpose_of
from upplied.planning.plan import METHOD_VERSION


def selected_findings(catalog: Catalog, selection: str, structure_id: str) -> list[dict[str, Any]]:
    """The findings of ids that are listed with commas, or those of a state on a structure.

    Raises
    ------
    RefusedError
        If there are none.
    CatalogError
        If an id is not known.
    """
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

    Parameters
    ----------
    catalog : Catalog
    row : dict
        Of `findings`.
    mm_px : float
        The largest ground sample distance of a look that counts, and of those that are planned, mm.
    to : str
        ``kind``, or ids with commas.
    since : datetime or str, optional
        Looks before that moment do not count.

    Returns
    -------
    list of dict
        Of each structure its id, status (seen, refused, or the plan's: draft, released, rejected and others)
        and, in words, the look, the plan or why there is none.
    """
    carrying, results = Carrying(catalog), []
    names = ",".join(carrying.targets(str(row["target_id"]), to))
    if not names:
        raise RefusedError(f"finding {row['finding_id']}", "is on the only structure of its kind", "others")
    for there in photographed(catalog, row, names, mm_px, since, carrying=carrying).to_dict("records"):
        name = str(there["structure_id"])
        if not pd.isna(there["looked_at"]):
            status, words = "seen", f"{there['looked_at']:%Y-%m-%d} at {there['mm_px']:.2f} mm/px"
        elif planned := _planned(catalog, name, purpose_of([str(row["finding_id"])], mm_px)):
            status, words = planned
        else:
            try:
                mission = plan_reshoot(catalog, [row], name, mm_px, carrying)
                status, words = "draft", f"{mission.transfer_id}; {mission.words[1]}"
            except UppliedError as error:
                status, words = "refused", str(error)
        results.append({"structure_id": name, "status": status, "words": words})
    return results


def plan_campaigns(catalog: Catalog, findings: Sequence[str], mm_px: float) -> list[str]:
    """Plan the campaigns of several findings; what kept a whole one from being planned, in words."""
    problems = []
    for start in findings:
        try:
            plan_campaign(catalog, catalog.finding(start), mm_px)
        except UppliedError as error:
            problems.append(f"campaign {start}: {error}")
    return problems


def _planned(catalog: Catalog, structure_id: str, purpose: str) -> tuple[str, str] | None:
    """State and words of the newest plan for a purpose round a structure as it is, by the method as it is."""
    rows = catalog.transfers(structure=structure_id, preset="recommended", status="ok", every=True)
    rows = rows[(rows["purpose"] == purpose) & (rows["method_version"] == METHOD_VERSION)]
    rows = rows[rows["target_sha256"] == catalog.newest("structures", structure_id)["sha256"]]
    if rows.empty:
        return None
    newest = rows.iloc[-1]
    return str(newest["state"]), f"{newest['transfer_id']}; planned before"
