"""Files that are replaced in one step."""

from __future__ import annotations

import os
from pathlib import Path


def replace_file(path: str | Path, content: bytes | str) -> Path:
    """Write a file beside `path`, then rename it; missing folders are created."""
    goal = Path(path)
    goal.parent.mkdir(parents=True, exist_ok=True)
    partial = goal.with_name(f".{goal.name}.{os.getpid()}.partial")
    try:
        with partial.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())  # else a power cut could leave an empty file
        partial.replace(goal)
    finally:
        partial.unlink(missing_ok=True)
    return goal
