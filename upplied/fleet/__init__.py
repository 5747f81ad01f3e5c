"""The jobs of a fleet without any engine, for command and flows: ingest, decide, transfer, publish."""

import logging
import uuid
from datetime import UTC, datetime

from upplied.extras import public_names

logging.getLogger("upplied").addHandler(logging.NullHandler())

# Of `__init__.pyi`: a process that plans needs neither what reads files nor what draws.
_PUBLIC, __getattr__ = public_names(__name__, __path__[0])
__all__ = ["new_run_id", *_PUBLIC]


def new_run_id() -> str:
    """A name for a run outside Prefect: when it began, and something unique."""
    return f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{uuid.uuid4().hex[:8]}"
