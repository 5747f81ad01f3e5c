"""The sorties of a mission, and their legs outside of the inspection: short, low, under the plan's rules.

From home the vehicle climbs straight up, flies to the inspection the shortest way that breaks no rule, if
need be along the roadmap of `planning.airspace`, and comes back alike. An inspection is cut where a free way
home exists, the cut waypoint in both sorties.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from upplied.config import CloudSettings
from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length, cumulated, leg_lengths
from upplied.geometry.scene import scene_of
from upplied.geometry.supposed_scene import extent, obstacle
from upplied.outputs.mission_options import MissionOptions
from upplied.outputs.missions.flying import SLOWEST_MPS
from upplied.planning.airspace.roadmap import Roadmap, roadmap, way
from upplied.planning.airspace.rules import Airspace
from upplied.planning.surface.samples import surface_samples
from upplied.records import Floats, Structure, SupposedSurface, Trajectory

#: Above ground: the limit of the open category (Regulation (EU) 2019/947, UAS.OPEN.010).
USUAL_CEILING_M = 120.0
_FASTEST_MPS = 15.0  # of a leg of the inspection
_GROUND_S = 20.0  # for starting and landing
_CLIMB_M = 3.0  # straight up before the first leg, at least
_SAMPLES = CloudSettings(surface_samples=3000)  # of the structure, for the roadmap
_PATH_STEP_M = 2.0  # between the places of the inspection that are in the roadmap too


@dataclass(frozen=True, eq=False)
class Transits:
    """Where the legs to and from one inspection may lead, and where they start."""

    structure: Structure
    supposed: SupposedSurface | None
    airspace: Airspace  # the rules for every leg of the mission
    inspection: Floats  # (N, 3) m, structure frame
    home: Floats  # (3,)

    @property
    def low_z_m(self) -> float:
        """Where the climb from home may end at the earliest, m."""
        climbed, floor = float(self.home[2]) + _CLIMB_M, self.airspace.floor_m
        return max(climbed, floor) if np.isfinite(floor) else climbed

    @property
    def return_z_m(self) -> float:
        """Height, m, at which an automatic return passes over everything that is known or supposed."""
        boxes = [float(high[2]) for _, high in self.airspace.surroundings.keep_out_m]
        tops = [extent(self.structure, self.supposed)[1][2], self.inspection[:, 2].max(), *boxes]
        return float(max(tops)) + self.airspace.clearance_m + 1.0

    def check_home(self) -> None:
        """Refuse a home from which the vehicle cannot climb."""
        above = self._above(self.low_z_m)
        if not self._climb_is_free(above):
            why = self._climbing.why(self.home) or self._climbing.why(above) or "there is an obstacle"
            fault = f"the climb from {self.home.round(1).tolist()} m to {self.low_z_m:.1f} m is not free"
            remedy = "choose another take-off point (--home-m)"
            raise RefusedError(self.structure.structure_id, f"{fault}: {why}", "", remedy)

    def leg_home(self, at: int) -> Floats | None:
        """The shortest free way (K, 3), m, from a place of the inspection to straight above home; or None.

        It ends at one of three heights above home: low, at the height of the place, or half-way.
        """
        place, ways = self.inspection[at], []
        high_m = max(self.low_z_m, float(place[2]))
        for height_m in sorted({self.low_z_m, (self.low_z_m + high_m) / 2, high_m}):
            above = self._above(height_m)
            if self._climb_is_free(above):
                leg = np.stack([place, above])
                ways.append(way(self._roads, place, above) if self.airspace.broken(leg)[0] else leg)
        free = [line for line in ways if line is not None]
        if not free:
            return None
        shortest = min(free, key=lambda line: leg_lengths(np.vstack([line, self.home])).sum())
        moved = leg_lengths(shortest) > 0.01  # controllers refuse a point that repeats the one before
        return shortest[np.append(True, moved)]

    @cached_property
    def _roads(self) -> Roadmap:
        surface = surface_samples(self.structure, scene_of(self.structure), _SAMPLES)
        step = arc_length(self.inspection) // _PATH_STEP_M
        places = self.inspection[np.unique(step, return_index=True)[1]]
        return roadmap(self.airspace, obstacle(surface, self.supposed), places)

    @cached_property
    def _climbing(self) -> Airspace:
        """The rules on the way up: the ground under home is no obstacle."""
        return replace(self.airspace, ground_clearance_m=-np.inf)

    def _climb_is_free(self, above: Floats) -> bool:
        return not bool(self._climbing.broken(np.stack([self.home, above]))[0])

    def _above(self, height_m: float) -> Floats:
        return np.array([self.home[0], self.home[1], height_m])


def default_home(
    structure: Structure, supposed: SupposedSurface | None, first: Floats, clearance_m: float
) -> tuple[Floats, str]:
    """A take-off on the ground near the first waypoint, outside the structure's box; and why there."""
    low, high = extent(structure, supposed)
    outward = first - (low + high) / 2
    outward[2] = 0.0
    reach = np.linalg.norm(outward)
    outward = outward / reach if reach > 1e-6 else np.eye(3)[0]
    place = first + _until_outside(first, outward, low, high, clearance_m + 3.0) * outward
    place[2] = structure.floor_z_m
    lowest = structure.surroundings.ground_z_m is None
    source = "the lowest point of the structure" if lowest else "the declared ground"
    where = f"take-off assumed at {place.round(1).tolist()} m in the structure frame"
    return place, f"{where}, at the height of {source}"


