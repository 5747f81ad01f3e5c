"""`upplied set` and `upplied settings`: settings of kinds and structures, and where each comes from."""

from __future__ import annotations

from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.options import (
    ByOption,
    CatalogOption,
    JsonOption,
    KindOption,
    NoteOption,
    OwnerArgument,
    StructureArgument,
)  # fmt: skip
from upplied.cli.terminal import console, next_step, opened, show

setting = App(name="set", help="Set planning parameters for a structure or for a whole kind.")
showing = App(name="settings", help="Show the planning parameters of a structure and their origin.")


@setting.default
def say(
    owner: OwnerArgument,
    /,
    *values: Annotated[str, Parameter(allow_leading_hyphen=False)],
    kind: KindOption = False,
    by: ByOption,
    note: NoteOption = "",
    catalog: CatalogOption = "catalog",
) -> int:
    """Set parameters. Those of a structure override its kind; options of a run override both.

    Parameters
    ----------
    values : str
        As STAGE.NAME=VALUE: route.clearance_m=3, transfer.standoff=kept, transfer.gsd_m=0.002; without a
        value the parameter is inherited again. preset=recommended is the only preset that is flown.
    """
    from upplied.cli.transfer import changes
    from upplied.errors import SettingsError

    if not values:
        raise SettingsError("upplied set", "nothing is set", "STAGE.NAME=VALUE")
    pairs: dict[str, object] = {}
    for text in values:
        if text.endswith("="):
            pairs[text[:-1]] = None
            continue
        if text.startswith("preset="):
            pairs["preset"] = text.removeprefix("preset=")
            continue
        for stage, names in changes((text,)).items():
            pairs |= {f"{stage}.{name}": value for name, value in names.items()}
    opened(catalog).set("kind" if kind else "structure", owner, pairs, by, note)
    console.print(f"{owner}: {len(pairs)} set", markup=False)
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
    rows = opened(catalog).settings_of(structure)
    if not (every or json):
        rows = rows[~rows["from"].str.startswith("preset")]
    show(f"settings of {structure}", rows.astype(object).to_dict("records"), json)
    return 0
