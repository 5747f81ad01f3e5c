"""A mission that shows findings from the views of their photos, and finely enough: a draft like any plan."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from upplied import records
from upplied.catalog import Catalog, recipe
from upplied.catalog.schema.plan_rows import transfer_id as id_of
from upplied.config import CloudSettings, Settings, digest
from upplied.errors import RefusedError
from upplied.findings.adding import on_surface
from upplied.findings.carried import Carrying
from upplied.findings.looks import Spot, spot_of
from upplied.findings.rays import footprint_m, size_px
from upplied.findings.viewing import Look, best_look, shows
from upplied.fleet.decisions import PlanRequest, SettingsOf
from upplied.fleet.flights import USUAL_CLEARANCE_M, place_breaches
from upplied.geometry.polylines import leg_lengths
from upplied.geometry.poses import in_a_row
from upplied.geometry.scene import scene_of
from upplied.geometry.supposed_scene import obstacle, scene_for
from upplied.planning.airspace.roadmap import Roadmap, roadmap
from upplied.planning.airspace.rules import Airspace, path_clearance
from upplied.planning.plan import METHOD_VERSION
from upplied.planning.surface.samples import surface_samples
from upplied.proof.tour import Toured, toured
from upplied.provenance import method, recorded
from upplied.records import Camera, Cloud, Ints, Structure, Trajectory

_SHOWN = 1  # of SURFACE_STATES
_FINDING = ("finding_id", "x_m", "y_m", "z_m", "normal_json", "outline_json", "camera_json", "place_error_m",
            "width_px", "height_px")  # fmt: skip
_ALIKE_DEG = 5.0  # between looks at a place: one pose may then show several findings
_AS_WANTED_DEG, _AS_NEAR = 1.0, 1.02  # off the reference view, that is not worth a word


@dataclass(frozen=True)
class Base:
    """The basis of a mission round a structure."""

    target: Structure
    camera: Camera
    settings: Settings
    pace: Trajectory  # flown or planned there before: no faster
    about: dict[str, Any]  # of `Plan`
    sha256: tuple[str, str, str]  # of the demonstration, the source and the target
    of_plan: str  # the plan that this is of; empty: a demonstration


@dataclass(frozen=True)
class Reshot:
    """The result of planning a mission."""

    plan: records.Plan
    shown: tuple[str, ...]  # findings
    refused: tuple[str, ...]  # in words
    words: tuple[str, ...]  # what a pilot should know
    transfer_id: str = ""  # where it is stored


def plan_reshoot(catalog: Catalog, rows: Sequence[dict[str, Any]], structure_id: str, mm_px: float) -> Reshot:
    """Plan a mission that shows the places of findings on a structure, and keep it as a draft.

    It is refused, and nothing stored, if no finding can be shown so by a safe flight. Rows are of `findings`,
    of structures of one kind; `mm_px` is the largest ground sample distance of each look, mm.
    """
    if not (rows and 0 < mm_px < np.inf):
        request = f"{len(rows)} findings at {mm_px:g} mm/px"
        raise RefusedError("the mission", f"has {request}", "at least one finding, and more than 0 mm/px")
    base = base_of(catalog, structure_id)
    carrying = Carrying(catalog)
    result = mission(carrying, rows, base, mm_px)
    key = digest(["reshoot", *depends_on(carrying, rows, base, mm_px)])
    hashes = zip(("demonstration_sha256", "source_sha256", "target_sha256"), base.sha256, strict=True)
    provenance = {
        **dict(hashes), **recorded(), "method_version": METHOD_VERSION, "settings": base.settings,
        "purpose": f"reshoot {digest([list(result.shown), mm_px])[:20]}",
    }  # fmt: skip
    catalog.add_plans([(key, result.plan, provenance)])
    return replace(result, transfer_id=id_of(key))


def depends_on(carrying: Carrying, rows: Sequence[dict[str, Any]], base: Base, mm_px: float) -> list[Any]:
    """All that a mission depends on; parameters as those of `mission`."""
    target_id = base.target.structure_id
    findings = [[_plain(row[name]) for name in _FINDING] for row in rows]
    sources = sorted({str(row["target_id"]) for row in rows} - {target_id})
    pairs = [carrying.pair_key(source, target_id) for source in sources]
    return [findings, pairs, mm_px, method(), base.settings.sha256, *base.sha256, base.of_plan]


def _plain(value: Any) -> Any:
    """A value of a row as JSON has it; none where it is missing."""
    value = value.item() if isinstance(value, np.generic) else value
    return value if value == value else None


def mission(carrying: Carrying, rows: Sequence[dict[str, Any]], base: Base, mm_px: float) -> Reshot:
    """A mission that shows the places of findings on a structure; parameters as those of `plan_reshoot`."""
    structure_id = base.target.structure_id
    base, words = _sized(base, rows)
    goals, refused = wanted_looks(carrying, rows, base.target)
    supposed = base.about["supposed"]
    route = base.settings.route
    clearance = route.clearance_m if route.enforce else USUAL_CLEARANCE_M
    scene = scene_for(base.target, supposed)
    airspace = Airspace(scene, clearance, base.target.surroundings, route.ground_clearance_m)
    surface = surface_samples(base.target, scene_of(base.target), CloudSettings())
    graph = roadmap(airspace, obstacle(surface, supposed))
    looks: dict[Look, Trajectory] = {}
    for one in goals:
        look = best_look(one, base.camera, graph, base.settings.retime, mm_px)
        if look is not None:
            looks[one] = look
            continue
        near = f"no safe look at {mm_px:g} mm/px, {clearance:g} m away, sees the place"
        refused.append(f"finding {one.finding_id}: {near}")
    what = f"a mission to {structure_id}"
    if not looks:
        raise RefusedError(what, "; ".join(refused)[:2000], "at least one safe viewpoint")
    tour = _tour(looks, base, graph, mm_px)
    path = tour.trajectory
    for one in [one for one, there in zip(looks, tour.covered, strict=True) if not there]:
        refused.append(f"finding {one.finding_id}: no safe leg leads to a viewpoint that shows it")
        del looks[one]
    broken = place_breaches(path, base.target, supposed, clearance)
    if broken:
        raise RefusedError(what, "; ".join(broken), "a safe flight", "name fewer findings")
    headline = f"shows {len(looks)} of {len(rows)} findings on {tour.length_m:.0f} m"
    words = [f"{headline} (by known safe legs at least {tour.bound_m:.0f} m)", *words]
    words += [*(_words(one, look, base.camera) for one, look in looks.items()), *refused]
    ids = sorted(one.finding_id for one in looks)
    state = np.zeros(len(surface), np.int64)
    state[_nearest(surface, list(looks))] = _SHOWN
    plan = records.Plan(
        **base.about,
        kind=base.target.kind,
        preset="recommended",
        status="ok",
        trajectory=path,
        is_viewpoint=tour.is_viewpoint,
        measures=records.Measures(
            min_clearance_m=path_clearance(scene, path.positions).distance_m,
            path_length_m=tour.length_m,
            duration_s=float(path.t_s[-1]),
            peak_speed_mps=float((leg_lengths(path.positions) / np.diff(path.t_s)).max()),
        ),
        warnings=tuple(words),
        surface=records.SurfaceStates(surface.points, state, surface.normals),
        flyable=True,
    )
    return Reshot(plan, tuple(ids), tuple(refused), tuple(words))


def base_of(catalog: Catalog, structure_id: str) -> Base:
    """Camera, settings and pace of the newest plan for a structure, or of a demonstration there."""
    target = catalog.structure(structure_id)
    plans = catalog.transfers(structure=structure_id, preset="recommended", status="ok")
    flown = catalog.demonstrations(structure=structure_id)
    if len(plans):
        name = str(plans.iloc[-1]["transfer_id"])
        basis, plan = recipe(catalog, name), catalog.plan(name)
        assert plan.trajectory is not None
        ends = {"source_id": plan.source_id, "supposed": plan.supposed, "registration": plan.registration}
        demonstration, pace, of_plan = basis.demonstration, plan.trajectory, name
        source_sha256, settings = str(basis.row["source_sha256"]), basis.settings
    elif len(flown):
        demonstration = catalog.demonstration(str(flown.iloc[-1]["demonstration_id"]))
        itself = records.Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True)
        ends = {"source_id": structure_id, "supposed": None, "registration": itself}
        pace, of_plan, source_sha256 = demonstration.trajectory, "", target.sha256
        settings = SettingsOf(catalog, PlanRequest())("recommended", target.kind, structure_id)
    else:
        fault, rule = "has neither plan nor demonstration", "one of them, with camera and clearance"
        remedy = f"plan for it: upplied transfer --to {structure_id}"
        raise RefusedError(f"structure {structure_id}", fault, rule, remedy)
    about = {"demonstration_id": demonstration.demonstration_id, "target_id": structure_id, **ends}
    hashes = demonstration.sha256, source_sha256, target.sha256
    return Base(target, demonstration.camera, settings, pace, about, hashes, of_plan)


def _sized(base: Base, rows: Sequence[dict[str, Any]]) -> tuple[Base, list[str]]:
    """The base with a camera whose pixels are known: else those of a finding's photo, which is said."""
    if base.camera.width_px:
        return base, []
    stated = [(row["width_px"] or np.nan, row["height_px"] or np.nan) for row in rows]
    known = [(int(width), int(height)) for width, height in stated if np.isfinite([width, height]).all()]
    width, height = known[0] if known else size_px(base.camera)
    whose = "as a photo of a finding" if known else "the usual size of a camera"
    text = f"the pixels of the camera are not known: {width} x {height} px, {whose}"
    return replace(base, camera=replace(base.camera, width_px=width, height_px=height)), [text]


