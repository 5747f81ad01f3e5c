"""A plan of the catalog as a person changes it, step by step, judged as every plan is."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.spatial import cKDTree

from upplied.catalog import Catalog, recipe
from upplied.config import digest
from upplied.errors import RefusedError
from upplied.fleet.flights import USUAL_CLEARANCE_M, place_breaches
from upplied.fleet.planner import Recent, required_surface
from upplied.geometry.scene import Scene, scene_of
from upplied.geometry.supposed_scene import obstacle, scene_for
from upplied.outputs.reports import plan_of
from upplied.planning.airspace.roadmap import Roadmap, roadmap
from upplied.planning.airspace.rules import Airspace
from upplied.planning.plan import plan_transfer
from upplied.planning.surface.samples import surface_samples
from upplied.proof.carried_edit import StoredEdit, edit_from_json, matched_edit, restored
from upplied.proof.edit import AirspaceLimits, Edit, Viewpoint, edited, viewpoints_of
from upplied.records import Bools, Cloud, Floats, Plan, Structure, Trajectory
from upplied.simulate import measure_flown

_PLACES = 300  # of the plan, that the ways may lead by
_ROADMAPS = 4  # that are held: those of the airspaces asked for last


@dataclass(frozen=True)
class Base:
    """What a change counts the viewpoints of: the plan as it is kept, or one that was planned anew."""

    plan: Plan
    airspace: AirspaceLimits | None = None  # of the airspace that it was planned anew in; None: as it is kept

    @cached_property
    def viewpoints(self) -> list[Viewpoint]:
        path, flags = flown_path(self.plan)
        return viewpoints_of(path, flags)


@dataclass(frozen=True)
class JudgedEdit:
    plan: Plan  # with its measures
    broken: tuple[str, ...]  # rules of the place, in words: it must not be kept
    short: str  # why it must not be flown, in words; it may be kept


class Editing:
    """One plan, with all that judging it anew needs at hand; one without viewpoints is refused."""

    def __init__(self, catalog: Catalog, transfer_id: str) -> None:
        self._catalog, self.recipe = catalog, recipe(catalog, transfer_id)
        self.transfer_id, self.target = transfer_id, self.recipe.target  # the structure as it was made for
        route = self.recipe.settings.route
        self.usual_m = route.clearance_m if route.enforce else USUAL_CLEARANCE_M  # that the plan keeps
        self.stored = Base(plan_of(catalog, self.recipe.row))
        flown_path(self.stored.plan)
        self._memo = Recent(catalog.cache)
        edits = catalog.edits()
        own = edits.loc[edits["transfer_id"] == transfer_id, "edit_json"]
        self.earlier = edit_from_json(own.iloc[-1]) if len(own) else StoredEdit()  # that made this plan
        self._roadmap = lru_cache(_ROADMAPS)(self._roadmap_by)

    def clearance_m(self, airspace: AirspaceLimits) -> float:
        """The clearance that a change asks for, never less than the plan's own."""
        return max(self.usual_m, self.earlier.airspace.clearance_m or 0.0, airspace.clearance_m or 0.0)

    def judged(self, base: Base, edit: Edit, airspace: AirspaceLimits) -> JudgedEdit:
        """The plan as it was changed, with its measures; refused where a viewpoint cannot be flown to."""
        path, flags = flown_path(base.plan)
        graph = self._roadmap(airspace, path.positions[:: max(1, len(path) // _PLACES)].tobytes())
        if edit == Edit() and not graph.airspace.broken(path.positions).any():
            path_flown, stops = path, flags
        else:
            path_flown, stops = edited(path, flags, edit, graph, self.recipe.settings.retime)
        inputs = (self.recipe.demonstration, self.recipe.source, self.target)
        known = self.recipe.settings, self._memo, self.recipe.siblings
        measured = measure_flown(path_flown, base.plan, *inputs, *known)
        where = self._forbidding(airspace), measured.supposed
        broken = place_breaches(path_flown, *where, self.clearance_m(airspace))
        least = self.recipe.settings.verdict.least_inspected_pct
        shown = measured.measures.coverage_inspected_pct
        short = f"shows {shown:.1f} % of the inspected surface (required: {least:g} %)"
        added, planned = base.plan.added, base.plan.trajectory
        if added is not None and planned is not None:  # of each pose as of the nearest one of the plan
            added = np.asarray(added[cKDTree(planned.positions).query(path_flown.positions)[1]], bool)
        plan = replace(measured, is_viewpoint=stops, added=added, flyable=True, not_flyable="")
        return JudgedEdit(plan, tuple(broken), short if shown < least else "")

    def replanned(self, airspace: AirspaceLimits, fixed: StoredEdit) -> tuple[Base, Edit]:
        """The plan made anew in an airspace, with fixed viewpoints put back, and these by its numbers."""
        settings, target = self.recipe.settings, self._forbidding(airspace)
        if self.clearance_m(airspace) > self.usual_m:
            route = replace(settings.route, clearance_m=self.clearance_m(airspace))
            settings = replace(settings, route=route)
        zones, _ = required_surface(self._catalog, self._memo, self.target, settings.required.zones)
        inputs = (self.recipe.demonstration, self.recipe.source, target)
        plan = plan_transfer(*inputs, settings, self._memo, zones, self.recipe.siblings)
        if plan.trajectory is None:
            raise RefusedError(f"a plan of {target.structure_id} in that airspace", plan.reason)
        flags, edit = restored(fixed, *flown_path(plan))
        return Base(replace(plan, is_viewpoint=flags), airspace), edit

    def carried(self, change: StoredEdit) -> tuple[Base, Edit, tuple[str, ...]]:
        """A change of another plan on this one: its base, the change by numbers, and what has no place."""
        if change.replanned:
            return *self.replanned(change.airspace, change), ()
        edit, lost = matched_edit(change, self.stored.viewpoints)
        return self.stored, edit, lost

    @cached_property
    def scene(self) -> Scene:
        return scene_for(self.target, self.stored.plan.supposed)

    @cached_property
    def surface(self) -> Cloud:
        return surface_samples(self.target, scene_of(self.target), self.recipe.settings.clouds)

    def _forbidding(self, airspace: AirspaceLimits) -> Structure:
        if not (airspace.boxes or self.earlier.airspace.boxes):
            return self.target
        around = self.target.surroundings
        boxes = np.concatenate([around.keep_out_m, boxes_of(self.earlier.airspace), boxes_of(airspace)])
        name = self.target.sha256 and digest([self.target.sha256, boxes.tolist()])
        return replace(self.target, surroundings=replace(around, keep_out_m=boxes), sha256=name)

    def _roadmap_by(self, request: AirspaceLimits, places: bytes) -> Roadmap:
        """The ways in an airspace that lead by places (K, 3), m, of which these are the bytes."""
        around, route = self._forbidding(request).surroundings, self.recipe.settings.route
        airspace = Airspace(self.scene, self.clearance_m(request), around, route.ground_clearance_m)
        in_the_way = obstacle(self.surface, self.stored.plan.supposed)
        return roadmap(airspace, in_the_way, np.frombuffer(places).reshape(-1, 3))


def flown_path(plan: Plan) -> tuple[Trajectory, Bools]:
    """The path of a plan, and which of its poses are viewpoints; one without any is refused."""
    if plan.trajectory is None or plan.is_viewpoint is None or not plan.is_viewpoint.any():
        raise RefusedError(f"a plan of {plan.target_id}", f"has no viewpoints: it is {plan.status}")
    return plan.trajectory, plan.is_viewpoint


def boxes_of(airspace: AirspaceLimits) -> Floats:
    """The forbidden boxes (K, 2, 3), m, each by its lower and its upper corner."""
    return np.sort(np.array(airspace.boxes, float).reshape(-1, 2, 3), axis=1)
