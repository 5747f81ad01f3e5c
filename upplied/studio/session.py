"""What a page of the studio asks for: a plan to draw, a change judged, planned anew, kept, decided about."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.catalog.verbs import required
from upplied.catalog.verbs.standing import unit_of
from upplied.checks import check_id
from upplied.errors import InputError, UppliedError
from upplied.fleet.editing import Base, Editing, JudgedEdit, flown_path
from upplied.fleet.edits import keep_edit, read_edit, viewpoint_row
from upplied.outputs.along import profile
from upplied.outputs.display import display_mesh, display_states, nearest_samples, packed, structure_data
from upplied.outputs.pair_page import path_data
from upplied.outputs.pairs import bound_options, number
from upplied.outputs.reports import trajectory_of
from upplied.poses import from_yaw_pitch, optical_axis
from upplied.proof.asking import Asking
from upplied.proof.carried_edit import kept_edit
from upplied.proof.edit import Asked, Edit
from upplied.records import Ints, Trajectory
from upplied.studio.requests import signed, text_of, viewpoint_of

_MOST_BASES = 50  # that were planned anew and are held: a page goes back to them
_NUMBERS = ("coverage_inspected_pct", "coverage_seen_pct", "min_clearance_m", "path_length_m", "duration_s")
_DIFFERS = (  # measure, words, unit, digits, and less than which it is as good
    ("coverage_inspected_pct", "points of what was inspected", "", 1, 0.05),
    ("min_clearance_m", "of clearance", " m", 2, 0.005),
    ("path_length_m", "of path", " m", 1, 0.05),
    ("duration_s", "of flight", " s", 0, 0.5),
)


class Session:
    """One plan of a catalog, opened; requests come from any thread and are answered one by one.

    Parameters
    ----------
    catalog : Catalog
    transfer_id : str
    """

    def __init__(self, catalog: Catalog, transfer_id: str) -> None:
        self.catalog = catalog
        self.editing = Editing(catalog, transfer_id)
        self._lock = threading.Lock()
        self._bases = [self.editing.kept]
        self._mesh = display_mesh(self.editing.target)
        self._origin = np.array(self._structure["origin"])
        self._near: Ints | None = None
        self._known = self._last()  # the last decision that the person at the page knows of
        self._draft = transfer_id  # what a decision is about: the plan, or the last draft that was kept

    def answer(self, what: str, said: Mapping[str, Any]) -> dict[str, Any]:
        """What a request of the page comes to; what cannot be is told as ``refused``, in words."""
        answers: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
            "plan": self._plan, "judge": self._judge, "replan": self._replan, "keep": self._keep,
            "decide": self._decide, "aim": self._aim, "zone": self._zone, "require": self._require,
        }  # fmt: skip
        if what not in answers:
            return {"refused": f"{what[:40]}: there is no such request"}
        with self._lock:
            try:
                return answers[what](said)
            except UppliedError as error:
                return {"refused": str(error)}

    @cached_property
    def _structure(self) -> dict[str, Any]:
        return structure_data(self.editing.target, self._mesh)

    def _plan(self, _: Mapping[str, Any]) -> dict[str, Any]:
        """All that the page begins with."""
        row, camera = self.editing.recipe.row, self.editing.recipe.demonstration.camera
        state = self.catalog.transfers(every=True, structure=row["target_id"])
        now = state[state["transfer_id"] == self._draft].iloc[-1].to_dict()
        judged = self._judged(self.editing.kept, Edit(), Asked())
        boxes = self.editing.target.surroundings.keep_out_m
        return {
            "id": self.editing.transfer_id,
            "demonstration": row["demonstration_id"],
            "target": row["target_id"],
            "kind": self.editing.recipe.target.kind,
            "state": bound_options({str(name): value for name, value in now.items()}),
            "structure": self._structure,
            "camera": {"hfov_deg": camera.hfov_deg, "vfov_deg": camera.vfov_deg},
            "usual_m": self.editing.clearance_m(Asked()),
            "declared_boxes": boxes.tolist(),
            "viewpoints": self._rows(self.editing.kept),
            "in_force": self._in_force(),
            **judged,
        }

    def _judge(self, said: Mapping[str, Any]) -> dict[str, Any]:
        base, edit, asked = self._read(said)
        return self._judged(base, edit, asked)

    def _replan(self, said: Mapping[str, Any]) -> dict[str, Any]:
        """The rest planned anew, in the airspace that is asked for, with what is fixed put back."""
        base, edit, asked = self._read(said)
        held = dict(edit.changed)
        fixed = said.get("fixed", [])
        for at in fixed if isinstance(fixed, list) else []:
            if isinstance(at, int) and 0 <= at < len(base.viewpoints) and at not in edit.deleted:
                held.setdefault(at, base.viewpoints[at])
        kept = kept_edit(base.viewpoints, Edit(edit.deleted, held), asked, True)
        made, again = self.editing.replanned(asked, kept)
        if len(self._bases) >= _MOST_BASES:
            rule = f"{_MOST_BASES} times at most"
            raise InputError("the plan", "was planned anew too often", rule, "open it again")
        self._bases.append(made)
        rows = self._rows(made)
        for at, wanted in again.changed.items():
            rows[at] = viewpoint_row(at, wanted)
        answer = self._judged(made, again, asked)
        return answer | {
            "base": len(self._bases) - 1,
            "viewpoints": rows,
            "deleted": list(again.deleted),
            "fixed": sorted(again.changed),
        }

    def _keep(self, said: Mapping[str, Any]) -> dict[str, Any]:
        base, edit, asked = self._read(said)
        by, note = signed(said)
        made = keep_edit(self.catalog, self.editing, base, edit, asked, by, note)
        self._draft = made
        return {"id": made, "told": f"kept as draft {made}"}

    def _decide(self, said: Mapping[str, Any]) -> dict[str, Any]:
        by, note = signed(said)
        wanted, plan = said.get("decision"), str(said.get("id", ""))
        if plan not in (self.editing.transfer_id, self._draft):
            raise InputError("the decision", f"is about {plan[:40]!r}", f"about {self._draft}")
        if wanted == "reviewed":
            self.catalog.review(plan, by, note)
        elif wanted == "released":
            known, self._known = self._known, self._last()  # whoever is told of another's decision knows it
            self._known = self.catalog.release(plan, by, note, after=known)
        elif wanted == "rejected":
            self._known = self.catalog.reject(plan, by, note)
        else:
            raise InputError("the decision", f"is {str(wanted)[:40]!r}", "reviewed, released or rejected")
        word = "is in force, released" if wanted == "released" else f"was {wanted}"
        return {"id": plan, "told": f"plan {plan} {word} by {by}"}

    def _aim(self, said: Mapping[str, Any]) -> dict[str, Any]:
        """The place on the surface that a viewpoint's camera looks at; none where it looks past it."""
        looking = viewpoint_of(said)
        quats = from_yaw_pitch(np.radians([looking.yaw_deg]), np.radians([looking.pitch_deg]))
        origin, axis = np.array([looking.position]), optical_axis(quats)
        reach = float(self.editing.scene.cast(origin, axis)[0][0])
        place = (origin + reach * axis)[0].round(3).tolist() if np.isfinite(reach) else None
        return {"place": place}

    def _zone(self, said: Mapping[str, Any]) -> dict[str, Any]:
        """The samples of a zone that is described, to be drawn."""
        patches = self._asking.patches(text_of(said, "where"))
        points = (self.editing.surface.points[patches] - self._origin).astype(np.float32)
        return {"points": packed(points), "share_pct": 100 * float(patches.mean())}

    def _require(self, said: Mapping[str, Any]) -> dict[str, Any]:
        """Ask for a zone of the structure: the next version of a set, with the zones that it had."""
        by, note = signed(said)
        name, target = check_id(text_of(said, "set"), "name of requirements"), self.editing.target
        zone = said.get("zone")
        if not isinstance(zone, Mapping):
            raise InputError("the zone", "is not described", "a name, a place, and what is asked")
        self._asking.patches(str(zone.get("where", "")))  # one that names no surface is refused
        table = self.catalog.requirements()
        own = (table["scope"] == "structure") & (table["owner"] == target.structure_id)
        before = table[own & (table["name"] == name)]
        zones = [] if before.empty else json.loads(before.iloc[-1]["zones_json"])
        zones = [each for each in zones if each["zone"] != zone.get("zone")] + [dict(zone)]
        self.catalog.require("structure", target.structure_id, name, zones, by, note)
        self.__dict__.pop("_asking", None)
        return {"told": f"{target.structure_id}: {name} asks for {len(zones)} zone(s)"}

    def _last(self) -> str:
        return self.catalog.standing().last.get(unit_of(self.editing.recipe.row), "")

    # --- what the answers are made of ----------------------------------------------------------

    def _read(self, said: Mapping[str, Any]) -> tuple[Base, Edit, Asked]:
        at = said.get("base", 0)
        if not isinstance(at, int) or not 0 <= at < len(self._bases):
            raise InputError("the change", f"is of plan number {at}", f"0 to {len(self._bases) - 1}")
        return self._bases[at], *read_edit("the change", said, self.editing, self._bases[at])

    def _judged(self, base: Base, edit: Edit, asked: Asked) -> dict[str, Any]:
        began, cpu = time.perf_counter(), time.process_time()
        judged = self.editing.judged(base, edit, asked)
        path, _ = flown_path(judged.plan)
        data = path_data(profile(path, self.editing.scene), self._origin)
        answer = {
            "path": data,
            "states": self._states(judged),
            "measures": {name: number(vars(judged.plan.measures), name) for name in _NUMBERS},
            "verdict": self._verdict(judged, self.editing.clearance_m(asked)),
            "differences": self._differences(judged),
            "zones": self._asking.judged(self._asking.planned(judged.plan, self._asking.camera)),
            "words": ", ".join(filter(None, (edit.words, asked.words, "planned anew" if base.asked else ""))),
        }
        took = {"judged_s": time.perf_counter() - began, "cpu_s": time.process_time() - cpu}
        return answer | {name: round(value, 3) for name, value in took.items()}

    def _verdict(self, judged: JudgedEdit, kept_m: float) -> dict[str, Any]:
        measures = judged.plan.measures
        wrong = [*judged.broken, *([judged.short] if judged.short else [])]
        said = f"keeps {measures.min_clearance_m:.2f} m from the structure, {kept_m:g} m asked for"
        shown = measures.coverage_inspected_pct
        headline = f"It shows {shown:.1f} % of what was inspected, and {said}."
        return {"flyable": not wrong, "headline": headline, "look": [*wrong, *judged.plan.warnings]}

    def _differences(self, judged: JudgedEdit) -> list[str]:
        """What is other than in the plan in force, and than in the plan as it was opened, in words."""
        told = []
        others = (("the plan in force", self._force_row), ("the plan as opened", self.editing.recipe.row))
        for name, row in others:
            if row is None:
                continue
            parts = []
            for measure, words, unit, digits, least in _DIFFERS:
                now, then = number(vars(judged.plan.measures), measure), number(row, measure)
                if now is not None and then is not None and abs(now - then) >= least:
                    parts.append(f"{now - then:+.{digits}f}{unit} {words}")
            told.append(f"against {name}: {', '.join(parts) or 'as good'}")
        return told

    def _states(self, judged: JudgedEdit) -> dict[str, str] | None:
        surface = judged.plan.surface
        if surface is None:
            return None
        if self._near is None:
            self._near = nearest_samples(self._mesh, surface)
        return packed(display_states(self._mesh, surface, self._near))

    def _rows(self, base: Base) -> list[dict[str, float]]:
        return [viewpoint_row(at, each) for at, each in enumerate(base.viewpoints)]

    @cached_property
    def _force_row(self) -> dict[str, Any] | None:
        row = self.editing.recipe.row
        force = self.catalog.in_force(structure=row["target_id"])
        same = force[(force["demonstration_id"] == row["demonstration_id"]) & (force["purpose"] == "")]
        if same.empty or same.iloc[-1]["transfer_id"] == row["transfer_id"]:
            return None
        return {str(name): value for name, value in same.iloc[-1].items()}

    def _in_force(self) -> dict[str, Any] | None:
        """The path of the plan in force, where that is another one."""
        row = self._force_row
        if row is None:
            return None
        path: Trajectory = trajectory_of(self.catalog.waypoints(row["transfer_id"]))
        return {"id": row["transfer_id"], "path": path_data(profile(path, self.editing.scene), self._origin)}

    @cached_property
    def _asking(self) -> Asking:
        camera = self.editing.recipe.demonstration.camera
        target, supposed = self.editing.target, self.editing.kept.plan.supposed
        asked = required.zones_of(self.catalog, target.kind, target.structure_id)
        known = supposed, camera, asked, self.catalog.faces_labelled
        return Asking(self.catalog.structure, self.catalog.cache, target, *known)
