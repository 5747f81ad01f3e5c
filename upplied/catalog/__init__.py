"""What is kept: structures, demonstrations and plans, in tables that many may fill at once."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from upplied.catalog.cache import Cache
    from upplied.catalog.changes import changed_structures, diff, history, runs
    from upplied.catalog.database import Catalog, open_catalog
    from upplied.catalog.exchange import export_dataset, import_dataset
    from upplied.catalog.lerobot import export_lerobot
    from upplied.catalog.maintenance import compact, vacuum
    from upplied.catalog.published import export_tables
    from upplied.catalog.queries import PlannedTrajectory
    from upplied.catalog.recipes import Recipe, recipe
    from upplied.catalog.verification import Finding, verify

__all__ = [
    "Cache",
    "Catalog",
    "Finding",
    "PlannedTrajectory",
    "Recipe",
    "changed_structures",
    "compact",
    "diff",
    "export_dataset",
    "export_lerobot",
    "export_tables",
    "history",
    "import_dataset",
    "open_catalog",
    "recipe",
    "runs",
    "vacuum",
    "verify",
]

# Loaded when first asked for: the storage libraries take a moment.
_HOME = {
    "cache": ("Cache",),
    "changes": ("changed_structures", "diff", "history", "runs"),
    "database": ("Catalog", "open_catalog"),
    "exchange": ("export_dataset", "import_dataset"),
    "lerobot": ("export_lerobot",),
    "maintenance": ("compact", "vacuum"),
    "published": ("export_tables",),
    "queries": ("PlannedTrajectory",),
    "recipes": ("Recipe", "recipe"),
    "verification": ("Finding", "verify"),
}


def __getattr__(name: str) -> Any:
    for module, names in _HOME.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
