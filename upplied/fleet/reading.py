"""Files read in worker processes: a bad one stops itself alone, an unchanged one is not parsed again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from typing import TypeVar

from upplied.errors import UppliedError
from upplied.fleet.run import cores
from upplied.fleet.workers import JobKilled, Workers, WorkersBroken
from upplied.inputs.passport.rules import findings_of
from upplied.inputs.rules import from_json
from upplied.records import Demonstration, Structure

BATCH = 50  # files that are read before their records are committed together
Item = TypeVar("Item")
Read = TypeVar("Read")
Stored = TypeVar("Stored", Structure, Demonstration)


@dataclass(frozen=True)
class Ingested:
    """What became of one file."""

    name: str  # the id, or the file where no id is known
    # "added", "unchanged", "retired", "failed", "readable" (a trial), or "passed over": no flight
    status: str
    reason: str = ""
    findings: tuple[str, ...] = ()  # warnings, and rules that were overruled, in words
    file: str = ""
    words: str = ""  # what the file is, and the record that was made of it


Progress = Callable[[Ingested], None]


def each(
    read: Callable[[Item], Read],
    items: Sequence[Item],
    name: Callable[[Item], str],
    workers: int,
    same: Callable[[Item], Ingested | None] = lambda item: None,
) -> Iterator[tuple[str, Read | Ingested | str]]:
    """Name and record of each file, in order, or why there is none; one that is the `same` is not read."""
    count = max(1, min(workers or cores(), len(items)))
    with Workers(count) as pool, ThreadPoolExecutor(count) as threads:

        def one(item: Item) -> tuple[str, Read | Ingested | str]:
            with suppress(UppliedError, OSError, ValueError):
                if (before := same(item)) is not None:
                    return name(item), before
            try:
                return name(item), pool.run(read, item)
            except WorkersBroken:
                raise
            except (JobKilled, UppliedError) as error:
                return name(item), f"{name(item)}: {error}" if isinstance(error, JobKilled) else str(error)
            except Exception as error:
                return name(item), f"{name(item)}: {type(error).__name__}: {error}"

        remaining = iter(items)
        while batch := list(islice(remaining, BATCH)):
            yield from threads.map(one, batch)


def content_of(read: Structure | Demonstration) -> tuple[str, ...]:
    """Values by which a record is known to be unchanged; a demonstration's hash is of all its words."""
    return (read.sha256, read.site, read.notes) if isinstance(read, Structure) else (read.sha256,)


def _added(name: str, read: Structure | Demonstration) -> Ingested:
    """A record that is new, with its warnings and overruled rules; a flight's with what it is."""
    if isinstance(read, Structure):
        return Ingested(name, "added", findings=tuple(map(str, from_json(read.verdicts_json))))
    camera = f"camera {read.camera.hfov_deg:.0f} x {read.camera.vfov_deg:.0f} deg"
    seconds = float(read.t_ns[-1] - read.t_ns[0]) * 1e-9
    words = f"{name} of {read.structure_id}, {len(read)} poses, {seconds:.0f} s, {camera}"
    words += f"; {read.notes}" if read.notes else ""
    return Ingested(name, "added", findings=tuple(map(str, findings_of(read.passport))), words=words)


def stored(
    reads: Iterator[tuple[str, Stored | Ingested | str]],
    known: Mapping[str, tuple[str, ...]],
    identify: Callable[[Stored], str],
    add: Callable[[list[Stored]], object],
    progress: Progress,
) -> list[Ingested]:
    """What became of the files, their records added a batch at a time; a known one is left as it is."""
    ingested: list[Ingested] = []
    waiting: list[Stored] = []
    seen: dict[str, str] = {}
    for name, read in reads:
        item = "" if isinstance(read, str) else read.name if isinstance(read, Ingested) else identify(read)
        if isinstance(read, str):
            ingested.append(Ingested(name, "failed", read))
        elif (first := seen.setdefault(item, name)) is not name:
            reason = f"{name}: its id {item!r} is that of {first}. Rename one of them"
            ingested.append(Ingested(name, "failed", reason))
        elif isinstance(read, Ingested) or known.get(item) == content_of(read):
            ingested.append(Ingested(item, "unchanged"))
        else:
            ingested.append(_added(item, read))
            waiting.append(read)
        progress(ingested[-1])
        if len(waiting) >= BATCH:
            add(waiting)
            waiting = []
    if waiting:
        add(waiting)
    return ingested
