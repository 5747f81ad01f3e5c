"""`upplied require` and `upplied zones`: which zones must be seen, and what became of each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.review import ByOption, NoteOption
from upplied.cli.terminal import CatalogOption, JsonOption, console, errors, next_step, opened, show

requiring = App(name="require", help="Say which zones of a structure, or of a kind, must be seen, and how.")
showing = App(name="zones", help="Say of every required zone whether it is met, as planned and as flown.")


@requiring.default
def require(
    owner: str,
    file: Path,
    /,
    *,
    kind: Annotated[bool, Parameter(negative="", help="The name is that of a kind.")] = False,
    by: ByOption,
    note: NoteOption = "",
    catalog: CatalogOption = "catalog",
) -> int:
    """Read a set of requirements; the set of the same name becomes its next version.

    Parameters
    ----------
    owner : str
        A structure, or with --kind a kind.
    file : Path
        TOML: `name`, and a `[[zone]]` each with `zone`, `where`, and what is asked: `gsd_mm`,
        `incidence_deg`, `max_age_days`. Without a zone the set is taken back.
    """
    import tomllib

    from upplied.errors import InputError
    from upplied.inputs.files import read_regular

    rule = "name = ..., and [[zone]] tables"
    try:
        said = tomllib.loads(read_regular(file, 1 << 20).decode("utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(str(file), f"is not TOML: {str(error)[:200]}", rule) from None
    zones = said.get("zone", [])
    if (
        set(said) - {"name", "zone"}
        or not isinstance(zones, list)
        or not all(isinstance(z, dict) for z in zones)
    ):
        raise InputError(str(file), "has other keys", rule)
    name = str(said.get("name", file.stem))
    opened(catalog).require("kind" if kind else "structure", owner, name, zones, by, note)
    console.print(f"{owner}: {name} asks for {len(zones)} zone(s)", markup=False)
    next_step(f"zones {'STRUCTURE' if kind else owner}", "what becomes of each", catalog)
    return 0


@showing.default
def zones(structure: str, /, *, catalog: CatalogOption = "catalog", json: JsonOption = False) -> int:
    """List the zones that are required of a structure; exit code 1 where one is not met as planned.

    Parameters
    ----------
    structure : str
        Its id.
    """
    from upplied.outputs.zones import zones as judged

    with errors.status("judging"):
        rows = judged(opened(catalog), structure)
    plain = [{name: None if value != value else value for name, value in row.items()} for row in rows]
    show(f"zones of {structure}", plain, json, ("asked_by", "version", "set", "probability", "on"))
    return int(any(row["planned"] != "met" for row in rows))
