"""Files that are replaced in one step, and that are on the disk then."""

import os
import uuid
from pathlib import Path


def replace_file(path: str | Path, content: bytes | str, lasting: bool = True, private: bool = False) -> Path:
    """Write a file beside `path`, then rename it: readers see the old bytes or the new; its path.

    Missing folders are created. Unless `lasting`, a power cut may empty it; a `private` one is its owner's.
    """
    goal = Path(path)
    goal.parent.mkdir(parents=True, exist_ok=True)
    draft = goal.with_name(f".{goal.name}.{uuid.uuid4().hex[:8]}.draft")
    try:
        mode = 0o600 if private else 0o666
        with open(draft, "xb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
            file.write(content.encode() if isinstance(content, str) else content)
            if lasting:
                file.flush()
                os.fsync(file.fileno())
        os.replace(draft, goal)
    finally:
        draft.unlink(missing_ok=True)
    if lasting:
        sync_path(goal.parent)
    return goal


def sync_path(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    if path.is_dir() and not hasattr(os, "O_DIRECTORY"):
        return  # Windows does not open folders
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
