"""A plan out as a file that a person changes, and back as a plan that was changed, judged anew."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from upplied.catalog import Catalog, recipe
from upplied.catalog.schema.plan_rows import transfer_id as id_of
from upplied.config import digest
from upplied.errors import InputError, RefusedError
from upplied.fleet.rechecking import USUAL_CLEARANCE_M, place_breaches
from upplied.inputs.files import read_regular
from upplied.outputs.files import replace_file
from upplied.outputs.reports import plan_of
from upplied.planning.airspace.roadmap import roadmap
from upplied.planning.airspace.rules import Airspace
from upplied.planning.plan import METHOD_VERSION
from upplied.planning.surface.samples import surface_samples
from upplied.proof.edit import Edit, Viewpoint, edit_of, edited, viewpoints_of
from upplied.provenance import method, recorded
from upplied.records import Floats, Plan, Surroundings
from upplied.scene import scene_of
from upplied.simulate import measure_flown

_MOST_BYTES = 16 << 20
_RULE = "a file as `upplied edit ID --out FILE` writes it"
_PLACES = 300  # of the plan, that the ways may lead by


def write_edit(catalog: Catalog, transfer_id: str, path: str | Path) -> Path:
    """Write the viewpoints of a plan as JSON, to be changed and read again by `edit_plan`."""
    plan = _flown(catalog.plan(transfer_id))
    assert plan.trajectory is not None and plan.is_viewpoint is not None
    rows = [
        {"viewpoint": number, "x_m": p.position[0], "y_m": p.position[1], "z_m": p.position[2],
         "yaw_deg": p.yaw_deg, "pitch_deg": p.pitch_deg}
        for number, p in enumerate(viewpoints_of(plan.trajectory, plan.is_viewpoint))
    ]  # fmt: skip
    rows = [{key: round(value, 4) for key, value in row.items()} for row in rows]
    said = {"plan": transfer_id, "target": plan.target_id, "clearance_m": _clearance(catalog, transfer_id)}
    text = json.dumps({**said, "keep_out": [], "viewpoints": rows}, indent=1)
    return replace_file(Path(path), text + "\n")


def edit_plan(catalog: Catalog, transfer_id: str, path: str | Path, by: str) -> str:
    """Read a changed file and keep the plan that follows, judged anew, as a draft; its id.

    Raises
    ------
    InputError
        If the file is not one of that plan, or changes nothing.
    RefusedError
        If what is asked for cannot be flown safely.
    """
    if not by.strip():
        raise InputError(str(path), "nobody says who changed it", "", "say --by NAME")
    made_from = recipe(catalog, transfer_id)
    plan = _flown(plan_of(catalog, made_from.row))
    assert plan.trajectory is not None and plan.is_viewpoint is not None
    before = viewpoints_of(plan.trajectory, plan.is_viewpoint)
    after, boxes, clearance = _read(Path(path), transfer_id, len(before))
    edit = edit_of(before, after)
    usual = _clearance(catalog, transfer_id)
    clearance = max(clearance, usual)
    words = [edit.words, f"{len(boxes)} boxes forbidden" * bool(len(boxes))]
    words.append(f"{clearance:g} m of clearance" * (clearance > usual))
    said = ", ".join(filter(None, words))
    if not said:
        raise InputError(
            str(path), "changes nothing", "", "move, turn or leave out a viewpoint, or forbid a box"
        )
    target = catalog.structure(plan.target_id)
    around = target.surroundings
    forbidden = replace(around, keep_out_m=np.concatenate([around.keep_out_m, boxes]))
    target = replace(target, surroundings=forbidden)
    path_, flags = _made(plan, edit, forbidden, target, made_from, clearance)
    broken = place_breaches(path_.positions, path_.t_s, target, clearance)
    if broken:
        raise RefusedError(f"plan {transfer_id} as it was changed", "; ".join(broken), "a safe flight")
    inputs = (made_from.demonstration, made_from.source, catalog.structure(plan.target_id))
    judged = measure_flown(path_, plan, *inputs, made_from.settings, catalog.cache)
    least = made_from.settings.verdict.least_inspected_pct
    shown = judged.measures.coverage_inspected_pct
    short = f"shows {shown:.1f} % of what was inspected, {least:g} % are asked for" if shown < least else ""
    made = replace(
        judged,
        is_viewpoint=flags,
        flyable=not short,
        not_flyable=short,
        warnings=(f"changed by {by.strip()}: {said}", *judged.warnings),
    )
    row = made_from.row
    key = digest(["edited", row["key"], method(), sorted(edit.deleted), repr(sorted(edit.changed.items())),
                  boxes.tolist(), clearance, catalog.structure(plan.target_id).sha256])  # fmt: skip
    provenance = {
        **{name: row[name] for name in ("demonstration_sha256", "source_sha256")},
        **recorded(),
        "target_sha256": catalog.structure(plan.target_id).sha256,
        "method_version": METHOD_VERSION,
        "settings": made_from.settings,
        "planned_on": f"changed by {by.strip()}, from {transfer_id}",
    }
    catalog.add_plans([(key, made, provenance)])
    return id_of(key)


def _made(plan: Plan, edit: Edit, around: Surroundings, target: Any, made_from: Any, clearance: float) -> Any:
    assert plan.trajectory is not None and plan.is_viewpoint is not None
    scene, settings = scene_of(target), made_from.settings
    airspace = Airspace(scene, clearance, around, settings.route.ground_clearance_m)
    every = max(1, len(plan.trajectory) // _PLACES)
    surface = surface_samples(target, scene, settings.clouds)
    graph = roadmap(airspace, surface, plan.trajectory.positions[::every])
    return edited(plan.trajectory, plan.is_viewpoint, edit, graph, settings.retime)


def _flown(plan: Plan) -> Plan:
    if plan.trajectory is None or plan.is_viewpoint is None or not plan.is_viewpoint.any():
        raise RefusedError(f"a plan of {plan.target_id}", f"has no viewpoints: it is {plan.status}")
    return plan


def _clearance(catalog: Catalog, transfer_id: str) -> float:
    route = recipe(catalog, transfer_id).settings.route
    return route.clearance_m if route.enforce else USUAL_CLEARANCE_M


def _read(path: Path, transfer_id: str, count: int) -> tuple[dict[int, Viewpoint], Floats, float]:
    """The viewpoints that are wanted by their numbers, the forbidden boxes (K, 2, 3), and the clearance."""
    try:
        said = json.loads(read_regular(path, _MOST_BYTES).decode("utf-8"))
        if said["plan"] != transfer_id:
            raise InputError(str(path), f"is of plan {str(said['plan'])[:40]}, not of {transfer_id}", _RULE)
        after = {}
        for row in said["viewpoints"]:
            place = tuple(float(row[name]) for name in ("x_m", "y_m", "z_m"))
            number = int(row["viewpoint"])
            if number in after or not 0 <= number < count:
                raise InputError(
                    str(path), f"has a viewpoint {number} too many", f"0 to {count - 1}, each once"
                )
            after[number] = Viewpoint(place, float(row["yaw_deg"]), float(row["pitch_deg"]))  # type: ignore[arg-type]
        boxes = np.array(said.get("keep_out", []), float).reshape(-1, 2, 3)
        clearance = float(said.get("clearance_m", 0.0))
    except (UnicodeDecodeError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(str(path), f"cannot be read: {type(error).__name__} {error}"[:200], _RULE) from None
    numbers = [value for p in after.values() for value in (*p.position, p.yaw_deg, p.pitch_deg)]
    if not np.isfinite([*numbers, clearance]).all() or not np.isfinite(boxes).all():
        raise InputError(str(path), "holds what is no number", _RULE)
    if any(not -90 <= p.pitch_deg <= 90 for p in after.values()):
        raise InputError(str(path), "turns a camera beyond straight up or down", "-90 to 90 degrees of pitch")
    return after, np.sort(boxes, axis=1), clearance
