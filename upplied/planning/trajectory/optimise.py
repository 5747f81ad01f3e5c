"""One optimisation of the carried path and of where its camera looks (preset `recommended`).

The state is a smooth displacement of the demonstrated path and of its camera's directions. Every problem
is a term, a file in `terms`, with a weight that says what its unit is worth as a share of the surface to
be shown (`OptimiseSettings`). One solver, L-BFGS-B with analytic slopes, weighs them all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from upplied.config import OptimiseSettings
from upplied.planning.airspace.rules import Airspace
from upplied.planning.carry.standoff import Standoff
from upplied.planning.trajectory.looks import looks_aside
from upplied.planning.trajectory.moves import Aside, moves_aside
from upplied.planning.trajectory.state import Flown, State
from upplied.planning.trajectory.terms import Term
from upplied.planning.trajectory.terms.clearance import Clearance
from upplied.planning.trajectory.terms.coverage import Coverage
from upplied.planning.trajectory.terms.place import Place
from upplied.planning.trajectory.terms.shape import Shape
from upplied.planning.trajectory.terms.smoothness import Smoothness
from upplied.planning.trajectory.terms.standoff import StandoffKept
from upplied.planning.trajectory.terms.turning import Turning
from upplied.planning.trajectory.view import View
from upplied.polylines import chosen_evenly, leg_lengths
from upplied.poses import from_yaw_pitch
from upplied.records import Bools, Floats, Ints, Record

_OBLIQUE_DEG = 88.0  # up to which lines of sight are asked for: those beyond the limit may come within it
_WIDEST, _NARROWEST = 0.20, 0.04  # of the soft coverage's borders, first and last: far first, then exactly
_APART = 0.15  # stand-offs flown plus radians turned, between stations that are asked what they show
_SHARES = (0.0, 0.25, 0.5, 0.75)  # of the way from the carried path, that may already be enough
_NEGLIGIBLE = (5e-4, 1e-3)  # of what was inspected, and of what lay behind it, as shares of the need:
# not worth leaving the path for, one sample of some 2000 and two
_COMFORTABLE = 2.5  # safety distances, at which to come nearer costs nothing yet
_FIRST = 10.0  # how many times what was inspected counts what lay behind it, before any of it is given up
_CORRECTIONS = 12  # that L-BFGS keeps


@dataclass(frozen=True, eq=False, repr=False)
class Problem(Record):
    """What is asked of a path, at M stations."""

    flown: Floats  # (M, 3) m, the demonstrated flight as the structure's map carries it
    carried: Flown  # at the counterparts, safe: where the optimisation starts
    demonstrated: Shape
    view: View
    standoff: Standoff
    airspace: Airspace
    speed_mps: Floats  # (M,) at which the expert flew there
    turned_rad: float  # by which the expert turned the camera
    pan_radps: float  # at which a turning camera is still sharp
    level: bool = False  # the path stays in its plane


def optimise(problem: Problem, shape_weight: float, weights: OptimiseSettings) -> tuple[State, Floats]:
    """The state whose path shows most for what it costs, and its variables.

    Parameters
    ----------
    problem : Problem
    shape_weight : float
        Of the departure from the demonstrated shape, as the fidelity asks for.
    weights : OptimiseSettings
        Of the other terms.

    Returns
    -------
    State
    array
        Its variables.
    """
    state = _state(problem, weights)
    variables = state.nearest(problem.carried)
    asked, need = _asked(problem.view, weights.samples)
    if len(asked) == 0:
        return state, variables
    lasting = _lasting_terms(problem, state.flown(variables), shape_weight, weights)
    judged = _Judged(state, problem.view, asked, need, lasting)
    start, urgent = variables, np.ones(len(need))
    first = judged.sees(start)
    nearest_m = min(
        float(problem.airspace.scene.distance(problem.carried.positions).min()),
        _COMFORTABLE * problem.airspace.clearance_m,
    )
    stride = max(1, round(_APART * len(problem.carried) / _progress(problem)))

    def terms(path: Flown, width: float) -> list[tuple[float, Term]]:
        """The terms, with what stands in the way and what is near from this path."""
        oblique = replace(problem.view.settings, max_incidence_deg=_OBLIQUE_DEG)
        # As far again as the widest border reaches: the path moves until lines of sight are asked for again.
        nearly = replace(problem.view, farthest_m=(1 + 2 * _WIDEST) * problem.view.farthest_m)
        free = nearly.reach(path.positions[::stride], asked, oblique, np.arange(0, len(path), stride))
        clearance = Clearance.of(problem.airspace, path)
        return [
            (1.0, Coverage.of(problem.view, asked, need * urgent, free, width, stride)),
            (weights.clearance, clearance),
            (weights.clearance, clearance.no_nearer(nearest_m)),
            *lasting,
        ]

    found = []
    for number, width in enumerate(np.geomspace(_WIDEST, _NARROWEST, weights.rounds)):
        path = state.flown(variables)
        if number == weights.rounds // 2:  # what small moves can show is shown by now
            price = weights.turning / problem.turned_rad
            path = looks_aside(path, problem.view, price, float(problem.speed_mps.mean()) / problem.pan_radps)
            aside = Aside(_standoff_m(problem), _departure(problem, shape_weight, weights), price)
            path = moves_aside(path, problem.view, problem.airspace, aside)
            variables = state.nearest(path)
        variables = _solved(state, variables, terms(path, float(width)), weights.iterations)
        now = judged.sees(variables)
        if number >= weights.rounds // 2:
            found.append((judged.worth(variables, now), variables))
        urgent[judged.given_up(first, now)] *= _FIRST
    every = np.flatnonzero(problem.view.need > 0)
    wholly = replace(judged, asked=every, need=problem.view.need[every])
    best = max(found, key=lambda each: each[0])[1]

    def turned() -> Floats:
        """The camera alone, from the carried path."""
        at = np.where(state.moves, start, best)
        return _solved(state, at, terms(state.flown(at), _NARROWEST), weights.iterations, ~state.moves)

    return state, _no_further(start, best, turned, wholly)


def _departure(
    problem: Problem, shape_weight: float, weights: OptimiseSettings
) -> Callable[[Floats], Floats]:
    """Share of the need that all of the path must show more to go aside by (C, 3), m: of place and shape."""
    shape = problem.demonstrated

    def price(off: Floats) -> Floats:
        place = weights.place * ((off / _standoff_m(problem)) ** 2).sum(axis=1)
        return np.asarray(place + shape_weight * ((off @ shape.standing.T / shape.unit_m) ** 2).sum(axis=1))

    return price


def _standoff_m(problem: Problem) -> float:
    return max(problem.standoff.usual_m, 1e-3)


@dataclass(frozen=True, eq=False, repr=False)
class _Judged(Record):
    """What the path of some variables truly shows of the samples that are asked for, and what it costs."""

    state: State
    view: View
    asked: Ints
    need: Floats
    lasting: Sequence[tuple[float, Term]]

    def sees(self, variables: Floats) -> Bools:
        """(m,) which of the samples some station sees."""
        path = self.state.flown(variables)
        quats = from_yaw_pitch(path.yaw, path.pitch)
        return self.view.shown(path.positions, quats, self.asked)

    def shares(self, seen: Bools) -> Floats:
        """(2,) share of the need that was inspected, and of what lay behind it, of samples (m,)."""
        got, inspected = self.need * seen, self.view.inspected[self.asked]
        return np.array([got[inspected].sum(), got[~inspected].sum()])

    def shown(self, variables: Floats) -> Floats:
        """(2,) the same of what the path of some variables shows."""
        return self.shares(self.sees(variables))

    def given_up(self, before: Bools, after: Bools) -> Bools:
        """(m,) inspected samples that are seen before and not after; none where as many are."""
        inspected = self.view.inspected[self.asked]
        more = self.need @ (inspected * (after.astype(float) - before)) >= -_NEGLIGIBLE[0]
        return np.zeros_like(before) if more else inspected & before & ~after

    def worth(self, variables: Floats, seen: Bools) -> float:
        """Share of the need that is seen (m,), less what the terms cost."""
        path = self.state.flown(variables)
        return float(self.shares(seen).sum()) - sum(
            weight * term.value(path)[0] for weight, term in self.lasting
        )


def _no_further(start: Floats, end: Floats, turned: Callable[[], Floats], judged: _Judged) -> Floats:
    """The variables nearest to the start, on the way to the end, that truly show as much as the end.

    The soft borders of the coverage would move a path that shows all already: on its own structure a
    flight is to come back as it was flown. To turn the camera comes before to leave the path.
    """
    first, last = judged.shown(start), judged.shown(end)
    if (first - last)[0] > max(_NEGLIGIBLE[0], (last - first)[1] / _FIRST):
        return start  # what was inspected is given up for so much more of what lay behind it, and for no less
    least = last - _NEGLIGIBLE
    if (first >= least).all():
        return start
    if (judged.shown(at := turned()) >= least).all():
        return at
    for share in _SHARES:
        at = np.where(judged.state.moves, start + share * (end - start), end)
        if (judged.shown(at) >= least).all():
            return at
    return end


def _lasting_terms(
    problem: Problem, start: Flown, shape_weight: float, weights: OptimiseSettings
) -> list[tuple[float, Term]]:
    """The terms that hold for all rounds, with their weights."""
    usual_m, carried = _standoff_m(problem), problem.carried
    leg = leg_lengths(carried.positions)
    firmly = weights.standoff_in_metres if problem.standoff.in_metres else weights.standoff
    return [
        (shape_weight, problem.demonstrated),
        (weights.place, Place(carried.positions, usual_m)),
        (firmly, StandoffKept.of(problem.standoff, start, weights.standoff_tolerance)),
        (weights.smoothness, Smoothness(problem.flown, max(float(leg.mean()), 1e-3), usual_m)),
        (weights.turning, Turning(carried.yaw, carried.pitch, problem.turned_rad)),
    ]


def _state(problem: Problem, weights: OptimiseSettings) -> State:
    """As many control points as the path has stand-offs and the camera radians, times their density."""
    base = Flown(problem.flown, problem.carried.yaw, problem.carried.pitch)
    progress = _progress(problem)
    controls = int(np.clip(round(progress / weights.spacing), 4, max(len(base) // 2, 4)))
    unit_m = np.full(3, float(problem.demonstrated.unit_m.max()))
    if problem.level:
        unit_m[2] = 0.0
    return State.of(base, unit_m, controls, controls)


def _progress(problem: Problem) -> float:
    """Stand-offs flown plus radians turned."""
    path = problem.carried
    length = float(leg_lengths(path.positions).sum())
    turned = float(np.abs(np.diff(path.yaw)).sum() + np.abs(np.diff(path.pitch)).sum())
    return max(length / _standoff_m(problem) + turned, 1e-3)


def _asked(view: View, most: int) -> tuple[Ints, Floats]:
    """At most so many samples that stand for all, and their need; two thirds of them inspected ones."""
    chosen, needs = [], []
    inspected = np.flatnonzero((view.need > 0) & view.inspected)
    context = np.flatnonzero((view.need > 0) & ~view.inspected)
    first = min(len(inspected), max(2 * most // 3, most - len(context)))
    for group, count in ((inspected, first), (context, most - first)):
        if len(group) and count:
            few = group[chosen_evenly(len(group), count)]
            chosen.append(few)
            needs.append(view.need[few] * view.need[group].sum() / view.need[few].sum())
    if not chosen:
        return np.empty(0, np.int64), np.empty(0)
    return np.concatenate(chosen), np.concatenate(needs)


def _solved(
    state: State,
    variables: Floats,
    terms: Sequence[tuple[float, Term]],
    iterations: int,
    free: Bools | None = None,
) -> Floats:
    """The variables at which the weighted sum of the terms is least, from where they are."""

    def objective(at: Floats) -> tuple[float, Floats]:
        flown, total = state.flown(at), 0.0
        positions, yaw, pitch = np.zeros_like(flown.positions), np.zeros(len(flown)), np.zeros(len(flown))
        for weight, term in terms:
            value, slope = term.value(flown)
            total += weight * value
            positions += weight * slope.positions
            yaw += weight * slope.yaw
            pitch += weight * slope.pitch
        slopes = state.pulled_back(Flown(positions, yaw, pitch))
        return total, slopes if free is None else np.where(free, slopes, 0.0)

    options = {"maxiter": iterations, "maxcor": _CORRECTIONS}
    return np.asarray(minimize(objective, variables, jac=True, method="L-BFGS-B", options=options).x)
