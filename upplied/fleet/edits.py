"""Changes of plans: out as a file and back, kept as drafts judged anew, carried over to later drafts."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.catalog.schema.plan_rows import transfer_id as id_of
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs.belonging import FLOWN
from upplied.catalog.verbs.roster import author
from upplied.config import digest
from upplied.errors import InputError, RefusedError, UppliedError
from upplied.files import replace_file
from upplied.fleet.editing import Base, Editing, boxes_of
from upplied.fleet.gaps import derived_from
from upplied.inputs.files import read_regular
from upplied.proof.carried_edit import combined, edit_from_json, edit_json, stored_edit
from upplied.proof.edit import AirspaceLimits, Edit, Viewpoint, edit_of
from upplied.provenance import method

_MOST_BYTES = 16 << 20
_MOST_BOXES = 1000
FARTHEST_M = 100_000.0  # of a viewpoint or a corner of a box from the structure's origin
_COLUMNS = ("x_m", "y_m", "z_m", "yaw_deg", "pitch_deg")  # of a viewpoint
_RULE = "a file as `upplied edit ID --out FILE` writes it"
_EARLIER = ("rejected", "recalled")  # states of a changed plan whose change is not carried over


def write_edit(catalog: Catalog, transfer_id: str, path: str | Path) -> Path:
    """Write the viewpoints of a plan as JSON, to be changed and read again by `edit_plan`."""
    editing = Editing(catalog, transfer_id)
    rows = [viewpoint_row(number, p) for number, p in enumerate(editing.stored.viewpoints)]
    document = {"plan": transfer_id, "target": editing.target.structure_id, "clearance_m": editing.usual_m}
    text = json.dumps({**document, "keep_out": [], "viewpoints": rows}, indent=1)
    return replace_file(Path(path), text + "\n")


def viewpoint_row(number: int, viewpoint: Viewpoint) -> dict[str, float]:
    values = (*viewpoint.position, viewpoint.yaw_deg, viewpoint.pitch_deg)
    row = {name: round(value, 4) for name, value in zip(_COLUMNS, values, strict=True)}
    return {"viewpoint": number, **row}


def edit_plan(catalog: Catalog, transfer_id: str, path: str | Path, by: str) -> str:
    """Read a changed file (`read_edit`) and keep the plan that follows as a draft (`keep_edit`); its id."""
    by, editing = author(by, str(path)), Editing(catalog, transfer_id)
    try:
        document = json.loads(read_regular(Path(path), _MOST_BYTES).decode("utf-8"))
        if document["plan"] != transfer_id:
            raise InputError(str(path), f"is for plan {document['plan']!s:.40}, not {transfer_id}", _RULE)
    except (UnicodeDecodeError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise _unreadable(str(path), error) from None
    edit, airspace = read_edit(str(path), document, editing, editing.stored)
    return keep_edit(catalog, editing, editing.stored, edit, airspace, by, what=str(path))


def read_edit(
    what: str, document: Mapping[str, Any], editing: Editing, base: Base
) -> tuple[Edit, AirspaceLimits]:
    """What differs from a plan in the viewpoints, boxes and clearance that a file, or a page, says."""
    count, after = len(base.viewpoints), {}
    try:
        for row in document["viewpoints"]:
            number = int(row["viewpoint"])
            if number in after or not 0 <= number < count:
                raise InputError(what, f"has a viewpoint {number} too many", f"0 to {count - 1}, each once")
            x, y, z, yaw, pitch = (float(row[name]) for name in _COLUMNS)
            after[number] = Viewpoint((x, y, z), yaw, pitch)
        boxes = np.array(document.get("keep_out", []), float).reshape(-1, 2, 3)
        clearance = float(document.get("clearance_m", 0.0))
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise _unreadable(what, error) from None
    numbers = [value for p in after.values() for value in (*p.position, p.yaw_deg, p.pitch_deg)]
    if not np.isfinite([*numbers, clearance, *boxes.ravel()]).all():
        raise InputError(what, "contains a value that is not a number", _RULE)
    places = [*(p.position for p in after.values()), *boxes.reshape(-1, 3), (clearance, 0.0, 0.0)]
    if np.abs(np.array(places)).max() > FARTHEST_M:
        raise InputError(what, "lies too far away", f"at most {FARTHEST_M:g} m from the structure's origin")
    if any(not -90 <= p.pitch_deg <= 90 for p in after.values()):
        raise InputError(what, "turns a camera beyond straight up or down", "-90 to 90 degrees of pitch")
    if len(boxes) > _MOST_BOXES:
        raise InputError(what, f"forbids {len(boxes)} boxes", f"{_MOST_BOXES} at most")
    whole = tuple(tuple(box.ravel().tolist()) for box in np.sort(boxes, axis=1))
    airspace = AirspaceLimits(whole, clearance if clearance > editing.usual_m else None)
    return edit_of(base.viewpoints, after), airspace


def words_of(edit: Edit, airspace: AirspaceLimits, base: Base) -> str:
    return ", ".join(filter(None, (edit.words, airspace.words, "planned again" if base.airspace else "")))


def keep_edit(
    catalog: Catalog,
    editing: Editing,
    base: Base,
    edit: Edit,
    airspace: AirspaceLimits,
    by: str,
    note: str = "",
    carried_from: str = "",
    lost: tuple[str, ...] = (),
    what: str = "the change",
) -> str:
    """Keep a plan as it was changed as a draft, and the change as such; the id of the draft.

    One that changes nothing is an `InputError`, one that cannot be flown safely is refused.
    """
    if not (words := words_of(edit, airspace, base)):
        rule = "move, turn or omit a viewpoint, add a keep-out box, or raise the clearance"
        raise InputError(what, "changes nothing", "", rule)
    judged = editing.judged(base, edit, airspace)
    if judged.broken:
        plan = f"plan {editing.transfer_id} as it was changed"
        raise RefusedError(plan, "; ".join(judged.broken), "a safe flight")
    whose = f"changed by {by.strip()}" + (", carried over" if carried_from else "")
    warnings = (f"{whose}: {words}", *lost, *judged.plan.warnings)
    draft = replace(judged.plan, flyable=not judged.short, not_flyable=judged.short, warnings=warnings)
    row, target = editing.recipe.row, editing.target
    key = digest(
        ["edited", row["key"], method(), sorted(edit.deleted), repr(sorted(edit.changed.items())),
         boxes_of(airspace).tolist(), editing.clearance_m(airspace), repr(base.airspace), target.sha256]
    )  # fmt: skip
    origin = f"{whose}, from {editing.transfer_id}"
    provenance = derived_from(editing.recipe, row["target_sha256"]) | {"planned_on": origin}
    provenance["siblings"] = [(one.structure_id, one.sha256) for one in editing.recipe.siblings]
    change = stored_edit(base.viewpoints, edit, airspace, base.airspace is not None)
    text = edit_json(combined(editing.earlier, change))  # by its places, for plans made later
    # The change first: if this process is stopped now, the next night carries it over.
    catalog.add_edit(_edit_row(row, id_of(key), text, words, by.strip(), note, carried_from, "; ".join(lost)))
    catalog.add_plans([(key, draft, provenance)])
    return id_of(key)


def standing_edit(catalog: Catalog, demonstration_id: str, target_id: str) -> Row | None:
    """The change that later drafts of a pair take over: the last that a person made and nobody rejected."""
    edits = catalog.edits()
    own = edits[(edits["demonstration_id"] == demonstration_id) & (edits["target_id"] == target_id)]
    if not len(own):
        return None
    plans = catalog.transfers(every=True, structure=target_id)
    states = dict(zip(plans["transfer_id"], plans["state"], strict=True))
    for row in own[own["carried_from"] == ""].iloc[::-1].to_dict("records"):
        if states.get(row["transfer_id"]) not in _EARLIER:
            return {str(name): value for name, value in row.items()}
    return None


def carry_edits(catalog: Catalog) -> list[str]:
    """Take people's changes over to newer drafts of `recommended`, once; what cannot be is told and kept."""
    if not len(edits := catalog.edits()):
        return []
    there = {"", *catalog.transfers(every=True, columns=["transfer_id"])["transfer_id"]}
    tried = edits[(edits["carried_from"] != "") & edits["transfer_id"].isin(there)]
    settled = {*edits["transfer_id"], *tried["base_id"]}
    pairs = {(row.demonstration_id, row.target_id) for row in edits.itertuples(index=False)}
    newest = catalog.transfers(status="ok", preset=FLOWN)
    problems = []
    for row in newest.to_dict("records"):
        pair = (str(row["demonstration_id"]), str(row["target_id"]))
        if pair not in pairs or row["transfer_id"] in settled:
            continue
        if (edit := standing_edit(catalog, *pair)) is None or edit["base_id"] == row["transfer_id"]:
            continue
        row = catalog.transfer(str(row["transfer_id"]))
        what = f"the change by {edit['by']} of {row['demonstration_id']} on {row['target_id']}"
        try:
            lost = _carried(catalog, row, edit)
        except UppliedError as error:
            lost = (str(error),)
            catalog.add_edit(_edit_row(row, "", edit["edit_json"], edit["words"], edit["by"], edit["note"],
                                       edit["edit_id"], str(error)))  # fmt: skip
            what += " is not in the newest draft"
        if lost:
            problems.append(f"{what}: {'; '.join(lost)}")
    return problems


def _carried(catalog: Catalog, row: Row, edit: Row) -> tuple[str, ...]:
    editing, change = Editing(catalog, row["transfer_id"]), edit_from_json(edit["edit_json"])
    base, again, lost = editing.carried(change)
    if again == Edit() and not change.airspace.words:
        raise RefusedError("none of it", "; ".join(lost) or "is left")
    notes = tuple(f"not carried over: {one}" for one in lost)
    whose = edit["by"], edit["note"], edit["edit_id"]
    keep_edit(catalog, editing, base, again, change.airspace, *whose, notes)
    return lost


def _edit_row(
    base: Row, plan_id: str, text: str, words: str, by: str, note: str, carried_from: str, lost: str
) -> Row:
    edit_id = digest([base["transfer_id"], plan_id, text, by, carried_from, lost])
    row = {"edit_id": edit_id, "base_id": base["transfer_id"], "transfer_id": plan_id, "edit_json": text}
    row |= {name: base[name] for name in ("demonstration_id", "target_id")}
    return row | {"words": words, "carried_from": carried_from, "lost": lost, "by": by, "note": note}


def _unreadable(what: str, error: Exception) -> InputError:
    return InputError(what, f"cannot be read: {type(error).__name__} {error}"[:200], _RULE)
