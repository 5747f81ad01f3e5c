"""Which plan is in force, told from the decisions in the order of their commits.

A release puts its plan in force and supersedes the one before; it does not count where somebody decided
meanwhile (`after` names the last decision it knew of). A rejected or recalled plan is not in force, and
none takes its place.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from upplied.catalog.schema.rows import Row

if TYPE_CHECKING:
    import pandas as pd

Unit = tuple[str, str, str]  # demonstration, target, purpose: of each, one plan is in force

#: Columns of `transfers` that follow from the decisions whenever they are read, and are never stored.
DERIVED = ("state", "state_at", "state_by", "state_note")


@dataclass
class Standing:
    """What follows from the decisions so far."""

    state: dict[str, str] = field(default_factory=dict)  # of plans that were decided about
    why: dict[str, Row] = field(default_factory=dict)  # plan -> the decision that gave it its state
    in_force: dict[Unit, Row] = field(default_factory=dict)  # the release that counts
    last: dict[Unit, str] = field(default_factory=dict)  # the decision that the next release must know of
    judged: dict[Unit, str] = field(default_factory=dict)  # target that the plan in force was last judged on
    order: dict[str, int] = field(default_factory=dict)  # decision -> where it stands among all
    void: set[str] = field(default_factory=set)  # releases that came after a decision they did not know of

    def of(self, transfer_id: str) -> str:
        """The state of a plan that has a path."""
        return self.state.get(transfer_id, "draft")

    def give(self, plan: str, state: str, row: Row) -> None:
        """Let a decision give a plan its state."""
        self.state[plan], self.why[plan] = state, row


def unit_of(row: Mapping[str, Any]) -> Unit:
    """Of what a plan, or a decision about it, is one of many."""
    return str(row["demonstration_id"]), str(row["target_id"]), str(row.get("purpose") or "")


def standing_of(decisions: Iterable[Row]) -> Standing:
    """What follows from decisions, in the order of commits."""
    now = Standing()
    for row in decisions:
        now.order[row["decision_id"]] = len(now.order)
        unit, plan, state = unit_of(row), row["transfer_id"], row["state"]
        before = now.in_force.get(unit)
        if state == "released":
            if (row["after"] or "") != now.last.get(unit, ""):
                now.void.add(row["decision_id"])
                continue
            if before is not None and before["transfer_id"] != plan:
                now.give(before["transfer_id"], "superseded", row)
            now.in_force[unit], now.judged[unit] = row, row["target_sha256"]
            now.give(plan, "released", row)
        elif state in ("rejected", "recalled"):
            if before is not None and before["transfer_id"] == plan:
                del now.in_force[unit]
            now.give(plan, state, row)
        elif state == "reviewed" and now.of(plan) in ("draft", "reviewed"):
            now.give(plan, state, row)
        elif state == "rechecked" and before is not None and before["transfer_id"] == plan:
            now.judged[unit] = row["target_sha256"]
        if state not in ("reviewed", "rechecked"):
            now.last[unit] = row["decision_id"]
    return now


def with_states(plans: pd.DataFrame, now: Standing) -> pd.DataFrame:
    """Rows of `transfers` with the columns that follow from the decisions, where they have those."""
    import pandas as pd

    ids = plans["transfer_id"]
    decided = ids[ids.isin(list(now.state))]  # few of many
    why = [now.why[plan] for plan in decided]
    values = {"state": ("draft", [now.state[plan] for plan in decided])}
    values |= {f"state_{name}": ("", [row[name] for row in why]) for name in ("by", "note")}
    values["state_at"] = (pd.NaT, [row["added_at"] for row in why])
    known = {}
    for name, (usual, of_decided) in values.items():
        if name in plans or name == "state":
            known[name] = pd.Series(usual, plans.index, dtype=object)
            known[name].loc[decided.index] = of_decided
    known["state"] = known["state"].where(plans["status"] == "ok", "")
    if "state_at" in known:
        known["state_at"] = pd.to_datetime(known["state_at"], utc=True)
    return plans.assign(**known)
