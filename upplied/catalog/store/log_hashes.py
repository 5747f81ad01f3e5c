"""Hashes of the entries of a table's log: each entry states those that no entry before it states.

The newest ones are stated beside the log (`identity.Heads`). Two writers may commit on the same version; the
next one then states both. Checkpoints count as entries.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator

from upplied.catalog.store.files import FileStore

STATED = "upplied.log"  # property of a commit: name -> hash of entries of the log
CHECKPOINTS = 50  # entries to a checkpoint
_MOST = 100  # entries that are looked back at: those of an older program state nothing
_NAME = re.compile(r"[0-9]{20}(\.checkpoint)?\.(json|parquet)")


def unstated(log: FileStore, version: int) -> dict[str, str]:
    """The hashes of the entries up to a version that none of them states."""
    found: dict[str, str] = {}
    stated = -1
    for number in range(version, max(version - _MOST, -1), -1):
        if number <= stated:
            break
        try:
            content = log.read(name := f"{number:020}.json")
        except FileNotFoundError:
            break  # cleaned away: older than anybody asks for
        found[name] = _sha256(content)
        stated = max([stated, *(int(other[:20]) for other in stated_in(content))])
        name = f"{number:020}.checkpoint.parquet"
        if (number + 1) % CHECKPOINTS == 0 and log.has(name):
            found[name] = _sha256(log.read(name))
    return found


def stated_in(content: bytes) -> dict[str, str]:
    """The hashes that an entry states."""
    for line in content.splitlines():
        if line.startswith(b'{"commitInfo"'):
            said = json.loads(line)["commitInfo"].get(STATED, "{}")
            return {name: str(value) for name, value in json.loads(said).items() if _NAME.fullmatch(name)}
    return {}


def rows_stated(content: bytes) -> int:
    """How many rows an entry says that it added."""
    for line in content.splitlines():
        if line.startswith(b'{"commitInfo"'):
            said = str(json.loads(line)["commitInfo"].get("rows", ""))
            return int(said) if said.isdigit() else 0
    return 0


def changed_entries(log: FileStore, newest: str) -> Iterator[tuple[str, str]]:
    """Entries that are not as they were stated, each with what is wrong, in words.

    Parameters
    ----------
    log : FileStore
    newest : str
        What is stated beside the log of its newest entries, as JSON; empty where nothing is.
    """
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
                stated += stated_in(content).items()
            except (ValueError, AttributeError, KeyError) as error:
                yield name, f"cannot be read: {error}"
    for name, sha256 in dict.fromkeys(stated):
        if not _NAME.fullmatch(name) or (name in contents and _sha256(contents[name]) != sha256):
            yield name, "was changed after it was written, or what is stated of it was"


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
