"""``python -m flows.watch FOLDER``: tell Prefect of every log that lands in a folder.

The event ``upplied.log.landed`` starts the deployment ``ingest-demonstrations`` with that log, and its
end starts ``transfer-fleet`` (the triggers are in prefect.yaml). Anything else may emit the same
event, with the payload ``{"logs": [path, ...]}``.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

from prefect.events import emit_event

LANDED = "upplied.log.landed"
EVERY_S = 5.0


def landed(folder: Path, seen: dict[Path, int]) -> Iterator[Path]:
    """Logs that are new since the last look and have stopped growing.

    Parameters
    ----------
    folder : path
        Watched with its subfolders.
    seen : dict
        Size of each log at the last look, -1 once it was told; changed in place.
    """
    for path in sorted(folder.rglob("*.mcap")):
        size = path.stat().st_size
        before = seen.get(path)
        if before == -1:
            continue
        seen[path] = -1 if size == before else size
        if size == before:
            yield path


def watch(folder: Path) -> NoReturn:
    """Look every few seconds, for ever; what lies there at the start is told too, since ingest knows it."""
    seen: dict[Path, int] = {}
    while True:
        for path in landed(folder, seen):
            emit_event(
                LANDED,
                resource={
                    "prefect.resource.id": f"upplied.log.{path.stem}",
                    "prefect.resource.name": path.name,
                },
                payload={"logs": [str(path.resolve())]},
            )
        time.sleep(EVERY_S)


def main(arguments: list[str]) -> int:
    """Watch the folder that is named, or say what is missing."""
    if len(arguments) != 1 or not Path(arguments[0]).is_dir():
        sys.stderr.write("usage: python -m flows.watch FOLDER, which exists\n")
        return 2
    if not os.environ.get("PREFECT_API_URL"):
        sys.stderr.write("PREFECT_API_URL is not set. Before this: set -a; source .env.example; set +a\n")
        return 2
    watch(Path(arguments[0]))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
