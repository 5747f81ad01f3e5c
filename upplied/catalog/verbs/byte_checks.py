"""Checks of every byte that a catalog holds, whatever it means: data files, logs, and files by content."""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from upplied.catalog.reading import Reading
from upplied.catalog.schema import codec
from upplied.catalog.store.chain import changed_entries
from upplied.catalog.store.contents import ContentStore
from upplied.catalog.store.delta import HASH_DIGITS, StepTable, StoredTable
from upplied.catalog.store.files import FileStore
from upplied.catalog.store.identity import Heads
from upplied.catalog.store.opening import HASHED_KEY
from upplied.errors import CatalogError

_PART = re.compile(r"part-([0-9a-f]{64})-[0-9a-f]{8}\.parquet")
_STEPS = re.compile(rf"[0-9]{{8}}-[0-9]{{6}}-[0-9]{{6}}-([0-9a-f]{{{HASH_DIGITS}}})\.parquet")
_CHANGED = "was changed after it was written; take it from a backup"

Fault = tuple[str, str]  # what, and what is wrong with it


@dataclass
class Folder:
    """The files of one kind that are kept by their content."""

    faults: dict[str, str] = field(default_factory=dict)  # hash -> what is wrong, empty where nothing is
    samples: dict[str, str] = field(default_factory=dict)  # hash -> that of the samples it names
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)  # of meshes: vertices and triangles


def fault_of(contents: dict[str, Folder], name: str, sha256: str) -> Fault:
    """The file of some content, or of the samples it names, and what is wrong with it, if anything."""
    folder = contents[name]
    wrong = folder.faults.get(sha256, "cannot be read: there is no such file")
    if not wrong and sha256 in folder.samples:
        return fault_of(contents, "samples", folder.samples[sha256])
    return f"{name}/{sha256}.parquet", wrong


def stored_contents(store: ContentStore[Any]) -> Folder:
    """Every file of a folder that is kept by its content, read once."""
    folder = Folder()
    for name in store.files.names():
        sha256 = name.removesuffix(".parquet")
        if not re.fullmatch(r"[0-9a-f]{64}\.parquet", name):
            continue  # a draft of a writer at work
        try:
            content = store.files.read(name)
            record = codec.decode(content, store.about.record_type, sha256)
        except FileNotFoundError:
            continue  # removed meanwhile
        except (OSError, pa.ArrowException, CatalogError) as error:
            damaged = isinstance(error, CatalogError)
            folder.faults[sha256] = "is damaged" if damaged else f"cannot be read: {error}"
            continue
        folder.faults[sha256] = "" if codec.is_as_written(content) else "is damaged: a byte was changed"
        if hasattr(record, "samples_sha256"):
            folder.samples[sha256] = record.samples_sha256
        if hasattr(record, "vertices"):
            folder.sizes[sha256] = len(record.vertices), len(record.triangles)
    return folder


def changed_files(catalog: Reading) -> Iterator[Fault]:
    """Files of the tables and their logs, and the catalog's identity, that are not as they were written."""
    if not catalog.identity.is_as_written():
        yield f"{catalog.location}/catalog.json", _CHANGED
    for table in catalog.tables.values():
        yield from _data_files(table)
        log = FileStore(f"{table.uri}/_delta_log")
        heads = Heads(catalog.location, table.declared.name)
        for name, wrong in changed_entries(log, heads.stated()):
            yield log.path(name), wrong
        yield from _last_checkpoint(log)


def _data_files(table: StoredTable) -> Iterator[Fault]:
    """Data files whose bytes do not have the hash in their name; retired ones too, while they are there."""
    files = FileStore(table.uri)
    yield from _changed(files, _PART)
    if isinstance(table, StepTable):
        yield from _changed(table.files, _STEPS)
    delta = table.delta()
    if delta is not None and delta.metadata().configuration.get(HASHED_KEY) == "0":
        for name in pa.table(delta.get_add_actions())["path"].to_pylist():
            if not _PART.fullmatch(name):
                yield files.path(name), "was put in by another program"


def _changed(files: FileStore, named: re.Pattern[str]) -> Iterator[Fault]:
    for name in files.names():
        if match := named.fullmatch(name):
            try:
                if not hashlib.sha256(files.read(name)).hexdigest().startswith(match[1]):
                    yield files.path(name), _CHANGED
            except FileNotFoundError:
                continue  # removed meanwhile
            except (OSError, pa.ArrowException) as error:
                yield files.path(name), f"cannot be read: {error}"


def _last_checkpoint(log: FileStore) -> Iterator[Fault]:
    """The note of the last checkpoint, where it does not describe that one."""
    if not log.has("_last_checkpoint"):
        return
    content = log.read("_last_checkpoint")
    try:
        version = json.loads(content)["version"]
        checkpoint = log.read(f"{version:020}.checkpoint.parquet")
        rows = pq.read_table(io.BytesIO(checkpoint), columns=["add"])["add"]
        note = {"version": version, "size": len(rows), "sizeInBytes": len(checkpoint)}
        note["numOfAddFiles"] = len(rows) - rows.null_count
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException):
        note = {}
    if json.dumps(note, separators=(",", ":")).encode() != content.removesuffix(b"\n"):
        yield log.path("_last_checkpoint"), _CHANGED
