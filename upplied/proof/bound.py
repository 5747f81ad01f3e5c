"""A lower bound on the length of a path by some of many poses that together see every sample.

The path is a tour through a depot that costs nothing to reach. Its linear relaxation (fractional poses and
legs; every sample seen; degrees; no subtours, as in the covering tour of Gendreau, Laporte and Semet 1997) is
solved with violated cuts and legs of negative reduced cost, round by round. By its duals every round gives a
valid bound.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, hstack, vstack
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from upplied.records import Bools, Floats, Ints

_ROUNDS = 120
_NEAREST = 8  # legs of each pose to begin with
_NEW_LEGS = 600  # in a round, at most
_MOST_CUTS = 150  # in a round; those that bind no more go when there are so many
_WHOLE = 10**6  # of one unit of flow
_SLACK = 1e-4
_ENOUGH, _PATIENCE = 1e-3, 10  # of the bound: what some of so many rounds must raise it by
_CLOSE = 0.99  # of a known way's length: a bound so near to it says that the way is short


def bound_m(apart: Floats, seen: Bools, known_m: float = np.inf) -> float:
    """A length, m, below which no path by some of these poses shows every sample.

    Legs between poses are `apart` (P, P), m, by the triangle inequality; each sample is `seen` (P, S) by one
    pose at least. A bound near to the length of a path that is known, m, is not raised any more.
    """
    seen = _hardest(seen[:, seen.any(axis=0)])
    useful = np.flatnonzero(seen.any(axis=1))
    apart, seen = apart[np.ix_(useful, useful)], seen[useful]
    if seen.all(axis=1).any():
        return 0.0
    relaxed = _Relaxed(apart, seen)
    best, idle = 0.0, 0
    for _ in range(_ROUNDS):
        bound, missing_legs = relaxed.solved()
        idle = 0 if bound > best * (1 + _ENOUGH) else idle + 1
        best = max(best, bound)
        if best >= _CLOSE * known_m or idle > _PATIENCE or not (relaxed.cut() or missing_legs):
            break
    return best


def _hardest(seen: Bools) -> Bools:
    """The samples (P, S) whose poses are not all poses of another one less: who sees those sees all."""
    common = seen.T.astype(np.int32) @ seen.astype(np.int32)
    count = seen.sum(axis=0)
    within = common == count[:, None]  # the poses of the first all see the second
    number = np.arange(len(count))
    implied = within & ((count[:, None] < count[None]) | (number[:, None] < number[None]))
    return np.asarray(seen[:, ~implied.any(axis=0)], bool)


@dataclass
class _Relaxed:
    """The relaxation with the legs and cuts so far; the depot is the last node."""

    apart: Floats
    seen: Bools

    def __post_init__(self) -> None:
        count = len(self.apart)
        self.cost = np.pad(self.apart, (0, 1))
        self.legs = np.zeros((count + 1, count + 1), bool)
        self.legs[:count, count] = True
        self.nearest = 0
        self.join()
        self.sides = np.zeros((0, count + 1), bool)  # of each cut, the nodes on the side without the depot
        self.least: list[tuple[int, float]] = []  # of each cut, the pose whose share it is twice, or -1: two

    def join(self) -> bool:
        """Add the legs from each pose to its next nearest ones; whether there were any more."""
        count = len(self.apart)
        first, self.nearest = self.nearest, self.nearest + _NEAREST
        near = np.argsort(self.apart, axis=1, kind="stable")[:, first : self.nearest]
        legs = np.zeros_like(self.legs)
        legs[np.arange(count)[:, None], near] = True
        self.legs |= np.triu(legs | legs.T, 1)
        return first < count

    def solved(self) -> tuple[float, bool]:
        """A bound that holds with all legs, and whether legs were added that pay."""
        count = len(self.apart)
        first, second = np.nonzero(self.legs)
        self.first, self.second = first, second
        number, rows = len(first), np.arange(len(first))
        nodes = np.concatenate([first, second])
        ends = csr_matrix((np.ones(2 * number), (nodes, np.tile(rows, 2))), (count + 1, number))
        shares = csr_matrix((np.full(count, -2.0), (np.arange(count), np.arange(count))), (count + 1, count))
        degree = hstack([ends, shares]).tocsr()
        cover = hstack([csr_matrix((self.seen.shape[1], number)), csr_matrix(-self.seen.T.astype(float))])
        across = csr_matrix(-(self.sides[:, first] != self.sides[:, second]).astype(float))
        pose = np.array([one for one, _ in self.least], np.int64)
        some = np.flatnonzero(pose >= 0)
        share = csr_matrix((np.full(len(some), 2.0), (some, pose[some])), (len(pose), count))
        upper = vstack([cover, hstack([across, share])]).tocsr()
        most = np.concatenate([-np.ones(self.seen.shape[1]), [-value for _, value in self.least]])
        self.flow, self.share = np.zeros(number), np.zeros(count)
        goal = np.concatenate([self.cost[first, second], np.zeros(count)])
        equal = np.append(np.zeros(count), 2.0)
        solution = linprog(goal, upper, most, degree, equal, bounds=(0, 1), method="highs")
        if solution.status != 0:  # the cuts need more legs than there are
            return 0.0, self.join()
        self.flow, self.share = solution.x[:number], solution.x[number:]
        prices = solution.ineqlin.marginals[self.seen.shape[1] :]
        pays = self._reduced(solution.eqlin.marginals, prices)
        if len(prices) > _MOST_CUTS:
            bind = np.flatnonzero(np.abs(prices) > _SLACK)
            self.sides, self.least = self.sides[bind], [self.least[at] for at in bind]
        pays[self.legs | ~np.triu(np.ones_like(self.legs), 1)] = 0.0
        bound = float(solution.fun + np.minimum(pays, 0.0).sum())
        new = np.argsort(pays, axis=None, kind="stable")[:_NEW_LEGS]
        new = new[pays.ravel()[new] < -_SLACK]
        self.legs.ravel()[new] = True
        return bound, bool(len(new))

    def _reduced(self, node: Floats, cut: Floats) -> Floats:
        cost = self.cost - node[:, None] - node[None]
        for side, price in zip(self.sides, cut, strict=True):
            if price:
                cost += price * (side[:, None] != side[None])
        return cost

    def cut(self) -> bool:
        """Add the cuts that the solution violates: round what sees a sample, or round a pose."""
        count = len(self.apart)
        used = self.flow > _SLACK
        first, second, flow = self.first[used], self.second[used], self.flow[used]
        new: dict[bytes, tuple[float, Bools, int, float]] = {}
        groups = [(np.flatnonzero(column), -1) for column in self.seen.T]
        groups += [(np.array([pose]), int(pose)) for pose in np.flatnonzero(self.share > 0.05)]
        for poses, pose in groups:
            side, value = _least_cut(count + 1, first, second, flow, poses)
            least = 2.0 if pose < 0 else 2.0 * float(self.share[pose])
            if value < least - 0.02:
                whole = pose < 0 or bool((~(self.seen & ~side[:-1, None]).any(axis=0)).any())
                key = side.tobytes() + bytes([whole]) + (b"" if whole else str(pose).encode())
                lacks = value - (2.0 if whole else least)
                new[key] = (lacks, side, -1 if whole else pose, 2.0 if whole else 0.0)
        if not new:
            return False
        worst = sorted(new.values(), key=lambda each: each[0])[:_MOST_CUTS]
        self.sides = np.vstack([self.sides, *(side for _, side, _, _ in worst)])
        self.least += [(pose, least) for _, _, pose, least in worst]
        return True


def _least_cut(count: int, first: Ints, second: Ints, flow: Floats, poses: Ints) -> tuple[Bools, float]:
    """The nodes on the side of some poses of the least cut between them and the depot, and its size."""
    whole = np.round(flow * _WHOLE).astype(np.int32)
    ends = np.concatenate([first, second, np.full(len(poses), count)])  # the last is the source
    others = np.concatenate([second, first, poses])
    room = np.concatenate([whole, whole, np.full(len(poses), 100 * _WHOLE, np.int32)])
    graph = csr_matrix((room, (ends, others)), (count + 1, count + 1))
    most = maximum_flow(graph, count, count - 1)
    left = graph - most.flow
    left.data[left.data < 0] = 0
    left.eliminate_zeros()
    reached = breadth_first_order(left.tocsr(), count, return_predecessors=False)
    return np.isin(np.arange(count), reached), most.flow_value / _WHOLE