def _until_outside(point: Floats, direction: Floats, low: Floats, high: Floats, margin: float) -> float:
    """How far to go from a point along a level direction to leave a box grown by a margin, m."""
    inside = (point[:2] > low[:2] - margin) & (point[:2] < high[:2] + margin)
    if not inside.all():
        return 0.0
    with np.errstate(divide="ignore"):
        reach = np.where(direction[:2] > 0, high[:2] + margin - point[:2], low[:2] - margin - point[:2])
        steps = np.where(np.abs(direction[:2]) > 1e-9, reach / direction[:2], np.inf)
    return float(steps.min())


@dataclass(frozen=True)
class Sortie:
    """Waypoints first .. last of an inspection, and its transit legs (K, 3), m, from above home and back."""

    first: int
    last: int
    outbound: Floats
    inbound: Floats
    duration_s: float


@dataclass
class Cutter:
    """Cuts one inspection under given options."""

    path: Trajectory
    transits: Transits
    options: MissionOptions
    most: int  # waypoints of one sortie
    stop_s: Floats  # (N,) that each waypoint costs besides its leg
    legs_home: dict[int, Floats | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        legs, planned = leg_lengths(self.path.positions), np.diff(self.path.t_s)
        self.speeds = np.clip(legs / np.maximum(planned, 1e-6), SLOWEST_MPS, _FASTEST_MPS)
        flown = legs / self.speeds
        self.holds_s = np.maximum(planned - flown, 0.0)  # turning on the spot, or hovering
        self.elapsed_s = cumulated(flown + self.holds_s + self.stop_s[1:])
        endurance_s = self.options.endurance_s
        self.budget_s = np.inf if endurance_s is None else endurance_s * (1 - self.options.reserve_pct / 100)

    def sorties(self) -> list[Sortie]:
        """As few as the greedy rule finds: each as long as it may be."""
        flights: list[Sortie] = []
        while not flights or flights[-1].last < len(self.path) - 1:
            flights.append(self._longest_from(flights[-1].last if flights else 0))
        return flights

    def _longest_from(self, first: int) -> Sortie:
        there = self._leg_home(first)
        if there is None:
            raise self._no_leg(first)
        least = first if len(self.path) == 1 else first + 1
        until_s = self.elapsed_s[first] + self.budget_s - self._transit_s(there)
        reach = np.searchsorted(self.elapsed_s, until_s)
        farthest = min(len(self.path) - 1, int(reach), first + self.most - len(there) - 1)
        for last in range(farthest, least - 1, -1):
            back = self._leg_home(last)
            if back is None or last - first + len(there) + len(back) - 1 > self.most:
                continue
            spent = self.elapsed_s[last] - self.elapsed_s[first] + self._transit_s(there)
            spent += self._transit_s(back) - _GROUND_S
            if spent <= self.budget_s:
                return Sortie(first, last, there[:0:-1], back[1:], float(spent))
        if farthest == len(self.path) - 1 and self._leg_home(farthest) is None:
            raise self._no_leg(farthest)
        endurance_s, limits = self.options.endurance_s, []
        if endurance_s is not None:
            limits.append(f"an endurance of {endurance_s:g} s, {self.options.reserve_pct:g} % in reserve")
        if self.most < 10**9:
            limits.append(f"at most {self.most} waypoints")
        what = f"mission from {self.path.positions[first].round(1).tolist()} m"
        fault = "no part of the inspection fits into one flight with its transit legs"
        remedy = "raise the limit, take off nearer (--home-m), or fly faster"
        raise RefusedError(what, fault, ", ".join(limits), remedy)

    def _leg_home(self, at: int) -> Floats | None:
        if at not in self.legs_home:
            self.legs_home[at] = self.transits.leg_home(at)
        return self.legs_home[at]

    def _transit_s(self, leg: Floats) -> float:
        way = leg_lengths(np.concatenate([leg, self.transits.home[None]]))
        return float(way.sum()) / self.options.transit_mps + _GROUND_S

    def _no_leg(self, at: int) -> RefusedError:
        place = f"{self.path.positions[at].round(1).tolist()} m, {self.path.t_s[at]:.0f} s into the plan"
        fault = f"no safe transit leg reaches the waypoint at {place}"
        rule = "transit legs keep the clearance, the ceiling, keep-out boxes and geofence"
        remedy = "choose another home, a smaller clearance, or a plan that starts in the open"
        return RefusedError(self.transits.structure.structure_id, fault, rule, remedy)
