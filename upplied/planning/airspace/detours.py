"""A path made safe: the whole of it keeps the safety distance, the ground, the fence and the boxes.

What comes a little too near is pushed out, smoothly along the path. What leads through the structure
is led round it. What cannot be repaired is refused with the reason and the place.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from upplied.config import Settings
from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length, chosen_evenly, leg_lengths
from upplied.geometry.poses import interpolate
from upplied.planning.airspace.roadmap import Roadmap, links, roadmap, tightened, way, way_towards
from upplied.planning.airspace.rules import Airspace, pushed_out
from upplied.planning.correspondence.pair import Pair
from upplied.records import Bools, Cloud, Floats, Trajectory, Waypoints

_BUFFER_M = 0.05  # kept beyond the safety distance while planning, so that the final test is passed
_SMOOTHINGS = 30
_SPACING_M = 1.0  # of the waypoints that a detour adds


def airspace_of(pair: Pair, settings: Settings) -> Airspace:
    """Where the vehicle may be at the target."""
    rule, target = settings.route, pair.target
    limits = rule.clearance_m, target.surroundings, rule.ground_clearance_m
    return Airspace(pair.target_scene, *limits, target.frame)


class Ways:
    """Where to fly round one structure by some rules; the graph of ways is made when one is needed, once.

    `surface` has samples of the target's outside with normals: where ways round it are sought.
    """

    def __init__(self, airspace: Airspace, surface: Cloud) -> None:
        self.airspace, self.surface = airspace, surface
        self.planning = replace(airspace, clearance_m=airspace.clearance_m + _BUFFER_M)

    @cached_property
    def graph(self) -> Roadmap:
        """The graph of ways, with a little more than the safety distance."""
        return roadmap(self.planning, self.surface)


def route(path: Waypoints, ways: Ways) -> Waypoints:
    """The waypoints at safe places, with further ones where a leg has to lead round something.

    Every leg of it keeps the rules. Added waypoints turn the camera steadily from one neighbour to the next
    and are no viewpoints.

    Raises
    ------
    RefusedError
        With the reason and the place, if no such path is found.
    """
    if len(path) == 0 or _is_safe(path.positions, ways.airspace):
        return path
    rules, positions = ways.planning, pushed_out(path.positions, ways.planning)
    if not (good := _good(positions, ways)).all():
        cut_off = np.flatnonzero(~good & rules.allowed(positions) & _sees_sky(positions, rules))
        if len(cut_off):
            place = int(cut_off[0]), positions[cut_off[0]]
            raise _refusal(rules, *place, "no free way leads here from the rest")
        positions = _moved_to_free(positions, good, ways.graph)
    pieces, origin = [positions[:1]], [np.zeros(1)]
    broken = rules.broken(positions)
    for leg in range(len(positions) - 1):
        line = positions[leg : leg + 2]
        if broken[leg]:
            line = _way_or_refusal(ways.graph, line[0], line[1], leg)
            line = _with_count(line, 1 + int(np.ceil(leg_lengths(line) / _SPACING_M).sum()))
        along = arc_length(line)
        pieces.append(line[1:])
        origin.append(leg + along[1:] / max(along[-1], 1e-12))
    whence, index = np.concatenate(origin), np.arange(float(len(path)))  # whole: a waypoint of the path
    own = np.isclose(whence, np.round(whence), atol=1e-9)
    turned = interpolate(Trajectory(index, path.positions, path.quat_xyzw), whence).quat_xyzw
    viewpoint = np.zeros(len(whence), bool)
    viewpoint[own] = path.is_viewpoint[np.round(whence[own]).astype(int)]
    added = path.added[np.floor(whence + 1e-9).astype(int)] & path.added[np.ceil(whence - 1e-9).astype(int)]
    smooth = _corners_rounded(np.vstack(pieces), binary_dilation(~own) & ~viewpoint, rules)
    _refuse_unsafe(smooth, ways.airspace)
    return Waypoints(smooth, turned, np.interp(whence, index, path.t_s), viewpoint, added)


def safe_positions(positions: Floats, ways: Ways) -> Floats:
    """As many positions (M, 3) as given, near them and in their order, on a path that keeps the rules.

    For closely spaced paths: what has to lead round something uses the positions that the
    unsafe stretch and its neighbourhood have.

    Raises
    ------
    RefusedError
        With the reason and the place, if no such path is found.
    """
    if len(positions) == 0 or _is_safe(positions, ways.airspace):
        return positions
    safe = pushed_out(positions, ways.planning)
    good = _good(safe, ways)
    if good.any():
        for way_on in (slice(None), slice(None, None, -1)):
            if first := int(good[way_on].argmax()):
                # All before the first good one lead on as near to the end as a way leads.
                ends, goal = safe[way_on][: first + 1], positions[way_on][0]
                line = tightened(way_towards(ways.graph, ends[-1], goal), ways.planning)[: first + 1]
                ends[::-1] = _with_count(line, first + 1) if len(line) > 1 else line
                good[way_on][:first] = True
    else:
        safe[[0, -1]], good[[0, -1]] = _moved_to_free(safe[[0, -1]], good[[0, -1]], ways.graph), True
    for _ in range(4):  # a detour may need the positions of its neighbourhood, which may touch the next
        led = ways.planning.broken(safe) | ~good[1:] | ~good[:-1]
        if not led.any():
            break
        changed, legs, along = np.zeros(len(safe), bool), np.flatnonzero(led), arc_length(positions)
        # What lies no farther apart along the path is led round at once.
        cut = np.flatnonzero(along[legs[1:]] - along[legs[:-1] + 1] > 2 * ways.planning.clearance_m)
        starts, stops = np.append(legs[0], legs[cut + 1]), np.append(legs[cut], legs[-1])
        for first, last in zip(starts.tolist(), stops.tolist(), strict=True):
            _lead_round(safe, changed, first, last + 1, positions, ways.graph)
        beside = binary_dilation(changed, iterations=15)
        safe = _corners_rounded(safe, beside, ways.planning, like=positions)
        good |= changed
    _refuse_unsafe(safe, ways.airspace)
    return safe


def _is_safe(positions: Floats, airspace: Airspace) -> bool:
    """Whether every rule is kept and the path is outside of the structure, as far as rays can tell."""
    if not airspace.allowed(positions).all() or airspace.broken(positions).any():
        return False
    return bool(_sees_sky(positions[:1], airspace)[0])


def _sees_sky(positions: Floats, airspace: Airspace) -> Bools:
    """Whether at least some rays from each position escape; inside a closed structure none does."""
    golden = np.arange(48) * np.pi * (3 - np.sqrt(5))
    z = 1 - (np.arange(48) + 0.5) / 24
    rays = np.column_stack([np.sqrt(1 - z**2) * np.cos(golden), np.sqrt(1 - z**2) * np.sin(golden), z])
    starts, reach = np.repeat(positions, 48, axis=0), 1e4
    hit = airspace.scene.occluded(starts, starts + reach * np.tile(rays, (len(positions), 1)), slack=0.0)
    return np.asarray((~hit).reshape(len(positions), 48).mean(axis=1) > 0.1, bool)


def _good(pushed: Floats, ways: Ways) -> Bools:
    """Which positions (M,) of a path are allowed and can be reached from outside."""
    good = ways.planning.allowed(pushed)
    broken = ways.planning.broken(pushed)
    if good.all() and not broken.any() and _sees_sky(pushed[:1], ways.planning)[0]:
        return good
    # Stretches without a broken leg are inside or outside as a whole: one free way out tells.
    stretch = np.concatenate([[0], np.cumsum(broken)])
    for number in np.unique(stretch[good]):
        members = np.flatnonzero((stretch == number) & good)
        probes = members[chosen_evenly(len(members), 8)]
        good[members] = any(len(links(ways.graph, probe)) for probe in pushed[probes])
    return good


def _moved_to_free(positions: Floats, good: Bools, graph: Roadmap) -> Floats:
    """Positions that are not good moved to places of the graph, or between their good neighbours."""
    if len(graph.places) == 0:
        index = int(np.flatnonzero(~good)[0])
        raise _refusal(graph.airspace, index, positions[index], graph.airspace.why(positions[index]))
    placed = np.array(positions)
    placed[~good] = graph.places[cKDTree(graph.places).query(positions[~good])[1]]
    return placed


def _lead_round(
    positions: Floats, changed: Bools, first: int, last: int, beside: Floats, graph: Roadmap
) -> None:
    """Replace the positions between two safe ones by a way round beside a path, with as many positions."""
    for _ in range(len(positions)):
        line = _way_or_refusal(graph, positions[first], positions[last], first, beside[first : last + 1])
        if last - first >= len(line) - 1:
            positions[first : last + 1] = _with_count(line, last - first + 1)
            changed[first : last + 1] = True
            return
        if first == 0 and last == len(positions) - 1:
            break
        first, last = max(first - 1, 0), min(last + 1, len(positions) - 1)
    raise _refusal(
        graph.airspace, first, positions[first], "the way round needs more waypoints than the path has"
    )


def _way_or_refusal(
    graph: Roadmap, start: Floats, goal: Floats, index: int, beside: Floats | None = None
) -> Floats:
    line = way(graph, start, goal, beside)
    if line is None:
        reason = graph.airspace.why(start) or graph.airspace.why(goal) or "no free way leads on from here"
        raise _refusal(graph.airspace, index, start, reason)
    return line if beside is None else tightened(line, graph.airspace)


def _with_count(line: Floats, count: int) -> Floats:
    """A polyline with `count` vertices, its own among them, the others spread over its legs."""
    length = leg_lengths(line)
    pieces = np.ones(len(length), int)
    for _ in range(count - 1 - len(length)):
        pieces[np.argmax(length / pieces)] += 1
    ends = zip(line[:-1], line[1:], pieces, strict=True)
    return np.vstack([*(a + np.arange(n)[:, None] / n * (b - a) for a, b, n in ends), line[-1:]])


def _corners_rounded(
    positions: Floats, movable: Bools, airspace: Airspace, like: Floats | None = None
) -> Floats:
    """Corners rounded where that breaks no rule; ends and what is not movable stay."""
    # Where a path to be `like` is given, the difference from it is smoothed instead: rounding the path itself
    # would pull every curve inwards.
    smooth, movable = np.array(positions), np.array(movable)
    like = np.zeros_like(smooth) if like is None else like
    movable[[0, -1]] = False
    for _ in range(_SMOOTHINGS):
        goal = np.array(smooth)
        off = smooth - like
        goal[1:-1] += 0.5 * ((off[2:] + off[:-2]) / 2 - off[1:-1])
        goal[~movable] = smooth[~movable]
        broken = airspace.broken(goal)
        if broken.any():
            touched = np.zeros(len(smooth), bool)
            touched[:-1] |= broken
            touched[1:] |= broken
            goal[touched] = smooth[touched]
            if airspace.broken(goal).any():
                break
        smooth = goal
    return smooth


def _refuse_unsafe(positions: Floats, airspace: Airspace) -> None:
    """The last word: the path as it will be flown, tested as a whole."""
    broken = airspace.broken(positions)
    if len(positions) == 1 and not airspace.allowed(positions)[0]:
        raise _refusal(airspace, 0, positions[0], airspace.why(positions[0]))
    if broken.any():
        leg = int(np.flatnonzero(broken)[0])
        start, end = positions[leg : leg + 2]
        reason = airspace.why(start) or airspace.why(end) or "the leg on breaks a rule"
        raise _refusal(airspace, leg, start, reason)


def _refusal(airspace: Airspace, index: int, position: Floats, reason: str) -> RefusedError:
    x, y, z = airspace.frame.to_declared(position)
    return RefusedError(
        f"waypoint {index} at ({x:.1f}, {y:.1f}, {z:.1f}) m",
        reason or "cannot be reached from outside the structure",
        "the whole path keeps the safety distance and stays where flying is allowed",
        "a smaller safety distance or other limits may help",
    )
