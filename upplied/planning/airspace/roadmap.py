"""Ways round a structure: a graph of places just beyond the safety distance.

The places stand before samples of the outside surface and on a box round all of it. Every edge is
tested along its whole length, and only what hangs together with that box is kept: the inside of a
hull, or a pocket that cannot be left, is no way.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from upplied.geometry.polylines import arc_length, chosen_evenly, interpolated
from upplied.geometry.vectors import across, neighbour_spacing
from upplied.planning.airspace.rules import Airspace, inside_fence, push
from upplied.records import Cloud, Floats, Ints, Record

_SAMPLES = 1500  # of the surface, that places are set before
_DEGREE = 14  # edges per place
_POST_M = 0.5  # from a post of the fence
_BAND_M = 0.1  # beyond the safety distance, in which a way is drawn tight
_BAND_STEP_M = 0.7  # between places of a way that is drawn tight
_BAND_PLACES = 8, 80  # of these, least and most
_DRAWN = 120  # times that a way is drawn towards its chords
_NEARER = 2.0  # metres of way, that a metre nearer to where a flight begins or ends is worth
_TILTS_DEG = (45.0, 80.0)  # from the normal: round edges, where the normals leave a gap


@dataclass(frozen=True, eq=False, repr=False)
class Roadmap(Record):
    """Places that may be flown to, and which are neighbours."""

    places: Floats  # (K, 3) m
    first: Ints  # (E,) one end of each free edge
    second: Ints  # (E,)
    length_m: Floats  # (E,)
    airspace: Airspace


def roadmap(airspace: Airspace, surface: Cloud, further: Floats | None = None) -> Roadmap:
    """Places round a structure, of whose outside `surface` has samples, and the free legs between them.

    With `further` places (N, 3), e.g. of the path itself, and only with what hangs together with those
    farthest outside.
    """
    shown = chosen_evenly(len(surface), _SAMPLES)  # what is supposed comes last
    points, normals = surface.points[shown], surface.outward[shown]
    spacing = max(neighbour_spacing(points), 1e-3) if len(points) > 1 else 1.0  # m
    near = airspace.clearance_m + 0.15 + 0.15 * spacing
    places = [points + near * normals]
    one, other = across(normals)
    for tilt in np.radians(_TILTS_DEG):
        for turn in np.arange(4) * np.pi / 2:
            beside = np.cos(turn) * one + np.sin(turn) * other
            places.append(points + near * (np.cos(tilt) * normals + np.sin(tilt) * beside))
    places.append(points + (near + 2.5 * spacing + 1.0) * normals)
    whole = np.stack([surface.points.min(axis=0), surface.points.max(axis=0)])
    places.append(_round_box(whole, near, number=5))
    for box in airspace.surroundings.keep_out_m:
        round_it = _round_box(box, 0.05 + 0.1 * airspace.clearance_m, number=3)
        places.append(airspace.frame.from_declared(round_it))
    # Inside each post of the fence, where a path has to turn, from low to high: one at each height, amid the
    # directions that lead inside. A ring of them would be neighbours of each other alone, and lead nowhere.
    fence, turns = airspace.surroundings.geofence_m, np.arange(16) * np.pi / 8
    ring = _POST_M * np.column_stack([np.cos(turns), np.sin(turns)])
    z, posts = np.linspace(whole[0, 2] - near, whole[1, 2] + near, 5), [np.empty((0, 3))]
    for post in fence:
        inside = ring[inside_fence(fence, post + ring)]
        if len(inside):
            amid = post + _POST_M * inside.mean(axis=0) / max(np.linalg.norm(inside.mean(axis=0)), 1e-9)
            posts.append(np.column_stack([np.tile(amid, (len(z), 1)), z]))
    places.append(airspace.frame.from_declared(np.vstack(posts)))
    if further is not None:
        places.append(further)
    stacked = np.vstack(places)
    stacked = stacked[_one_a_cell(stacked, 0.4 * spacing)]
    stacked = stacked[airspace.allowed(stacked)]
    first, second = _neighbours(stacked, spacing)
    free = ~airspace.broken_legs(stacked[first], stacked[second])
    first, second, count = first[free], second[free], len(stacked)
    length = np.linalg.norm(stacked[first] - stacked[second], axis=1)
    component = connected_components(csr_matrix((length, (first, second)), shape=(count, count)))[1]
    outside = np.maximum(whole[0] - stacked, stacked - whole[1]).max(axis=1)
    outer = np.bincount(component[outside > 0]) if (outside > 0).any() else np.zeros(1)
    members = np.flatnonzero(component == outer.argmax())
    number = np.full(count, -1)
    number[members] = np.arange(len(members))
    both = number[first] >= 0
    return Roadmap(stacked[members], number[first[both]], number[second[both]], length[both], airspace)


def way(graph: Roadmap, start: Floats, goal: Floats, beside: Floats | None = None) -> Floats | None:
    """A short way (K, 3) from start to goal, both included, that breaks no rule; None if none is known.

    One that is to stay `beside` a path (N, 3) costs twice its length a safety distance off it.
    """
    if not graph.airspace.broken(np.stack([start, goal]))[0]:
        return np.stack([start, goal])
    count = len(graph.places)
    nodes = np.vstack([graph.places, start, goal])
    total, before = _shortest(graph, nodes, [links(graph, start), links(graph, goal)], beside)
    if not np.isfinite(total[count + 1]):
        return None
    return shortened(nodes[_backwards(before, count, count + 1)], graph.airspace)


def way_towards(graph: Roadmap, start: Floats, goal: Floats) -> Floats:
    """A way (K, 3) from start to the place that lies as near to a goal as the way there is worth.

    A metre nearer to the goal is worth `_NEARER` metres of way.
    """
    count, nodes = len(graph.places), np.vstack([graph.places, start])
    total, before = _shortest(graph, nodes, [links(graph, start)], None)
    best = int((total + _NEARER * np.linalg.norm(nodes - goal, axis=1)).argmin())
    return shortened(nodes[_backwards(before, count, best)], graph.airspace)


def _shortest(graph: Roadmap, nodes: Floats, near: list[Ints], beside: Floats | None) -> tuple[Floats, Ints]:
    """How far each node is from the one after the graph's places, m, and the node before it on the way."""
    # `near` are the places to which straight legs lead from each node that is none of the graph's.
    count = len(graph.places)
    first = np.concatenate([graph.first, *(np.full(len(some), count + at) for at, some in enumerate(near))])
    second = np.concatenate([graph.second, *near])
    length = np.linalg.norm(nodes[first] - nodes[second], axis=1)
    if beside is not None:
        off = cKDTree(beside).query(nodes)[0] / graph.airspace.clearance_m
        length *= 1 + (off[first] + off[second]) / 2
    matrix = csr_matrix((length, (first, second)), shape=(len(nodes), len(nodes)))
    total, before = dijkstra(matrix, directed=False, indices=count, return_predecessors=True)
    return total, before


