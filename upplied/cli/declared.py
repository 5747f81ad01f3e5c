"""`upplied set`, `settings`, `require` and `zones`: parameters and required zones of kinds and structures."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from upplied.cli.options import By, Note, OfKind, Owner, StructureId, Words
from upplied.cli.terminal import HERE, PRINTED, Results, Where, errors, plain, say
from upplied.errors import InputError, SettingsError
from upplied.files import replace_file
from upplied.outputs.labels import LABELS

if TYPE_CHECKING:
    from upplied.catalog import Catalog

Every = Annotated[bool, Parameter("--all", help="Include the parameters of the preset.")]


def set_(
    owner: Owner, /, *values: Words, kind: OfKind = False, by: By, note: Note = "", where: Where = HERE
) -> int:
    """Set planning parameters for a structure or for a whole kind.

    Those of a structure override its kind; options of a run override both.

    Parameters
    ----------
    values : str
        Parameters as STAGE.NAME=VALUE: route.clearance_m=3, transfer.standoff=kept, transfer.gsd_m=0.002;
        without a value the parameter is inherited again. preset=recommended is the only preset that is flown.
    """
    from upplied.cli.transfer import changes

    if not values:
        raise SettingsError("upplied set", "nothing is set", "STAGE.NAME=VALUE")
    pairs: dict[str, object] = {}
    for text in values:
        if text.endswith("="):
            pairs[text[:-1]] = None
        elif text.startswith("preset="):
            pairs["preset"] = text.removeprefix("preset=")
        else:
            ((stage, names),) = changes((text,)).items()
            pairs |= {f"{stage}.{name}": value for name, value in names.items()}
    where.opened().set("kind" if kind else "structure", owner, pairs, by, note)
    say(f"{owner}: {len(pairs)} set")
    where.next_step("plan --dry-run", "show the plans that change")
    return 0


def settings(structure: StructureId, /, *, every: Every = False, results: Results = PRINTED) -> int:
    """Show the planning parameters of a structure and their origin: those set for it or for its kind."""
    rows = results.opened().settings_of(structure)
    if not (every or results.json):
        rows = rows[~rows["from"].str.startswith("preset")]
    results.show(f"settings of {structure}", rows.astype(object).to_dict("records"))
    return 0


def require(
    owner: Owner, file: Path, /, *, kind: OfKind = False, by: By, note: Note = "", where: Where = HERE
) -> int:
    """Require zones of a structure or of a kind, with the quality of their pictures.

    A set of the same name becomes its next version.

    Parameters
    ----------
    file : Path
        TOML: `name`, and a `[[zone]]` each with `zone`, `where` and requirements: `looks`, `gsd_mm`,
        `incidence_deg`, `max_age_days`. Instead of `where` a zone may give a face `label`
        of the file named in `labels`. A set without zones is withdrawn.
    """
    from upplied.inputs.files import read_regular

    rule = "name = ..., and [[zone]] tables"
    try:
        document = tomllib.loads(read_regular(file, 1 << 20).decode("utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(str(file), f"is not TOML: {str(error)[:200]}", rule) from None
    zones = document.get("zone", [])
    tables = isinstance(zones, list) and all(isinstance(zone, dict) for zone in zones)
    if set(document) - {"name", "zone", "labels"} or not tables:
        raise InputError(str(file), "has other keys", rule)
    name, store = str(document.get("name", file.stem)), where.opened()
    zones = _with_labels(store, zones, document.get("labels"), file, "" if kind else owner)
    store.require("kind" if kind else "structure", owner, name, zones, by, note)
    say(f"{owner}: {name} requires {len(zones)} zone(s)")
    where.next_step(f"zones {'STRUCTURE' if kind else owner}", "show whether each is covered")
    return 0


def _with_labels(
    store: Catalog, zones: list[dict[str, Any]], labels: object, file: Path, owner: str
) -> list[dict[str, Any]]:
    from upplied.inputs.columns import read_face_labels

    label_files: dict[str, str] = {}
    labelled = []
    file_rule = 'labels = "FILE" next to the name, and label instead of where'
    for zone in zones:
        if "label" not in zone:
            labelled.append(zone)
            continue
        what = f"{file}, zone {str(zone.get('zone', '(unnamed)'))[:60]}"
        on = str(zone.get("on") or owner)
        if "where" in zone:
            raise InputError(what, "has a label and a place", file_rule)
        if not isinstance(labels, str):
            raise InputError(what, "has a label, but names no file of labels", file_rule)
        if not on:
            rule = 'on = "ID": the structure that is labelled'
            raise InputError(what, "has a label, but no structure", rule)
        if on not in label_files:
            faces = len(store.structure(on).triangles)
            label_files[on] = store.add_labels(on, read_face_labels(file.parent / labels, faces, on))
        rest = {name: value for name, value in zone.items() if name != "label"}
        labelled.append(rest | {"where": f"labels {label_files[on]} {zone['label']}"})
    return labelled


def zones(structure: StructureId, /, *, mesh: Path | None = None, results: Results = PRINTED) -> int:
    """Show which required zones of a structure are covered, by plans and by flights.

    Exit code 1 if the plans do not cover one.

    Parameters
    ----------
    mesh : Path
        Save the structure's mesh as PLY, for labelling faces.
    """
    if mesh is not None:
        from upplied.outputs.display import ply_bytes

        record = results.opened().structure(structure)
        replace_file(mesh, ply_bytes(record.vertices, record.triangles, record.normals))
        say(f"{mesh}: {len(record.triangles)} faces")
        return 0
    from upplied.outputs.zones import zones as judged

    with errors.status("judging"):
        rows = judged(results.opened(), structure)
    titles = {name: name for name in LABELS["zones"]} if results.json else LABELS["zones"]
    shown = [{title: plain(row)[name] for name, title in titles.items()} for row in rows]
    spare = ("required by", "version", "set", "probability", "defined on")
    results.show(f"zones of {structure}", shown, spare)
    return int(any(row["planned"] != "met" for row in rows))
