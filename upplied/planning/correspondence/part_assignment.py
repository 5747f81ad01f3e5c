"""Which part of the target corresponds to which of the source: one to one, by place, size and neighbours.

Nearest neighbours send the points of an inner engine to an outer one where that lies nearer. So
parts are matched before points: an assignment over all parts, then exchanges that make the parts
which touch each other keep touching.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from upplied.planning.constants import COMPACT, LEAST_PART, MAJORITY, MOST_RATIO, TOLERANCE
from upplied.planning.surface.parts import Parts, sides
from upplied.records import Bools, Floats, Ints, Record

_ALIKE = 1.8  # ratio of extents along an axis, boxes matched, up to which parts surely correspond
_PART_OF = 0.2  # least share of the common surface, for each of the parts that make up one
_NEIGHBOURS = 0.6  # weight of lost contact, and of changed places, of parts that touch
_TRIES = 3


@dataclass(frozen=True, eq=False, repr=False)
class Matching(Record):
    """Classes of parts that correspond to each other; parts in no class correspond to whatever is near."""

    source_class: Ints  # (K,) class of each source part, -1 where it is in none
    target_class: Ints  # (L,) class of each target part, -1 where it is in none

    def __len__(self) -> int:
        return int(self.source_class.max(initial=-1)) + 1


def match_parts(
    source: Parts,
    target: Parts,
    diagonal_m: float,
    fits: Callable[[Sequence[int], Sequence[int]], bool],
    pinned: Mapping[int, int] | None = None,
) -> Matching:
    """Match parts one to one; both structures are in the frame and at the scale of the source.

    Boxes of like extents are proof enough. Where they are less alike, a deck that is shorter or a wing
    modelled whole here and in halves there, the surfaces must agree with box on box: `fits` says so of some
    source parts and some target parts. `pinned` is source part to target part, as the user named them;
    `diagonal_m` is that of the source.
    """
    pinned = dict(pinned or {})
    cost, allowed = _costs(source, target, diagonal_m)
    for one, other in np.argwhere(allowed & ~_alike(source, target, diagonal_m, LEAST_PART, _ALIKE)).tolist():
        allowed[one, other] = fits([one], [other])
    for one, other in pinned.items():
        allowed[one, :], allowed[:, other] = False, False
        allowed[one, other] = True
        cost[one, other] = -1.0
    cost = np.where(allowed, cost, 10.0)
    alone = np.full((len(source), len(source)), 10.0)
    unmatched = 2 * np.sqrt(source.area)  # by its size, so that a fairing displaces no engine
    np.fill_diagonal(alone, unmatched)
    rows, columns = linear_sum_assignment(np.hstack([cost, alone]))
    partner = np.full(len(source), -1)
    with_one = columns < len(target)
    with_one[with_one] = allowed[rows[with_one], columns[with_one]]
    partner[rows[with_one]] = columns[with_one]
    partner = _exchanged(partner, cost, source, target, diagonal_m, set(pinned))
    here, there = np.full(len(source), -1), np.full(len(target), -1)
    has = np.flatnonzero(partner >= 0)
    here[has] = there[partner[has]] = np.arange(len(has))
    # One part may correspond to two that make it up.
    both_ways = ((source, here, target, there, False), (target, there, source, here, True))
    for one_side, one_class, other_side, other_class, swapped in both_ways:
        for part in np.flatnonzero(one_class < 0).tolist():
            free = np.flatnonzero(other_class < 0)
            for pair in _unions_like(one_side, part, other_side, free, diagonal_m):
                if fits(pair, [part]) if swapped else fits([part], pair):
                    one_class[part] = other_class[pair] = here.max() + 1
                    break
    for _ in range(2):  # what was joined here may make it more alike to join its like there
        here = _with_pieces(here, source, there, target, diagonal_m)
        there = _with_pieces(there, target, here, source, diagonal_m)
    return Matching(here, there)


def like_shape(source: Parts, part: int, target: Parts, diagonal_m: float) -> Ints:
    """The target parts that have the shape and size of a source part, wherever they are."""
    alike = _alike(source, target, diagonal_m, LEAST_PART, MOST_RATIO)
    return np.flatnonzero((alike & _alike(source, target, diagonal_m, TOLERANCE, _ALIKE))[part])


def _costs(source: Parts, target: Parts, diagonal_m: float) -> tuple[Floats, Bools]:
    apart = cdist(source.middle, target.middle) / diagonal_m
    size = np.abs(np.log(source.area[:, None] / target.area[None, :]))
    near = apart < COMPACT  # boxes matched, no part lies farther from its partner than a compact one is long
    allowed = _alike(source, target, diagonal_m, LEAST_PART, MOST_RATIO) & near & (size < np.log(MOST_RATIO))
    # On different sides of structures that are their own mirror images.
    across = (np.abs(source.side[:, None] - target.side[None, :]) > MAJORITY).any(axis=2)
    return apart, allowed & ~(across & ~np.logical_and.outer(source.blade, target.blade))


def _alike(source: Parts, target: Parts, diagonal_m: float, floor: float, most: float) -> Bools:
    """Which parts (K, L) have extents of at most a ratio, where these are above a floor."""
    # Blades may have turned: they are compared along their own axes as well.
    boxes = _ratios(source.high - source.low, target.high - target.low, floor * diagonal_m)
    turned = _ratios(source.extent, target.extent, floor * diagonal_m)
    along = np.logical_and.outer(source.blade, target.blade) & (turned.max(axis=2) < np.log(most))
    return np.asarray((boxes.max(axis=2) < np.log(most)) | along, bool)


def _ratios(one: Floats, other: Floats, floor: float) -> Floats:
    """|log| of the ratio of extents, (K, L, 3); none counts as less than the floor, m."""
    one, other = np.maximum(one, floor), np.maximum(other, floor)
    return np.asarray(np.abs(np.log(one[:, None] / other[None, :])))


def _exchanged(
    partner: Ints, cost: Floats, source: Parts, target: Parts, diagonal_m: float, fixed: set[int]
) -> Ints:
    """Exchange partners while that lowers the cost with neighbours: decks keep their order."""
    best, lowest = partner, _total(partner, cost, source, target, diagonal_m)
    free = [part for part in range(len(partner)) if part not in fixed]
    for _ in range(20):
        before = lowest
        for candidate in _neighbours(best, free, cost):
            total = _total(candidate, cost, source, target, diagonal_m)
            if total < lowest - 1e-12:
                best, lowest = candidate, total
        if lowest == before:
            break
    return best


def _neighbours(partner: Ints, free: list[int], cost: Floats) -> Iterator[Ints]:
    """Assignments that differ by one exchange or one move to a target part that is not taken."""
    for one, other in combinations(free, 2):
        swapped = partner.copy()
        swapped[one], swapped[other] = partner[other], partner[one]
        if all(swapped[part] < 0 or cost[part, swapped[part]] < 10.0 for part in (one, other)):
            yield swapped
    spare = set(range(cost.shape[1])) - set(partner.tolist())
    for one in free:
        for other in sorted(spare):
            if cost[one, other] < 10.0:
                moved = partner.copy()
                moved[one] = other
                yield moved


def _total(partner: Ints, cost: Floats, source: Parts, target: Parts, diagonal_m: float) -> float:
    """Cost of an assignment: of each pair, and of neighbours that lose touch or change sides."""
    # Two parts that touch on the target alone count as well, or a tier might be left out in the middle.
    has = np.flatnonzero(partner >= 0)
    total = float(cost[has, partner[has]].sum()) + float(2 * np.sqrt(source.area[partner < 0]).sum())
    one, other = np.nonzero(np.triu(source.touching, 1))
    weight = np.sqrt(source.area[one] * source.area[other])
    known = (partner[one] >= 0) & (partner[other] >= 0)
    total += _NEIGHBOURS * float(weight[~known].sum())
    one, other, weight = one[known], other[known], weight[known]
    lost = ~target.touching[partner[one], partner[other]]
    here = source.middle[other] - source.middle[one]
    there = target.middle[partner[other]] - target.middle[partner[one]]
    shifted = np.linalg.norm(here - there, axis=1) / diagonal_m
    total += _NEIGHBOURS * float((weight * (lost + shifted)).sum())
    one, other = has[np.array(np.nonzero(np.triu(target.touching[np.ix_(partner[has], partner[has])], 1)))]
    new = ~source.touching[one, other]
    weight = np.sqrt(target.area[partner[one]] * target.area[partner[other]])
    return total + _NEIGHBOURS * float(weight[new].sum())


def _with_pieces(own: Ints, one: Parts, others: Ints, other: Parts, diagonal_m: float) -> Ints:
    """The classes (K,) of parts, where pieces in none joined the compact body that they touch."""
    # The inlet of a nacelle is a part of its own here and not there. The body has to stay as alike to its
    # counterpart as it was.
    own, size = own.copy(), (one.high - one.low).max(axis=1)
    compact = size < COMPACT * diagonal_m
    for part in np.flatnonzero((own < 0) & compact):
        for host in np.flatnonzero((own >= 0) & compact & one.touching[part]):
            mine, theirs = own == own[host], others == own[host]
            low, high = other.low[theirs].min(axis=0), other.high[theirs].max(axis=0)
            apart = []
            for members in (mine, mine | (np.arange(len(own)) == part)):
                extent = one.high[members].max(axis=0) - one.low[members].min(axis=0)
                least = LEAST_PART * diagonal_m
                apart.append(_ratios(extent[None], (high - low)[None], least).max())
            if apart[1] <= apart[0] + TOLERANCE:
                own[part] = own[host]
                break
    return own


def with_named(
    matching: Matching, name: Ints, shares: Floats, target: Parts, pinned: Mapping[int, int]
) -> Matching:
    """Let parts that were matched with none correspond to what comes to them, or what they come to.

    A fuselage of which the middle was never scanned is two parts, a pier without its cap has another box, and
    a T-tail makes one part of a fin and two stabilisers. `name` (L,) is the source part that each target part
    is named by, -1 where there is none; `shares` (L, K) how much of the target's surface lies on each of its
    parts and is what each source part comes to. `pinned` parts, as the user named them, stay.
    """
    source_class, target_class = matching.source_class.copy(), matching.target_class.copy()
    for other in np.flatnonzero(target_class < 0):
        mine = (source_class < 0) & (shares[other] > MAJORITY * shares.sum(axis=0))
        mine[list(pinned)] = False
        mine &= shares[other] > _PART_OF * shares[other, mine].sum()
        if shares[other, mine].sum() > MAJORITY * target.area[other]:
            source_class[mine] = target_class[other] = max(source_class.max(), target_class.max()) + 1
    for other in np.flatnonzero((target_class < 0) & (name >= 0)):
        part = int(name[other])
        if source_class[part] < 0 and part not in pinned:
            source_class[part] = max(source_class.max(), target_class.max()) + 1
        if part not in pinned and (name[target_class == source_class[part]] == part).all():
            target_class[other] = source_class[part]
    return Matching(source_class, target_class)


def _unions_like(one: Parts, part: int, other: Parts, free: Ints, diagonal_m: float) -> list[list[int]]:
    """Pairs of parts whose common box is like that of a part, the most alike first."""
    pairs = np.array(list(combinations(free.tolist(), 2)), np.int64).reshape(-1, 2)
    area = other.area[pairs]
    pairs = pairs[area.min(axis=1) > _PART_OF * area.sum(axis=1)]
    low, high = other.low[pairs].min(axis=1), other.high[pairs].max(axis=1)
    mirrored = np.isfinite(other.side[pairs]).all(axis=1)
    side = np.where(mirrored, sides(low, high, other.low.min(axis=0), other.high.max(axis=0)), np.nan)
    unions = _boxes(low, high, other.area[pairs].sum(axis=1), side)
    alone = _boxes(one.low[[part]], one.high[[part]], one.area[[part]], one.side[[part]])
    cost, allowed = _costs(alone, unions, diagonal_m)
    best = np.argsort(np.where(allowed[0], cost[0], np.inf), kind="stable")[:_TRIES]
    return [pairs[index].tolist() for index in best if allowed[0, index]]


def _boxes(low: Floats, high: Floats, area: Floats, side: Floats) -> Parts:
    """Parts known by their boxes alone."""
    extent = np.sort(high - low, axis=1)[:, ::-1]
    alone, none = np.zeros((len(low), len(low)), bool), np.zeros(len(low), bool)
    return Parts(low, high, area, alone, extent, ~none, side, none)