def links(graph: Roadmap, position: Floats) -> Ints:
    """Places near a position to which a straight leg is free."""
    if len(graph.places) == 0:
        return np.empty(0, np.int64)
    near = np.atleast_1d(cKDTree(graph.places).query(position, k=min(4 * _DEGREE, len(graph.places)))[1])
    start = np.repeat(position[None], len(near), axis=0)
    return np.asarray(near[~graph.airspace.broken_legs(start, graph.places[near])], np.int64)


def shortened(path: Floats, airspace: Airspace) -> Floats:
    """The path without the corners that can be cut."""
    corners, index = [0], 0
    while index < len(path) - 1:
        ahead = np.arange(index + 1, len(path))
        free = ~airspace.broken_legs(np.repeat(path[index : index + 1], len(ahead), axis=0), path[ahead])
        free[0] = True
        index = int(ahead[np.flatnonzero(free)[-1]])
        corners.append(index)
    return path[corners]


def tightened(line: Floats, airspace: Airspace) -> Floats:
    """A way (K, 3) drawn tight round what it leads round: which places it came by does not matter then.

    `line` breaks no rule; it has the same ends, and is the line itself where it cannot be drawn tight.
    """
    if len(line) < 3:
        return line
    wider = replace(airspace, clearance_m=airspace.clearance_m + _BAND_M)
    along = arc_length(line)
    count = int(np.clip(along[-1] / _BAND_STEP_M, *_BAND_PLACES)) + 1
    band = interpolated(np.linspace(0, along[-1], count), along, line)
    for turn in range(_DRAWN):
        reach = min(2 ** (3 - turn % 4), (count - 1) // 2)  # far ones first
        step = (band[2 * reach :] + band[: -2 * reach]) / 4 - band[reach:-reach] / 2
        # Shorter than half the safety distance, so that nothing is stepped across.
        length = np.linalg.norm(step, axis=1, keepdims=True)
        moved = np.array(band)
        moved[reach:-reach] += step * np.minimum(1, airspace.clearance_m / 2 / np.maximum(length, 1e-12))
        moved += push(moved, wider)
        band[1:-1] = moved[1:-1]
    return line if airspace.broken(band).any() else shortened(band, airspace)


def _one_a_cell(points: Floats, spacing: float) -> Ints:
    """Indices of one point for each cell of a grid."""
    cell = np.floor((points - points.min(axis=0)) / spacing).astype(np.int64)
    size = cell.max(axis=0) + 1
    number = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
    return np.sort(np.unique(number, return_index=True)[1])


def _round_box(box: Floats, distance_m: float, number: int) -> Floats:
    """A grid of places on a box that stands a distance outside of a given one."""
    steps = np.linspace(0, 1, number)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    grid = grid[((grid == 0) | (grid == 1)).any(axis=1)]
    low, high = box
    return low - distance_m + grid * (high - low + 2 * distance_m)


def _neighbours(places: Floats, spacing: float) -> tuple[Ints, Ints]:
    """Edges from each place to its nearest ones, each pair once."""
    # The same again among fewer and fewer places: long edges join patches that stand apart.
    count, pairs = len(places), [np.empty(0, np.int64)]
    layer = np.arange(count)
    while len(layer) > 1:
        near = cKDTree(places[layer]).query(places[layer], k=min(_DEGREE + 1, len(layer)))[1][:, 1:]
        a, b = layer[np.repeat(np.arange(len(layer)), near.shape[1])], layer[near.ravel()]
        pairs.append(np.minimum(a, b) * count + np.maximum(a, b))
        spacing *= 2.5
        fewer = layer[_one_a_cell(places[layer], spacing)]
        if len(fewer) == len(layer) or len(layer) <= _DEGREE:
            break
        layer = fewer
    pair = np.unique(np.concatenate(pairs))
    return pair // count, pair % count


def _backwards(before: Ints, start: int, goal: int) -> Ints:
    """The nodes from start to goal, from each node's predecessor."""
    route = [goal]
    while route[-1] != start:
        route.append(int(before[route[-1]]))
    return np.array(route[::-1])
