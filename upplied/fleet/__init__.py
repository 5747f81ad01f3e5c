"""The jobs of a fleet without any engine, for command and flows: ingest, decide, transfer, publish."""

# ruff: noqa: F401
from __future__ import annotations

import importlib
import logging
import uuid
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from upplied.fleet.admission import RuleOptions, check_structures
    from upplied.fleet.decisions import Decision, Job, PlanRequest, decide
    from upplied.fleet.ingest import Ingested, ingest_demonstrations, ingest_structures
    from upplied.fleet.rechecking import Rechecked, recheck
    from upplied.fleet.run import (
        Resources,
        Result,
        Run,
        Shard,
        cores,
        known_outcomes,
        plan_here,
        shard_name,
        shards,
        transfer,
    )
    from upplied.fleet.workers import Limits
    from upplied.outputs.publish import publish

logging.getLogger("upplied").addHandler(logging.NullHandler())

# Where each name is, for a type checker above; loaded when first asked for: a process that plans needs
# neither what reads files nor what draws.
_NAMES = {
    "fleet.admission": "RuleOptions check_structures",
    "fleet.decisions": "Decision Job PlanRequest decide",
    "fleet.ingest": "Ingested ingest_demonstrations ingest_structures",
    "fleet.rechecking": "Rechecked recheck",
    "fleet.run": "Resources Result Run Shard cores known_outcomes plan_here shard_name shards transfer",
    "fleet.workers": "Limits",
    "outputs.publish": "publish",
}
_HOME = {name: f"upplied.{module}" for module, names in _NAMES.items() for name in names.split()}
__all__ = ["new_run_id", *_HOME]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def new_run_id() -> str:
    """A name for a run outside Prefect: when it began, and something unique."""
    return f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{uuid.uuid4().hex[:8]}"
