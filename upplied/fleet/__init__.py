"""The jobs of a fleet without any engine: ingest, decide, transfer, publish.

The command line calls these functions directly; the flows call the same ones from Prefect's tasks.
"""

from __future__ import annotations

import importlib
import logging
import uuid
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from upplied.fleet.admission import Asked
    from upplied.fleet.checking import check_structures
    from upplied.fleet.decisions import Decision, Job, PlanRequest, decide
    from upplied.fleet.ingest import (
        Ingested,
        ingest_demonstrations,
        ingest_structures,
    )
    from upplied.fleet.keeping import Result, kept
    from upplied.fleet.rechecking import Rechecked, recheck
    from upplied.fleet.run import (
        SHARD_TARGETS,
        Resources,
        Run,
        Shard,
        bundles,
        cores,
        plan_here,
        shard_name,
        shards,
        transfer,
    )
    from upplied.fleet.workers import Limits
    from upplied.outputs.publish import publish

__all__ = [
    "SHARD_TARGETS",
    "Asked",
    "Decision",
    "Ingested",
    "Job",
    "Limits",
    "PlanRequest",
    "Rechecked",
    "Resources",
    "Result",
    "Run",
    "Shard",
    "bundles",
    "check_structures",
    "cores",
    "decide",
    "ingest_demonstrations",
    "ingest_structures",
    "kept",
    "new_run_id",
    "plan_here",
    "publish",
    "recheck",
    "shard_name",
    "shards",
    "transfer",
]

logging.getLogger("upplied").addHandler(logging.NullHandler())

# Loaded when first asked for: a process that plans needs neither what reads files nor what draws.
_HOME = {
    "upplied.fleet.admission": ("Asked",),
    "upplied.fleet.checking": ("check_structures",),
    "upplied.fleet.decisions": ("Decision", "Job", "PlanRequest", "decide"),
    "upplied.fleet.ingest": ("Ingested", "ingest_demonstrations", "ingest_structures"),
    "upplied.fleet.keeping": ("Result", "kept"),
    "upplied.fleet.rechecking": ("Rechecked", "recheck"),
    "upplied.fleet.run": (
        "SHARD_TARGETS",
        "Resources",
        "Run",
        "Shard",
        "bundles",
        "cores",
        "plan_here",
        "shard_name",
        "shards",
        "transfer",
    ),
    "upplied.fleet.workers": ("Limits",),
    "upplied.outputs.publish": ("publish",),
}


def __getattr__(name: str) -> Any:
    for module, names in _HOME.items():
        if name in names:
            return getattr(importlib.import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def new_run_id() -> str:
    """A name for a run outside Prefect: when it began, and something unique."""
    return f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{uuid.uuid4().hex[:8]}"
