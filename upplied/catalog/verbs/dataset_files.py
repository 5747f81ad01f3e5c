"""What makes an exported folder stand for itself: README, licence, data dictionary, and ``dataset.json``.

That one has the dataset's name (``name-v1``), where it came from, and the hash of every other file.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any

import pandas as pd

import upplied
from upplied.catalog.schema.dictionary import data_dictionary
from upplied.catalog.schema.tables import SCHEMA_VERSION, STEPS, TABLES
from upplied.errors import CatalogError, InputError
from upplied.files import replace_file

#: Not flights, which are flown again in a moment, and what people decide, change, overrule and find.
EXCHANGED = [name for name in TABLES if name in {*STEPS, *STEPS.values(), "structures"}]

DATASET = "dataset.json"
_MAX_ABOUT_BYTES = 64 << 20  # of dataset.json
_MAX_BYTES = 8 << 30  # of one file of a folder that is imported


def new_folder(folder: str | os.PathLike[str]) -> Path:
    """Where a dataset may be written: nothing lies there yet, else it is refused."""
    place = Path(folder)
    if place.exists() and any(place.iterdir()):
        raise InputError(str(place), "is not empty", "a new folder", "choose another")
    return place


def names_of(transfers: pd.DataFrame | Sequence[str]) -> list[str]:
    """The names of plans, of rows of `Catalog.transfers` or as they are."""
    return list(transfers["transfer_id"] if isinstance(transfers, pd.DataFrame) else transfers)


def describe(place: Path, about: dict[str, Any]) -> None:
    """Write what a person and a program need to know of the folder; `dataset.json` last."""
    about |= {
        "schema_version": SCHEMA_VERSION,
        "made_by": f"upplied {upplied.__version__}",
        "made_at": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    lines = [f"- {count} rows in `{table}.parquet`" for table, count in about["rows"].items()]
    whom = f" Please name: {about['attribution']}." if about["attribution"] else ""
    text = resources.files(__package__).joinpath("texts", "dataset.md").read_text(encoding="utf-8")
    readme = text.format(name=about["name"], rows="\n".join(lines), licence=about["licence"], whom=whom)
    replace_file(place / "README.md", readme.encode())
    replace_file(place / "LICENCE.txt", f"{about['licence']}\n{about['attribution']}\n".encode())
    replace_file(place / "DATA_DICTIONARY.md", data_dictionary().encode())
    files = {_relative(place, path): _sha256(path) for path in sorted(place.rglob("*")) if path.is_file()}
    replace_file(place / DATASET, json.dumps({**about, "files": files}, indent=2).encode())


def check_files(place: Path) -> tuple[str, set[str]]:
    """Compare the files with their hashes; the dataset's name (else the folder's), and the files' names.

    One missing, changed or unlisted is an error.
    """
    try:
        if not (path := place / DATASET).is_file() or path.stat().st_size > _MAX_ABOUT_BYTES:
            raise OSError("it is no file, or too large")
        about = json.loads(path.read_text(encoding="utf-8"))
        version, files = int(about["schema_version"]), dict(about["files"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise CatalogError(str(place / DATASET), f"cannot be read: {error}", "an exported folder") from None
    if version > SCHEMA_VERSION:
        fault = f"has schema version {version}"
        raise CatalogError(str(place), fault, f"at most {SCHEMA_VERSION}", "use a newer version")
    needed = {f"{name}.parquet" for name in EXCHANGED}
    for name in sorted(needed | set(files)):
        path = place / name
        if name not in files or _relative(place, path) != name or ".." in Path(name).parts:
            raise CatalogError(f"{place}: {name[:200]}", "is not listed, or lies outside the folder")
        if not path.is_file() or path.stat().st_size > _MAX_BYTES or _sha256(path) != files[name]:
            raise CatalogError(str(path), "is missing, too large, or not the file that was exported")
    named = re.fullmatch(r"[A-Za-z0-9_-]{1,64}", str(about.get("name", "")))
    return named[0] if named else place.resolve().name[:64], set(files)


def _relative(place: Path, path: Path) -> str:
    try:
        return path.resolve().relative_to(place.resolve()).as_posix()
    except ValueError:
        return ""


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
