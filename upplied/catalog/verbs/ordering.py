"""Which row of a plan, a pair or an id counts, and which plan is in force, by the order of commits.

Of rows the newest counts, and no failure before a plan. A release puts its plan in force and supersedes the
one before; it does not count where somebody decided meanwhile (`after` names the last decision it knew of).
A rejected or recalled plan is not in force, and none takes its place.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds

from upplied.catalog.schema import plan_rows
from upplied.catalog.schema.rows import Row
from upplied.catalog.store.delta import StoredTable
from upplied.catalog.store.files import explained

PAIR = ["demonstration_id", "target_id", "preset"]
SLOT = [*PAIR, "purpose"]  # of these, the newest plan is current
NEWEST = ["commit_version", "planned_at"]  # what orders plans; the time counts within a commit
_FEW_KEYS = 5000  # up to here their pairs are asked for alone
_MOST_ROWS = 50_000  # of a table that is kept at hand, a kilobyte each
COMMIT = ("commit_version", "added_at", "commit_id")  # what orders rows of an id, whatever clocks say
ORDERED = ["transfer_id", *SLOT, "status", *NEWEST]  # what `in_order` goes by


class Current:
    """Finds the newest row of an id, again and again; a small table is read once for each version."""

    def __init__(self, table: StoredTable) -> None:
        self._table = table
        self._at_hand: tuple[ds.Dataset, pa.Table, dict[str, int]] | None = None

    def row(self, name: str) -> Row | None:
        """The current version of an id, retired or not; None where there is none."""
        dataset, key = self._table.dataset(), self._table.declared.names[0]
        if dataset is None:
            return None
        if self._at_hand is None or self._at_hand[0] is not dataset:
            if explained(self._table.uri, dataset.count_rows) > _MOST_ROWS:
                return newest_rows(self._table, pc.field(key) == name).get(name)
            table = self._table.read().sort_by([(each, "ascending") for each in COMMIT])
            self._at_hand = dataset, table, {each: at for at, each in enumerate(table[key].to_pylist())}
        _, table, places = self._at_hand
        return table.slice(places[name], 1).to_pylist()[0] if name in places else None


def newest_rows(table: StoredTable, where: ds.Expression | None = None) -> dict[str, Row]:
    """The current version of each id, retired ones too; of those that came at once, the last."""
    name = table.declared.names[0]
    return {row[name]: row for row in by_commit(table.read(where))}


def by_commit(table: pa.Table) -> list[Row]:
    """Rows in the order of their commits."""
    return sorted(table.to_pylist(), key=itemgetter(*COMMIT))


def retired(table: StoredTable, where: ds.Expression | None = None) -> list[str]:
    """The ids whose current version is retired."""
    name, every = table.declared.names[0], pc.scalar(True) if where is None else where
    ids = table.read(every & pc.field("retired"), [name])[name].unique()  # that ever were: few, mostly none
    newest = newest_rows(table, every & pc.field(name).isin(ids)) if len(ids) else {}
    return [each for each, row in newest.items() if row["retired"]]


def rows_of_keys(table: StoredTable, keys: Iterable[str]) -> dict[str, Row]:
    """The row that stands for each of the keys that are known."""
    known = table.named(ids_of(list(keys)))  # of one narrow column: most often there are none
    if not len(known):
        return {}
    rows = in_order(table.read(pc.field("transfer_id").isin(known)), newest=False)
    return {row["key"]: row for row in rows.to_pylist()}


def superseded(table: StoredTable, plans: list[Row]) -> list[Row]:
    """Those of the stored plans that are not the newest of their demonstration, target and preset."""
    if not plans:
        return []
    where = pc.field("demonstration_id").isin(list({row["demonstration_id"] for row in plans}))
    where &= pc.field("target_id").isin(list({row["target_id"] for row in plans}))
    current = set(in_order(table.read(where, ORDERED), newest=True)["transfer_id"].to_pylist())
    return [row for row in plans if row["transfer_id"] not in current]


def ids_of(keys: Sequence[str] | pa.Array) -> pa.Array:
    """The names of the plans with these keys."""
    texts = keys if isinstance(keys, pa.Array) else pa.array(keys, pa.string())
    return pc.utf8_slice_codeunits(texts, 0, plan_rows.ID_DIGITS)


def settled_plans(
    table: StoredTable, ids: pa.Array, retry_failed: bool, run_id: str, more: list[str]
) -> pa.Table:
    """The plans of these ids that are current of their pair, preset and purpose."""
    where = None
    if len(ids) <= _FEW_KEYS:  # those of their pairs are enough, where there are any
        known = table.read(pc.field("transfer_id").isin(ids), PAIR[:2])
        first, second = (pc.field(name).isin(known[name].unique()) for name in PAIR[:2])
        where = first & second
    ours = ["run_id"] if retry_failed and run_id else []
    plans = in_order(table.narrow([*ORDERED, "imported_from", *ours, *more], where), newest=True)
    foreign = pc.ends_with(plans["imported_from"].cast(pa.string()), plan_rows.AS_IT_SAYS)
    mask = pc.and_(pc.is_in(plans["transfer_id"], ids), pc.invert(foreign))
    if retry_failed:
        ended = pc.not_equal(plans["status"], "failed")
        mask = pc.and_(mask, pc.or_(ended, pc.equal(plans["run_id"], run_id)) if ours else ended)
    return plans.filter(mask)


def in_order(table: pa.Table, newest: bool) -> pa.Table:
    """One row per plan, its newest, ordered by pair and commit; with `newest`, the last of each pair."""
    # A failure may be followed, racing writers may add a plan twice, and one may become current again.
    pairs, chosen = np.zeros(len(table), np.int64), np.arange(len(table))
    for name in SLOT:  # a number per row that is the same for the same pair, and grows with its names
        encoded = table[name].combine_chunks().dictionary_encode()
        rank = pc.rank(encoded.dictionary).take(encoded.indices).to_numpy().astype(np.int64)
        pairs = pairs * (1 + len(encoded.dictionary)) + rank
    commit, planned = (table[name].cast(pa.int64()).to_numpy() for name in NEWEST)
    plans = table["transfer_id"].combine_chunks().dictionary_encode()
    if len(plans.dictionary) < len(table):  # of a plan one that is no failure stands, and of those the newest
        codes, succeeded = plans.indices.to_numpy(), pc.not_equal(table["status"], "failed").to_numpy()
        order = np.lexsort((planned, commit, succeeded, codes))
        chosen = np.sort(order[np.flatnonzero(np.diff(codes[order], append=-1))])
    order = chosen[np.lexsort((planned[chosen], commit[chosen], pairs[chosen]))]
    if newest:
        order = order[np.flatnonzero(np.diff(pairs[order], append=-1))]
    return table.take(order)


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
            if before is not None and (other := before["transfer_id"]) != plan:
                now.state[other], now.why[other] = "superseded", row
            now.in_force[unit], now.judged[unit] = row, row["target_sha256"]
        elif before is not None and before["transfer_id"] == plan:
            if state in ("rejected", "recalled"):
                del now.in_force[unit]
            elif state == "rechecked":
                now.judged[unit] = row["target_sha256"]
        if decisive := state in ("released", "rejected", "recalled"):
            now.last[unit] = row["decision_id"]
        if decisive or (state == "reviewed" and now.of(plan) in ("draft", "reviewed")):
            now.state[plan], now.why[plan] = state, row
    return now


def with_states(plans: pd.DataFrame, now: Standing) -> pd.DataFrame:
    """Rows of `transfers` with the columns that follow from the decisions, where they have those."""
    ids = plans["transfer_id"]
    decided = ids[ids.isin(list(now.state))]  # few of many
    why = [now.why[plan] for plan in decided]
    values = {"state": ("draft", [now.state[plan] for plan in decided])}
    values |= {f"state_{name}": ("", [row[name] for row in why]) for name in ("by", "note")}
    values["state_at"] = (pd.NaT, [row["added_at"] for row in why])
    known = {}
    for name in [name for name in values if name in plans or name == "state"]:
        known[name] = pd.Series(values[name][0], plans.index, dtype=object)
        known[name].loc[decided.index] = values[name][1]
    known["state"] = known["state"].where(plans["status"] == "ok", "")
    if "state_at" in known:
        known["state_at"] = pd.to_datetime(known["state_at"], utc=True)
    return plans.assign(**known)
