"""What all tests share: where real structures and flights lie, and the ones we make ourselves."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# Before numpy is loaded: on small matrices more threads than one only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder with `meshes/` and `logs/` of real structures and flights; tests skip where it is absent.

    Set UPPLIED_REAL_DATA to read another folder. The files carry other people's licences, so they
    are not part of this project.
    """
    folder = Path(os.environ.get("UPPLIED_REAL_DATA", ROOT.parent / "shared" / "data"))
    if not (folder / "meshes").is_dir():
        pytest.skip(f"no real structures at {folder}; set UPPLIED_REAL_DATA to a folder that has them")
    return folder
