"""`upplied watch FOLDER`: tell Prefect of every log that lands in a folder, once it has come whole.

The event ``upplied.log.landed`` (``upplied.flight.landed`` with ``--flights``) starts the ingest by a
trigger in prefect.yaml. Anything else may emit it, with the payload ``{"logs": [path, ...]}``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from prefect.events import emit_event
from watchfiles import watch as changes

from upplied.errors import InputError
from upplied.inputs.sources import door, photos

LANDED = "upplied.log.landed"
FLOWN = "upplied.flight.landed"  # of a log that is a flight of a plan, not a demonstration
QUIET_S = 10.0  # without a change: a log that says itself that it is whole waits no longer
STILL_S = 60.0  # of a file that cannot say it, and of a folder of photos
PATIENCE_S = 600.0  # one that never says so is told all the same, and ingest finds what is wrong with it
MAGIC = b"\x89MCAP0\r\n"  # MCAP specification, "Format": a file begins and ends with it


class Landing:
    """What lies in a folder and its subfolders, and what of it has been told; the clock gives seconds."""

    def __init__(self, folder: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self.folder, self._clock = folder, clock
        self._seen: dict[Path, tuple[tuple[int, int], float]] = {}  # size and change, and since when
        self._reported: dict[Path, tuple[int, int]] = {}

    def landed(self) -> Iterator[Path]:
        """Logs that have come whole since the last look, or have been changed and are whole again."""
        now = self._clock()
        for path, parts in self._flights():
            with suppress(OSError):  # gone since it was listed, or a link to nothing
                stats = [part.stat() for part in parts]
                facts = sum(stat.st_size for stat in stats), max(stat.st_mtime_ns for stat in stats)
                before, since = self._seen.get(path, (None, now))
                self._seen[path] = facts, since if facts == before else now
                if self._reported.get(path) == facts:
                    continue
                quiet = now - self._seen[path][1]
                if quiet >= _wait_s(path):
                    self._reported[path] = facts
                    if looks_like_flight(path):
                        yield path

    def _flights(self) -> Iterator[tuple[Path, list[Path]]]:
        """Files, and folders of photos with these."""
        for place in sorted({self.folder, *(path.parent for path in self.folder.rglob("*"))}):
            images = photos.members(place)
            if len(images) > 1:
                yield place, images
            for path in sorted(set(place.iterdir()) - set(images)):
                if path.is_file() and not path.name.startswith("."):
                    yield path, [path]


def _wait_s(path: Path) -> float:
    """How long a file is quiet before it counts as come whole: a log that ends as a whole one does, less."""
    if path.is_dir():
        return STILL_S
    with path.open("rb") as file:
        head = file.read(len(MAGIC))
        if path.suffix != ".mcap" and head != MAGIC:
            return STILL_S
        file.seek(max(len(MAGIC), path.stat().st_size - len(MAGIC)))
        return QUIET_S if head == file.read() == MAGIC else PATIENCE_S


def looks_like_flight(path: Path) -> bool:
    """Whether there is a flight to read, or one that cannot be read: ingest says then why."""
    try:
        return bool(door.kind_of(path))
    except InputError:
        return True


def watch(folder: Path, event: str = LANDED) -> None:
    """Tell of logs until Ctrl-C; what lies there at the start is told too, since ingest knows it."""
    landing = Landing(folder)
    tell(landing, event)
    # Woken by changes, and often enough without one to see that a log has been quiet.
    for _ in changes(folder, yield_on_timeout=True, rust_timeout=int(QUIET_S * 500), recursive=True):
        tell(landing, event)


def tell(landing: Landing, event: str = LANDED) -> None:
    """Emit the event for each log that has landed."""
    for path in landing.landed():
        resource = {"prefect.resource.id": f"upplied.log.{path.stem}", "prefect.resource.name": path.name}
        emit_event(event, resource, payload={"logs": [str(path.resolve())]})
