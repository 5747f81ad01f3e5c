"""The half of `upplied catalog` that writes: merging, cleaning, giving away and taking in."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from upplied.cli.catalog import app
from upplied.cli.terminal import CatalogOption, console, opened, say


@app.command
def compact(*, catalog: CatalogOption = "catalog") -> int:
    """Merge small data files; readers and writers go on meanwhile."""
    from upplied.catalog import compact as merge

    _counted("merged files", merge(opened(catalog)))
    return 0


@app.command
def vacuum(
    *,
    keep_days: Annotated[float, Parameter(help="Younger versions can still be asked for.")] = 30.0,
    catalog: CatalogOption = "catalog",
) -> int:
    """Remove files that no version needs any more; rows are never removed."""
    from upplied.catalog import vacuum as clean

    done = clean(opened(catalog), keep_days)
    _counted("files removed", done.files_removed)
    _counted("rows of stopped writers removed", done.orphan_commits)
    console.print(
        f"{done.surfaces_removed} surfaces that no plan names removed, {done.drafts_removed} drafts"
    )
    console.print(f"{done.cache_bytes_freed} bytes of cache freed")
    return 0


@app.command
def export(
    folder: Path,
    /,
    *,
    format: Annotated[
        Literal["parquet", "lerobot", "tum"], Parameter(help="What it is for: any program, learning, evo.")
    ] = "parquet",
    licence: Annotated[str, Parameter(help="As an SPDX name (CC-BY-4.0), or in words.")] = "",
    name: Annotated[str, Parameter(help="With its version, as boxes-v1; else the folder's.")] = "",
    attribution: Annotated[str, Parameter(help="Whom to name.")] = "",
    kind: Annotated[str | None, Parameter(help="Only structures of this kind.")] = None,
    demonstration: Annotated[str | None, Parameter(help="Only this demonstration.")] = None,
    preset: Annotated[
        str,
        Parameter(help="Of this preset; all: of every one; else of the first in use: recommended, paper."),
    ] = "",
    catalog: CatalogOption = "catalog",
) -> int:
    """Write the plans that are ok, with all they refer to, as a folder that stands for itself.

    Parameters
    ----------
    folder : Path
        New, or empty.
    """
    from upplied.catalog import export_dataset, export_lerobot, export_tum

    store = opened(catalog)
    asked = preset if preset not in ("", "all") else None
    chosen = store.transfers(status="ok", kind=kind, demonstration=demonstration, preset=asked)
    if not preset:
        used = [name for name in ("recommended", "paper", "baseline") if name in set(chosen["preset"])]
        chosen = chosen[chosen["preset"].isin(used[:1])]
    if format == "tum":
        _counted(str(folder), export_tum(store, folder, chosen))
        return 0
    if format == "lerobot":
        flown = store.demonstrations()
        flown = flown[flown["structure_id"].isin(store.structures(kind=kind)["structure_id"])]
        names = [name for name in flown["demonstration_id"] if demonstration in (None, name)]
        _counted(str(folder), export_lerobot(store, folder, chosen, 10, names, licence, attribution))
        return 0
    name = name or folder.resolve().name
    _counted(str(folder), export_dataset(store, folder, name, chosen, licence, attribution))
    return 0


@app.command(name="import")
def import_(
    folder: Path,
    /,
    *,
    replace: Annotated[
        bool, Parameter(negative="", help="Let what has the same name here become a newer version.")
    ] = False,
    verify: Annotated[
        bool, Parameter(negative="", help="Compute the measures of every plan again, and compare them.")
    ] = False,
    catalog: CatalogOption = "catalog",
) -> int:
    """Take in an exported folder after checking all of it.

    Parameters
    ----------
    folder : Path
        As `upplied catalog export` wrote it.
    """
    from upplied.catalog import import_dataset
    from upplied.fleet.flights import measured

    done = import_dataset(opened(catalog), folder, replace, measured if verify else None)
    _counted("added rows", done)
    return 0


def _counted(what: str, counts: dict[str, int]) -> None:
    say(f"{what}: {_words(counts)}")


def _words(counts: dict[str, int]) -> str:
    said = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items() if count)
    return said or "none"
