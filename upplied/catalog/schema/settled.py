"""The table of settings that belong to kinds and structures, not to runs."""

from __future__ import annotations

from upplied.catalog.schema.columns import (
    TEXT,
    Column,
    Table,
    committed,
    identity,
)

SETTINGS = Table(
    "settings",
    "one row per setting of a kind or a structure, and per change of it; the newest counts",
    ("setting_id",),
    (
        identity("setting_id", "name of the row"),
        Column(
            "scope",
            TEXT,
            "",
            "whose it is",
            required=True,
            allowed=("kind", "structure", "preset of kind", "preset of structure"),
        ),
        identity("owner", "the kind, or the id of the structure"),
        identity("setting", "stage and name, as route.clearance_m; of a preset preset.name"),
        Column("value_json", TEXT, "", "the value; empty: taken back, and inherited again"),
        identity("by", "who said so"),
        Column("note", TEXT, "", "why"),
        *committed("when it was said"),
    ),
    ("owner", "added_at"),
)
