"""`upplied set` and `upplied settings`: settings of kinds and structures, and where each comes from."""

from __future__ import annotations

from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.options import ByOption, CatalogOption, JsonOption, NoteOption, StructureArgument
from upplied.cli.terminal import console, next_step, opened, show

setting = App(name="set", help="Set planning parameters for a structure or for a whole kind.")
showing = App(name="settings", help="Show the planning parameters of a structure and their origin.")


@setting.default
def say(
    owner: str,
    /,
    *values: Annotated[str, Parameter(allow_leading_hyphen=False)],
    kind: Annotated[bool, Parameter(negative="", help="OWNER is a kind, not a structure.")] = False,
    by: ByOption,
    note: NoteOption = "",
    catalog: CatalogOption = "catalog",
) -> int:
    """Set parameters. Those of a structure override its kind; options of a run override both.

    Parameters
    ----------
    owner : str
        ID of a structure, or a kind with --kind.
    values : str
        As STAGE.NAME=VALUE: route.clearance_m=3, transfer.standoff=kept, transfer.gsd_m=0.002; without a
        value the parameter is inherited again. preset=recommended is the only preset that is flown.
    """
    from upplied.cli.transfer import changes
    from upplied.errors import SettingsError

    if not values:
        raise SettingsError("upplied set", "nothing is set", "STAGE.NAME=VALUE")
    made: dict[str, object] = {}
    for text in values:
        if text.endswith("="):
            made[text[:-1]] = None
            continue
        if text.startswith("preset="):
            made["preset"] = text.removeprefix("preset=")
            continue
        for stage, names in changes((text,)).items():
            made |= {f"{stage}.{name}": value for name, value in names.items()}
    opened(catalog).set("kind" if kind else "structure", owner, made, by, note)
    console.print(f"{owner}: {len(made)} set", markup=False)
    next_step("plan --dry-run", "show the plans that change", catalog)
    return 0


@showing.default
def settings(
    structure: StructureArgument,
    /,
    *,
    every: Annotated[
        bool, Parameter(name="--all", negative="", help="Include the parameters of the preset.")
    ] = False,
    catalog: CatalogOption = "catalog",
    json: JsonOption = False,
) -> int:
    """Show the planning parameters of a structure: by default those set for it or for its kind."""
    found = opened(catalog).settings_of(structure)
    if not (every or json):
        found = found[~found["from"].str.startswith("preset")]
    show(f"settings of {structure}", found.astype(object).to_dict("records"), json)
    return 0
