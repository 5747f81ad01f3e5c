"""The table of requirements: which zones of a structure, or of all of a kind, must be seen, and how."""

from __future__ import annotations

from upplied.catalog.schema.columns import (
    TEXT,
    WHOLE,
    Column,
    Table,
    committed,
    identity,
)

REQUIREMENTS = Table(
    "requirements",
    "one row per set of requirements and version; the newest of a name counts",
    ("requirement_id",),
    (
        identity("requirement_id", "name of the row"),
        Column("scope", TEXT, "", "whom it asks", required=True, allowed=("kind", "structure")),
        identity("owner", "the kind, or the id of the structure"),
        identity("name", "of the set"),
        Column(
            "version", WHOLE, "1", "1, 2, ... per owner and name in the order of commits, counted when read"
        ),
        Column("zones_json", TEXT, "", "zones, each with its place and what is asked; none: taken back"),
        identity("by", "who asks"),
        Column("note", TEXT, "", "why"),
        *committed("when it was asked"),
    ),
    ("owner", "added_at"),
)
