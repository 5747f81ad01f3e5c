"""What people decide about plans, and what the check of a changed structure finds.

Every decision is a row that is added; which plan is in force follows from the rows (`standing`). Two who
release at once are told apart by the order of their commits: each release names the last decision that it
knew of, so the second does not count, and whoever made it is told.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import pandas as pd
import pyarrow.compute as pc

from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs import adding, custody, ordering, queries
from upplied.catalog.verbs.frames import frame
from upplied.catalog.verbs.roster import check_name, roster_of, signature
from upplied.catalog.verbs.standing import Standing, standing_of, unit_of
from upplied.errors import RefusedError, SettingsError
from upplied.provenance import code_version

if TYPE_CHECKING:
    from upplied.catalog.reading import Reading

#: Rules that a release keeps unless it is forced by their names, and why.
RELEASE_RULES = {
    "preset": "only `recommended` is made to be flown",
    "verdict": "the plan reaches what it must to be flown",
    "rejected": "nobody rejected it",
    "recalled": "it was not recalled",
    "changed": "the structure is as it was when the plan was made",
}
_LONGEST = 2000  # letters of a name or note: it stands on pages


def decisions(catalog: Reading, transfer_id: str | None = None) -> pd.DataFrame:
    """See `Catalog.decisions`."""
    table = catalog.tables["decisions"]
    where = None if transfer_id is None else pc.field("transfer_id") == transfer_id
    found = frame(table.read(where)).sort_values("commit_version", kind="stable")
    return found.reset_index(drop=True)


def standing(catalog: Reading) -> Standing:
    """What follows from all decisions of a catalog."""
    return standing_of(queries.decided(catalog.tables["decisions"]))


def in_force(catalog: Reading, **asked: Any) -> pd.DataFrame:
    """See `Catalog.in_force`."""
    found = catalog.transfers(in_force=True, **asked)
    newest = catalog.transfers(columns=["transfer_id", *ordering.PAIR, "status"], **asked)
    newest = newest[newest["status"] == "ok"].rename(columns={"transfer_id": "newer_draft"})
    found = found.merge(newest.drop(columns="status"), how="left", on=ordering.PAIR)
    same = (found["newer_draft"] == found["transfer_id"]) | (found["purpose"] != "")
    found["newer_draft"] = found["newer_draft"].where(~same).fillna("")
    hashes = catalog.structures().set_index("structure_id")["sha256"]
    judged = standing(catalog).judged
    now = [judged.get(unit_of(row)) == hashes.get(row["target_id"]) for row in found.to_dict("records")]
    found["target_changed"] = [not same for same in now]
    altered = custody.alterations(catalog, found["transfer_id"].tolist(), standing(catalog))
    found["altered"] = found["transfer_id"].map(altered).fillna("").astype(object)
    return found


def foremost(catalog: Reading, columns: Sequence[str]) -> pd.DataFrame:
    """The newest plans, but the one in force in the place of the newest of its pair and preset.

    A plan in force whose demonstration is retired stays.
    """
    read = list(dict.fromkeys([*columns, *ordering.PAIR, "purpose"]))
    newest, force = catalog.transfers(columns=read), catalog.transfers(in_force=True, columns=read)
    force = force[force["purpose"] == ""]
    if not len(force):
        return newest
    pair = pd.MultiIndex.from_frame(newest[ordering.PAIR])
    left = newest[~pair.isin(pd.MultiIndex.from_frame(force[ordering.PAIR]))]
    every = pd.concat([left, force]) if len(left) else force
    return every.sort_values(ordering.PAIR, kind="stable").reset_index(drop=True)


def recalled(catalog: Reading, structure: str | None = None) -> pd.DataFrame:
    """See `Catalog.recalled`."""
    now = standing(catalog)
    left = {
        row["transfer_id"]
        for plan, row in now.why.items()
        if now.state[plan] == "recalled" and now.last[unit_of(row)] == row["decision_id"]
    }
    every = catalog.transfers(every=True, structure=structure, ids=sorted(left))
    used = set(catalog.structures()["structure_id"])
    return every[every["target_id"].isin(used)].reset_index(drop=True)


def review(catalog: Reading, transfer_id: str, by: str, note: str = "") -> str:
    """See `Catalog.review`."""
    row = _plan(catalog, transfer_id)
    return _decide(catalog, row, "reviewed", by, note)


def reject(catalog: Reading, transfer_id: str, by: str, note: str = "") -> str:
    """See `Catalog.reject`."""
    row = _plan(catalog, transfer_id)
    return _decide(catalog, row, "rejected", by, note)


def release(
    catalog: Reading,
    transfer_id: str,
    by: str,
    note: str = "",
    force: Sequence[str] = (),
    after: str | None = None,
) -> str:
    """See `Catalog.release`."""
    row = _plan(catalog, transfer_id)
    custody.check_releasable(catalog, row)
    now = standing(catalog)
    roster_of(catalog).check_may_release(by.strip())
    forced = _check_release(catalog, row, now.of(transfer_id), tuple(force))
    unit = unit_of(row)
    known = now.last.get(unit, "") if after is None else after
    said = {"after": known, "forced": "; ".join(forced), "target_sha256": _target_sha256(catalog, row)}
    made = _decide(catalog, row, "released", by, note, **said)
    again = standing(catalog)
    if made in again.void:
        there = again.in_force.get(unit)
        found = "somebody decided about this pair meanwhile"
        found += (
            "" if there is None else f": {there['by']} released {there['transfer_id']}, which is in force"
        )
        raise RefusedError(
            f"release of {transfer_id}", found, "who releases knows what was decided before", "look again"
        )
    return made


def recall(catalog: Reading, row: Row, note: str, target_sha256: str, by: str) -> str:
    """Take a plan out of force whose structure changed so that it is not safe there; the decision's name."""
    return _decide(catalog, row, "recalled", by, note, target_sha256=target_sha256)


