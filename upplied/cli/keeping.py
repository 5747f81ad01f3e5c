"""The half of `upplied catalog` that writes: merging, cleaning, exporting and importing."""

from __future__ import annotations

import re
from itertools import count
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from upplied.cli.catalog import app
from upplied.cli.terminal import HERE, Where, console, errors, say

NO_LICENCE = "All rights reserved"  # whoever gives data away chooses another
FormatOption = Annotated[
    Literal["parquet", "lerobot", "tum"],
    Parameter(help="parquet for any program, lerobot for learning, tum for evo."),
]
NameOption = Annotated[
    str, Parameter(help="Name with a version, as boxes-v1; by default that of the folder.")
]
PresetOption = Annotated[
    str, Parameter(help="Preset, or all; by default the first in use of recommended, paper, baseline.")
]
DaysOption = Annotated[float, Parameter(help="Days for which older versions stay readable.")]


@app.command
def compact(*, where: Where = HERE) -> int:
    """Merge small data files; readers and writers are not interrupted."""
    from upplied.catalog import compact as merge

    with errors.status("merging files"):
        _counted("merged files", merge(where.opened()))
    return 0


@app.command
def vacuum(*, keep_days: DaysOption = 30.0, where: Where = HERE) -> int:
    """Remove files that no version needs; rows are never removed."""
    from upplied.catalog import vacuum as clean

    with errors.status("removing files"):
        done = clean(where.opened(), keep_days)
    _counted("files removed", done.files_removed)
    _counted("rows of stopped writers removed", done.orphan_commits)
    console.print(
        f"{done.surfaces_removed} unused surfaces and {done.drafts_removed} unfinished exports removed"
    )
    console.print(f"{done.cache_bytes_freed} bytes of cache freed")
    return 0


@app.command
def export(
    folder: Path | None = None,
    /,
    *,
    format: FormatOption = "parquet",
    licence: Annotated[str, Parameter(help="Licence: an SPDX name (CC-BY-4.0) or a sentence.")] = NO_LICENCE,
    name: NameOption = "",
    attribution: Annotated[str, Parameter(help="Name that users must credit.")] = "",
    kind: Annotated[str | None, Parameter(help="Only structures of this kind.")] = None,
    demonstration: Annotated[str | None, Parameter(help="Only this demonstration.")] = None,
    preset: PresetOption = "",
    where: Where = HERE,
) -> int:
    """Export all plans with result ok and their inputs as a folder.

    Parameters
    ----------
    folder : Path
        New or empty folder; by default fleet-v1 here, or the next version that does not exist.
    """
    from upplied.catalog import export_dataset, export_lerobot, export_tum

    store = where.opened()
    folder = folder or next(each for at in count(1) if not (each := Path(f"fleet-v{at}")).exists())
    chosen_preset = preset if preset not in ("", "all") else None
    chosen = store.transfers(status="ok", kind=kind, demonstration=demonstration, preset=chosen_preset)
    if not preset:
        used = [name for name in ("recommended", "paper", "baseline") if name in set(chosen["preset"])]
        chosen = chosen[chosen["preset"].isin(used[:1])]
    with errors.status("exporting"):
        if format == "tum":
            counts = export_tum(store, folder, chosen)
        elif format == "lerobot":
            flown = store.demonstrations()
            flown = flown[flown["structure_id"].isin(store.structures(kind=kind)["structure_id"])]
            names = [each for each in flown["demonstration_id"] if demonstration in (None, each)]
            counts = export_lerobot(store, folder, chosen, 10, names, licence, attribution)
        else:
            name = name or versioned(folder.resolve().name)
            counts = export_dataset(store, folder, name, chosen, licence, attribution)
    _counted(str(folder), counts)
    return 0


def versioned(name: str) -> str:
    """A name with a version: its own, or the first."""
    return name if re.search(r"-v\d+$", name) else f"{name}-v1"


@app.command(name="import")
def import_(
    folder: Path,
    /,
    *,
    replace: Annotated[bool, Parameter(help="Store entries of the same name as newer versions.")] = False,
    verify: Annotated[bool, Parameter(help="Compute the measures of every plan again and compare.")] = False,
    where: Where = HERE,
) -> int:
    """Import an exported folder after checking it.

    Parameters
    ----------
    folder : Path
        As `upplied catalog export` wrote it.
    """
    from upplied.catalog import import_dataset
    from upplied.fleet.flights import measured

    with errors.status("importing"):
        done = import_dataset(where.opened(), folder, replace, measured if verify else None)
    _counted("added rows", done)
    return 0


def _counted(what: str, counts: dict[str, int]) -> None:
    words = ", ".join(f"{number} {name.replace('_', ' ')}" for name, number in counts.items() if number)
    say(f"{what}: {words or 'none'}")
