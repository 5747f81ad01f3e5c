"""What is kept: structures, demonstrations and plans, in tables that many may fill at once."""

# ruff: noqa: F401
from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

# Read when pyarrow is loaded: its own allocator holds 40 MB more of a process that writes, and is no faster.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")

if TYPE_CHECKING:
    from upplied.catalog.database import Catalog, open_catalog
    from upplied.catalog.store.cache import Cache
    from upplied.catalog.verbs.changes import changed_structures, diff, history, runs
    from upplied.catalog.verbs.exporting import export_dataset
    from upplied.catalog.verbs.importing import import_dataset
    from upplied.catalog.verbs.lerobot import export_lerobot
    from upplied.catalog.verbs.maintenance import compact, vacuum
    from upplied.catalog.verbs.published import export_tables, published_tables
    from upplied.catalog.verbs.queries import PlannedTrajectory
    from upplied.catalog.verbs.recipes import Recipe, recipe
    from upplied.catalog.verbs.tum import export_tum
    from upplied.catalog.verbs.verification import Finding, verify

# Where each name is, for a type checker above; loaded when first asked for: storage libraries take a moment.
_NAMES = {
    "store.cache": "Cache",
    "verbs.changes": "changed_structures diff history runs",
    "database": "Catalog open_catalog",
    "verbs.exporting": "export_dataset",
    "verbs.importing": "import_dataset",
    "verbs.lerobot": "export_lerobot",
    "verbs.maintenance": "compact vacuum",
    "verbs.published": "export_tables published_tables",
    "verbs.queries": "PlannedTrajectory",
    "verbs.recipes": "Recipe recipe",
    "verbs.tum": "export_tum",
    "verbs.verification": "Finding verify",
}
_HOME = {name: f"{__name__}.{module}" for module, names in _NAMES.items() for name in names.split()}
__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
