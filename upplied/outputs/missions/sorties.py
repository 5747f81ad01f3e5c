"""Where an inspection is cut into sorties: where a free way home exists, the cut waypoint in both."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from upplied.errors import RefusedError
from upplied.geometry.polylines import cumulated, leg_lengths
from upplied.outputs.mission_options import MissionOptions
from upplied.outputs.missions.transits import Transits
from upplied.records import Floats, Trajectory

_GROUND_S = 20.0  # for starting and landing
SLOWEST_MPS, _FASTEST_MPS = 0.2, 15.0


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
        given = self.options.endurance_s
        self.budget_s = np.inf if given is None else given * (1 - self.options.reserve_pct / 100)

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
        reach = np.searchsorted(
            self.elapsed_s, self.elapsed_s[first] + self.budget_s - self._transit_s(there)
        )
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
        raise self._too_short(first)

    def _leg_home(self, at: int) -> Floats | None:
        if at not in self.legs_home:
            self.legs_home[at] = self.transits.leg_home(at)
        return self.legs_home[at]

    def _transit_s(self, leg: Floats) -> float:
        way = leg_lengths(np.concatenate([leg, self.transits.home[None]]))
        return float(way.sum()) / self.options.transit_mps + _GROUND_S

    def _no_leg(self, at: int) -> RefusedError:
        place = self.path.positions[at].round(1).tolist()
        return RefusedError(
            self.transits.structure.structure_id,
            f"no safe transit leg reaches the waypoint at {place} m, {self.path.t_s[at]:.0f} s into the plan",
            "transit legs keep the clearance, the ceiling, keep-out boxes and geofence",
            "choose another home, a smaller clearance, or a plan that starts in the open",
        )

    def _too_short(self, at: int) -> RefusedError:
        given = self.options.endurance_s
        limits = [f"at most {self.most} waypoints"] if self.most < 10**9 else []
        if given is not None:
            limits.insert(0, f"an endurance of {given:g} s, {self.options.reserve_pct:g} % in reserve")
        return RefusedError(
            f"mission from {self.path.positions[at].round(1).tolist()} m",
            "no part of the inspection fits into one flight with its transit legs",
            ", ".join(limits),
            "raise the limit, take off nearer (--home-m), or fly faster",
        )
