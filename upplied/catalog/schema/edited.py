"""The table of edits: what people changed of plans, and what became of it in plans made later."""

from __future__ import annotations

from upplied.catalog.schema.columns import (
    TEXT,
    Column,
    Table,
    committed,
    identity,
)

EDITS = Table(
    "edits",
    "one row per change of a plan, and one for each plan made later that it was carried over to, or was not",
    ("edit_id",),
    (
        identity("edit_id", "hash of the plan it was made of, of the change and of whose it is"),
        identity("base_id", "the plan that was changed"),
        Column("transfer_id", TEXT, "", "the plan that came of it; empty where it could not be carried over"),
        identity("demonstration_id", "the demonstration of both"),
        identity("target_id", "the structure they are for"),
        Column("edit_json", TEXT, "", "the change: viewpoints where they were and are wanted, boxes, m"),
        Column("words", TEXT, "", "the change, in words"),
        Column("carried_from", TEXT, "", "the edit that this one carries over; empty where a person made it"),
        Column("lost", TEXT, "", "what of it could not be carried over, and why; empty: all of it was"),
        identity("by", "who changed the plan"),
        Column("note", TEXT, "", "why"),
        *committed("when it was added"),
    ),
    ("target_id", "added_at"),
)
