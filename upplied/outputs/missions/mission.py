"""A mission: what an autopilot is told, in degrees and metres on the Earth; and how a plan becomes one."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from upplied.errors import RefusedError
from upplied.outputs.missions import geodesy
from upplied.outputs.missions.flying import Flying
from upplied.outputs.missions.legs import Airspace, airspace_of, default_home
from upplied.outputs.missions.options import MissionOptions
from upplied.outputs.missions.sorties import Cutter, Sortie
from upplied.outputs.missions.thinning import thinned
from upplied.records import (
    Bools,
    Camera,
    Floats,
    Placement,
    Plan,
    Record,
    Structure,
    SurfaceStates,
    Trajectory,
)

ANYTHING = Flying()
_SAME_PLACE_M = 0.05
_CROWDED_M = 0.25  # mean step between viewpoints


@dataclass(frozen=True, eq=False, repr=False)
class Mission(Record):
    """One sortie: take off at home, climb, fly the waypoints in order, return above home and land.

    Waypoints without `inspect` lead from above home to the inspection and back.
    """

    name: str
    number: int  # of this sortie, from 1
    count: int  # of sorties
    placement: Placement
    altitude: str  # what is written: "relative" to take-off, "amsl" or "ellipsoid"
    home: Floats  # (3,) latitude and longitude, deg, altitude, m
    home_local: Floats  # (3,) m, structure frame
    geodetic: Floats  # (N, 3) latitude and longitude, deg, altitude in the placement's datum, m
    local: Floats  # (N, 3) m, structure frame
    quat_xyzw: Floats  # (N, 4) camera to structure
    heading_deg: Floats  # (N,) of the camera, 0 .. 360 clockwise from true north
    pitch_deg: Floats  # (N,) of the gimbal, negative down
    speed_mps: Floats  # (N,) of the leg that ends at the waypoint
    hold_s: Floats  # (N,) to hover on arrival, while the camera turns or as the expert did
    photo: Bools  # (N,) take one here
    inspect: Bools  # (N,)
    photo_distance_m: float  # between photos during the inspection, 0: at `photo` alone
    duration_s: float
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.local)

    @property
    def stops(self) -> list[range]:
        """The waypoints by place: those after the first of a range are turns of the camera on the spot."""
        starts = [0]
        for at in range(1, len(self)):
            if np.linalg.norm(self.local[at] - self.local[starts[-1]]) > _SAME_PLACE_M:
                starts.append(at)
        return [range(start, end) for start, end in pairwise([*starts, len(self)])]

    @property
    def height_m(self) -> Floats:
        """Height (N,) above take-off, m."""
        return self.local[:, 2] - self.home_local[2]

    @property
    def written_alt_m(self) -> Floats:
        """Altitude (N,) as the mission states it, m."""
        return self.height_m if self.altitude == "relative" else self.geodetic[:, 2]


def missions_of(
    plan: Plan | Trajectory,
    structure: Structure,
    options: MissionOptions,
    flying: Flying = ANYTHING,
    camera: Camera | None = None,
) -> list[Mission]:
    """The sorties of a plan, each within the endurance and the number of waypoints that are allowed.

    Raises
    ------
    RefusedError
        If the plan is not ok, the structure's place is unknown, the altitude reference does not fit
        its datum, or no safe way leads to the inspection and back.
    """
    path, is_viewpoint, surface, name = _inspection(plan, structure)
    placement = geodesy.placement_of(structure)
    check_altitude(options.altitude, placement, structure.structure_id)
    airspace = airspace_of(structure, path.positions, options.clearance_m)
    broken = airspace.forbidden(path.positions) if len(path) > 1 else ""
    if broken:
        raise RefusedError(
            name, f"the plan cannot be flown: {broken}", "", "plan again with these surroundings"
        )
    notes = []
    if options.home_m is None:
        home, note = default_home(structure, path.positions[0], options.clearance_m)
        notes.append(note)
    else:
        home = np.array(options.home_m, float)
    _check_home(airspace, home, options.clearance_m, structure.structure_id)
    if is_viewpoint is not None and _crowded(path.positions[is_viewpoint]):
        notes.append(
            f"the viewpoints are a recording's poses: photos every {options.photo_distance_m:g} m instead"
        )
        is_viewpoint = None
    fixed = np.zeros(len(path), bool) if is_viewpoint is None else is_viewpoint
    tolerances = (options.tolerance_m, options.tolerance_deg)
    view = (surface, camera or Camera())
    kept, note = thinned(path, fixed, tolerances, airspace.scene, view, options.clearance_m, flying.turning)
    notes.append(note)
    short = Trajectory(path.t_s[kept], path.positions[kept], path.quat_xyzw[kept])
    most = min(options.max_waypoints or 10**9, flying.max_waypoints or 10**9)
    cutter = Cutter(short, airspace, home, options, most, flying.stop_s)
    sorties = cutter.sorties()
    notes += _told(sorties, options, flying, airspace.transit_z_m - float(home[2]))
    by_distance = options.photos == "distance" or (options.photos == "viewpoints" and is_viewpoint is None)
    photo = fixed[kept] if options.photos == "viewpoints" else np.zeros(len(kept), bool)
    made = []
    for at, sortie in enumerate(sorties):
        body = _waypoints(cutter, photo, sortie)
        heading, pitch = geodesy.heading_and_pitch(body.quat_xyzw, placement.heading_deg)
        made.append(
            Mission(
                name=name,
                number=at + 1,
                count=len(sorties),
                placement=placement,
                altitude=options.altitude,
                home=geodesy.to_geodetic(home[None], placement)[0],
                home_local=home,
                geodetic=geodesy.to_geodetic(body.local, placement),
                local=body.local,
                quat_xyzw=body.quat_xyzw,
                heading_deg=heading,
                pitch_deg=pitch,
                speed_mps=body.speed_mps,
                hold_s=body.hold_s,
                photo=body.photo,
                inspect=body.inspect,
                photo_distance_m=options.photo_distance_m if by_distance else 0.0,
                duration_s=sortie.duration_s,
                notes=tuple(notes),
            )
        )
    return made


def _told(sorties: list[Sortie], options: MissionOptions, flying: Flying, transit_m: float) -> list[str]:
    """What the person who flies must know of heights, return and sorties."""
    heights = {
        "relative": "heights are metres above the place of take-off: start there, or say where (home_m)",
        "amsl": "altitudes are metres above mean sea level",
        "ellipsoid": "altitudes are metres above the WGS 84 ellipsoid",
    }
    told = [
        heights[options.altitude],
        f"the way there and back is {transit_m:.1f} m above take-off: let an automatic return climb no less",
    ]
    times = ", ".join(f"{sortie.duration_s:.0f}" for sortie in sorties)
    if len(sorties) > 1:
        told.append(
            f"{len(sorties)} sorties of {times} s, each from the waypoint at which the one before turned back"
        )
    elif options.endurance_s is None:
        told.append(f"about {times} s in the air; no endurance of a battery was declared")
    else:
        told.append(f"about {times} s in the air, of {options.endurance_s:g} s that a battery lasts")
    if flying.stop_s:
        told.append(f"{flying.stop_s:g} s are counted for the stop at each waypoint")
    return [*told, flying.note] if flying.note else told


def check_altitude(altitude: str, placement: Placement, structure_id: str) -> None:
    """Absolute altitudes are written only in the datum of the placement: datums differ by tens of metres."""
    if altitude not in ("relative", placement.datum):
        raise RefusedError(
            structure_id,
            f"its altitude is known as {placement.datum}, {altitude} was asked for",
            "no geoid model is applied",
            "export with altitude relative to take-off, or give the manifest that datum",
        )


@dataclass(frozen=True)
class _Body:
    local: Floats
    quat_xyzw: Floats
    speed_mps: Floats
    hold_s: Floats
    photo: Bools
    inspect: Bools


def _inspection(
    plan: Plan | Trajectory, structure: Structure
) -> tuple[Trajectory, Bools | None, SurfaceStates | None, str]:
    if isinstance(plan, Trajectory):
        return plan, None, None, structure.structure_id
    name = f"{plan.demonstration_id}--{plan.target_id}"
    if plan.status != "ok" or plan.trajectory is None:
        raise RefusedError(
            name, f"the plan is {plan.status}: {plan.reason}", "only a plan that is ok is flown"
        )
    if plan.target_id != structure.structure_id:
        raise RefusedError(
            name, f"the structure given is {structure.structure_id}", f"the plan is for {plan.target_id}"
        )
    return plan.trajectory, plan.is_viewpoint, plan.surface, name


def _crowded(viewpoints: Floats) -> bool:
    """Whether viewpoints follow each other so closely that nobody stops at each for a photo."""
    steps = np.linalg.norm(np.diff(viewpoints, axis=0), axis=1)
    return len(steps) > 0 and float(steps.mean()) < _CROWDED_M


def _check_home(airspace: Airspace, home: Floats, clearance_m: float, name: str) -> None:
    column = np.array([home, [home[0], home[1], airspace.transit_z_m]])
    if not airspace.free(column, clearance_m):
        why = airspace.forbidden(column) or f"it comes nearer than {clearance_m:g} m to the structure"
        raise RefusedError(
            name,
            f"the climb from {home.round(1).tolist()} m to {airspace.transit_z_m:.1f} m is not free: {why}",
            "",
            "choose another home (home_m)",
        )


def _waypoints(cutter: Cutter, photo: Bools, sortie: Sortie) -> _Body:
    """The way in, the inspection and the way back as one list; on the ways the camera keeps its direction."""
    path, inside = cutter.path, slice(sortie.first, sortie.last + 1)
    ways = ((sortie.first, sortie.way_in), (sortie.last, sortie.way_out))
    turned = [np.repeat(path.quat_xyzw[[at]], len(way), axis=0) for at, way in ways]
    before, after = (np.full(len(way), cutter.options.transit_mps) for _, way in ways)
    holds = [before * 0, [0.0], cutter.holds_s[sortie.first : sortie.last], after * 0]
    speeds = [before, [cutter.options.transit_mps], cutter.speeds[sortie.first : sortie.last], after]
    inspect = np.concatenate([before * 0, np.ones(sortie.last - sortie.first + 1), after * 0]) > 0
    photos = np.zeros(len(inspect), bool)
    photos[inspect] = photo[inside]
    return _Body(
        np.concatenate([sortie.way_in, path.positions[inside], sortie.way_out]),
        np.concatenate([turned[0], path.quat_xyzw[inside], turned[1]]),
        np.concatenate(speeds),
        np.concatenate(holds),
        photos,
        inspect,
    )
