"""The processes of this machine, as /proc tells of them: what fault tests aim at and look for."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path


def children(pid: int) -> list[int]:
    """Processes that a process started; none where it has ended."""
    try:
        threads = list(Path(f"/proc/{pid}/task").iterdir())
        return [int(child) for thread in threads for child in (thread / "children").read_text().split()]
    except (FileNotFoundError, ProcessLookupError):
        return []


def descendants(pid: int) -> list[int]:
    """Children, their children, and so on; the youngest first."""
    return [pid for child in children(pid) for pid in (*descendants(child), child)]


def command(pid: int) -> str:
    """The command line; empty where the process has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except (FileNotFoundError, ProcessLookupError):
        return ""


def ended(pid: int) -> bool:
    """Whether a process has ended, be it that its parent has not looked yet."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def cut_the_power(pid: int) -> None:
    """End a process and all that came of it at once, without a word."""
    for victim in (*descendants(pid), pid):
        with suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)


def at_work_in(place: Path) -> list[int]:
    """Processes whose working folder this is."""
    pids = []
    for folder in Path("/proc").iterdir():
        with suppress(FileNotFoundError, PermissionError, ProcessLookupError):
            if folder.name.isdigit() and (folder / "cwd").readlink() == place:
                pids.append(int(folder.name))
    return pids


def with_variable(name: str, value: str) -> list[int]:
    """Processes that were started with this variable in their environment, and have not ended."""
    variable, pids = f"{name}={value}".encode(), []
    for folder in Path("/proc").iterdir():
        with suppress(FileNotFoundError, PermissionError, ProcessLookupError):
            if folder.name.isdigit() and variable in (folder / "environ").read_bytes().split(b"\0"):
                pids.append(int(folder.name))
    return [pid for pid in pids if not ended(pid)]
