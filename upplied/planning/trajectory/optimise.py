"""One optimisation of the carried path and of where its camera looks (preset `recommended`).

The state is a smooth displacement of a start and of its camera's directions. Every problem is a term, a file
in `terms`, with a weight that says what its unit is worth as a share of the surface to be shown
(`OptimiseSettings`). One solver, L-BFGS-B with analytic slopes, weighs them all. The carried path is
optimised, unless another start is clearly worth more, and flown as it is where the result is worth no more.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from upplied.config import OptimiseSettings
from upplied.geometry.polylines import cumulated, leg_lengths
from upplied.geometry.poses import from_yaw_pitch
from upplied.planning.airspace.rules import Airspace, pushed_out
from upplied.planning.carry.standoff import Standoff
from upplied.planning.trajectory.state import Flown, State, Term, between
from upplied.planning.trajectory.terms.coverage import Coverage, Hidden
from upplied.planning.trajectory.terms.path import Clearance, Leaving, Shape, StandoffKept, Turning
from upplied.planning.trajectory.view import ALIKE, Sight, View
from upplied.records import Bools, Floats, Ints, Record

_NODES = 4  # of a piece of the spline, at which a path is judged
_STEPS = 2  # in which the number of pieces doubles
_LITTLE = 1e-9  # of progress, from station to station at least
_CORRECTIONS = 12  # that L-BFGS keeps
_MOVED = 0.5  # stand-offs that count as much as a radian turned: the solver settles in half the steps
_CLEARLY = 0.1  # of the need, by which another start is worth more: a few hundredths say nothing of the ends
_LOST = 5e-4  # of the need, that the carried flight shows and a path that is worth more may miss


@dataclass(frozen=True, eq=False, repr=False)
class Problem(Record):
    """What is asked of a path, at M stations."""

    starts: Sequence[Flown]  # safe; the first, the carried one, may be flown as it is
    demonstrated: Shape
    view: View
    standoff: Standoff
    airspace: Airspace
    turned_rad: float  # by which the expert turned the camera
    aside_rad: Floats  # (M,) of the expert's optical axis from what was inspected; NaN where none was seen
    level: bool = False  # the path stays in its plane

    def along(self, path: Flown, origin: Ints, added: Bools, best: Flown) -> "Problem":
        """The same for a path with stations added to its own; `origin` is the own one that each belongs to.

        It starts from that path, and from it with its own stations on the best path without added ones.
        """
        own, fov_deg = np.flatnonzero(~added), self.view.fov_deg
        shape, poses = self.demonstrated, path.columns
        demonstrated = np.where(added[:, None], np.nan, shape.demonstrated[origin])
        poses[own] = best.columns[origin[own]]
        led = Flown(poses[:, :3].copy(), np.unwrap(poses[:, 3]), poses[:, 4].copy())
        return replace(
            self,
            starts=[path, led],
            demonstrated=replace(shape, demonstrated=demonstrated),
            view=self.view if fov_deg is None else replace(self.view, fov_deg=fov_deg[origin]),
            standoff=replace(self.standoff, station=own[self.standoff.station]),
            aside_rad=self.aside_rad[origin],
        )

    def between(self, stations: Floats) -> "Problem":
        """The same at fractions of stations (N,)."""
        view, viewed = self.view, self.standoff.station
        return replace(
            self,
            starts=[start.between(stations) for start in self.starts],
            demonstrated=self.demonstrated.between(stations),
            view=view if view.fov_deg is None else replace(view, fov_deg=between(stations, view.fov_deg)),
            standoff=replace(self.standoff, station=np.abs(stations - viewed[:, None]).argmin(axis=1)),
            aside_rad=between(stations, self.aside_rad),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Optimised(Record):
    """The result of a search."""

    search: "_Search"
    variables: Floats

    @property
    def path(self) -> Flown:
        """The path at its stations."""
        return self.state.flown(self.variables)

    @property
    def state(self) -> State:
        """What the variables are of, at the stations."""
        return self.search.whole

    def partly(self, share: float) -> "Optimised":
        """Of the way from the start to the result, this share."""
        return replace(self, variables=share * self.variables)


def optimise(problem: Problem, shape_weight: float, weights: OptimiseSettings) -> Optimised:
    """The state whose path shows most for what it costs, and its variables.

    The departure from the demonstrated shape has the weight that the fidelity asks for.
    """
    samples, need = problem.view.sampled(weights.samples)
    starts = range(len(problem.starts))
    searches = [_Search.of(problem, start, samples, need, shape_weight, weights) for start in starts]
    if len(samples) == 0:
        return Optimised(searches[0], searches[0].first)
    first = [search.value(search.state.flown(search.first), search.first_sight) for search in searches]
    best = int(np.argmax(first))
    carried, search = searches[0], searches[best if first[best] > first[0] + _CLEARLY else 0]
    worth, variables = search.improved()
    flown, is_clear = carried.cleared(carried.first)
    least = carried.shown(flown) - _LOST if is_clear else 0.0
    alike = worth < carried.worth(carried.first, carried.first_sight) + ALIKE
    if alike or search.shown(search.cleared(variables)[0]) < least:
        return Optimised(carried, carried.first)
    return Optimised(search, variables)


def as_good(worth: Sequence[float]) -> list[int]:
    """Those that are worth as much as the best, in order: among equals no hair's breadth decides."""
    return np.flatnonzero(np.array(worth) >= max(worth) - ALIKE).tolist()


