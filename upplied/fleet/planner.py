"""In a worker process: one job planned; errors become plans with a reason."""

import json
import os
import socket
import time
import traceback
import uuid
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from functools import lru_cache, partial
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa

from upplied.catalog import Catalog, open_catalog
from upplied.catalog.schema.plan_rows import tuples
from upplied.catalog.store.files import FileStore, explained
from upplied.catalog.verbs.belonging import zones_named
from upplied.catalog.verbs.recipes import settings_of
from upplied.checks import check_id
from upplied.errors import CatalogError, RefusedError, UppliedError
from upplied.fleet.decisions import Job
from upplied.geometry.scene import open3d
from upplied.planning.correspondence.memo import Memo, no_memo
from upplied.planning.plan import plan_transfer
from upplied.proof.required_zones import RequiredZones
from upplied.records import Camera, Plan, Structure
from upplied.records.plans import RequiredSurface

R = TypeVar("R")
Shard = tuple[Job, ...]


@dataclass(frozen=True)
class Outcome:
    job: Job
    plan: Plan
    seconds: float
    detail: str = ""  # the traceback of an error nobody foresaw, for developers
    process: str = ""  # host/process that planned it


_catalog: Catalog | None = None
_memo: Memo = no_memo


def prepare(location: str) -> None:
    global _catalog, _memo
    _catalog = open_catalog(location)
    _memo = Recent(_catalog.cache)
    open3d()


_structure = lru_cache(8)(Catalog.structure)
_demonstration = lru_cache(16)(Catalog.demonstration)


@lru_cache(maxsize=4)
def _required(
    catalog: Catalog, target_id: str, sha256: str, name: str
) -> tuple[RequiredSurface | None, tuple[str, ...]]:
    return required_surface(catalog, _memo, _structure(catalog, target_id), name)


def transferred(catalog: Catalog, job: Job) -> Plan:
    demonstration = _demonstration(catalog, job.demonstration_id)
    source, target = _structure(catalog, job.source_id), _structure(catalog, job.target_id)
    siblings = [_structure(catalog, name) for name, _ in job.siblings]
    now = (demonstration.sha256, source.sha256, target.sha256), tuple(one.sha256 for one in siblings)
    if now != (job.sha256, tuple(sha256 for _, sha256 in job.siblings)):
        return superseded(job)
    zones, untold = _required(catalog, job.target_id, job.sha256[2], job.settings.required.zones)
    plan = plan_transfer(demonstration, source, target, job.settings, _memo, zones, siblings)
    return replace(plan, warnings=(*plan.warnings, *untold))


def superseded(job: Job) -> Plan:
    return without_path(job, "superseded", "its inputs changed after the run began; the next run plans it")


def plan_job(job: Job, plan_of: Callable[[Catalog, Job], Plan] = transferred) -> Outcome:
    """Plan one job in this process, which was prepared; errors become plans with a reason."""
    assert _catalog is not None
    began, detail = time.monotonic(), ""
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
    return f"{socket.gethostname()}/{os.getpid()}"


def without_path(job: Job, status: str, reason: str) -> Plan:
    pair = job.demonstration_id, job.source_id, job.target_id, job.kind
    return Plan(*pair, job.settings.preset, status, reason)


class Recent:
    """A memo before another, of at most `max_bytes`: what all targets of a source need is read once."""

    def __init__(self, memo: Memo, max_bytes: int = 128 << 20) -> None:
        self._memo, self._max_bytes = memo, max_bytes
        self._known: OrderedDict[tuple[str, str], Any] = OrderedDict()
        self._bytes = 0

    def __call__(self, stage: str, record_type: type[R], key: str, compute: Callable[[], R]) -> R:
        name = stage, key
        if name not in self._known:
            self._known[name] = self._memo(stage, record_type, key, compute)
            self._bytes += nbytes(self._known[name])
        self._known.move_to_end(name)
        record: R = self._known[name]
        while self._bytes > self._max_bytes and self._known:
            self._bytes -= nbytes(self._known.popitem(last=False)[1])
        return record


