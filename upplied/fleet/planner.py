"""In a worker process: one job planned; errors become plans with a reason."""

from __future__ import annotations

import os
import socket
import time
import traceback
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from upplied.catalog import Catalog, open_catalog
from upplied.catalog.verbs.required import zones_named
from upplied.errors import RefusedError, UppliedError
from upplied.fleet.decisions import Job
from upplied.geometry.scene import open3d
from upplied.planning.correspondence.memo import Memo, no_memo
from upplied.planning.plan import plan_transfer
from upplied.proof.required_zones import RequiredZones
from upplied.records import Camera, Demonstration, Plan, Structure
from upplied.records.required import RequiredSurface

R = TypeVar("R")


@dataclass(frozen=True)
class Outcome:
    """What came of one job."""

    job: Job
    plan: Plan
    seconds: float
    detail: str = ""  # the traceback of an error nobody foresaw, for developers
    process: str = ""  # host/process that planned it


_catalog: Catalog | None = None
_memo: Memo = no_memo


def prepare(location: str) -> None:
    """Open the catalog and load what planning needs, once per process."""
    global _catalog, _memo
    _catalog = open_catalog(location)
    _memo = Recent(_catalog.cache)
    open3d()


@lru_cache(maxsize=8)
def _structure(structure_id: str) -> Structure:
    assert _catalog is not None
    return _catalog.structure(structure_id)


@lru_cache(maxsize=16)
def _demonstration(demonstration_id: str) -> Demonstration:
    assert _catalog is not None
    return _catalog.demonstration(demonstration_id)


@lru_cache(maxsize=4)
def _required(target_id: str, sha256: str, name: str) -> tuple[RequiredSurface | None, tuple[str, ...]]:
    assert _catalog is not None
    return required_surface(_catalog, _memo, _structure(target_id), name)


def transferred(catalog: Catalog, job: Job) -> Plan:
    """The plan of a job that carries a demonstration to a target."""
    demonstration = _demonstration(job.demonstration_id)
    source, target = _structure(job.source_id), _structure(job.target_id)
    siblings = [_structure(name) for name, _ in job.siblings]
    now = (demonstration.sha256, source.sha256, target.sha256), tuple(one.sha256 for one in siblings)
    if now != (job.sha256, tuple(sha256 for _, sha256 in job.siblings)):
        return superseded(job)
    zones, untold = _required(job.target_id, job.sha256[2], job.settings.required.zones)
    plan = plan_transfer(demonstration, source, target, job.settings, _memo, zones, siblings)
    return replace(plan, warnings=(*plan.warnings, *untold))


def superseded(job: Job) -> Plan:
    """What comes of a job whose inputs are others by now."""
    return without_path(job, "superseded", "its inputs changed after the run began; the next run plans it")


def plan_job(job: Job, plan_of: Callable[[Catalog, Job], Plan] = transferred) -> Outcome:
    """Plan one job in this process, which was prepared; errors become plans with a reason."""
    assert _catalog is not None
    began = time.monotonic()
    detail = ""
    try:
        plan = _catalog.keep_surface(plan_of(_catalog, job))
    except MemoryError:
        raise  # the worker says so, and is replaced
    except RefusedError as refusal:
        plan = without_path(job, "refused", str(refusal))
    except UppliedError as error:
        plan = without_path(job, "failed", str(error))
    except Exception as error:
        plan = without_path(job, "failed", f"{type(error).__name__}: {error}")
        detail = traceback.format_exc()
    return Outcome(job, plan, time.monotonic() - began, detail, this_process())


def this_process() -> str:
    """This host and process, as ``host/number``."""
    return f"{socket.gethostname()}/{os.getpid()}"


def without_path(job: Job, status: str, reason: str) -> Plan:
    """A plan that says why there is none."""
    pair = job.demonstration_id, job.source_id, job.target_id, job.kind
    return Plan(*pair, job.settings.preset, status, reason)


class Recent:
    """A memo before another, of at most `max_bytes`: what all targets of a source need is read once."""

    def __init__(self, memo: Memo, max_bytes: int = 128 << 20) -> None:
        self._memo, self._max_bytes = memo, max_bytes
        self._held: OrderedDict[tuple[str, str], Any] = OrderedDict()
        self._bytes = 0

    def __call__(self, stage: str, record_type: type[R], key: str, compute: Callable[[], R]) -> R:
        """The record of this stage and key."""
        name = stage, key
        if name not in self._held:
            self._held[name] = self._memo(stage, record_type, key, compute)
            self._bytes += nbytes(self._held[name])
        self._held.move_to_end(name)
        record: R = self._held[name]
        while self._bytes > self._max_bytes and self._held:
            self._bytes -= nbytes(self._held.popitem(last=False)[1])
        return record


def nbytes(value: Any) -> int:
    """Bytes of the arrays in a record."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    if is_dataclass(value) and not isinstance(value, type):
        return sum(nbytes(getattr(value, item.name)) for item in fields(value))
    return 0


def required_surface(
    catalog: Catalog, memo: Memo, target: Structure, name: str
) -> tuple[RequiredSurface | None, tuple[str, ...]]:
    """What plans of a structure are to show first, and the zones that cannot be planned for, in words.

    The zones are named as `required.zones` of the settings has it (empty: none); unknown ones are a
    `CatalogError`.
    """
    if not name:
        return None, ()
    zones = zones_named(catalog, target.kind, target.structure_id, name)
    known = Camera(), zones, catalog.faces_labelled
    # Where the zones are is asked, not what may be seen of them: what was never scanned plays no part.
    asking = RequiredZones(catalog.structure, memo, target, None, *known)
    return asking.required()