@dataclass(frozen=True, eq=False, repr=False)
class _Search(Record):
    """The search from one start, whose path is judged at nodes that lie evenly along it.

    Stations lie densely where a flight bends: how many, noise in the log decides.
    """

    problem: Problem  # at the nodes
    weights: OptimiseSettings
    state: State  # at the nodes
    whole: State  # at the stations
    first: Floats  # the variables of the start
    samples: Ints  # (m,) that stand for all
    need: Floats  # (m,)
    lasting: Sequence[tuple[float, Term]]  # the terms that hold for all rounds, with their weights

    @classmethod
    def of(
        cls,
        problem: Problem,
        number: int,
        samples: Ints,
        need: Floats,
        shape_weight: float,
        weights: OptimiseSettings,
    ) -> "_Search":
        unit_m = np.full(3, _MOVED * _standoff_m(problem))
        if problem.level:
            unit_m[2] = 0.0
        start = problem.starts[number]
        progress = _progress(problem, start)
        length = max(float(progress[-1]), _LITTLE)
        share, pieces = progress / length, _pieces(length / weights.spacing)
        nodes = np.linspace(0, 1, _NODES * pieces + 1)
        whole = State.of(start, share, unit_m, pieces)
        problem = problem.between(np.interp(nodes, share, np.arange(float(len(share)))))
        start = problem.starts[number]
        state = State.of(start, nodes, unit_m, pieces)
        first = np.zeros(state.basis.shape[1] * len(state.unit))
        leaving = Leaving.of(problem.starts[0].positions, _standoff_m(problem))
        standoff = StandoffKept.of(problem.standoff, state.flown(first), weights.standoff_tolerance)
        lasting: list[tuple[float, Term]] = [
            (shape_weight, problem.demonstrated),
            (weights.standoff, standoff),
            (weights.turning, Turning(start.yaw, start.pitch, problem.turned_rad)),
            (weights.leaving, leaving),
        ]
        return cls(problem, weights, state, whole, first, samples, need, lasting)

    def shown(self, path: Flown) -> float:
        """Share of the need that is truly seen."""
        quats = from_yaw_pitch(path.yaw, path.pitch)
        return float(self.need @ self.problem.view.shown(path.positions, quats, self.samples))

    @cached_property
    def first_sight(self) -> Sight:
        """Of the start."""
        return self.sight(self.state.flown(self.first))

    def value(self, path: Flown, sight: Sight) -> float:
        """Share of the need that is truly seen, less what the lasting terms and the optical axis cost."""
        terms = [*self.lasting, (self.weights.axis, sight.axis)]
        return self.shown(path) - sum(weight * term.value(path)[0] for weight, term in terms)

    def sight(self, path: Flown) -> Sight:
        """What a path's cameras may see, and should look at."""
        return Sight.of(path, self.problem.view, self.samples, self.need, self.problem.aside_rad)

    def worth(self, variables: Floats, sight: Sight) -> float:
        """Its value as it will be flown, and 1 less where no push leads out of what it comes too near to."""
        path, is_clear = self.cleared(variables)
        return self.value(path, sight) - (not is_clear)

    def cleared(self, variables: Floats) -> tuple[Flown, bool]:
        """The path pushed out where it comes too near, else as at its start, and whether it is clear then."""
        path, airspace = self.state.flown(variables), self.problem.airspace
        if not Clearance.of(airspace, path).broken(path).any():
            return path, True
        path = replace(path, positions=pushed_out(path.positions, airspace))
        broken = Clearance.of(airspace, path).broken(path)
        path.positions[broken] = self.state.flown(self.first).positions[broken]
        return path, not Clearance.of(airspace, path).broken(path).any()

    def improved(self) -> tuple[float, Floats]:
        """The best of the rounds, until one gains too little, and what it is worth."""
        variables, sight = self.first, self.first_sight
        results: list[tuple[float, Floats]] = []
        for _ in range(self.weights.rounds):
            best = max((worth for worth, _ in results), default=-np.inf)
            terms = self.terms(self.state.flown(variables), sight)
            variables = self.solved(variables, terms)
            sight = self.sight(self.state.flown(variables))
            results.append((self.worth(variables, sight), variables))
            if results[-1][0] < best + ALIKE:
                break
        return results[as_good([worth for worth, _ in results])[-1]]

    def terms(self, path: Flown, sight: Sight) -> list[tuple[float, Term]]:
        """The terms, with what is near from this path and what stands in its way."""
        problem, weights, view, samples = self.problem, self.weights, self.problem.view, self.samples
        nearest_m = float(problem.airspace.scene.distance(self.state.flown(self.first).positions).min())
        limit = Clearance.of(problem.airspace, path)
        return [
            (1.0, Coverage.of(view, samples, self.need, sight.free)),
            (1.0, Hidden.of(view, problem.airspace, path, _standoff_m(problem))),
            (weights.axis, sight.axis),
            (weights.clearance, limit),
            (weights.clearance, limit.no_nearer(nearest_m)),
            *self.lasting,
        ]

    def solved(self, variables: Floats, terms: Sequence[tuple[float, Term]]) -> Floats:
        """The variables at which the weighted sum of the terms is least, from where they are."""

        def objective(at: Floats) -> tuple[float, Floats]:
            flown, total = self.state.flown(at), 0.0
            positions, yaw, pitch = np.zeros_like(flown.positions), np.zeros(len(flown)), np.zeros(len(flown))
            for weight, term in terms:
                value, slope = term.value(flown)
                total += weight * value
                positions += weight * slope.positions
                yaw += weight * slope.yaw
                pitch += weight * slope.pitch
            return total, self.state.pulled_back(Flown(positions, yaw, pitch))

        options = {"maxiter": self.weights.iterations, "maxcor": _CORRECTIONS}
        return np.asarray(minimize(objective, variables, jac=True, method="L-BFGS-B", options=options).x)


def _standoff_m(problem: Problem) -> float:
    return max(problem.standoff.usual_m, 1e-3)


def _progress(problem: Problem, path: Flown) -> Floats:
    """Stand-offs flown plus radians turned, up to each station (M,)."""
    turned = np.abs(np.diff(path.yaw)) + np.abs(np.diff(path.pitch))
    return cumulated(leg_lengths(path.positions) / _standoff_m(problem) + turned + _LITTLE)


def _pieces(wished: float) -> int:
    """One of few numbers of pieces of a spline: a little more way is not divided otherwise."""
    return max(round(2 ** (round(_STEPS * np.log2(wished)) / _STEPS)), 1)
