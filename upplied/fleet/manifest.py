"""The shards of a run, as JSON beside its catalog, and who works on each.

An engine that gives a lost worker's work to another one does not say so, and the run reads it here.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, fields, replace

import pyarrow as pa

from upplied.catalog import Catalog, open_catalog
from upplied.catalog.schema.plan_rows import settings_text, tuples
from upplied.catalog.store.files import FileStore
from upplied.catalog.verbs.recipes import settings_of
from upplied.checks import check_id
from upplied.errors import CatalogError
from upplied.fleet.decisions import Job
from upplied.fleet.planner import this_process
from upplied.fleet.run import Shard

FOLDER = "shards"
_SUFFIX = ".jobs"


def write_shards(catalog: Catalog, run_id: str, shards: Sequence[Shard]) -> list[str]:
    """Write the jobs of each shard; returns their names, as `read_shard` takes them."""
    store = _store(catalog)
    names = [f"{check_id(run_id, 'run')}/{number:05}{_SUFFIX}" for number in range(len(shards))]
    try:
        for name, shard in zip(names, shards, strict=True):
            store.write(name, _encoded(shard))
    except (OSError, pa.ArrowException) as error:
        raise CatalogError(store.path(run_id), f"cannot be written: {error}") from None
    return names


def read_shard(location: str, name: str) -> list[Job]:
    """The jobs of one shard; one that is not there, or is not what was written, is an error."""
    run_id, _, number = name.partition("/")
    check_id(run_id, "run")
    check_id(number.removesuffix(_SUFFIX), "shard")
    store = _store(open_catalog(location))
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
    store = _store(open_catalog(location))
    place = f"{name.removesuffix(_SUFFIX)}.{uuid.uuid4().hex}.json"
    begun = Attempt(name, f"{this_process()}/{worker}")
    store.write(place, json.dumps(asdict(begun)).encode(), lasting=False)
    try:
        yield
    finally:
        store.write(place, json.dumps(asdict(replace(begun, ended=True))).encode(), lasting=False)


def attempts(catalog: Catalog, run_id: str) -> list[Attempt]:
    """Who worked on the shards of a run, by shard and worker; of a damaged note nothing is known."""
    store = FileStore(_store(catalog).path(check_id(run_id, "run")))
    turns = []
    for name in store.names():
        with suppress(OSError, ValueError, TypeError):
            if name.endswith(".json"):
                turns.append(Attempt(**json.loads(store.read(name))))
    return sorted(turns, key=lambda one: (one.shard, one.worker, one.ended))


def remove_shards(catalog: Catalog, run_id: str) -> None:
    """Remove what a run wrote; what cannot be removed is left for maintenance."""
    _store(catalog).remove_folder(check_id(run_id, "run"))


def _store(catalog: Catalog) -> FileStore:
    return FileStore(f"{str(catalog.location).rstrip('/')}/{FOLDER}")


def _encoded(shard: Shard) -> bytes:
    names = [item.name for item in fields(Job) if item.name != "settings"]
    jobs = [
        {**{name: getattr(job, name) for name in names}, "settings": job.settings.sha256} for job in shard
    ]
    different = {job.settings.sha256: job.settings for job in shard}
    settings = {sha256: settings_text(each) for sha256, each in different.items()}
    return json.dumps({"settings": settings, "jobs": jobs}).encode()
