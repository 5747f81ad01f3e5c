"""The requests of the studio's page: draw a plan; judge, plan again, store and decide about a change."""

import threading
import time
from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.checks import pair_name
from upplied.errors import InputError, UppliedError
from upplied.fleet.editing import Base, Editing, JudgedEdit, flown_path
from upplied.fleet.edits import keep_edit, read_edit, viewpoint_row, words_of
from upplied.fleet.flights import place_breaches
from upplied.geometry.poses import from_yaw_pitch, optical_axis
from upplied.outputs.display import display_states, nearest_samples, packed, structure_data
from upplied.outputs.labels import LABELS
from upplied.outputs.pair_page import path_data, profile
from upplied.outputs.pairs import decision_words, number, sentence
from upplied.outputs.reports import Reader
from upplied.outputs.verdicts import headline
from upplied.proof.carried_edit import stored_edit
from upplied.proof.edit import AirspaceLimits, Edit
from upplied.records import Ints
from upplied.web.live import Decisions, ZoneRequests, signed

_MOST_BASES = 50  # replanned versions in memory, to which a page can return
_MOST_OPEN = 8  # plans; of more, the least recently used is closed
_DIFFERENCES = LABELS["differences"]


class Sessions:
    def __init__(self, catalog: Catalog) -> None:
        self._lock, self._stages = threading.Lock(), dict[str, str]()
        self._session = lru_cache(_MOST_OPEN)(partial(self._opened, catalog))

    def _opened(self, catalog: Catalog, plan: str) -> "Session":
        return Session(catalog, plan, partial(self._stages.__setitem__, plan))

    def answer(self, request: Mapping[str, Any], plan: str, what: str) -> dict[str, Any]:
        """The answer to a request about a plan; an `UppliedError` if it cannot be opened."""
        if what == "progress":
            return {"stage": self._stages.get(plan, "Opening the plan")}
        with self._lock:
            session = self._session(plan)
            self._stages.pop(plan, None)
        return session.answer(what, request)