def nbytes(value: Any) -> int:
    if isinstance(value, np.ndarray):
        return value.nbytes
    if is_dataclass(value) and not isinstance(value, type):
        return sum(nbytes(getattr(value, item.name)) for item in fields(value))
    return 0


def required_surface(
    catalog: Catalog, memo: Memo, target: Structure, name: str
) -> tuple[RequiredSurface | None, tuple[str, ...]]:
    """What plans of a structure are to show first, and the zones that cannot be planned for, in words.

    The zones are named as `required.zones` has it (empty: none); unknown ones are a `CatalogError`.
    """
    if not name:
        return None, ()
    zones = zones_named(catalog, target.kind, target.structure_id, name)
    known = Camera(), zones, catalog.faces_labelled
    # Where the zones are is asked, not what may be seen of them: what was never scanned plays no part.
    asking = RequiredZones(catalog.structure, memo, target, None, *known)
    return asking.required()


_SUFFIX = ".jobs"


def write_shards(catalog: Catalog, run_id: str, shards: Sequence[Shard]) -> list[str]:
    """Write the jobs of each shard; returns their names, as `read_shard` takes them."""
    store = catalog.shards
    names = [f"{check_id(run_id, 'run')}/{number:05}{_SUFFIX}" for number in range(len(shards))]
    others = [item.name for item in fields(Job) if item.name != "settings"]
    for name, shard in zip(names, shards, strict=True):
        settings = {job.settings.sha256: job.settings for job in shard}
        jobs = [{at: getattr(job, at) for at in others} | {"settings": job.settings.sha256} for job in shard]
        plain = {"settings": {key: one.text for key, one in settings.items()}, "jobs": jobs}
        explained(store.path(run_id), partial(store.write, name, json.dumps(plain).encode()), doing="written")
    return names


def read_shard(location: str, name: str) -> list[Job]:
    """The jobs of one shard; one that is not there, or is not what was written, is an error."""
    run_id, _, number = name.partition("/")
    check_id(run_id, "run")
    check_id(number.removesuffix(_SUFFIX), "shard")
    store = open_catalog(location).shards
    try:
        plain = json.loads(store.read(name))
        settings = {sha256: settings_of(text) for sha256, text in plain["settings"].items()}
        return [Job(**{**job, "settings": settings[job["settings"]]}) for job in tuples(plain["jobs"])]
    except (OSError, pa.ArrowException, KeyError, TypeError, ValueError) as error:
        raise CatalogError(store.path(name), f"cannot be read: {error}") from None


@dataclass(frozen=True)
class Attempt:
    """One worker's work on one shard, ended unless the worker was lost; `worker` as `planned_on` says it."""

    shard: str
    worker: str
    ended: bool = False


@contextmanager
def attempt(location: str, name: str, worker: str) -> Iterator[None]:
    """Write who works on a shard, and at the end that it ended, whether it failed or not."""
    store = open_catalog(location).shards
    place = f"{name.removesuffix(_SUFFIX)}.{uuid.uuid4().hex}.json"
    begun = Attempt(name, f"{this_process()}/{worker}")
    store.write(place, json.dumps(asdict(begun)).encode(), lasting=False)
    try:
        yield
    finally:
        store.write(place, json.dumps(asdict(replace(begun, ended=True))).encode(), lasting=False)


def attempts(catalog: Catalog, run_id: str) -> list[Attempt]:
    """Who worked on the shards of a run, by shard and worker; of a damaged note nothing is known."""
    store = FileStore(catalog.shards.path(check_id(run_id, "run")))
    turns = []
    for name in store.names():
        with suppress(OSError, ValueError, TypeError):
            if name.endswith(".json"):
                turns.append(Attempt(**json.loads(store.read(name))))
    return sorted(turns, key=lambda one: (one.shard, one.worker, one.ended))


def remove_shards(catalog: Catalog, run_id: str) -> None:
    """Remove what a run wrote; what cannot be removed, or is of a run that was killed, goes by `vacuum`."""
    catalog.shards.remove_folder(check_id(run_id, "run"))