def rechecked(
    catalog: Reading, row: Row, note: str, target_sha256: str, by: str, supposed_sha256: str = ""
) -> str:
    """Keep that a plan in force was judged on its changed structure, and stays in force.

    `supposed_sha256` is that of what of the changed structure was never scanned (`Catalog.supposed`).
    """
    said = {"target_sha256": target_sha256, "supposed_sha256": supposed_sha256}
    return _decide(catalog, row, "rechecked", by, note, **said)


def _plan(catalog: Reading, transfer_id: str) -> Row:
    row = catalog.transfer(transfer_id)
    if row["status"] != "ok" or not row["n_waypoints"]:
        found = f"has no path: it is {row['status']}: {row['reason']}"
        raise RefusedError(f"plan {transfer_id}", found, "what is decided about can be flown")
    return row


def _check_release(catalog: Reading, row: Row, state: str, force: tuple[str, ...]) -> list[str]:
    """The rules that are broken and overruled, in words; refuses where others are broken."""
    unknown = sorted(set(force) - set(RELEASE_RULES))
    if unknown:
        raise SettingsError(f"rule {unknown[0]!r}", "is unknown", f"one of {', '.join(RELEASE_RULES)}")
    what = f"release of {row['transfer_id']}"
    purpose = row["purpose"] or ""
    if purpose.startswith("experiment "):
        raise RefusedError(
            what, f"it is of the {purpose}", "an experiment is never in force", "plan it without --experiment"
        )
    broken = []
    if row["preset"] != "recommended" and not purpose:
        broken.append(("preset", f"it is of preset {row['preset']}"))
    if not row["flyable"]:
        broken.append(("verdict", row["not_flyable"] or "it was planned before anybody asked"))
    if state in ("rejected", "recalled"):
        broken.append((state, f"it was {state}"))
    if row["target_sha256"] and row["target_sha256"] != _target_sha256(catalog, row):
        broken.append(("changed", f"{row['target_id']} changed since it was planned"))
    left = [(rule, found) for rule, found in broken if rule not in force]
    if left:
        rule, found = left[0]
        more = "".join(f"; {rule}: {found}" for rule, found in left[1:])
        raise RefusedError(what, f"{found}{more}", RELEASE_RULES[rule], f"or overrule it: --force {rule}")
    return [f"{rule}: {found}" for rule, found in broken]


def _target_sha256(catalog: Reading, row: Row) -> str:
    return str(catalog.newest("structures", row["target_id"])["sha256"])


def _decide(catalog: Reading, row: Row, state: str, by: str, note: str, **said: str) -> str:
    """Add a decision; its name."""
    for what, text in (("name", by), ("note", note)):
        if len(text) > _LONGEST:
            raise SettingsError(f"{what} of a decision", f"has {len(text)} letters", f"at most {_LONGEST}")
    if not by.strip():
        raise SettingsError("a decision", "says not who decided", "a name", "say --by NAME")
    check_name(by.strip())
    name = adding.new_commit_id(catalog)
    made = {
        "decision_id": name,
        **{key: row[key] or "" for key in ("transfer_id", "demonstration_id", "target_id", "purpose")},
        "state": state,
        "by": by.strip(),
        "note": note,
        "plan_sha256": row["waypoints_sha256"],
        "plan_row_sha256": custody.seals(catalog, [row["transfer_id"]])[row["transfer_id"]],
        "code_version": code_version(),
        **said,
    }
    made["signature"] = signature(roster_of(catalog), made)
    adding.add_rows(catalog, "decisions", [made])
    return name
