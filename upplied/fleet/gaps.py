"""The flight that shows what a flight left out, as a plan of the catalog like any other."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from upplied.catalog import Catalog, Recipe, recipe
from upplied.catalog.schema.plan_rows import transfer_id as id_of
from upplied.catalog.schema.rows import Row
from upplied.config import digest, focal_px
from upplied.errors import RefusedError, UppliedError
from upplied.fleet.flight_logs import flown_with, required_of, zones_asked
from upplied.fleet.flights import USUAL_CLEARANCE_M, place_breaches
from upplied.geometry.polylines import leg_lengths
from upplied.geometry.supposed_scene import obstacle, scene_for
from upplied.geometry.vectors import with_normals
from upplied.outputs.zones import looked
from upplied.planning.airspace.roadmap import roadmap
from upplied.planning.airspace.rules import Airspace, path_clearance
from upplied.planning.geometry.clouds import spacing
from upplied.planning.plan import METHOD_VERSION
from upplied.proof.gap import GapFlight, ZoneGap, gap_flight, square_metres
from upplied.proof.zones import Demand
from upplied.provenance import method, recorded
from upplied.records import Bools, Camera, Cloud, Ints, Measures, Plan, Structure, SurfaceStates

_OTHER, _SHOWN, _MISSED, _UNATTAINABLE = 0, 1, 2, 3  # of SURFACE_STATES
_WITHIN_M = 0.02  # of the plan's clearance, which its own poses keep to the millimetre alone
_PLACES = 300  # of the plan, that the ways may lead by


def plan_gap(catalog: Catalog, start: str) -> str:
    """Plan the flight that shows what a flight left out, of its plan and of zones; its id, or a refusal."""
    row = catalog.flight(start)
    flight_id = str(row["flight_id"])
    if not row["looks_sha256"]:
        what, remedy = f"flight {start}", "fly it or add it again"
        raise RefusedError(what, "was stored by a version without looks", "", remedy)
    basis = recipe(catalog, str(row["transfer_id"]))
    target = catalog.structure(str(row["target_id"]))
    flown = catalog.plan(str(row["transfer_id"]))
    camera = basis.demonstration.camera
    surface, required = required_of(catalog, basis.row, flown, target, camera)
    inspected = np.zeros(len(surface), bool)
    inspected[catalog.looks.get(str(row["looks_sha256"])).as_asked] = True
    settings, scene = basis.settings, scene_for(target, flown.supposed)
    route = settings.route
    clearance = route.clearance_m if route.enforce else USUAL_CLEARANCE_M
    airspace = Airspace(scene, clearance, target.surroundings, route.ground_clearance_m)
    zones, untold = missed_zones(catalog, row, target, camera)
    key = digest(["gap", flight_id, method(), target.sha256, basis.settings.sha256, *key_of(zones)])
    if len(catalog.transfers(every=True, ids=[id_of(key)], columns=["transfer_id"])):
        return id_of(key)
    missing = np.asarray(required & ~inspected, bool)

    def flight_at(clearance_m: float) -> GapFlight:
        path = flown.trajectory
        assert path is not None
        around = replace(airspace, clearance_m=clearance_m)
        every = max(1, len(path) // _PLACES)
        graph = roadmap(around, obstacle(surface, flown.supposed), path.positions[::every])
        known = settings.retime, [zone.gap for zone in zones], settings.inspection
        return gap_flight(path, surface, missing, camera, graph, *known)

    flight, clearance_words = _as_far(flown, airspace, flight_at)
    if broken := place_breaches(flight.trajectory, target, flown.supposed, clearance):
        raise RefusedError(f"gap of flight {start}", "; ".join(broken), "a safe flight", "plan it again")
    nearest_m = path_clearance(airspace.scene, flight.trajectory.positions).distance_m
    plan = _plan(flown, flight, surface, missing, nearest_m, zones, (clearance_words, *untold))
    provenance = derived_from(basis, target.sha256) | {"purpose": f"gap {flight_id[:20]}"}
    catalog.add_plans([(key, plan, provenance)])
    return id_of(key)


def derived_from(basis: Recipe, target_sha256: str) -> dict[str, Any]:
    inputs = {name: basis.row[name] for name in ("demonstration_sha256", "source_sha256")}
    planning = {"method_version": METHOD_VERSION, "settings": basis.settings, "target_sha256": target_sha256}
    return inputs | recorded() | planning


def _as_far(flown: Plan, airspace: Airspace, fly_at: Callable[[float], GapFlight]) -> tuple[GapFlight, str]:
    """The flight at the clearance of its plan, else at the safety distance, and which it is, in words."""
    assert flown.trajectory is not None
    limit = airspace.clearance_m
    wish = path_clearance(airspace.scene, flown.trajectory.positions).certain_m - _WITHIN_M
    if wish <= limit:
        return fly_at(limit), f"keeps the safety distance of {limit:g} m, as its plan does"
    first: GapFlight | None = None
    why = ""
    try:
        first = fly_at(wish)
        if not _lacking(first):
            return first, f"keeps {wish:.1f} m from the structure, as its plan does"
    except RefusedError as refusal:
        why = refusal.finding
    try:
        second = fly_at(limit)
    except RefusedError:
        if first is None:
            raise
        second = first
    if first is not None and _lacking(second) >= _lacking(first):
        return first, f"keeps {wish:.1f} m from the structure, as its plan does"
    more = why or f"{_lacking(first) - _lacking(second)} places more are shown so" if first else why
    return second, f"keeps the safety distance of {limit:g} m, not the {wish:.1f} m of its plan: {more}"


def _lacking(flight: GapFlight) -> int:
    return int(flight.unattainable.sum()) + sum(int(none.sum()) for _, none in flight.zones)


def plan_gaps(catalog: Catalog, flights: Sequence[str]) -> list[str]:
    """A draft for what each of some flights left out; why there is none, in words."""
    problems = []
    for flight in flights:
        try:
            plan_gap(catalog, flight)
        except UppliedError as error:
            problems.append(f"no flight closes the gap of {flight[:12]}: {error}")
    return problems


def _plan(
    flown: Plan,
    flight: GapFlight,
    surface: Cloud,
    missing: Bools,
    clearance_m: float,
    zones: "Sequence[Zone]",
    untold: tuple[str, ...],
) -> Plan:
    state = np.full(len(surface), _OTHER, np.int64)
    state[missing] = _MISSED
    state[flight.unattainable] = _UNATTAINABLE
    state[flight.shows] = _SHOWN
    for zone, (shown, none) in zip(zones, flight.zones, strict=True):
        patch = nearest(surface, zone.gap.cloud)
        state[patch[~shown]] = np.where(none[~shown], _UNATTAINABLE, _MISSED)
        state[patch[shown & (state[patch] == _OTHER)]] = _SHOWN
    path = flight.trajectory
    headline = "shows what zones miss"
    if missing.any():
        share_pct = 100 * int(flight.shows.sum()) / int(missing.sum())
        headline = f"shows {share_pct:.1f} % of the gap as near and as frontally as planned"
    legs = f"by known safe legs {flight.bound_m:.0f} m are needed at least"
    headline += f"; {legs}, it flies {flight.length_m:.0f} m"
    of_zones = [zone.summary(*both) for zone, both in zip(zones, flight.zones, strict=True)]
    return Plan(
        *(flown.demonstration_id, flown.source_id, flown.target_id, flown.kind),
        preset="recommended",
        status="ok",
        trajectory=path,
        is_viewpoint=flight.is_viewpoint,
        registration=flown.registration,
        measures=Measures(
            min_clearance_m=clearance_m,
            path_length_m=flight.length_m,
            duration_s=float(path.t_s[-1]),
            peak_speed_mps=float((leg_lengths(path.positions) / np.diff(path.t_s)).max()),
        ),
        warnings=(headline, *of_zones, *untold),
        surface=SurfaceStates(surface.points, state, surface.normals),
        supposed=flown.supposed,
        flyable=True,
    )


@dataclass(frozen=True)
class Zone:
    row: dict[str, Any]  # which names it
    demand: Demand
    gap: ZoneGap

    def summary(self, shown: Bools, unattainable: Bools) -> str:
        cloud, named = self.gap.cloud, f"zone {self.row['zone']} ({self.row['set']} {self.row['version']})"
        area, all_of_it = square_metres(cloud, shown), square_metres(cloud, np.ones(len(cloud), bool))
        text = f"{named}: shows {area:.1f} of {all_of_it:.1f} m2 that was not seen as it asks"
        if unattainable.any():
            text += f"; {square_metres(cloud, unattainable):.1f} m2 of it no safe pose shows so"
            text += ": the camera's pixels are not known" if self.gap.farthest_m == 0 else ""
        if self.demand.looks > 1:
            text += f"; it requires {self.demand.looks} pictures, this flight shows each place at least once"
        return text


def missed_zones(
    catalog: Catalog, row: Row, target: Structure, camera: Camera
) -> tuple[list[Zone], tuple[str, ...]]:
    """What of zones a flight (its row) and all others did not show; and zones without surface, in words."""
    if (asking := zones_asked(catalog, row, target, camera)) is None:
        return [], ()
    surface, misses = asking.surface, []
    for named, demand, missed in asking.missed(*looked(catalog, flown_with(catalog, row), surface)):
        if missed.any():
            cloud = Cloud(surface.points[missed], surface.outward[missed], surface.areas[missed])
            most = 90.0 if demand.incidence_deg is None else demand.incidence_deg
            misses.append(Zone(named, demand, ZoneGap(demand.zone, cloud, _farthest_m(demand, camera), most)))
    return misses, asking.required()[1]


def key_of(zones: list[Zone]) -> list[str]:
    """What a plan for these zones is named by, beside its flight; nothing where there are none."""
    names, parts = ("zone", "set", "version"), []
    for zone in zones:
        demanded = [zone.demand.looks, zone.gap.farthest_m, zone.gap.incidence_deg]
        parts.append([*(zone.row[name] for name in names), *demanded, zone.gap.cloud.points.tolist()])
    return [digest(parts)] if parts else []


def nearest(surface: Cloud, cloud: Cloud) -> Ints:
    """The sample of a surface that is nearest to each of a cloud's, on its side of a thin plate."""
    apart = spacing(surface)
    known = cKDTree(with_normals(surface.points, surface.outward, 2 * apart))
    return np.asarray(known.query(with_normals(cloud.points, cloud.outward, 2 * apart))[1], np.int64)


def _farthest_m(demand: Demand, camera: Camera) -> float:
    if demand.gsd_mm is None:
        return float("inf")
    return 1e-3 * demand.gsd_mm * focal_px(camera.width_px, camera.hfov_deg) if camera.width_px else 0.0
