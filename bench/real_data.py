"""Structures of the real world, where a folder holds them; they are not part of this project.

``UPPLIED_REAL_DATA`` names the folder; without it, ``../shared/data`` beside the root is tried.
"""

from __future__ import annotations

import os
from pathlib import Path

from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import read_structure
from upplied.records import Structure, Surroundings

ROOT = Path(__file__).resolve().parents[1]


def real_folder() -> Path | None:
    """The folder with `meshes/`, or None where there is none."""
    folder = Path(os.environ.get("UPPLIED_REAL_DATA", ROOT.parent / "shared" / "data"))
    return folder if (folder / "meshes").is_dir() else None


def real_structure(folder: Path, place: str) -> Structure:
    """A mesh such as ``airplane/a320_fr24``: metres, Z up, nose along +X, the ground at its lowest point."""
    kind, name = place.split("/")
    return read_structure(
        StructureEntry(
            name,
            kind,
            folder / "meshes" / kind / f"{name}.ply",
            unit_m=1.0,
            surroundings=Surroundings(ground_z_m=0.0),
        )
    )