def wanted_looks(
    carrying: Carrying, rows: Sequence[dict[str, Any]], target: Structure
) -> tuple[list[Look], list[str]]:
    """How findings are to be looked at on a structure, as their photos did; and what has no place there."""
    looks, refused, structure_id = [], [], target.structure_id
    for source in sorted({str(row["target_id"]) for row in rows}):
        own = [row for row in rows if row["target_id"] == source]
        carrying.targets(source, structure_id)
        spots = [spot_of(row) for row in own]
        there = carrying.to(spots, structure_id)
        known = np.isfinite(there.place[:, 0])
        there.place[known], there.normal[known] = on_surface(scene_of(target), there.place[known])
        for at, (row, spot) in enumerate(zip(own, spots, strict=True)):
            place, normal = there.place[at], there.normal[at]
            if not np.isfinite(place).all():
                refused.append(f"finding {row['finding_id']}: {there.doubt(at)}")
                continue
            away, distance = spot.normal, float("nan")
            if row["camera_json"]:
                away = np.array(json.loads(row["camera_json"])[:3]) - spot.place
                distance = float(np.linalg.norm(away))
            direction = there.turn[at] @ (away / np.linalg.norm(away))
            corners = place + (spot.corners - spot.place) @ there.turn[at].T
            moved = Spot(structure_id, place, normal, corners)
            photo = str(row["photo"] or (f"the photo at {row['photo_s']:.1f} s" if row["flight_id"] else ""))
            looks.append(Look(str(row["finding_id"]), moved, direction, distance, photo, there.doubt(at)))
    return looks, refused