class Session:
    """One plan of a catalog, opened; requests come from any thread and are answered one by one.

    While the plan opens, `stage` receives the current step in words.
    """

    def __init__(self, catalog: Catalog, transfer_id: str, stage: Callable[[str], object] = str) -> None:
        self.catalog = catalog
        stage("Reading the plan and its structures")
        self.editing = Editing(catalog, transfer_id)
        self.decisions = Decisions(catalog)
        self._lock = threading.Lock()
        self._bases = [self.editing.stored]
        stage("Drawing the structure")
        self._reader = Reader(catalog)
        self._mesh = self._reader.display_mesh(self.editing.target)
        self._structure = structure_data(self.editing.target, self._mesh)
        self._origin = np.array(self._structure["origin"])
        self._near: Ints | None = None
        self.zones = ZoneRequests(catalog, self.editing, self._origin)
        self._known = self.decisions.last(transfer_id)  # the last decision that the page shows
        self._draft = transfer_id  # subject of a decision: the plan, or the last stored draft
        stage("Checking clearance along the path")

    def answer(self, what: str, request: Mapping[str, Any]) -> dict[str, Any]:
        """The answer to a request of the page; ``refused`` is the reason why there is none."""
        answers: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
            "plan": self._plan, "judge": lambda _: self._judged(*self._read(request)),
            "replan": self._replan, "keep": self._keep,
            "decide": self._decide, "aim": self._aim, "zone": self.zones.drawn, "require": self.zones.require,
            "zones": lambda _: {"zones": self.zones.judged(self.editing.stored.plan)},
        }  # fmt: skip
        if what not in answers:
            return {"refused": f"{what[:40]}: this request does not exist"}
        with self._lock:
            try:
                return answers[what](request)
            except UppliedError as error:
                return {"refused": str(error)}

    def _plan(self, request: Mapping[str, Any]) -> dict[str, Any]:
        row, camera = self.editing.recipe.row, self.editing.recipe.demonstration.camera
        rows = self.catalog.transfers(every=True, structure=row["target_id"])
        now = rows[rows["transfer_id"] == self._draft].iloc[-1].to_dict()
        plan, placement = self.editing.stored.plan, self.editing.target.placement
        path, scene, force = flown_path(plan)[0], self.editing.scene, self._force_row
        ahead = None if force is None else self.catalog.plan(force["transfer_id"]).trajectory
        clearance_m = self.editing.clearance_m(AirspaceLimits())
        broken = place_breaches(path, self.editing.target, plan.supposed, clearance_m)
        judged = JudgedEdit(plan, tuple(broken), plan.not_flyable)
        return {
            "id": self.editing.transfer_id,
            "demonstration": row["demonstration_id"],
            "target": row["target_id"],
            "pair": pair_name(row["demonstration_id"], row["target_id"]),
            "state": decision_words({str(name): value for name, value in now.items()}),
            "structure": self._structure,
            "camera": {"hfov_deg": camera.hfov_deg, "vfov_deg": camera.vfov_deg},
            "heading_deg": None if placement is None else placement.heading_deg,  # of +X, from true north
            "usual_m": clearance_m,
            "declared_boxes": self.editing.target.surroundings.keep_out_m.tolist(),
            "viewpoints": self._rows(self.editing.stored),
            "in_force": None if ahead is None else path_data(profile(ahead, scene), self._origin),
            **self._shown(judged, Edit(), AirspaceLimits(), self.editing.stored),
        }

    def _replan(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """The other viewpoints planned again in the airspace of the request, with the fixed ones put back."""
        base, edit, airspace = self._read(request)
        changes, fixed = dict(edit.changed), request.get("fixed", [])
        for at in fixed if isinstance(fixed, list) else []:
            if isinstance(at, int) and 0 <= at < len(base.viewpoints) and at not in edit.deleted:
                changes.setdefault(at, base.viewpoints[at])
        fixed_edit = stored_edit(base.viewpoints, Edit(edit.deleted, changes), airspace, True)
        replanned, again = self.editing.replanned(airspace, fixed_edit)
        if len(self._bases) >= _MOST_BASES:
            rule = f"{_MOST_BASES} times at most"
            raise InputError("the plan", "was planned again too many times", rule, "open the plan again")
        self._bases.append(replanned)
        rows = self._rows(replanned)
        for at, viewpoint in again.changed.items():
            rows[at] = viewpoint_row(at, viewpoint)
        fixed_again = {"deleted": list(again.deleted), "fixed": sorted(again.changed)}
        answer = self._judged(replanned, again, airspace) | fixed_again
        return answer | {"base": len(self._bases) - 1, "viewpoints": rows}

    def _keep(self, request: Mapping[str, Any]) -> dict[str, Any]:
        base, edit, airspace = self._read(request)
        by, note = signed(request)
        self._draft = keep_edit(self.catalog, self.editing, base, edit, airspace, by, note)
        return {"id": self._draft, "message": f"Stored as draft {self._draft}."}

    def _decide(self, request: Mapping[str, Any]) -> dict[str, Any]:
        plan = str(request.get("id", ""))
        if plan not in (self.editing.transfer_id, self._draft):
            raise InputError("the decision", f"is about {plan[:40]!r}", f"about {self._draft}")
        known, now = self._known, self.decisions.last(plan)
        self._known = now  # a person who is refused for a newer decision knows it afterwards
        answer = self.decisions.decide({**request, "known": known})
        self._known = answer["known"]
        return answer

    def _aim(self, request: Mapping[str, Any]) -> dict[str, Any]:
        base, edit, _ = self._read(request)
        at = request.get("viewpoint")
        if not isinstance(at, int) or not 0 <= at < len(base.viewpoints):
            raise InputError("the viewpoint", f"is {at!s:.40}", f"0 to {len(base.viewpoints) - 1}")
        looking = edit.changed.get(at, base.viewpoints[at])
        quats = from_yaw_pitch(np.radians([looking.yaw_deg]), np.radians([looking.pitch_deg]))
        origin, axis = np.array([looking.position]), optical_axis(quats)
        reach = float(self.editing.scene.cast(origin, axis)[0][0])
        place = (origin + reach * axis)[0].round(3).tolist() if np.isfinite(reach) else None
        return {"place": place}

    def _read(self, request: Mapping[str, Any]) -> tuple[Base, Edit, AirspaceLimits]:
        at = request.get("base", 0)
        if not isinstance(at, int) or not 0 <= at < len(self._bases):
            raise InputError("the change", f"refers to plan number {at}", f"0 to {len(self._bases) - 1}")
        return self._bases[at], *read_edit("the change", request, self.editing, self._bases[at])

    def _judged(self, base: Base, edit: Edit, airspace: AirspaceLimits) -> dict[str, Any]:
        began, cpu = time.perf_counter(), time.process_time()
        judged = self.editing.judged(base, edit, airspace)
        answer = self._shown(judged, edit, airspace, base) | {"zones": self.zones.judged(judged.plan)}
        took = {"judged_s": time.perf_counter() - began, "cpu_s": time.process_time() - cpu}
        return answer | {name: round(value, 3) for name, value in took.items()}

    def _shown(self, judged: JudgedEdit, edit: Edit, airspace: AirspaceLimits, base: Base) -> dict[str, Any]:
        path, measures = flown_path(judged.plan)[0], vars(judged.plan.measures)
        standoff = {"standoff_mode": self.editing.recipe.row.get("standoff_mode")}
        faults = [*judged.broken, *([judged.short] if judged.short else [])]
        return {
            "path": path_data(profile(path, self.editing.scene), self._origin),
            "states": self._states(judged),
            "measures": {name: number(measures, name) for name in _DIFFERENCES},
            "verdict": {
                "flyable": not faults,
                "headline": headline(measures | standoff, self.editing.clearance_m(airspace)),
                "look": [sentence(each) for each in (*faults, *judged.plan.warnings)],
            },
            "differences": self._differences(measures),
            "words": words_of(edit, airspace, base),
        }

    def _differences(self, measures: Mapping[str, Any]) -> list[str]:
        sentences = []
        others = {"the plan in force": self._force_row, "the plan as opened": self.editing.recipe.row}
        for name, row in others.items():
            if row is None:
                continue
            parts = []
            for measure, (words, form, least) in _DIFFERENCES.items():
                now, then = number(measures, measure), number(row, measure)
                if now is not None and then is not None and abs(now - then) >= least:
                    parts.append(f"{words} {form.format(now - then)}")
            sentences.append(f"Compared with {name}: {', '.join(parts) or 'no difference'}.")
        return sentences

    def _states(self, judged: JudgedEdit) -> dict[str, str] | None:
        if (surface := judged.plan.surface) is None:
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
