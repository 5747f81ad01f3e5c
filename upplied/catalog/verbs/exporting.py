"""A part of a catalog as a folder that stands for itself; `importing` takes it in.

With it go README, licence, data dictionary, ``splits.json`` (which side of learning each structure is on) and
``dataset.json``: the dataset's name (``name-v1``), where it came from, and the hash of every other file.
"""

import hashlib
import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from importlib import resources
from itertools import zip_longest
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa

import upplied
from upplied.catalog.database import Catalog
from upplied.catalog.schema import codec
from upplied.catalog.schema.tables import SCHEMA_VERSION, STEPS, TABLES, data_dictionary
from upplied.catalog.store.contents import NAMED_CONTENTS, States, file_name
from upplied.catalog.verbs.custody import checked_steps
from upplied.catalog.verbs.published import write
from upplied.errors import CatalogError, InputError
from upplied.files import replace_file

#: Not flights, which are flown again in a moment, and what people decide, change, overrule and find.
EXCHANGED = [name for name in TABLES if name in {*STEPS, *STEPS.values(), "structures"}]
DATASET = "dataset.json"
SHARES = {"train": 0.8, "validation": 0.1, "test": 0.1}
_HELD_BACK = ("test", "validation")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}-v[1-9][0-9]*")
_MAX_ABOUT_BYTES = 64 << 20  # of dataset.json
_MAX_BYTES = 8 << 30  # of one file of a folder that is imported


def export_dataset(
    catalog: Catalog,
    folder: str | os.PathLike[str],
    name: str,
    transfers: pd.DataFrame | Sequence[str],
    licence: str,
    attribution: str = "",
) -> dict[str, int]:
    """Write some plans, with all they refer to, as a folder that stands for itself.

    Parameters
    ----------
    catalog : Catalog
    folder : path
        New, or empty.
    name : str
        With its version, as ``airliners-v1``.
    transfers : DataFrame or sequence of str
        Rows of `Catalog.transfers`, or names of plans.
    licence : str
        Under which the data may be used, as an SPDX name (``CC-BY-4.0``) or in words.
    attribution : str
        Whom to name.

    Returns
    -------
    dict
        Rows written, by table.
    """
    place = new_folder(folder)
    if not _NAME.fullmatch(name):
        raise InputError(f"dataset name {name[:80]!r}", "is not a name with a version", "like airliners-v1")
    if not licence.strip():
        raise InputError(f"dataset {name}", "has no licence", "say one, like CC-BY-4.0")
    names, every = set(names_of(transfers)), catalog.transfers(every=True)
    missing = sorted(names - set(every["transfer_id"]))
    if missing or not names:
        what = f"transfers {', '.join(missing[:5]) or '(none)'}"
        raise CatalogError(what, "are not in the catalog", "at least one that is")
    plans = every[every["transfer_id"].isin(names)]
    demonstrations = _only(catalog.demonstrations(every=True), "demonstration_id", plans["demonstration_id"])
    needed = {*plans["source_id"], *plans["target_id"], *demonstrations["structure_id"]}
    needed |= {*plans["parts_told_by"].dropna()} - {""}
    structures = _only(catalog.structures(every=True), "structure_id", needed)
    frames = {"structures": structures, "demonstrations": demonstrations, "transfers": plans}
    tables: dict[str, Iterable[pa.Table]] = {
        name: [pa.Table.from_pandas(rows, TABLES[name].schema, preserve_index=False)]
        for name, rows in frames.items()
    }
    tables["poses"] = checked_steps(catalog, "poses", demonstrations)
    tables["waypoints"] = checked_steps(catalog, "waypoints", plans[plans["n_waypoints"] > 0])
    try:
        counts = {name: write(place / f"{name}.parquet", TABLES[name], tables[name]) for name in EXCHANGED}
    except OSError as error:
        raise CatalogError(str(place), f"cannot be written: {error}", "", "free space or rights") from None
    for kind, table, column in NAMED_CONTENTS:
        for sha256 in sorted({*frames[table][column]} - {""}) if table in frames else ():
            _put(catalog, place, kind, sha256)
    splits = splits_of(catalog, plans.to_dict("records"))
    replace_file(place / "splits.json", json.dumps(splits, indent=1))
    describe(place, {"name": name, "licence": licence, "attribution": attribution, "rows": counts})
    return counts


def _put(catalog: Catalog, place: Path, kind: str, sha256: str) -> None:
    path = place / kind / file_name(sha256)
    if not path.exists():
        record = catalog.contents[kind].get(sha256)
        replace_file(path, codec.encode(record))
        if isinstance(record, States):
            _put(catalog, place, "samples", record.samples_sha256)


def _only(frame: pd.DataFrame, column: str, names: Any) -> pd.DataFrame:
    return frame[frame[column].isin(set(names))].drop_duplicates(column, keep="last")  # retired or not


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
    about |= {"schema_version": SCHEMA_VERSION, "made_by": f"upplied {upplied.__version__}"}
    about["made_at"] = datetime.now(UTC).isoformat(timespec="seconds")
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
    """The dataset's name (else the folder's) and its files, of which none is missing, changed or unlisted."""
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
    for name in sorted({f"{table}.parquet" for table in EXCHANGED} | set(files)):
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


def splits_of(
    catalog: Catalog, plans: Iterable[Mapping[str, Any]], demonstrations: Iterable[str] | None = None
) -> dict[str, dict[str, dict[str, list[Any]]]]:
    """What is for training of some plans and demonstrations (all in use): the content of ``splits.json``.

    By structure: none on two sides, each kind on all where it has enough members; by kind: each left out.
    """
    kinds, flights = kinds_of(catalog), catalog.demonstrations()
    flown = dict(zip(flights["demonstration_id"], flights["structure_id"], strict=True))
    planned = {str(row["transfer_id"]): str(row["target_id"]) for row in plans}
    names = flown if demonstrations is None else demonstrations
    owned = {"plans": planned, "demonstrations": {name: flown[name] for name in names}}

    def parted(sides: Iterable[str], side_of: Mapping[str, str], structure_of: Mapping[str, Any]) -> Any:
        """By side, then by sort, the names of what belongs to structures on that side."""
        return {
            side: {
                sort: sorted(name for name, at in each.items() if side_of.get(at) == side)
                for sort, each in structure_of.items()
            }
            for side in sides
        }

    every = {"structures": {name: name for name in kinds}, **owned}
    return {
        "by_structure": parted(SHARES, split_of(kinds), every),
        "by_kind": parted(sorted(set(kinds.values())), kinds, owned),
    }


def kinds_of(catalog: Catalog) -> dict[str, str]:
    """The kind of each structure in the fleet."""
    return dict(catalog.structures()[["structure_id", "kind"]].itertuples(index=False, name=None))


def split_of(kinds: Mapping[str, str]) -> dict[str, str]:
    """The side of each structure, the same on every machine: by the hash of its name, kind by kind."""
    sides: dict[str, str] = {}
    for kind in sorted(set(kinds.values())):
        names = [name for name in kinds if kinds[name] == kind]
        names.sort(key=lambda name: hashlib.sha256(name.encode()).hexdigest())
        count = {side: round(len(names) * SHARES[side]) or int(len(names) >= 3) for side in _HELD_BACK}
        held_back = [side for side in _HELD_BACK for _ in range(count[side])]
        sides |= zip_longest(names, held_back, fillvalue="train")
    return sides
