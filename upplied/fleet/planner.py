"""In a worker process: one job planned; errors become plans with a reason."""

from __future__ import annotations

import os
import socket
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

from upplied.catalog import Catalog, open_catalog
from upplied.errors import RefusedError, UppliedError
from upplied.fleet.decisions import Job
from upplied.fleet.recent import Recent
from upplied.fleet.required import required_surface
from upplied.planning.correspondence.memo import Memo, no_memo
from upplied.planning.plan import plan_transfer
from upplied.records import Demonstration, Plan, Structure
from upplied.records.required import RequiredSurface
from upplied.scene import open3d


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
    return Plan(
        demonstration_id=job.demonstration_id,
        source_id=job.source_id,
        target_id=job.target_id,
        kind=job.kind,
        preset=job.settings.preset,
        status=status,
        reason=reason,
    )
