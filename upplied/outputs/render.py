"""Pictures and missions from a catalog, by ID, for `upplied render`, `export` and `brief`."""

import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from upplied.catalog import Catalog
from upplied.catalog.schema.plan_rows import is_foreign
from upplied.catalog.verbs.custody import FOREIGN_PLAN, HEAD_DIGITS, alterations, chain_heads
from upplied.errors import CatalogError
from upplied.files import replace_file
from upplied.outputs import figures
from upplied.outputs.brief import as_settled, brief_html
from upplied.outputs.colours import DEMONSTRATED
from upplied.outputs.draw.views import View
from upplied.outputs.missions import FORMATS, Exported, MissionOptions, export, missions_for
from upplied.outputs.missions.gate import CUSTODY, Breach
from upplied.outputs.pairs import PRESETS
from upplied.outputs.pictures import reference_photos
from upplied.outputs.reports import plan_of
from upplied.outputs.zones import MissionZones

ZONES = ".zones.json"  # ending of the results of required zones, beside a mission


def render_structure(
    catalog: Catalog, structure_id: str, views: Sequence[str | View] = ("three-quarter", "side", "top")
) -> bytes:
    """PNG of a structure with all demonstrations on it."""
    structure = catalog.structure(structure_id)
    rows = catalog.demonstrations()
    flown = rows.loc[rows["structure_id"] == structure_id, "demonstration_id"] if len(rows) else []
    paths = [(str(name), catalog.demonstration(str(name)), DEMONSTRATED) for name in flown]
    return figures.structure_png(structure, views, trajectories=paths)


def render_transfer(catalog: Catalog, transfer_id: str, view: str | View | None = None) -> bytes:
    """PNG of one transfer: the demonstration on its structure, the plan on the target."""
    row = _row(catalog, transfer_id)
    flown, target = (catalog.structure(str(row[name])) for name in ("source_id", "target_id"))
    demonstration = catalog.demonstration(str(row["demonstration_id"]))
    return figures.transfer_png(flown, target, demonstration, plan_of(catalog, row), view=view)


def render_comparison(
    catalog: Catalog, demonstration_id: str, target_id: str, view: str | View | None = None
) -> bytes:
    """PNG of the newest plan of each preset for one demonstration and target, side by side."""
    rows = catalog.transfers(demonstration=demonstration_id, structure=target_id).to_dict("records")
    if not rows:
        pair, remedy = f"{demonstration_id} to {target_id}", "run: upplied transfer"
        raise CatalogError(pair, "no transfer is in the catalog", "", remedy)
    rows.sort(key=lambda row: (*PRESETS, row["preset"]).index(row["preset"]))
    plans = [plan_of(catalog, row) for row in rows]
    return figures.comparison_png(catalog.structure(target_id), plans, view=view)


def export_transfer(
    catalog: Catalog, transfer_id: str, format: str, path: str | Path, options: MissionOptions | None = None
) -> Exported:
    """One transfer as mission files, through the gate; see `upplied.outputs.missions.export`.

    If the structure has required zones, their results are written beside the mission: ``FILE.zones.json``.
    """
    row, zones, custody = _leaving(catalog, transfer_id)
    keep = partial(keep_overruled, catalog, row, "export", format)
    exported = export(
        *(zones.plan, zones.structure, format, path, as_settled(row, options or MissionOptions())),
        *(zones.camera, undecided(catalog, row), keep, lambda missions: (*zones.notes(missions), *custody)),
    )
    if not zones.required:
        return exported
    rows = [{name: None if value != value else value for name, value in one.items()}
            for one in zones.judged(exported.missions)]  # fmt: skip
    beside = replace_file(Path(f"{path}{ZONES}"), json.dumps(rows, indent=1).encode())
    return replace(exported, paths=(*exported.paths, beside))


