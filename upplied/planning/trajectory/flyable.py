"""Paths as they are flown: safe, with stations close together, and little longer than there is time for."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from upplied.config import Settings
from upplied.errors import RefusedError
from upplied.geometry.polylines import interpolated
from upplied.geometry.poses import fov_at, from_yaw_pitch
from upplied.planning.airspace.detours import Ways, safe_positions
from upplied.planning.carry.carried import Carried, Goal
from upplied.planning.geometry.frechet import frechet_floored
from upplied.planning.trajectory.added_passes import Extended
from upplied.planning.trajectory.optimise import Optimised
from upplied.planning.trajectory.sharpness import sharply_timed
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.terms.path import Shape
from upplied.planning.trajectory.view import ALIKE, View
from upplied.records import Bools, Floats, Ints, Record, Waypoints

_STEP_M = 0.5  # largest leg of the result
_HALVINGS = 20  # of the way to the demonstrated shape
_DRAWN_BACK = 4  # paths between the start and the result, that are asked whether they are in time


@dataclass(frozen=True, eq=False, repr=False)
class Result(Record):
    """A path as it is flown, how long it takes, and the share of the need that it shows."""

    waypoints: Waypoints
    taken_s: float
    shown: float

    def worth(self, limit_s: float) -> float:
        """What it shows, less the share of a time by which it takes longer."""
        return self.shown - max(self.taken_s / max(limit_s, 1e-9) - 1, 0.0)


@dataclass(frozen=True, eq=False, repr=False)
class Flyable(Record):
    """Paths of a take as they are flown: safe, how long they take, and may take."""

    carried: Carried
    goal: Goal
    settings: Settings
    ways: Ways

    def safe(self, positions: Floats) -> Floats:
        """Positions that keep the rules, with every leg between them."""
        return safe_positions(positions, self.ways) if self.settings.route.enforce else positions

    def finished(self, result: Optimised, origin: Ints, added: Bools) -> Waypoints:
        """A path as it is flown: a curve that is safe, and that departs no farther than it may."""
        carried, goal, settings = self.carried, self.goal, self.settings
        at, curve = result.state.curve(result.variables, _STEP_M)
        positions = self.safe(curve.positions)
        station = np.interp(at, np.arange(float(len(origin))), origin)
        if settings.refine.deviation is not None:
            positions = _within(settings.refine.deviation, positions, station, goal, self.safe)
        low, high = np.radians([settings.retime.min_gimbal_pitch_deg, settings.retime.max_gimbal_pitch_deg])
        nearest = np.floor(at).astype(int), np.ceil(at).astype(int)
        further = added[nearest[0]] | added[nearest[1]]
        return Waypoints(
            positions,
            from_yaw_pitch(curve.yaw, np.clip(curve.pitch, low, high)),
            np.interp(station, np.arange(float(len(goal.flown))), carried.path.t_s),
            (nearest[0] == at) & carried.path.is_viewpoint[origin[nearest[0]]] & ~further,
            further,
        )

    def in_time(self, result: Optimised, origin: Ints, added: Bools, limit_s: float) -> Result:
        """What of a result is worth most in a time, drawn back to its start or not.

        What takes a percent longer has to show a percent more, and among paths worth as much within a point
        the whole is flown: no second decides.
        """
        whole = self._partly(result, 1.0, origin, added)
        within, beyond, parts = 0.0, 1.0, [whole]
        if whole.taken_s <= limit_s:
            return whole
        for _ in range(_DRAWN_BACK):
            share = (within + beyond) / 2
            try:
                parts.append(self._partly(result, share, origin, added))
            except RefusedError:  # between two paths that can be made safe lies one that can not
                beyond = share
                continue
            within, beyond = (share, beyond) if parts[-1].taken_s <= limit_s else (within, share)
        best = max(parts, key=lambda part: part.worth(limit_s))
        return whole if whole.worth(limit_s) >= best.worth(limit_s) - ALIKE else best

    def _partly(self, result: Optimised, share: float, origin: Ints, added: Bools) -> Result:
        part = result if share == 1 else result.partly(share)
        waypoints = self.finished(part, origin, added)
        return Result(waypoints, self.seconds(waypoints), self.shown(part, waypoints))

    def shown(self, result: Optimised, path: Waypoints) -> float:
        """Share of the need that a path as it is flown truly shows: what made it safe may hide some."""
        view = result.search.problem.view
        if view.fov_deg is not None:
            view = replace(view, fov_deg=fov_at(self.carried.take.inspection.flight, path.t_s))
        return 1 - float(view.need[view.missed(path.positions, path.quat_xyzw)].sum())

    def allowed_s(self, view: View, start: Flown) -> float:
        """As much longer than the demonstration as what is to be shown is larger, and some more, at most.

        Where what is carried takes longer already, some more than that.
        """
        flight, area = self.carried.take.inspection.flight, view.cloud.areas
        zones = float(area[view.inspected].sum() / max(area[self.goal.inspected.need > 0].sum(), 1e-9))
        ratio = max(self.goal.area_ratio, 1.0) * max(zones, 1.0)
        usual_s = ratio * float(flight.t_s[-1] - flight.t_s[0])
        carried_s = self.seconds_of(Extended.alone(start))
        return self.settings.refine.longer * max(usual_s, carried_s)

    def seconds_of(self, longer: Extended) -> float:
        """The time of a path with passes, before it is optimised."""
        path, origin, own = longer.path, longer.origin, self.carried.path
        viewed = own.is_viewpoint[origin] & ~longer.added
        poses = from_yaw_pitch(path.yaw, path.pitch)
        return self.seconds(Waypoints(path.positions, poses, own.t_s[origin], viewed, longer.added))

    def seconds(self, path: Waypoints) -> float:
        """The time of a path as it will be flown."""
        take = self.carried.take
        flight = take.inspection.flight
        timed = sharply_timed(path, flight, [take], self.goal.inspected, self.settings).trajectory
        return float(timed.t_s[-1] - timed.t_s[0])


def _within(
    bound: float, positions: Floats, at: Floats, goal: Goal, safe: Callable[[Floats], Floats]
) -> Floats:
    """The path, drawn towards the demonstrated shape until within the bound; refused if not safe there."""
    flown = interpolated(at, np.arange(float(len(goal.flown))), goal.flown)
    image, stands = Shape.of(flown, goal.standing).image(positions), goal.standing
    reference = goal.reference @ stands.T

    def departure(path: Floats) -> float:
        return frechet_floored(reference, path @ stands.T)

    low, high = 0.0, 0.0 if departure(positions) <= bound else 1.0
    for _ in range(_HALVINGS if high else 0):
        middle = (low + high) / 2
        beyond = departure(positions + middle * (image - positions)) > bound
        low, high = (middle, high) if beyond else (low, middle)
    drawn = safe(positions + high * (image - positions))
    if (departs := departure(drawn)) > bound * (1 + 1e-6):
        raise RefusedError(
            "the shape of the path",
            f"departs from the demonstrated one by {departs:.2f} of its spread where it is safe",
            f"at most {bound:g} (refine.deviation)",
            "leave refine.deviation out: a larger departure then is a warning",
        )
    return drawn
