"""A good flight becomes a demonstration, with what its operator did better than the plan."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from upplied.catalog import Catalog
from upplied.catalog.schema.rows import Row
from upplied.catalog.verbs.recipes import settings_of
from upplied.catalog.verbs.roster import author
from upplied.checks import check_id
from upplied.config import digest
from upplied.errors import RefusedError, SettingsError
from upplied.geometry.supposed_scene import scene_for
from upplied.planning.airspace.rules import path_clearance
from upplied.proof.align import silence_s
from upplied.proof.as_flown import LOOKED, SILENT, STOOD
from upplied.records import Demonstration

_WHOLE_PCT = 98.0  # of the plan's length, and in view of what it shows: less is no whole inspection
_INSPECTED_PCT = 95.0  # as asked, of what the plan shows: flights of the sample fleet reach 96 and more
#: What a flight must keep to be shown to the database as an example, and why.
RULES = {
    "flown": "a vehicle flew it: a simulated flight shows nothing that its plan does not",
    "whole": f"{_WHOLE_PCT:g} % of the plan was flown and in view, {_INSPECTED_PCT:g} % inspected as planned",
    "recorded": "the log has no gap, and its camera pose never froze",
    "clearance": "it stayed within the clearance limit of its plan",
}


def promote_flight(
    catalog: Catalog, start: str, by: str, name: str = "", force: Collection[str] = ()
) -> Demonstration:
    """Keep a flight, by how its id begins, as a demonstration of the structure that it was flown round.

    `by` says that it is good; `force` names `RULES` that are overruled, which its notes say. Refused where
    another is broken, or there is a demonstration of that `name` (empty: the plan's, the structure and the
    day).
    """
    if unknown := sorted(set(force) - set(RULES)):
        raise SettingsError(f"rule {unknown[0]!r}", "is unknown", f"one of {', '.join(RULES)}")
    by = author(by, "a demonstration")
    row = catalog.flight(start)
    what = f"flight {str(row['flight_id'])[:12]}"
    plan = catalog.transfer(str(row["transfer_id"]))
    flown = catalog.flown(str(row["flight_sha256"]))
    structure = catalog.structure(str(row["target_id"]))
    scene = scene_for(structure, catalog.supposed(str(plan["transfer_id"])))
    broken = _broken(row, path_clearance(scene, flown.positions).distance_m, plan)
    if left := [(rule, fault) for rule, fault in broken if rule not in force]:
        reasons = "; ".join(fault for _, fault in left)
        raise RefusedError(what, reasons, RULES[left[0][0]], f"or overrule it: --force {left[0][0]}")
    usual_name = f"{plan['demonstration_id']}-{structure.structure_id}-{row['flown_at']:%Y%m%d}"[:64]
    name = check_id(name or usual_name, "demonstration id")
    if name in set(catalog.demonstrations(every=True)["demonstration_id"]):
        remedy = "say --name NAME"
        raise RefusedError(f"demonstration {name}", "is in the catalog", "a name of its own", remedy)
    before = catalog.demonstration(str(plan["demonstration_id"]))
    camera, start_ns = before.camera, int(row["flown_at"].value)
    if flown.fov_deg is not None:  # the narrowest field of view that the flight itself logged
        camera = camera.zoomed(flown.fov_deg[[flown.fov_deg[:, 0].argmin()]])[0]
    overruled = "".join(f"; overruled, {rule}: {fault}" for rule, fault in broken)
    note = f"promoted by {by} from {what}, which flew plan {plan['transfer_id']}{overruled}"
    demonstration = Demonstration(
        demonstration_id=name,
        structure_id=structure.structure_id,
        t_ns=start_ns + np.round(flown.t_s * 1e9).astype(np.int64),
        positions=flown.positions,
        quat_xyzw=flown.quat_xyzw,
        camera=camera,
        fov_deg=flown.fov_deg,
        operator=str(row["operator"] or ""),
        site=before.site if before.structure_id == structure.structure_id else "",
        sha256=digest(["flight", row["flight_id"], row["flight_sha256"]]),
        breaks=np.flatnonzero(np.diff(flown.t_s) > silence_s(flown)).astype(np.int64) + 1,
        clock="flight",
        topic=f"flight {row['flight_id']}",
        notes=note,
    )
    catalog.add_demonstrations([demonstration])
    return demonstration


def _broken(row: Row, clearance_m: float, plan: Row) -> list[tuple[str, str]]:
    """The rules that a flight breaks, and what was found."""
    broken = []
    if row["kind"] != "flown":
        broken.append(("flown", f"is {row['kind'] or 'simulated'}"))
    shares = {"flown_pct": "of its plan was flown", "required_pct": "of what it shows was in view"}
    for column, words in shares.items():
        if not (row[column] or 0.0) >= _WHOLE_PCT:
            broken.append(("whole", f"{row[column] or 0.0:.1f} % {words}"))
    inspected = row["inspected_pct"]
    if inspected is None or inspected != inspected:  # judged before there was such a figure
        broken.append(("whole", "the share inspected as planned is unknown"))
    elif inspected < _INSPECTED_PCT:
        broken.append(("whole", f"{inspected:.1f} % of its surface was inspected as planned"))
    for part in str(row["findings"] or "").split("; "):
        if part.startswith((SILENT, STOOD, LOOKED)):
            broken.append(("recorded", part))
    route = settings_of(plan["settings_json"]).route
    if route.enforce and clearance_m < route.clearance_m:
        broken.append(("clearance", f"comes within {clearance_m:.2f} m (limit {route.clearance_m:g} m)"))
    return broken
