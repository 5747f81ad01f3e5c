"""Stands for systemd in the drills: starts the services of docs/operating.md, and starts again what ends.

    python supervisor.py FOLDER UNIT ...

A unit's ``ExecStart`` is run as it is written, with this Python in place of the installed one.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

from upplied.flows.server import end_with_parent, stop

ROOT = Path(__file__).parents[1]
RESTART_S = 1.0  # the units say 10: nothing in a drill depends on the pause


def units() -> dict[str, str]:
    """The units of the page, by name."""
    page = (ROOT / "docs" / "operating.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```ini\n(.*?)```", page, re.DOTALL)
    return {re.search(r"system/(\S+?)(?:@?\.service)", block)[1]: block for block in blocks}


def words(unit: str) -> list[str]:
    """What a unit runs."""
    program, *rest = re.search(r"^ExecStart=(.*)$", unit, re.MULTILINE)[1].split()
    return [sys.executable, "-m", Path(program).name, *rest]


def start(name: str, folder: Path) -> subprocess.Popen[bytes]:
    """Run a unit in a folder; the kernel ends it when this process is killed."""
    with (folder / f"{name}.log").open("ab") as log:
        return subprocess.Popen(
            words(units()[name]),
            cwd=folder,
            env=os.environ | {"UPPLIED_HOME": str(folder)},
            stdout=log,
            stderr=log,
            start_new_session=True,
            preexec_fn=end_with_parent,
        )


def main() -> None:
    """Keep the units running until SIGTERM."""
    folder, names = Path(sys.argv[1]), sys.argv[2:]
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    running = {name: start(name, folder) for name in names}
    try:
        while True:
            for name, process in running.items():
                if process.poll() is not None:
                    stop(process, 1.0)
                    time.sleep(RESTART_S)
                    running[name] = start(name, folder)
            time.sleep(0.2)
    finally:
        for process in reversed(running.values()):
            stop(process)


if __name__ == "__main__":
    main()
