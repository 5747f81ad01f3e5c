"""Missions from a plan: sorties, transit legs, corners, photos, the gate, and the fence for the autopilot."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from upplied.checks import pair_name
from upplied.errors import RefusedError
from upplied.geometry.supposed_scene import scene_for
from upplied.outputs.mission_options import MissionOptions
from upplied.outputs.missions import gate
from upplied.outputs.missions.flying import Flying, passing_m, thinned
from upplied.outputs.missions.photos import shots_of
from upplied.outputs.missions.records import Fence, Mission, heading_and_pitch, placement_of, to_geodetic
from upplied.outputs.missions.transits import USUAL_CEILING_M, Cutter, Sortie, Transits, default_home
from upplied.planning.airspace.rules import Airspace, path_clearance
from upplied.records import Bools, Camera, Floats, Plan, Structure, SupposedSurface, Trajectory

ANYTHING = Flying(zooms=True)  # a reader of the plan itself
_EXACT_M = 0.02  # accuracy of a clearance
_RALLY_CLEARANCE_M = 1.0  # minimum distance of a rally point from the structure
_STEP_M = 0.5  # spacing of the points of the path that are tested against a box
_NEVER_SCANNED = "part of the structure was never scanned: every leg also keeps clear of its inferred surface"


def missions_of(
    plan: Plan,
    structure: Structure,
    options: MissionOptions,
    flying: Flying = ANYTHING,
    camera: Camera | None = None,
    objections: tuple[gate.Breach, ...] = (),
) -> list[Mission]:
    """The sorties of a plan, each within the endurance and the number of waypoints that are allowed.

    Raises RefusedError if the plan is not ok, the structure's place is unknown or in another datum than the
    altitudes, no safe transit leads there and back, or a rule of the gate is broken that is not overruled.
    """
    path, name = _path_of(plan, structure)
    supposed, seen = plan.supposed, (plan.surface, camera or Camera())
    placement = placement_of(structure)
    if options.altitude not in ("relative", placement.datum):  # they differ by tens of metres
        fault = f"its altitude is known as {placement.datum}, {options.altitude} was requested"
        remedy = "export with altitude relative to take-off, or give the manifest that datum"
        raise RefusedError(structure.structure_id, fault, "no geoid model is applied", remedy)
    if options.altitude not in flying.altitudes:
        raise RefusedError(name, f"{options.altitude} altitudes were requested", flying.altitude_rule)
    limits, steps = gate.limits_of(options), gate.planned(path.positions, path.t_s)
    broken = [*objections, *gate.breaches(steps, structure, limits, supposed)]
    zooms = flying.zooms and not (flying.zooms_not_by and options.firmware == flying.zooms_not_by)
    broken += gate.zoom_breaches(path, zooms)
    overruled = gate.pass_or_refuse(name, broken, options.overruled)
    notes = gate.notes_of(overruled)
    if supposed is not None:
        notes.append(_NEVER_SCANNED)
    airspace = _airspace_of(structure, supposed, path.positions, options)
    if options.home_m is None:
        home, note = default_home(structure, supposed, path.positions[0], options.clearance_m)
        notes.append(note)
    else:
        home = np.array(options.home_m, float)
    shots = shots_of(name, plan, airspace.scene, seen[1], options)
    path, tolerances = shots.path, (options.tolerance_m, options.tolerance_deg)
    waypoints, note, share = thinned(path, shots.fixed, tolerances, airspace, seen, flying.turning, zooms)
    shown = share if options.photos == "video" else shots.shown
    share = float(np.fmin(share, shots.shown))
    lacking = [*gate.coverage_breaches(share, limits), *gate.overlap_breaches(shots.across, options.overlaps)]
    unseen = gate.pass_or_refuse(name, lacking, options.overruled)
    notes += [note, *shots.notes, *gate.notes_of(unseen)]
    short = path.take(waypoints) if zooms else replace(path.take(waypoints), fov_deg=None)
    if short.fov_deg is not None:
        notes.append(
            f"the camera zooms, from {short.fov_deg[:, 0].max():.1f} to {short.fov_deg[:, 0].min():.1f} deg "
            f"of horizontal field of view{flying.zoom_note}"
        )
    transits = Transits(structure, supposed, airspace, short.positions, home)
    transits.check_home()
    passing = passing_m(short, airspace, options.corner_m) if flying.passes else np.zeros(len(short))
    most = min(options.max_waypoints or 10**9, flying.max_waypoints or 10**9)
    cutter = Cutter(short, transits, options, most, np.where(passing > 0, 0.0, flying.stop_s))
    sorties = cutter.sorties()
    notes += _notes(sorties, options, flying, transits, int((passing == 0).sum()))
    photo = shots.photo[waypoints]
    missions = []
    for at, sortie in enumerate(sorties):
        body = _waypoints(cutter, photo, passing, sortie)
        heading, pitch = heading_and_pitch(body["quat_xyzw"], placement.heading_deg)
        missions.append(
            Mission(
                name=name,
                number=at + 1,
                count=len(sorties),
                placement=placement,
                altitude=options.altitude,
                home=to_geodetic(home[None], placement)[0],
                home_local=home,
                return_height_m=transits.return_z_m - float(home[2]),
                geodetic=to_geodetic(body["local"], placement),
                heading_deg=heading,
                pitch_deg=pitch,
                photo_distance_m=shots.every_m,
                shown_pct=shown * plan.measures.coverage_inspected_pct,
                films=options.photos == "video",
                duration_s=sortie.duration_s,
                notes=tuple(notes),
                overruled=(*overruled, *unseen),
                **body,
            )
        )
    return missions


def _airspace_of(
    structure: Structure, supposed: SupposedSurface | None, path: Floats, options: MissionOptions
) -> Airspace:
    """The rules for every leg of a mission round a path (N, 3), m, structure frame."""
    # The clearance is the required one, or that of the plan if less; the gate decides about such a plan.
    # The ceiling is the structure's, and the usual one unless the plan is higher.
    scene = scene_for(structure, supposed)
    planned = path_clearance(scene, path).certain_m
    usual = USUAL_CEILING_M if options.max_height_m is None else options.max_height_m
    declared = structure.surroundings.ceiling_z_m
    ceiling = max(structure.floor_z_m + usual, float(path[:, 2].max()))
    ceiling = ceiling if declared is None else min(ceiling, declared)
    around = replace(structure.surroundings, ceiling_z_m=ceiling)
    return Airspace(scene, min(options.clearance_m, planned) - _EXACT_M, around)


def _notes(
    sorties: list[Sortie], options: MissionOptions, flying: Flying, transits: Transits, stops: int
) -> list[str]:
    transit_legs = [leg for sortie in sorties for leg in (sortie.outbound, sortie.inbound) if len(leg)]
    highest = max((float(leg[:, 2].max()) for leg in transit_legs), default=float(transits.home[2]))
    over_ground = max(highest, float(transits.inspection[:, 2].max())) - transits.structure.floor_z_m
    heights = {
        "relative": "heights are metres above the take-off point: take off there, or set --home-m",
        "amsl": "altitudes are metres above mean sea level",
        "ellipsoid": "altitudes are metres above the WGS 84 ellipsoid",
    }
    notes = [
        heights[options.altitude],
        f"transit legs reach {highest - transits.home[2]:.1f} m above take-off; set the return-to-home "
        f"altitude to at least {transits.return_z_m - transits.home[2]:.1f} m",
    ]
    if over_ground > USUAL_CEILING_M:
        notes.append(f"the mission reaches {over_ground:.0f} m above ground: more than {USUAL_CEILING_M:g} m")
    times = ", ".join(f"{sortie.duration_s:.0f}" for sortie in sorties)
    if len(sorties) > 1:
        resumed = "each resumes at the last waypoint of the previous one"
        notes.append(f"{len(sorties)} flights of {times} s; {resumed}")
    elif options.endurance_s is None:
        notes.append(f"flight time about {times} s; battery not checked: set --endurance-s")
    else:
        notes.append(f"flight time about {times} s, battery endurance {options.endurance_s:g} s")
    if flying.stop_s:
        where = f"each of the {stops} stops" if flying.passes else "the stop at each waypoint"
        notes.append(f"the flight time includes {flying.stop_s:g} s for {where}")
    return [*notes, flying.note] if flying.note else notes


def _path_of(plan: Plan, structure: Structure) -> tuple[Trajectory, str]:
    """The path of a plan for this structure, and the name of its mission."""
    name = pair_name(plan.demonstration_id, plan.target_id)
    if plan.status != "ok" or plan.trajectory is None:
        fault = f"the plan is {plan.status}: {plan.reason}"
        raise RefusedError(name, fault, "only a plan that is ok is flown")
    if plan.target_id != structure.structure_id:
        fault = f"the structure given is {structure.structure_id}"
        raise RefusedError(name, fault, f"the plan is for {plan.target_id}")
    return plan.trajectory, name


def _waypoints(cutter: Cutter, photo: Bools, passing: Floats, sortie: Sortie) -> dict[str, Any]:
    """Fields of a mission; on its transit legs direction and zoom of the camera are constant."""
    path, inside = cutter.path, slice(sortie.first, sortie.last + 1)
    ends = len(sortie.outbound), len(sortie.inbound)

    def stretched(values: Floats) -> Floats:
        return np.pad(values[inside], [ends, (0, 0)], "edge")

    legs, transit_mps = slice(sortie.first, sortie.last), cutter.options.transit_mps
    inspect = np.pad(np.ones(sortie.last - sortie.first + 1, bool), ends)
    photos, passed = np.pad(photo[inside], ends), np.pad(passing[inside], ends)
    passed[np.flatnonzero(inspect)[[0, -1]]] = 0.0
    return {
        "local": np.concatenate([sortie.outbound, path.positions[inside], sortie.inbound]),
        "quat_xyzw": stretched(path.quat_xyzw),
        "speed_mps": np.pad(cutter.speeds[legs], (ends[0] + 1, ends[1]), constant_values=transit_mps),
        "hold_s": np.pad(cutter.holds_s[legs], (ends[0] + 1, ends[1])),
        "passing_m": passed,
        "photo": photos,
        "inspect": inspect,
        "fov_deg": None if path.fov_deg is None else stretched(path.fov_deg),
    }


def fenced(missions: list[Mission], structure: Structure, supposed: SupposedSurface | None) -> list[Mission]:
    """The sorties of a plan with the fence and the rally points of their structure's surroundings.

    A fence consists of polygons on the ground without a top: a keep-out box under the path is omitted, with a
    note. A vehicle that lost its link may fly to a rally point instead of home.
    """
    around = structure.surroundings
    fences, passed = [], 0
    if len(around.geofence_m):
        fences.append(Fence(True, _corners(around.geofence_m, missions[0])))
    for low, high in around.keep_out_m:
        if any(_passes_over(mission, low, high) for mission in missions):
            passed += 1
        else:
            box = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
            fences.append(Fence(False, _corners(box, missions[0])))
    note = f"{passed} keep-out boxes are not in the fence, because the mission flies over them"
    rally, notes = _rally(missions[0], structure, supposed), (note,) if passed else ()
    return [replace(one, fences=tuple(fences), rally=rally, notes=(*one.notes, *notes)) for one in missions]


def _rally(mission: Mission, structure: Structure, supposed: SupposedSurface | None) -> Floats:
    """Rally points (R, 3), latitude and longitude, deg, height over home, m; refused where one is no use."""
    points = np.asarray(structure.surroundings.rally_m, float)
    if not len(points):
        return points
    airspace = Airspace(scene_for(structure, supposed), _RALLY_CLEARANCE_M, structure.surroundings)
    covered = np.isfinite(airspace.scene.cast(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))[0])
    for number, (point, under) in enumerate(zip(points, covered.tolist(), strict=True), 1):
        if fault := airspace.why(point) or "the structure is above it" * under:
            reason = f"rally point {number} at {point.tolist()} m cannot be used: {fault}"
            raise RefusedError(mission.name, reason, "correct the rally points in the manifest")
    heights = points[:, 2:] - mission.home_local[2]
    return np.hstack([to_geodetic(points, mission.placement)[:, :2], heights])


def _corners(corners: Floats, mission: Mission) -> Floats:
    points = np.column_stack([corners, np.zeros(len(corners))])
    return to_geodetic(points, mission.placement)[:, :2]


def _passes_over(mission: Mission, low: Floats, high: Floats) -> bool:
    """Whether a leg, from home and back to it, has a point over the box."""
    path = np.vstack([mission.home_local, mission.local, mission.home_local])[:, :2]
    for start, end in pairwise(path):
        points = np.linspace(start, end, int(np.linalg.norm(end - start) / _STEP_M) + 2)
        if ((points >= low[:2]) & (points <= high[:2])).all(axis=1).any():
            return True
    return False
