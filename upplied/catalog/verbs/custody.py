"""Whether a plan that was released is still what was released, and whether it was measured here at all."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.schema import plan_rows
from upplied.catalog.schema.rows import ADDED, Row
from upplied.catalog.store.chain import changed_rows, content_hashes, head_of
from upplied.catalog.verbs import ordering
from upplied.catalog.verbs.owned import step_faults
from upplied.catalog.verbs.roster import roster_of
from upplied.errors import RefusedError

if TYPE_CHECKING:
    from upplied.catalog.reading import Reading
    from upplied.catalog.verbs.standing import Standing

HEAD_DIGITS = 20  # of a hash, where people read it
_NOT_ITS_OWN = {*ADDED, "planned_at"}  # of a row of plans: another when it becomes current again


def alterations(catalog: Reading, transfer_ids: Collection[str], now: Standing) -> dict[str, str]:
    """Why plans are not what was released, in words: waypoints, rows and releases are compared again."""
    released = {plan: now.why[plan] for plan in transfer_ids if now.of(plan) == "released"}
    if not released:
        return {}
    rows, hashes = stored_plans(catalog, released)
    roster, order = roster_of(catalog), now.order
    table, names = catalog.tables["decisions"], [row["decision_id"] for row in released.values()]
    changed = dict(changed_rows(table.declared, table.whole(pc.field("decision_id").isin(names))))
    faults = dict(step_faults(catalog, "waypoints", rows))
    for row in rows.select(["transfer_id", "waypoints_sha256"]).to_pylist():
        plan, decision = row["transfer_id"], released[row["transfer_id"]]
        if decision["decision_id"] in changed:
            faults[plan] = f"its release {changed[decision['decision_id']]}"
        elif wrong := roster.fault(decision, order):
            faults[plan] = f"its release does not count: {wrong}"
        elif decision["plan_sha256"] != row["waypoints_sha256"]:
            faults[plan] = "its waypoints are not those that were released"
        elif decision["plan_row_sha256"] and decision["plan_row_sha256"] != hashes[plan]:
            faults[plan] = "its row differs from the one that was released"
    return faults


def check_releasable(catalog: Reading, row: Row) -> None:
    """Refuse a plan that was never measured here, or whose row or steps are not as they were written."""
    what = f"release of {row['transfer_id']}"
    if plan_rows.is_foreign(row):
        raise RefusedError(what, *FOREIGN_PLAN, "plan it here, or import it again with --verify")
    catalog.path_of(row)
    stored, _ = stored_plans(catalog, [row["transfer_id"]])
    for _, wrong in changed_rows(catalog.tables["transfers"].declared, stored):
        raise RefusedError(what, f"its row {wrong}", "what is released is what was planned", "plan it again")


FOREIGN_PLAN = ("it was imported and not measured here", "what is flown was judged here")


def chain_heads(catalog: Reading) -> dict[str, str]:
    """The hash of the last row of each table whose rows follow each other: it proves those before it."""
    chained = {name: table.whole() for name, table in catalog.tables.items() if table.declared.is_chained}
    heads = {name: head_of(rows) for name, rows in chained.items() if len(rows)}
    return {name: sha256 for name, sha256 in heads.items() if sha256}


def foreign_plans(catalog: Reading) -> list[str]:
    """The plans that were imported and not measured here."""
    columns = ["transfer_id", "imported_from", "status", *ordering.SLOT, *ordering.NEWEST]
    rows = ordering.in_order(catalog.tables["transfers"].read(None, columns), newest=False)
    return [row["transfer_id"] for row in rows.to_pylist() if plan_rows.is_foreign(row)]


def heads_in_words(heads: dict[str, str]) -> str:
    """The heads of decisions and flights, in one line; empty where there are none."""
    tables = ("decisions", "flights")
    return ", ".join(f"{name} {heads[name][:HEAD_DIGITS]}" for name in tables if name in heads)


def stored_plans(catalog: Reading, transfer_ids: Collection[str]) -> tuple[pa.Table, dict[str, str]]:
    """The rows that stand for plans, with all their columns, and the hash of what each says."""
    ids = pa.array(sorted(transfer_ids), pa.string())
    rows = catalog.tables["transfers"].whole(pc.field("transfer_id").isin(ids))
    rows = ordering.in_order(rows, newest=False)
    own = rows.select([name for name in rows.column_names if name not in _NOT_ITS_OWN])
    names = rows["transfer_id"].to_pylist()
    return rows, dict(zip(names, content_hashes(own), strict=True))
