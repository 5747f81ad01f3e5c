"""`upplied set`, `settings`, `require` and `zones`: what is declared of kinds and structures.

Parameters of plans, with where each comes from; and zones that must be seen, with what became of each.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
from upplied.cli.terminal import console, errors, next_step, opened, plain, show

if TYPE_CHECKING:
    from upplied.catalog import Catalog

setting = App(name="set", help="Set planning parameters for a structure or for a whole kind.")
showing = App(name="settings", help="Show the planning parameters of a structure and their origin.")
requiring = App(
    name="require", help="Require zones of a structure or of a kind: what must be seen, and how well."
)
covering = App(name="zones", help="Show which required zones are covered, by plans and by flights.")


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
    every: Annotated[bool, Parameter(name="--all", help="Include the parameters of the preset.")] = False,
    catalog: CatalogOption = "catalog",
    json: JsonOption = False,
) -> int:
    """Show the planning parameters of a structure: by default those set for it or for its kind."""
    rows = opened(catalog).settings_of(structure)
    if not (every or json):
        rows = rows[~rows["from"].str.startswith("preset")]
    show(f"settings of {structure}", rows.astype(object).to_dict("records"), json)
    return 0


@requiring.default
def require(
    owner: OwnerArgument,
    file: Path,
    /,
    *,
    kind: KindOption = False,
    by: ByOption,
    note: NoteOption = "",
    catalog: CatalogOption = "catalog",
) -> int:
    """Import a set of requirements; a set of the same name becomes its next version.

    Parameters
    ----------
    file : Path
        TOML: `name`, and a `[[zone]]` each with `zone`, `where` and requirements: `looks`, `gsd_mm`,
        `incidence_deg`, `max_age_days`. Instead of `where` a zone may name a `label` of the faces
        that the file `labels` labels. A set without zones is withdrawn.
    """
    import tomllib

    from upplied.errors import InputError
    from upplied.inputs.files import read_regular

    rule = "name = ..., and [[zone]] tables"
    try:
        document = tomllib.loads(read_regular(file, 1 << 20).decode("utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(str(file), f"is not TOML: {str(error)[:200]}", rule) from None
    zones = document.get("zone", [])
    if (
        set(document) - {"name", "zone", "labels"}
        or not isinstance(zones, list)
        or not all(isinstance(z, dict) for z in zones)
    ):
        raise InputError(str(file), "has other keys", rule)
    name, store = str(document.get("name", file.stem)), opened(catalog)
    zones = _with_labels(store, zones, document.get("labels"), file, "" if kind else owner)
    store.require("kind" if kind else "structure", owner, name, zones, by, note)
    console.print(f"{owner}: {name} requires {len(zones)} zone(s)", markup=False)
    next_step(f"zones {'STRUCTURE' if kind else owner}", "show whether each is covered", catalog)
    return 0


def _with_labels(
    store: Catalog, zones: list[dict[str, Any]], labels: object, file: Path, owner: str
) -> list[dict[str, Any]]:
    """The zones with the place of those that name a label of faces."""
    from upplied.errors import InputError
    from upplied.inputs.face_labels import read_face_labels

    label_files: dict[str, str] = {}
    labelled = []
    for zone in zones:
        if "label" not in zone:
            labelled.append(zone)
            continue
        what = f"{file}, zone {str(zone.get('zone', '(unnamed)'))[:60]}"
        on = str(zone.get("on") or owner)
        if not isinstance(labels, str) or "where" in zone:
            fault = (
                "has a label and a place" if "where" in zone else "has a label, but names no file of labels"
            )
            raise InputError(what, fault, 'labels = "FILE" next to the name, and label instead of where')
        if not on:
            raise InputError(
                what, "has a label, but no structure", 'on = "ID": the structure that is labelled'
            )
        if on not in label_files:
            faces = len(store.structure(on).triangles)
            label_files[on] = store.add_labels(on, read_face_labels(file.parent / labels, faces, on))
        rest = {name: value for name, value in zone.items() if name != "label"}
        labelled.append(rest | {"where": f"labels {label_files[on]} {zone['label']}"})
    return labelled


@covering.default
def zones(
    structure: StructureArgument,
    /,
    *,
    mesh: Path | None = None,
    catalog: CatalogOption = "catalog",
    json: JsonOption = False,
) -> int:
    """List the required zones of a structure; exit code 1 if the plans do not cover one.

    Parameters
    ----------
    mesh : Path
        Save the structure's mesh as PLY, for labelling faces.
    """
    if mesh is not None:
        return _mesh(opened(catalog), structure, mesh)
    from upplied.outputs.zones import zones as judged

    with errors.status("judging"):
        rows = judged(opened(catalog), structure)
    show(
        f"zones of {structure}",
        [plain(row) for row in rows],
        json,
        ("asked_by", "version", "set", "probability", "on"),
    )
    return int(any(row["planned"] != "met" for row in rows))


def _mesh(store: Catalog, structure_id: str, path: Path) -> int:
    from upplied.outputs.files import replace_file
    from upplied.outputs.ply import ply_bytes

    structure = store.structure(structure_id)
    replace_file(path, ply_bytes(structure.vertices, structure.triangles, structure.normals))
    console.print(f"{path}: {len(structure.triangles)} faces", markup=False)
    return 0