def _tour(looks: dict[Look, Trajectory], base: Base, graph: Roadmap, mm_px: float) -> Toured:
    """A short safe flight by poses that show every spot, of those that safe legs join."""
    poses, seen = in_a_row(list(looks.values())), np.eye(len(looks), dtype=bool)
    for number, one in enumerate(looks):
        ways = poses.positions - one.spot.place
        ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
        alike = np.flatnonzero(ways @ ways[number] >= np.cos(np.radians(_ALIKE_DEG)))
        seen[alike, number] |= shows(poses.take(alike), one.spot, base.camera, graph, mm_px)
    return toured(poses, seen, graph, base.pace, base.settings.retime)


def _words(goal: Look, look: Trajectory, camera: Camera) -> str:
    spot, position = goal.spot, look.positions[0]
    ray = position - spot.place
    distance = float(np.linalg.norm(ray))
    off = float(np.degrees(np.arccos(np.clip(ray @ goal.direction / distance, -1, 1))))
    pixel = 1e3 * footprint_m(camera, position, spot.place, spot.normal)
    text = f"finding {goal.finding_id}: from {distance:.1f} m at {pixel:.2f} mm/px"
    if goal.reference:
        text += f", as {goal.reference} showed it"
        if off > _AS_WANTED_DEG:
            text += f", but {off:.0f} degrees aside: no nearer viewpoint is safe and shows it"
        if distance > _AS_NEAR * goal.distance_m:
            text += f", from {distance - goal.distance_m:.1f} m farther"
        elif distance * _AS_NEAR < goal.distance_m:
            text += f", from {goal.distance_m - distance:.1f} m nearer"
    return f"{text}; {goal.note}" if goal.note else text


def _nearest(surface: Cloud, looks: Sequence[Look]) -> Ints:
    places = np.array([one.spot.place for one in looks])
    away = np.linalg.norm(surface.points[None] - places[:, None], axis=2)
    facing = np.array([one.spot.normal for one in looks]) @ surface.outward.T
    return np.asarray(np.where(facing > 0, away, np.inf).argmin(axis=1), np.int64)