def brief_transfer(
    catalog: Catalog, transfer_id: str, format: str, path: str | Path, options: MissionOptions | None = None
) -> Path:
    """The pilot's brief of one transfer in a format, HTML."""
    row, zones, custody = _leaving(catalog, transfer_id)
    options, warnings = as_settled(row, options or MissionOptions()), zones.plan.warnings
    inputs = (format, zones.plan, zones.structure, options, zones.camera)
    missions = missions_for(*inputs, undecided(catalog, row))
    keep_overruled(catalog, row, "brief", format, missions[0].overruled)
    results = zones.notes(missions), reference_photos(catalog, warnings), custody
    page = brief_html(row, missions, zones.structure, zones.camera, options, warnings, *results)
    return replace_file(Path(path), page)


def mission_files(catalog: Catalog, transfer_id: str, format: str) -> list[tuple[str, bytes]]:
    """Names and bytes of a mission's files with the usual options; of the pilot's brief for ``brief``."""
    with tempfile.TemporaryDirectory() as folder:
        goal = Path(folder, f"{transfer_id}{FORMATS.get(format, '.html')}")
        if format == "brief":
            paths: Sequence[Path] = (brief_transfer(catalog, transfer_id, "qgc-plan", goal),)
        else:
            paths = export_transfer(catalog, transfer_id, format, goal).paths
        return [(path.name, path.read_bytes()) for path in paths]


def _leaving(catalog: Catalog, transfer_id: str) -> tuple[dict[str, Any], MissionZones, tuple[str, ...]]:
    """The row of a plan, the plan with the zones of its structure, and the note with the catalog's heads."""
    row = _row(catalog, transfer_id)
    structure = catalog.structure(str(row["target_id"]))
    camera = catalog.demonstration(str(row["demonstration_id"])).camera
    heads, chains = chain_heads(catalog), ("decisions", "flights")
    words = ", ".join(f"{name} {heads[name][:HEAD_DIGITS]}" for name in chains if name in heads)
    custody = (f"{CUSTODY}: {words}",) if words else ()
    return row, MissionZones(catalog, plan_of(catalog, row), structure, camera), custody


def keep_overruled(catalog: Catalog, row: Any, way: str, format: str, overruled: Sequence[Breach]) -> None:
    """Store which rules of the gate were overruled for an export or a brief, before anything is written."""
    forced = [breach for breach in overruled if breach.rule != "released"]  # the note of a draft
    if forced:
        record = {name: str(row[name] or "") for name in ("transfer_id", "waypoints_sha256")}
        record |= {"way": way, "format": format}
        catalog.add_overruled([{**record, "rule": one.rule, "found": str(one)} for one in forced])


def undecided(catalog: Catalog, row: Any) -> list[Breach]:
    """Objections to flying a plan, from its origin and from the decisions about its pair."""
    state, who = row.get("state") or "draft", row.get("state_by") or "nobody"
    faults = [Breach("foreign", FOREIGN_PLAN[0])] if is_foreign(row) else []
    if state == "released":
        wrong = alterations(catalog, [row["transfer_id"]], catalog.standing())
        faults += [Breach("altered", f"differs from the release: {one}") for one in wrong.values()]
        return faults
    if state in ("rejected", "recalled"):
        note = row.get("state_note") or "no reason was given"
        return [*faults, Breach(state, f"{state} by {who}: {note}")]
    if state == "superseded":
        return [*faults, Breach("superseded", f"{who} released another plan of {row['target_id']}")]
    faults.insert(0, Breach("released", f"it is a {state} plan"))
    if row.get("purpose"):
        return faults
    current, same = catalog.transfers(), ["demonstration_id", "target_id", "preset"]
    alike = current["transfer_id"][(current[same] == [row[name] for name in same]).all(axis=1)].tolist()
    if alike and row["transfer_id"] not in alike:  # a newer draft of the same pair and preset
        faults.append(Breach("superseded", f"{alike[0]} replaced it"))
    return faults


def _row(catalog: Catalog, transfer_id: str) -> dict[str, Any]:
    rows = catalog.transfers(every=True, ids=[transfer_id])
    if not len(rows):
        remedy = "see: upplied catalog transfers"
        raise CatalogError(f"transfer {transfer_id}", "is not in the catalog", "", remedy)
    return dict(rows.iloc[0].items())
