"""The carried flight made safe and completed until it sees what it should (preset `recommended`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from upplied.planning.trajectory.camera_turns import past
from upplied.planning.trajectory.lean import lean
from upplied.planning.trajectory.likeness import Likeness
from upplied.planning.trajectory.look import Detours, Looks, View, bend, find_detours, find_looks, stations_of
from upplied.planning.trajectory.rounded import rounded
from upplied.planning.trajectory.stretch import stretched
from upplied.records import Bools, Floats, Ints, Waypoints

_REACHES = (0.2, 0.4, 0.6, 0.8, 1.0)  # of the allowed deviation: no further than needed
_LEANS = 3  # at each reach, at most
_WIDE = 0.7  # of the usual stand-off, that a bend takes to each side at least: shorter ones look like kinks
_ENOUGH = 0.003  # share of the need that may stay unseen before the next reach is tried


def complete(
    path: Waypoints,
    view: View,
    likeness: Likeness,
    reach_m: Floats,
    safe: Callable[[Floats], Floats],
    allowed: Callable[[Floats], Bools],
    broken: Callable[[Floats], Bools],
) -> tuple[Waypoints, Looks]:
    """Route and bend the path, and find turns of its camera, until nothing worth a turn is missed.

    Parameters
    ----------
    path : Waypoints
        The carried flight, target frame.
    view : View
        What is to be seen, and by which camera.
    likeness : Likeness
        What bends must keep of the demonstration.
    reach_m : array, shape (3,), m
        How far bends may lead from the carried flight along each axis.
    safe : callable
        Takes positions (M, 3), gives as many that keep the safety distance, also between them.
    allowed : callable
        Takes positions (K, 3), gives (K,) bool: where the vehicle may be.
    broken : callable
        Takes positions (K, 3), gives (K - 1,) bool: which legs between them break a rule.

    Returns
    -------
    Waypoints
    Looks
        Turns of the camera at stations of that path, for `camera_turns.with_looks`.
    """
    positions = safe(path.positions)
    covered = _shown(positions, path.quat_xyzw, view)

    def within(tried: Floats, before: Floats, changed: Ints) -> bool:
        return likeness.kept(tried, before) and bool(allowed(tried[changed]).all())

    def better(tried: Floats) -> tuple[Floats, Bools]:
        """What was tried, made safe, unless that shows less: what keeps the distance may hide again."""
        if tried is positions:
            return positions, covered
        tried = safe(tried)
        seen = _shown(tried, path.quat_xyzw, view)
        return (tried, seen) if view.need[seen].sum() > view.need[covered].sum() else (positions, covered)

    positions, covered = better(stretched(positions, view, likeness, allowed))
    for share in _REACHES:
        if view.need[~covered].sum() < _ENOUGH * view.need.sum():
            break
        near_m = share * reach_m
        leant, shown = _leant(positions, path.quat_xyzw, covered, view, near_m, within)
        detours = find_detours(leant, shown, view, near_m, allowed)
        positions, covered = better(
            _bent(leant, path.quat_xyzw, detours, view, within, _WIDE * likeness.standoff.usual_m)
        )
    smooth = rounded(replace(path, positions=positions), broken)
    covered = view.covered(smooth.positions, smooth.quat_xyzw)
    return smooth, find_looks(past(smooth.positions), smooth.quat_xyzw, covered, view)


def _shown(positions: Floats, quat_xyzw: Floats, view: View) -> Bools:
    """What the path sees or could see by turning the camera, (N,)."""
    seen = view.covered(positions, quat_xyzw)
    missing = np.flatnonzero((view.need > 0) & ~seen)
    if len(missing):
        seen[missing] = view.reachable(positions[stations_of(positions)], missing)
    return seen


def _leant(
    positions: Floats,
    quat_xyzw: Floats,
    covered: Bools,
    view: View,
    reach_m: Floats,
    within: Callable[[Floats, Floats, Ints], bool],
) -> tuple[Floats, Bools]:
    """The path after as many leans as show more than they hide, and what it covers then."""
    best = view.need[covered].sum()
    for _ in range(_LEANS):
        missing = np.flatnonzero((view.need > 0) & ~covered)
        if len(missing) == 0:
            break
        asked = lean(positions, missing, view, reach_m)
        for share in (1.0, 0.5):
            tried = positions + share * asked
            if not within(tried, positions, np.arange(len(tried))):
                continue
            seen = _shown(tried, quat_xyzw, view)
            if view.need[seen].sum() > best:
                positions, covered, best = tried, seen, view.need[seen].sum()
                break
        else:
            break
    return positions, covered


def _bent(
    positions: Floats,
    quat_xyzw: Floats,
    detours: Detours,
    view: View,
    within: Callable[[Floats, Floats, Ints], bool],
    least_m: float,
) -> Floats:
    """The path with each bend that shows more than it hides; the same array where none does."""
    if len(detours.station) == 0:
        return positions
    seen = view.seen(positions, quat_xyzw)
    shown = np.zeros(seen.shape[1], bool)
    for place, quat, station in zip(detours.positions, detours.quat_xyzw, detours.station, strict=True):
        tried = bend(positions, place, int(station), least_m)
        changed = np.flatnonzero(np.abs(tried - positions).max(axis=1) > 1e-9)
        if not within(tried, positions, changed):
            continue
        rows = np.array(seen)
        rows[changed] = view.seen(tried[changed], quat_xyzw[changed])
        there = view.seen(place[None], quat[None])[0]
        before = view.need[seen.any(axis=0) | shown].sum()
        if view.need[rows.any(axis=0) | shown | there].sum() > before:
            positions, seen, shown = tried, rows, shown | there
    return positions
