"""The table of decisions, and the columns of `transfers` that follow from it when they are read.

A plan that nobody decided about is a draft. What people decide is a row of `decisions`, and nothing is ever
changed there: which plan is in force follows from the rows in the order of their commits
(`upplied.catalog.verbs.decisions`).
"""

from __future__ import annotations

from upplied.catalog.schema.columns import (
    MOMENT,
    TEXT,
    Column,
    Table,
    committed,
    identity,
)

#: What a row of `decisions` may say of its plan.
DECISION_STATES = ("reviewed", "released", "rejected", "recalled", "rechecked")

DECISIONS = Table(
    "decisions",
    "one row per decision about a plan, by a person or by the check of a changed structure",
    ("decision_id",),
    (
        identity("decision_id", "name of the decision"),
        identity("transfer_id", "the plan that was decided about"),
        identity("demonstration_id", "its demonstration"),
        identity("target_id", "its target: of a demonstration, target and purpose one plan is in force"),
        Column("purpose", TEXT, "", "its purpose, as in `transfers`"),
        Column(
            "state",
            TEXT,
            "",
            "what was decided; recalled: the structure changed and the plan is not safe there; "
            "rechecked: it changed and the plan still is",
            required=True,
            allowed=DECISION_STATES,
        ),
        identity("by", "who decided, as they say"),
        Column("note", TEXT, "", "why"),
        Column("forced", TEXT, "", "rules that were overruled by name"),
        Column("plan_sha256", TEXT, "", "hash of the waypoints that were decided about"),
        Column("plan_row_sha256", TEXT, "", "hash of what its row said of it then; empty in older rows"),
        Column("target_sha256", TEXT, "", "hash of the target that the plan was judged against"),
        Column(
            "supposed_sha256",
            TEXT,
            "",
            "rechecked: hash of what of that target was never scanned, as in `transfers`; empty: nothing",
        ),
        Column(
            "after",
            TEXT,
            "",
            "the last decision that whoever released knew of; a release after another one does not count",
        ),
        Column("signature", TEXT, "", "of who decided, Ed25519 (`upplied keys`); empty: not signed"),
        Column("code_version", TEXT, "", "version of the program"),
        *committed("when it was decided"),
    ),
    ("added_at",),
)

OVERRULED = Table(
    "overruled",
    "one row per rule of the gate that a person overruled when a plan was exported, briefed or flown",
    ("overruled_id", "commit_id"),
    (
        identity("overruled_id", "hash of the plan, its waypoints, the way, the format and what was found"),
        identity("transfer_id", "the plan that left"),
        Column("waypoints_sha256", TEXT, "", "hash of the waypoints that left"),
        Column("way", TEXT, "", "how it left", required=True, allowed=("export", "brief", "fly")),
        Column("format", TEXT, "", "of the mission; empty for a flight in simulation"),
        identity("rule", "the rule that was overruled (docs/checks.md)"),
        Column("found", TEXT, "", "what was found, in words"),
        *committed("when it was added"),
    ),
    ("transfer_id", "added_at"),
)

#: Of a plan, derived from the decisions about it whenever it is read; never stored.
DECIDED = (
    Column(
        "state",
        TEXT,
        "",
        "derived when read: draft, reviewed, released (in force), superseded, rejected or recalled; "
        "empty: no path",
    ),
    Column("state_at", MOMENT, "UTC", "derived when read: when that was decided"),
    Column("state_by", TEXT, "", "derived when read: by whom"),
    Column("state_note", TEXT, "", "derived when read: why"),
)
