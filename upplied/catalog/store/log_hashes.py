"""Hashes of a log's entries: each entry states those that none before it states, the newest `identity.Heads`.

Of two writers who commit on the same version the next one states both. Checkpoints count as entries.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from typing import Any

from upplied.catalog.store.files import FileStore

STATED = "upplied.log"  # property of a commit: name -> hash of entries of the log
CHECKPOINTS = 50  # entries to a checkpoint
_MOST = 100  # entries that are looked back at: those of an older program state nothing
_NAME = re.compile(r"[0-9]{20}(\.checkpoint)?\.(json|parquet)")


def unstated(log: FileStore, version: int) -> dict[str, str]:
    """The hashes of the entries up to a version that none of them states."""
    hashes: dict[str, str] = {}
    stated = -1
    for number in range(version, max(version - _MOST, -1), -1):
        if number <= stated:
            break
        try:
            content = log.read(name := f"{number:020}.json")
        except FileNotFoundError:
            break  # cleaned away: older than anybody asks for
        hashes[name] = _sha256(content)
        stated = max([stated, *(int(other[:20]) for other in _stated_in(content))])
        name = f"{number:020}.checkpoint.parquet"
        if (number + 1) % CHECKPOINTS == 0 and log.has(name):
            hashes[name] = _sha256(log.read(name))
    return hashes


def _commit(content: bytes) -> dict[str, Any]:
    """What an entry says of its commit."""
    lines = (line for line in content.splitlines() if line.startswith(b'{"commitInfo"'))
    return dict(json.loads(next(lines, b'{"commitInfo": {}}'))["commitInfo"])


def _stated_in(content: bytes) -> dict[str, str]:
    """The hashes that an entry states."""
    hashes = json.loads(_commit(content).get(STATED, "{}"))
    return {name: str(value) for name, value in hashes.items() if _NAME.fullmatch(name)}


def rows_added(log: FileStore) -> int:
    """How many rows a log says were added, by the entries that were not cleaned away."""
    try:
        rows = [
            str(_commit(log.read(name)).get("rows", ""))
            for name in log.names()
            if _NAME.fullmatch(name) and name.endswith(".json")
        ]
    except (ValueError, AttributeError, KeyError, TypeError):
        return 0  # a finding of its own
    return sum(int(count) for count in rows if count.isdigit())


def changed_entries(log: FileStore, newest: str) -> Iterator[tuple[str, str]]:
    """Entries that are not as stated, and what is wrong; `newest` is what stands beside the log, as JSON."""
    contents = {name: log.read(name) for name in log.names() if _NAME.fullmatch(name)}
    stated: list[tuple[str, str]] = []
    try:
        stated += json.loads(newest or "{}").items()
        if "\n" in newest or (newest and json.dumps(json.loads(newest)) != newest):
            raise ValueError("it has other words")
    except (ValueError, AttributeError):
        yield "what is stated of the newest entry", "was changed after it was written"
    for name, content in contents.items():
        if name.endswith(".json"):
            try:
                stated += _stated_in(content).items()
            except (ValueError, AttributeError, KeyError, TypeError) as error:
                yield name, f"cannot be read: {error}"
    for name, sha256 in dict.fromkeys(stated):
        if not _NAME.fullmatch(name) or (name in contents and _sha256(contents[name]) != sha256):
            yield name, "was changed after it was written, or what is stated of it was"


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
